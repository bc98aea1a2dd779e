function [x, P] = ekf_predict(P, fx, F, Q)
% EKF_PREDICT  The predicted state fx becomes the state; its covariance is F P F' + Q (the papers' (4)).
  x = fx;
  P = F*P*F' + Q;
  P = (P + P') / 2;
end
