function make_vehicle_goldens(inputs, outputs)
% MAKE_VEHICLE_GOLDENS  Run the reference over the drives that make_vehicle_cases.py wrote; one CSV file a drive and method.
  fid = fopen(fullfile(inputs, 'runs.txt'), 'r');
  runs = textscan(fid, '%s %s');
  fclose(fid);
  names = {'t_s', 'x', 'y', 'vx', 'vy', 'azimuth', 'speed', 'c1', 'c2', 'c3', 'c4', 'c5', 'c6', 'speed_sigma', 'mode', ...
           'used', 'refused', 'chi_square', 'degrees', 'worst_w', 'circle'};
  for k = 1:numel(runs{1})
    epochs = read_table(fullfile(inputs, [runs{1}{k} '_epochs.csv']));
    o = vehicle_options(read_table(fullfile(inputs, [runs{1}{k} '_' runs{2}{k} '_options.csv'])));
    rows = vehicle_run(runs{2}{k}, epochs, o);
    write_table(fullfile(outputs, [runs{1}{k} '_' runs{2}{k} '.csv']), names, rows);
  end
end
