function [s, out] = vehicle_paper_step(s, e, o, dt, out)
% VEHICLE_PAPER_STEP  Steps 1 to 7 of the third paper's 2.1.1: (9) to (15).
  azimuth = s.pose(3);
  speed = norm(s.x(3:4));
  a = e.bosch;
  if ~isfinite(a)
    a = 0;
  end
  T = [eye(2) dt*eye(2); zeros(2) eye(2)];
  u = [cos(azimuth); sin(azimuth)];
  S = [0.5*dt^2*u; dt*u];
  y = T*s.x + S*a;                                       % (9)
  Q = T*s.P*T' + S*o.q_ww*S';                            % (10)
  way = y(1:2) - s.x(1:2);
  D = norm(way);
  predicted = azimuth;
  if D > 1e-3
    predicted = atan2(way(2), way(1));
  end
  c = cos(predicted);
  n = sin(predicted);
  gps = e.gps - rotation2(predicted)*o.lever;
  l = [gps; e.turn'; e.odo; speed*dt + 0.5*dt^2*e.xsens; speed*dt + 0.5*dt^2*e.bosch; e.oss];
  turn_row = [-n/D c/D -dt*n/D dt*c/D];
  A = [1 0 0 0; 0 1 0 0; repmat(turn_row, 4, 1); repmat([c n dt*c dt*n], 4, 1)];
  h = [y(1:2); wrap_pi(predicted - azimuth)*ones(4, 1); D*ones(4, 1)];
  used = isfinite(l);
  used(1:2) = all(used(1:2));
  if D <= 1e-3
    used(3:6) = false;
  end
  rows = find(used)';
  s.x = y;
  s.P = Q;
  if ~isempty(rows)
    R = diag(arrayfun(@(row, z) row_variance(o, row, z, dt), rows, l(rows)'));
    on_gps = find(rows <= 2);
    R(sub2ind(size(R), on_gps, on_gps)) = gps_variance(o, e);
    d = l(rows) - h(rows);                               % (11)
    turns = rows >= 3 & rows <= 6;
    d(turns) = wrap_pi(d(turns));
    Qdd = R + A(rows, :)*Q*A(rows, :)';                  % (12)
    out.chi_square = d'*(Qdd\d);
    out.degrees = numel(rows);
    out.used = sum(2.^(rows - 1));
    [s.x, s.P] = row_by_row(y, Q, d, A(rows, :), diag(R));   % (13) to (15)
  end
  if used(1)
    s.gps_t = e.t;
    s.refused_t = NaN;
  end
  s = pose_from_state(s);
end
