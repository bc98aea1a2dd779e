function rows = vehicle_run(method, epochs, o)
% VEHICLE_RUN  A drive by a method, a row an epoch: t, x, y, vx, vy, azimuth, speed, covariance of [x y azimuth] (upper
%   triangle), speed sigma, mode, used, refused, chi-square, degrees, worst |w|, circle. docs/vehicle.md says the rules.
  kinematic = strncmp(method, 'kinematic', 9);
  s = struct('mode', 0, 'circle', false, 'speed', NaN, 'speed_sigma', NaN, 'gps_t', -Inf, 'refused_t', NaN, ...
             'reckoned', zeros(3, 1), 'g', zeros(2, 0), 'd', zeros(2, 0), 'gt', [], 'gv', [], ...
             'pose', NaN(3, 1), 'C', NaN(3), 'x', NaN(4, 1), 'P', NaN(4));
  rows = zeros(size(epochs, 1), 21);
  t = NaN;
  for k = 1:size(epochs, 1)
    e = struct('t', epochs(k, 1), 'gps', epochs(k, 2:3)', 'gps_sigma', epochs(k, 4), 'turn', epochs(k, 5:8), ...
               'odo', epochs(k, 9), 'xsens', epochs(k, 10), 'bosch', epochs(k, 11), 'oss', epochs(k, 12));
    if strcmp(method, 'kinematic-paper')
      e.gps_sigma = NaN;   % its variance is one for all positions
    end
    out = struct('used', 0, 'refused', 0, 'chi_square', NaN, 'degrees', 0, 'worst_w', NaN);
    dt = e.t - t;
    if k == 1
      dt = 0;
    end
    if dt > 0 || k == 1
      t = e.t;
      if s.mode == 0
        s = vehicle_start(s, e, o, dt);
        if s.mode == 1
          s.gps_t = e.t;
          if kinematic
            s = state_from_pose(s);
          end
        end
      else
        [s, out] = moved(method, kinematic, s, e, o, dt, out);
      end
    end
    if s.mode == 0
      rows(k, :) = [t NaN(1, 13) 0 0 0 NaN 0 NaN 0];
    else
      v = s.speed*[cos(s.pose(3)) sin(s.pose(3))];
      C = s.C;
      rows(k, :) = [t s.pose(1:2)' v mod(s.pose(3), 2*pi) s.speed C(1, 1) C(1, 2) C(1, 3) C(2, 2) C(2, 3) C(3, 3) ...
                    s.speed_sigma s.mode out.used out.refused out.chi_square out.degrees out.worst_w s.circle];
    end
  end
end

function [s, out] = moved(method, kinematic, s, e, o, dt, out)
  distance = weighted_mean(o, [7 10], [e.odo e.oss], dt);
  if ~strcmp(method, 'kinematic-paper') && distance < o.standstill*dt
    s.mode = 3;
    s.speed = 0;
    s.speed_sigma = o.standstill;
    return
  end
  if s.mode == 3
    s.speed = o.standstill;
    if isfinite(distance)
      s.speed = distance/dt;
    end
    s.speed_sigma = 0.3 + s.speed/2;
    if kinematic
      s = state_from_pose(s);
    end
  end
  switch method
    case 'kinematic-paper'
      [s, out] = vehicle_paper_step(s, e, o, dt, out);
    case 'kinematic'
      [s, out] = vehicle_kinematic_step(s, e, o, dt, out);
    otherwise
      [s, out] = vehicle_adjust_step(method, s, e, o, dt, out);
  end
  s.mode = 1 + (e.t - s.gps_t > 1);
end
