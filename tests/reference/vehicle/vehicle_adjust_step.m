function [s, out] = vehicle_adjust_step(method, s, e, o, dt, out)
% VEHICLE_ADJUST_STEP  One epoch by least-squares adjustment: straight line (17) or circle (20).
%   Unknowns [x0 y0 x1 y1 azimuth], the azimuth being the current one (straight) or the previous one (circle).
  s.circle = is_circle(method, s, e, o, dt);
  left_out = false(1, 10);
  critical = [10.827566170662733 13.815510557964274 16.26623619623813 18.466826952903151 20.515005652432873 ...
              22.457744484825323 24.321886347856854 26.12448155837614 27.877164871256568 29.588298445074415];
  for snooped = 0:1000
    [l, Q, kinds, bits] = observations(s, e, o, dt, left_out);
    x = first_values(s, e, o, dt);
    r = lsa_adjust(l, Q, @(x) model(x, kinds, s.circle, o.lever), x, find(kinds == 3 | kinds == 4 | kinds == 10));
    if ~r.converged
      return   % the epoch cannot be adjusted: everything stays
    end
    r.w(~any(bits, 2)) = NaN;   % the previous epoch is not suspected
    [w, k] = max(abs(r.w));   % NaN is passed over
    outlier = isfinite(w) && r.degrees >= 1 && r.vPv > critical(r.degrees) ...
              && w > 3.2905267314918945;
    if ~outlier || snooped >= 3
      break
    end
    must = false;
    if kinds(k) <= 2
      [s, must] = note_refused(s, e.t, o);
      if must
        lost = sum((e.gps - s.pose(1:2)).^2);
        s.C = s.C + diag([lost lost lost/(lost + (s.speed*max(o.reaccept_s, 1))^2)]);
      end
    end
    if ~must
      left_out = left_out | bits(k, :);
    end
  end
  used = any(bits, 1);
  if used(1)
    s.gps_t = e.t;
    s.refused_t = NaN;
  end
  [g, dg] = geometry(r.x, s.circle);
  J = [0 0 1 0 0; 0 0 0 1 0; dg(3, :)];
  s.pose = [r.x(3:4); wrap_pi(g(3))];
  s.C = J*r.Qxx*J';
  a = e.bosch;
  if ~isfinite(a)
    a = e.xsens;
  end
  if ~isfinite(a)
    a = 0;
  end
  s.speed = g(1)/dt + 0.5*dt*a;
  s.speed_sigma = sqrt(dg(1, :)*r.Qxx*dg(1, :)')/dt;
  out.used = sum(2.^(find(used) - 1));
  out.refused = sum(2.^(find(left_out) - 1));
  out.chi_square = r.vPv;
  out.degrees = r.degrees;
  out.worst_w = w;
end

function circle = is_circle(method, s, e, o, dt)
  circle = strcmp(method, 'lsa-circle');
  if strcmp(method, 'lsa')
    turn = weighted_mean(o, [3 5 6], e.turn([1 3 4]), dt);
    if ~isfinite(turn)
      turn = weighted_mean(o, 3:6, e.turn, dt);
    end
    circle = s.circle;
    if isfinite(turn)
      threshold = o.turn_threshold;
      if s.circle
        threshold = threshold*o.turn_hysteresis;
      end
      circle = abs(turn) > threshold;
    end
  end
end

% kinds: 1 X, 2 Y, 3 rotation of the gyros, 4 of the odometer, 5 to 7 distances, 8 to 10 the previous x, y, azimuth
function [l, Q, kinds, bits] = observations(s, e, o, dt, left_out)
  l = []; q = []; kinds = []; bits = zeros(0, 10);
  if all(isfinite(e.gps)) && ~left_out(1)
    add(1, [1 2], e.gps(1), gps_variance(o, e));
    add(2, [1 2], e.gps(2), gps_variance(o, e));
  end
  turns = e.turn;
  turns(left_out(3:6)) = NaN;
  turn = weighted_mean(o, 3:6, turns, dt);
  [gyros, variance] = weighted_mean(o, 4:6, turns(2:4), dt);
  if isfinite(gyros)
    add(3, 3 + find(isfinite(turns(2:4))), gyros, variance);
  end
  if isfinite(turns(1))
    add(4, 3, turns(1), row_variance(o, 3, turns(1), dt));
  elseif ~isfinite(turn)
    add(3, [], 0, (0.3*dt)^2);
  end
  ways = [e.odo e.oss];
  ways(left_out([7 10])) = NaN;
  rows = [7 10];
  for k = 1:2
    if isfinite(ways(k))
      add(4 + k, rows(k), ways(k)*chord_share(turn), row_variance(o, rows(k), ways(k), dt));
    end
  end
  row = 8;
  a = e.xsens;
  if isfinite(e.bosch) && ~left_out(9)
    row = 9;
    a = e.bosch;
  end
  measured = isfinite(a) && ~left_out(row);
  if measured || ~any(isfinite(ways))
    sigma = 4;
    way = s.speed*dt;
    if measured
      sigma = o.accel_sigma(row - 7);
      way = way + 0.5*dt^2*a;
    end
    add(7, row*ones(1, measured), way, (s.speed_sigma*dt)^2 + (0.5*dt^2*sigma)^2 + row_variance(o, row, way, dt));
  end
  for k = 1:3
    add(7 + k, [], s.pose(k), 1);
  end
  Q = diag(q);
  Q(end-2:end, end-2:end) = s.C;

  function add(kind, rows, value, variance)
    kinds(end+1, 1) = kind;
    bits(end+1, :) = ismember(1:10, rows);
    l(end+1, 1) = value;
    q(end+1, 1) = variance;
  end
end

function x = first_values(s, e, o, dt)
  turn = e.turn(1);
  if ~isfinite(turn)
    turn = weighted_mean(o, 3:6, e.turn, dt);
  end
  if ~isfinite(turn)
    turn = 0;
  end
  D = weighted_mean(o, [7 10], [e.odo e.oss], dt);
  if ~isfinite(D)
    D = s.speed*dt;
  end
  D = max(D, 1e-3);
  chord = s.pose(3) + s.circle*turn/2;
  x = [s.pose(1:2); s.pose(1:2) + D*[cos(chord); sin(chord)]; s.pose(3) + (~s.circle)*turn];
end

function [g, dg] = geometry(x, circle)
% Length, previous azimuth and current azimuth, and their derivatives by the unknowns.
  way = x(3:4) - x(1:2);
  D = norm(way);
  c = way(1)/D;
  n = way(2)/D;
  chord = atan2(way(2), way(1));
  dchord = [n -c -n c 0]/D;
  given = [0 0 0 0 1];
  if circle
    g = [D; x(5); x(5) + 2*wrap_pi(chord - x(5))];
    dg = [-c -n c n 0; given; 2*dchord - given];
  else
    g = [D; chord; x(5)];
    dg = [-c -n c n 0; dchord; given];
  end
end

function [h, A] = model(x, kinds, circle, lever)
  [g, dg] = geometry(x, circle);
  arm = rotation2(g(3))*lever;
  E = eye(5);
  all_h = [x(3:4) + arm; g(3) - g(2); g(3) - g(2); g(1); g(1); g(1); x(1:2); g(2)];
  turn = dg(3, :) - dg(2, :);
  all_A = [E(3, :) - arm(2)*dg(3, :); E(4, :) + arm(1)*dg(3, :); turn; turn; repmat(dg(1, :), 3, 1); E(1:2, :); dg(2, :)];
  h = all_h(kinds);
  A = all_A(kinds, :);
end
