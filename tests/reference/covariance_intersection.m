function [c, C, omega] = covariance_intersection(a, A, b, B, minimise, angles)
% COVARIANCE_INTERSECTION  Fuse two estimates whose correlation is unknown.
%   inv(C) = omega inv(A) + (1 - omega) inv(B), with omega in [0, 1] minimising log det C (MINIMISE = 'det') or
%   trace C ('trace'). ANGLES lists the elements that are angles in radians.
  b(angles) = a(angles) + wrap_pi(b(angles) - a(angles));
  Ai = inverse(A);
  Bi = inverse(B);
  omega = best_omega(A, Ai, B, Bi, minimise);
  C = inverse(omega*Ai + (1 - omega)*Bi);
  c = C * (omega*(Ai*a) + (1 - omega)*(Bi*b));
  c(angles) = wrap_pi(c(angles));
end

function omega = best_omega(A, Ai, B, Bi, minimise)
  D = Ai - Bi;
  if strcmp(minimise, 'trace')
    g0 = -trace(B*D*B);
    g1 = -trace(A*D*A);
    flat = abs(g0) < 1e-9*trace(B) && abs(g1) < 1e-9*trace(A);
  else
    g0 = -trace(B*D);
    g1 = -trace(A*D);
    flat = abs(g0) < 1e-9 && abs(g1) < 1e-9;
  end
  if flat
    omega = 0.5;
  elseif g0 >= 0
    omega = 0;
  elseif g1 <= 0
    omega = 1;
  else
    low = 0;
    high = 1;
    for halving = 1:60
      omega = (low + high) / 2;
      C = inverse(omega*Ai + (1 - omega)*Bi);
      if strcmp(minimise, 'trace')
        g = -trace(C*D*C);
      else
        g = -trace(C*D);
      end
      if g < 0
        low = omega;
      else
        high = omega;
      end
    end
    omega = (low + high) / 2;
  end
end

function Xi = inverse(X)
% Inverse of a covariance, scaled first so that metres and radians weigh alike.
  d = 1 ./ sqrt(diag(X));
  scale = d * d';
  Xi = scale .* inv(scale .* X);
  Xi = (Xi + Xi') / 2;
end
