function s = pose_from_state(s)
% POSE_FROM_STATE  Position, azimuth and speed with their covariances from the filter's state.
  v = norm(s.x(3:4));
  s.pose(1:2) = s.x(1:2);
  s.speed = v;
  if v > 1e-6
    u = s.x(3:4)/v;
    s.pose(3) = atan2(u(2), u(1));
    J = [1 0 0 0; 0 1 0 0; 0 0 -u(2)/v u(1)/v];
    s.C = J*s.P*J';
    s.speed_sigma = sqrt(max(u'*s.P(3:4, 3:4)*u, 0));
  end
end
