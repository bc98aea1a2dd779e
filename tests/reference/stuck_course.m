function c = stuck_course(c, t, lat, lon, speed_mps, course_deg, hdop, compass_deg)
% STUCK_COURSE  How one receiver sees the boat's way turn while the compass repeats its reading (true: COMPASS_DEG).
%   Without arguments: the state at the beginning. T is the stamp, us; the rest is of a valid fix. What matters outside:
%   c.heard, the stamp of its last velocity; c.since, since when it denies the compass (NaN: does not); c.way, since
%   when the boat has had way (NaN: has none). The rules are those of docs/fusion.md.
  if nargin == 0
    c = struct('mark', [NaN NaN NaN], 'now', [0 0], 'then', [0 0], 'heard', -Inf, 'way', NaN, 'since', NaN);
    return
  end
  if isnan(hdop)
    hdop = 2;
  end
  [c, v, sigma] = velocity(c, t, lat, lon, speed_mps, course_deg);
  if ~(norm(v) <= 100)   % NaN: none
    return
  end
  dt = (t - c.heard) / 1e6;
  if dt <= 5
    c.now = c.now + dt/(2 + dt) * (v - c.now);
  else
    c.now = v;
    c.since = NaN;
  end
  c.heard = t;

  if norm(c.now) < 0.5
    c.way = NaN;
  elseif isnan(c.way) && norm(c.now) >= 1
    c.way = t;
  end
  if t - c.way >= 5e6
    c.then = c.then + min(dt/120, 1) * (c.now - c.then);
  else
    c.then = c.now;
  end

  [along, across] = on_axis(c.then, compass_deg);
  off_axis = min(8*pi/180 + atan2(across, along), 30*pi/180);
  [along, across] = on_axis(c.now - c.then, compass_deg);
  allowed = norm([0.7, 0.15*norm(c.then), 4*sigma*hdop]);
  if ~(across*cos(off_axis) - along*sin(off_axis) > allowed)
    c.since = NaN;
  elseif isnan(c.since)
    c.since = t;
  end
end

function [along, across] = on_axis(v, compass_deg)
% Without their signs: she may as well go astern.
  psi = compass_deg * pi/180;
  along = abs(v * [cos(psi); sin(psi)]);
  across = abs(v * [-sin(psi); cos(psi)]);
end

function [c, v, sigma] = velocity(c, t, lat, lon, speed_mps, course_deg)
% The receiver's own velocity, else that of its way since a mark, [north east] m/s; NaN: none yet. SIGMA is per HDOP.
  v = [NaN NaN];
  sigma = 0.08;
  if speed_mps >= 0 && isfinite(speed_mps) && isfinite(course_deg)
    v = speed_mps * [cos(course_deg*pi/180), sin(course_deg*pi/180)];
  elseif speed_mps >= 0 && speed_mps <= 0.35
    v = [0 0];
  else
    span = (t - c.mark(3)) / 1e6;
    if span >= 2 && span <= 3
      [north, east] = local_from_geodetic(c.mark(1:2), lat, lon);
      v = [north east] / span;
      sigma = 0.1*sqrt(2) / span;
    end
    if ~(span < 2)
      c.mark = [lat lon t];
    end
  end
end
