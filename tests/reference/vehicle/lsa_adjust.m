function r = lsa_adjust(l, Q, model, x, angles)
% LSA_ADJUST  Gauss-Newton adjustment of observations L with cofactors Q; [h, A] = MODEL(x); ANGLES are rows in radians.
%   The third paper's (16) to (19), with l^ = l + v, redundancy numbers and Baarda's w. Observations are whitened by the
%   Cholesky factor of Q, and the least squares solved by orthogonal factors.
  L = chol(Q)';
  r.converged = false;
  for iteration = 1:20
    [h, A] = model(x);
    dl = l - h;
    dl(angles) = wrap_pi(dl(angles));
    [E, R] = qr(L\A, 0);
    b = L\dl;
    dx = R\(E'*b);
    x = x + dx;
    if max(abs(dx)) < 1e-10
      r.converged = true;
      break
    end
  end
  M = eye(numel(l)) - E*E';   % takes the residuals out of whitened misclosures
  r.x = x;
  r.Qxx = inv(R)*inv(R)';
  r.v = -dl;
  r.Qvv = L*M*L';
  r.Qadjusted = Q - r.Qvv;
  r.redundancy = diag(L*M/L);
  q = diag(L'\M/L);
  r.w = L'\(M*b) ./ sqrt(q);
  r.w(r.redundancy <= 1e-4 | q <= 1e-4*diag(inv(Q))) = NaN;
  r.vPv = sum((M*b).^2);
  r.degrees = numel(l) - numel(x);
end
