function [x, P] = row_by_row(x, P, d, H, R)
% ROW_BY_ROW  Update with innovations D of uncorrelated variances R (a vector), each row as a scalar in Joseph's form: the
%   textbook's joint update without the inverse of an ill-conditioned matrix.
  x0 = x;
  for i = 1:numel(d)
    h = H(i, :);
    K = P*h' / (h*P*h' + R(i));
    x = x + K*(d(i) - h*(x - x0));
    J = eye(numel(x)) - K*h;
    P = J*P*J' + K*R(i)*K';
    P = (P + P')/2;
  end
end
