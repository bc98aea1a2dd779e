function s = vehicle_start(s, e, o, dt)
% VEHICLE_START  Takes an epoch of the first metres; s.mode becomes 1 once pose, C and speed are found.
%   The positions g and the dead-reckoned ones d (azimuth 0 at the beginning) are kept, and d is turned onto g.
  turn = weighted_mean(o, 3:6, e.turn, dt);
  distance = weighted_mean(o, [7 10], [e.odo e.oss], dt);
  if isfinite(distance)
    half = 0;
    if isfinite(turn)
      half = turn/2;
    end
    s.reckoned(1:2) = s.reckoned(1:2) ...
                      + distance*chord_share(turn) * [cos(s.reckoned(3) + half); sin(s.reckoned(3) + half)];
    s.reckoned(3) = s.reckoned(3) + 2*half;
    s.speed = NaN;
    if dt > 0
      s.speed = distance/dt;
    end
  end
  if ~all(isfinite(e.gps))
    return
  end
  speed = s.speed;
  speed_sigma = 0.5;
  if isfinite(o.start_azimuth)
    lever = rotation2(o.start_azimuth)*o.lever;
    if ~isfinite(speed)
      speed = 0;
      speed_sigma = 10;
    end
    s = started(s, e.gps - lever, o.start_azimuth, gps_variance(o, e), (2*pi/180)^2, -lever, speed, speed_sigma);
    return
  end
  s.g(:, end+1) = e.gps;
  s.d(:, end+1) = s.reckoned(1:2) + rotation2(s.reckoned(3))*o.lever;
  s.gt(end+1) = e.t;
  s.gv(end+1) = gps_variance(o, e);
  n = size(s.g, 2);
  if isnan(speed)
    chord = e.gps - s.g(:, 1);
    duration = e.t - s.gt(1);
    if norm(chord) > 3 + 15*sqrt(s.gv(end)) && duration > 0
      azimuth = atan2(chord(2), chord(1));
      speed = norm(chord)/duration;
      s = started(s, e.gps - rotation2(azimuth)*o.lever, azimuth, s.gv(end), 2*s.gv(end)/norm(chord)^2, [0; 0], ...
                  speed, 5 + speed);
    end
    return
  end
  g = s.g - mean(s.g, 2);
  d = s.d - mean(s.d, 2);
  variance = mean(s.gv);
  azimuth_variance = variance / sum(d(:).^2);
  if n >= 3 && azimuth_variance < o.start_sigma^2
    turn = atan2(sum(d(1, :).*g(2, :) - d(2, :).*g(1, :)), sum(d(:).*g(:)));
    arm = rotation2(turn)*(s.reckoned(1:2) - mean(s.d, 2));
    s = started(s, mean(s.g, 2) + arm, wrap_pi(turn + s.reckoned(3)), variance/n, azimuth_variance, arm, speed, ...
                speed_sigma);
  end
end

function s = started(s, position, azimuth, variance, azimuth_variance, arm, speed, speed_sigma)
  e = [-arm(2); arm(1); 1];
  s.C = azimuth_variance*(e*e') + diag([variance variance 0]);
  s.pose = [position; azimuth];
  s.speed = speed;
  s.speed_sigma = speed_sigma;
  s.mode = 1;
end
