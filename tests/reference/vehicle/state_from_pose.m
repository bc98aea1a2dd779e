function s = state_from_pose(s)
% STATE_FROM_POSE  The filter's [x; y; vx; vy] and covariance from position, azimuth and speed.
  c = cos(s.pose(3));
  n = sin(s.pose(3));
  G = [1 0 0 0; 0 1 0 0; 0 0 -s.speed*n c; 0 0 s.speed*c n];
  s.x = [s.pose(1:2); s.speed*c; s.speed*n];
  s.P = G*blkdiag(s.C, s.speed_sigma^2)*G';
end
