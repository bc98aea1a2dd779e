function [x, P] = ekf_update(x, P, z, H, R, hx, angles)
% EKF_UPDATE  Textbook update with a measurement z = hx + noise of covariance R (the papers' (5) to (7)).
%   ANGLES lists the rows of z that are angles in radians: their innovation is wrapped to (-pi, pi].
  innovation = z - hx;
  innovation(angles) = wrap_pi(innovation(angles));
  S = H*P*H' + R;
  K = (P*H') / S;
  x = x + K*innovation;
  J = eye(numel(x)) - K*H;
  P = J*P*J' + K*R*K';   % Joseph's form of (I - K H) P: the same, with less rounding
  P = (P + P') / 2;
end
