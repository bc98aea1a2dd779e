function [x, P] = ekf_step(P, z, fx, F, Q, H, R)
% EKF_STEP  Predict and update in one, as TinyEKF does it, with the predicted measurement hx = H fx.
  [x, P] = ekf_predict(P, fx, F, Q);
  [x, P] = ekf_update(x, P, z, H, R, H*fx, []);
end
