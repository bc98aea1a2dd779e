function [s, out] = vehicle_kinematic_step(s, e, o, dt, out)
% VEHICLE_KINEMATIC_STEP  The filter with the previous epoch's state as clones: states [now; then], 8 in all.
  turn = weighted_mean(o, 3:6, e.turn, dt);
  share = chord_share(turn);
  lateral = o.lateral;
  if ~isfinite(turn)
    turn = 0;
    lateral = 4*lateral;
  end
  a = e.bosch;
  along = o.accel_sigma(2)^2;
  if ~isfinite(a)
    a = 0;
    along = o.along^2/dt;
  end
  old = s.pose(3);
  v0 = s.speed;
  v1 = v0 + a*dt;
  D = v0*dt + 0.5*a*dt^2;
  now = old + turn;
  chord = old + turn/2;
  u = [cos(chord); sin(chord)];
  n = [-u(2); u(1)];
  n0 = [-sin(old); cos(old)];
  bend = 0;
  if v0 > 0.05
    bend = a/v0;
  end
  F = [eye(2) rotation2(turn/2)*(dt*eye(2) + 0.5*dt^2*bend*(n0*n0'))
       zeros(2) rotation2(turn)*(eye(2) + dt*bend*(n0*n0'))];
  S = [0.5*dt^2*eye(2); dt*eye(2)];
  Q = S*(along*(u*u') + lateral^2/dt*(n*n'))*S' + diag([1 1 0 0])*o.position_walk^2*dt;
  x = [s.x(1:2) + D*u; v1*[cos(now); sin(now)]; s.x];
  P = [F*s.P*F' + Q, F*s.P; s.P*F', s.P];

  % Observations with their predictions, derivatives and variances; NaN where there is none.
  z = [e.gps; e.turn'; e.odo*share; 0.5*dt^2*e.xsens; NaN; e.oss*share];
  arm = rotation2(now)*o.lever;
  h = [x(1:2) + arm; turn*ones(4, 1); D; D - v0*dt; NaN; D];
  H = zeros(10, 8);
  H(1:2, 1:2) = eye(2);
  if v1 > 0.05
    H(1:2, 3:4) = [-arm(2); arm(1)] * [-sin(now) cos(now)]/v1;
  end
  H(3:6, 3:4) = repmat([-sin(now) cos(now)]/v1, 4, 1);
  H(3:6, 7:8) = repmat([sin(old) -cos(old)]/v0, 4, 1);
  H(7:10, 1:2) = repmat(u', 4, 1);
  H(7:10, 5:6) = -repmat(u', 4, 1);
  H(8, 7:8) = -dt*[cos(old) sin(old)];
  values = [e.gps; e.turn'; e.odo; z(8); NaN; e.oss];
  R = arrayfun(@(row) row_variance(o, row, values(row), dt), (1:10)');
  R(1:2) = gps_variance(o, e);
  R(8) = R(8) + (0.5*dt^2*o.accel_sigma(1))^2;
  used = isfinite(z);
  used(1:2) = all(used(1:2));
  if ~(v1 > 0.05 && v0 > 0.05)
    used(3:6) = false;
  end
  used(8) = used(8) && v0 > 0.05;

  d = z - h;
  d(3:6) = wrap_pi(d(3:6));
  refused = false(10, 1);
  if used(1)
    far = o.gate_gps > 0 && d(1:2)'*((H(1:2, :)*P*H(1:2, :)' + R(1)*eye(2)) \ d(1:2)) > o.gate_gps;
    if far
      [s, must] = note_refused(s, e.t, o);
      if must
        common = sum(d(1:2).^2)*diag([1 1 [1 1]/max(o.reaccept_s, 1)^2]);
        P = P + kron(ones(2), common);
      else
        refused(1:2) = true;
      end
    end
    if ~refused(1)
      s.gps_t = e.t;
      s.refused_t = NaN;
    end
  end
  for row = find(used(3:10))' + 2
    if o.gate_row > 0 && d(row)^2 > o.gate_row*(H(row, :)*P*H(row, :)' + R(row))
      refused(row) = true;
    end
  end
  rows = find(used & ~refused)';
  if ~isempty(rows)
    out.used = sum(2.^(rows - 1));
    out.degrees = numel(rows);
    out.chi_square = d(rows)'*((H(rows, :)*P*H(rows, :)' + diag(R(rows))) \ d(rows));
    [x, P] = row_by_row(x, P, d(rows), H(rows, :), R(rows));
  end
  out.refused = sum(2.^(find(refused)' - 1));
  s.x = x(1:4);
  s.P = P(1:4, 1:4);
  s = pose_from_state(s);
end
