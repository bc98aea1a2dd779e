function rows = fusion_run(method, samples, tasks, o)
% FUSION_RUN  The papers' post-processing: a table of samples to heading rows, ten a second.
%   METHOD is 'cnw-ekf', 'cnw3' or 'ekf-ci'. SAMPLES has one row a sample, in order of arrival, with the columns below.
%   TASKS has one row a switch: [t_us task running before], where BEFORE is the row of SAMPLES it precedes and the task
%   is a number: 0 to 7 polls gps1 to gps8, 8 the compass, 9 the IMU; 11 to 13 stages 1 to 3; 21 to 28 the filters;
%   30 to 39 is no task: the source of that number less 30 is lost.
%   O holds the options, see fusion_options. ROWS has the columns of heading_columns(o.n_gps): angles in degrees,
%   mode 0 invalid, 1 dead-reckoning, 2 degraded, 3 ok; pos_mode 0 invalid, 1 dead-reckoning, 2 gps; NaN is missing.
%   The rules are those of docs/fusion.md. Times are microseconds, held exactly by a double.
  s = start_state(o, method);
  n_samples = size(samples, 1);
  rows = zeros(0, 9 + 3*max(3, o.n_gps));
  next_task = 1;
  next_grid = NaN;   % tenths of a second; unknown until the first sample
  for k = 1:n_samples + 1
    while next_task <= size(tasks, 1) && tasks(next_task, 4) <= k
      t = max(tasks(next_task, 1), s.now);
      [rows, next_grid] = write_rows(rows, next_grid, s, t, o);
      s.now = t;
      s = switch_task(s, tasks(next_task, 2), tasks(next_task, 3));
      next_task = next_task + 1;
    end
    if k > n_samples
      break
    end
    sample = samples(k, :);
    t = sample(1);
    if t < s.now - 1e6
      continue
    end
    t = max(t, s.now);
    if isnan(next_grid)
      next_grid = ceil(t / 1e5);
    end
    if next_grid * 1e5 < t
      [rows, next_grid] = write_rows(rows, next_grid, s, t, o);
    end
    s.now = t;
    source = sample(2);
    if ~s.source_on(source + 1) || ~o.configured(source + 1)
      continue
    end
    switch source
      case 9
        s = take_imu(s, t, sample(19:21)', sample(22:24)', o);
      case 8
        s = take_compass(s, t, sample(13), sample(14), sample(15), sample(11), o);
      otherwise
        s = take_gps(s, t, source + 1, sample, o);
    end
  end
end

function s = start_state(o, method)
  n = o.n_gps;
  deg2 = (pi/180)^2;
  s.method = method;
  s.now = -Inf;
  % sources 1 to 8 the GPS, 9 the compass, 10 the IMU
  s.source_on = true(1, 10);
  s.last = -Inf(1, 10);       % stamp of the last sample that refreshed the source
  s.interval = repmat(1e5, 1, 10);
  s.period = repmat(1e5, 1, 10);
  s.lost = false(1, 10);
  s.stage_on = true(1, 3);
  s.filter_on = true(1, n);
  % GPS
  s.heard = -Inf(1, n);       % stamp of the last sample of any kind
  s.valid = false(1, n);
  s.w = zeros(1, n);
  s.faz = NaN(1, n);          % deg
  s.faz_time = -Inf(1, n);    % stamp of the last finite one
  s.fix = NaN(n, 2);          % last valid position, deg
  s.fix_time = -Inf(1, n);
  s.speed = NaN(1, n);
  s.speed_time = -Inf(1, n);
  s.variation = NaN;
  s.origin = [NaN NaN];
  % compass, IMU
  s.compass = NaN;            % true heading, deg
  s.compass_reading = NaN;    % deg, as it came
  s.compass_turned = 0;       % rad, by the gyro since that reading first came, forgotten within 10 s
  s.compass_stuck = false;
  s.courses = repmat(stuck_course(), 1, n);
  s.imu_reading = NaN(6, 1);
  s.imu_same = 0;             % samples with that reading
  s.imu_since = NaN;          % stamp of the first of them
  s.rate = 0;                 % rad/s
  s.attitude = [0 0 0 1];
  s.burst = 0;                % samples of this stamp so far
  s.burst_interval = 0;       % s
  % filters
  s.Q = diag([0.01 0.01 10*deg2]);
  s.R = diag([0.3 0.07 0.03*deg2]);
  s.P0 = diag([10 10 100*deg2]);
  s.has_filter = true(1, n);
  if strcmp(method, 'cnw-ekf')
    s.has_filter = (1:n) == 1;
  end
  s.running = false(1, n);
  s.x = zeros(3, n);
  s.P = zeros(3, 3, n);
  s.time = zeros(1, n);
  s.has_position = false(1, n);
  s.position_time = zeros(1, n);
end

function s = switch_task(s, task, running)
  if task <= 9
    s.source_on(task + 1) = running;
  elseif task <= 13
    s.stage_on(task - 10) = running;
  elseif task >= 30
    s.lost(task - 29) = true;
  else
    s.filter_on(task - 20) = running;
    if ~running
      s.running(task - 20) = false;
    end
  end
end

function is = fresh(s, source, t)
  is = s.source_on(source) && ~s.lost(source) && t - s.last(source) <= max(3*s.period(source), 1e6);
end

function s = refresh(s, source, t)
  s.lost(source) = false;
  if s.last(source) > -Inf && t > s.last(source)
    interval = min(t - s.last(source), 2e6);
    s.period(source) = max(interval, s.interval(source));
    s.interval(source) = interval;
  end
  s.last(source) = t;
end

% ---- samples --------------------------------------------------------------------------------------------------------

function s = take_imu(s, t, gyro_dps, accel_g, o)
  reading = [gyro_dps; accel_g];
  if isequal(reading, s.imu_reading)   % never so with a NaN
    s.imu_same = s.imu_same + 1;
  else
    s.imu_reading = reading;
    s.imu_same = 1;
    s.imu_since = t;
  end
  if s.imu_same >= 20 && t - s.imu_since >= 1e6
    s.lost(10) = true;
    return
  end
  if ~all(isfinite(gyro_dps))
    return
  end
  gyro = o.mount * gyro_dps * pi/180;
  accel = o.mount * accel_g;
  if o.specific_force
    accel = -accel;
  end
  before = s.last(10);
  dt = 0;
  if before > -Inf
    dt = (t - before) / 1e6;
  end
  [phi, theta, s.attitude] = attitude(s.attitude, dt, gyro, accel);
  r = yaw_rate(phi, theta, gyro);
  shared = t == before;
  s = refresh(s, 10, t);
  if shared
    s.burst = s.burst + 1;
    change = (r - s.rate) / s.burst;
    s.rate = s.rate + change;
    s.compass_turned = s.compass_turned + s.burst_interval*change;
    for j = find(s.running)
      s.x(3, j) = wrap_pi(s.x(3, j) + s.burst_interval*change);
    end
  else
    s.burst = 1;
    s.burst_interval = min(dt, 1);
    s.rate = r;
    span = s.burst_interval;
    s.compass_turned = s.compass_turned + r*span - s.compass_turned*span/10;
    s = advance(s, find(s.running), t);
  end
end

function s = take_compass(s, t, reference, heading_deg, deviation_deg, variation_deg, o)
  true_deg = compass_true(reference, heading_deg, deviation_deg, variation_deg, o, s.variation);
  if ~isfinite(true_deg)
    return
  end
  anew = heading_deg ~= s.compass_reading;
  if anew
    s.compass_reading = heading_deg;
    s.compass_turned = 0;
    s.compass_stuck = false;
  end
  if anew || ~fresh(s, 9, t)
    [s.courses.way] = deal(NaN);
    [s.courses.since] = deal(NaN);
  end
  s.compass_stuck = s.compass_stuck || abs(s.compass_turned) > 10*pi/180;
  if s.compass_stuck
    s.lost(9) = true;
    return
  end
  s.compass = true_deg;
  s = refresh(s, 9, t);
  s = steer_silent_filters(s, t);
end

function s = take_gps(s, t, i, sample, o)
  lat = sample(5);
  lon = sample(6);
  s = refresh(s, i, t);
  s.heard(i) = t;
  if isfinite(sample(11))
    s.variation = sample(11);
  end
  north = NaN;
  east = NaN;
  s.valid(i) = isfinite(lat) && isfinite(lon) && sample(3) >= 1;
  s.faz(i) = NaN;
  s.w(i) = 0;
  if s.valid(i)
    s.w(i) = 1;
    if s.stage_on(1)
      s.w(i) = cnw_stage1(sample(3), sample(10));
    end
    if t - s.fix_time(i) <= 2e6
      s.faz(i) = forward_azimuth(s.fix(i, 1), s.fix(i, 2), lat, lon);
      if isfinite(s.faz(i))
        s.faz_time(i) = t;
      end
    end
    s.fix(i, :) = [lat lon];
    s.fix_time(i) = t;
    [s, north, east] = locate(s, lat, lon);
    s.courses(i) = stuck_course(s.courses(i), t, lat, lon, sample(8), sample(9), sample(10), s.compass);
    s = judge_compass(s, t);
  end
  if s.running(i)
    s = advance(s, i, t);
  end
  if isfinite(sample(8))
    s.speed(i) = sample(8);
    s.speed_time(i) = t;
  end
  psi_deg = s.faz(i);
  if ~isfinite(psi_deg)
    psi_deg = gpsec(s, t);
  end
  s = correct(s, i, t, north, east, psi_deg);
  if ~fresh(s, 9, t)
    s = steer_silent_filters(s, t);
  end
end

function s = judge_compass(s, t)
% While no gyro measures turns, a compass is stuck when more than half of the receivers with a fix deny it.
  if fresh(s, 10, t) || ~fresh(s, 9, t)
    return
  end
  fixes = 0;
  denials = 0;
  for i = find(s.valid)
    if fresh(s, i, t)
      c = s.courses(i);
      fixes = fixes + 1;
      denials = denials + (c.heard - c.since >= 3e6 && t - c.heard <= 5e6);
    end
  end
  if 2*denials > fixes
    s.compass_stuck = true;
    s.lost(9) = true;
  end
end

function [s, north, east] = locate(s, lat, lon)
% The position in the local frame, whose origin moves when the boat is 5 km away from it.
  if isnan(s.origin(1))
    s.origin = [lat lon];
  end
  [north, east] = local_from_geodetic(s.origin, lat, lon);
  if hypot(north, east) > 5000
    for j = find(s.running & s.has_position)
      [lat_j, lon_j] = geodetic_from_local(s.origin, s.x(1, j), s.x(2, j));
      [s.x(1, j), s.x(2, j)] = local_from_geodetic([lat lon], lat_j, lon_j);
    end
    s.origin = [lat lon];
    north = 0;
    east = 0;
  end
end

% ---- stage 2 and the filters ----------------------------------------------------------------------------------------

function [w, faz, compass] = quality(s, t)
% Weights, forward azimuths and compass as they count at t.
  n = numel(s.w);
  w = s.w;
  faz = s.faz;
  for i = 1:n
    if ~fresh(s, i, t)
      w(i) = 0;
      faz(i) = NaN;
    end
  end
  compass = NaN;
  if fresh(s, 9, t)
    compass = s.compass;
  end
end

function psi_deg = gpsec(s, t)
  psi_deg = NaN;
  if s.stage_on(2)
    [w, faz, compass] = quality(s, t);
    psi_deg = cnw_stage2(faz, w, compass);
  end
end

function s = steer_silent_filters(s, t)
% GPSEC_yaw for the filters whose own GPS has sent nothing in the last 150 ms.
  psi_deg = NaN;
  asked = false;
  for j = find(t - s.heard > 150e3)
    if ~asked
      psi_deg = gpsec(s, t);
      asked = true;
    end
    if s.running(j)
      s = advance(s, j, t);
    end
    s = correct(s, j, t, NaN, NaN, psi_deg);
  end
end

function s = advance(s, filters, t)
  [x, P] = predicted(s, filters, t);
  s.x(:, filters) = x;
  s.P(:, :, filters) = P;
  s.time(filters) = max(s.time(filters), t);
end

function [x, P] = predicted(s, filters, t)
% States and covariances of some filters, predicted to t.
  x = s.x(:, filters);
  P = s.P(:, :, filters);
  dt = (t - s.time(filters)) / 1e6;
  u = s.speed(filters);
  u(t - s.speed_time(filters) > 2e6) = 0;
  r = 0;
  if fresh(s, 10, t)
    r = s.rate;
  end
  for k = find(dt > 0)
    [fx, F] = heading_model(x(:, k), u(k), 0, r, dt(k));
    [x(:, k), P(:, :, k)] = ekf_predict(P(:, :, k), fx, F, s.Q*dt(k));
  end
end

function s = correct(s, j, t, north, east, psi_deg)
% Start, anchor or update filter j with a position and a heading, either of which may be missing (NaN).
  if ~s.has_filter(j) || ~s.filter_on(j)
    return
  end
  psi = wrap_pi(psi_deg * pi/180);
  positioned = isfinite(north);
  if ~s.running(j)
    if isfinite(psi)
      s.running(j) = true;
      s.x(:, j) = [0; 0; psi];
      if positioned
        s.x(1:2, j) = [north; east];
      end
      s.P(:, :, j) = s.P0;
      s.time(j) = t;
      s.has_position(j) = positioned;
      s.position_time(j) = t;
    end
    return
  end
  measured = [positioned positioned isfinite(psi)];
  if positioned
    if ~s.has_position(j) || t - s.position_time(j) > 10e6
      s.x(1:2, j) = [north; east];
      P = s.P0;
      P(3, 3) = s.P(3, 3, j);
      s.P(:, :, j) = P;
      measured(1:2) = false;
    end
    s.has_position(j) = true;
    s.position_time(j) = t;
  end
  if any(measured)
    rows = find(measured);
    z = [north; east; psi];
    H = eye(3);
    [x, P] = ekf_update(s.x(:, j), s.P(:, :, j), z(rows), H(rows, :), s.R(rows, rows), s.x(rows, j), ...
                        find(rows == 3));
    x(3) = wrap_pi(x(3));
    s.x(:, j) = x;
    s.P(:, :, j) = P;
  end
end

% ---- rows -----------------------------------------------------------------------------------------------------------

function [rows, next_grid] = write_rows(rows, next_grid, s, t, o)
  while next_grid * 1e5 < t   % false while the grid is unknown (NaN)
    rows(end + 1, :) = one_row(s, next_grid * 1e5, o);
    next_grid = next_grid + 1;
  end
end

function row = one_row(s, t, o)
  n = o.n_gps;
  [w, faz, compass] = quality(s, t);
  imu_fresh = fresh(s, 10, t);
  running = find(s.running);
  x = NaN(3, n);
  P = NaN(3, 3, n);
  [x(:, running), P(:, :, running)] = predicted(s, running, t);
  if strcmp(s.method, 'ekf-ci') && s.stage_on(3) && ~isempty(running)
    [c, C] = intersected(s, x, P);
    heading = wrap_360(c(3) * 180/pi);
    sigma = sqrt(C(3, 3)) * 180/pi;
    place = c(1:2);
  else
    [heading, sigma] = stage3_heading(s, w, x, P);
    place = stage3_position(s, w, x);
  end

  source_fresh = zeros(1, 10);
  for i = 1:10
    source_fresh(i) = fresh(s, i, t);
  end
  fit = source_fresh;
  fit(1:n) = fit(1:n) & s.valid;
  moving = t - s.faz_time <= max(3 * s.period(1:n), 1e6);
  absolute = any(fit(1:n) & moving) || isfinite(compass);
  stopped = ~all(s.stage_on) || ~all(s.filter_on);
  if ~isfinite(heading) || ~(absolute || imu_fresh) || sigma > o.max_sigma_deg
    mode = 0;
    heading = NaN;
    sigma = NaN;
  elseif ~absolute
    mode = 1;
  elseif any(o.configured & ~fit) || stopped || all(w == 0)
    mode = 2;
  else
    mode = 3;
  end

  lat = NaN;
  lon = NaN;
  positioned = s.running & s.has_position;
  if any(positioned)
    [lat, lon] = geodetic_from_local(s.origin, place(1), place(2));
  end
  if any(positioned & source_fresh(1:n) & s.valid)
    pos_mode = 2;
  elseif any(positioned) && t - max(s.fix_time) <= 60e6
    pos_mode = 1;
  else
    pos_mode = 0;
    lat = NaN;
    lon = NaN;
  end

  rate_dps = NaN;
  if imu_fresh
    rate_dps = s.rate * 180/pi;
  end
  gpsec_deg = NaN;
  if s.stage_on(2)
    gpsec_deg = cnw_stage2(faz, w, compass);
  end
  unused = NaN(1, max(0, 3 - n));
  row = [t/1e6 heading sigma rate_dps lat lon mode pos_mode w unused faz unused gpsec_deg ...
         wrap_360(x(3, :)*180/pi) unused];
end

function [heading, sigma] = stage3_heading(s, w, x, P)
% Stage 3 (of a single filter its own heading; with the stage stopped the first filter's) and its sigma, degrees.
  heading = NaN;
  sigma = NaN;
  running = find(s.running);
  if isempty(running)
    return
  end
  if ~s.stage_on(3)
    running = running(1);
  end
  sigmas = sqrt(reshape(P(3, 3, running), 1, [])) * 180/pi;
  v = weights_of(running, w);
  heading = cnw_stage3(wrap_360(x(3, running) * 180/pi), v);
  sigma = sum(v .* sigmas) / sum(v);
end

function place = stage3_position(s, w, x)
% North and east, m, of the filters that have a position, weighted as their headings; NaN when none has.
  place = [NaN; NaN];
  positioned = find(s.running & s.has_position);
  if isempty(positioned)
    return
  end
  if ~s.stage_on(3)
    positioned = positioned(1);
  end
  v = weights_of(positioned, w);
  place = x(1:2, positioned) * v' / sum(v);
end

function v = weights_of(filters, w)
  v = w(filters);
  if sum(v) == 0
    v = ones(size(v));
  end
end

function [c, C] = intersected(s, x, P)
% Covariance intersection of neighbours, again and again, until one is left: for three, as the 2015 method, thrice.
  members = find(s.running);
  if any(s.running & s.has_position)
    members = find(s.running & s.has_position);
  end
  xs = x(:, members);
  Ps = P(:, :, members);
  while size(xs, 2) > 1
    m = size(xs, 2) - 1;
    xs_next = zeros(3, m);
    Ps_next = zeros(3, 3, m);
    for k = 1:m
      [xs_next(:, k), Ps_next(:, :, k)] = covariance_intersection(xs(:, k), Ps(:, :, k), xs(:, k + 1), ...
                                                                  Ps(:, :, k + 1), 'det', 3);
    end
    xs = xs_next;
    Ps = Ps_next;
  end
  c = xs;
  C = Ps;
end
