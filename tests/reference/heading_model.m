function [fx, F] = heading_model(x, u, v, r, dt)
% HEADING_MODEL  One Euler step of the vessel's motion, and its Jacobian.
%   State [north m; east m; psi rad], surge u and sway v in m/s, yaw rate r in rad/s, dt in s.
  s = sin(x(3));
  c = cos(x(3));
  fx = [x(1) + dt * (u*c - v*s)
        x(2) + dt * (u*s + v*c)
        wrap_pi(x(3) + dt * r)];
  F = [1 0 dt*(-u*s - v*c)
       0 1 dt*( u*c - v*s)
       0 0 1];
end
