function o = vehicle_options(row)
% VEHICLE_OPTIONS  Options of a run from the row that make_vehicle_cases.py wrote.
  o.white = row(1:10);
  o.walk = row(11:20);
  o.relative = row(21:30);
  o.accel_sigma = row(31:32);   % XSENS, Bosch
  names = {'q_ww', 'along', 'lateral', 'position_walk', 'gate_gps', 'gate_row', 'reaccept_s', 'start_sigma', ...
           'turn_threshold', 'turn_hysteresis', 'standstill', 'start_azimuth', 'lever_x', 'lever_y'};
  for k = 1:numel(names)
    o.(names{k}) = row(32 + k);
  end
  o.lever = [o.lever_x; o.lever_y];
end
