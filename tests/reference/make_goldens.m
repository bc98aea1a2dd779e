function make_goldens(inputs, outputs)
% MAKE_GOLDENS  Run the reference over the inputs that make_cases.py wrote; write one CSV file a function and stream.
%   Of ten_minutes only the rows of whole seconds are kept.
  run_functions(inputs, outputs);
  fid = fopen(fullfile(inputs, 'streams.txt'), 'r');
  runs = textscan(fid, '%s %s');
  fclose(fid);
  for k = 1:numel(runs{1})
    name = runs{1}{k};
    method = runs{2}{k};
    samples = read_table(fullfile(inputs, [name '_samples.csv']));
    tasks = read_table(fullfile(inputs, [name '_tasks.csv']));
    o = fusion_options(read_table(fullfile(inputs, [name '_options.csv'])));
    tic;
    rows = fusion_run(method, samples, tasks, o);
    fprintf('%s %s: %d rows, %.1f s\n', name, method, size(rows, 1), toc);
    if strcmp(name, 'ten_minutes')
      rows = rows(mod(round(rows(:, 1) * 10), 10) == 0, :);
    end
    write_table(fullfile(outputs, [name '_' strrep(method, '-', '_') '.csv']), heading_columns(o.n_gps), rows);
  end
end

function run_functions(inputs, outputs)
  t = read_table(fullfile(inputs, 'forward_azimuth.csv'));
  write_table(fullfile(outputs, 'forward_azimuth.csv'), {'faz_deg'}, forward_azimuth(t(:, 1), t(:, 2), t(:, 3), t(:, 4)));

  t = read_table(fullfile(inputs, 'cnw_stage1.csv'));
  write_table(fullfile(outputs, 'cnw_stage1.csv'), {'weight'}, cnw_stage1(t(:, 1), t(:, 2)));

  t = read_table(fullfile(inputs, 'cnw_stage2.csv'));
  y = zeros(size(t, 1), 1);
  for k = 1:size(t, 1)
    n = t(k, 1);
    y(k) = cnw_stage2(t(k, 3:2+n), t(k, 11:10+n), t(k, 2));
  end
  write_table(fullfile(outputs, 'cnw_stage2.csv'), {'gpsec_deg'}, y);

  t = read_table(fullfile(inputs, 'cnw_stage3.csv'));
  y = zeros(size(t, 1), 1);
  for k = 1:size(t, 1)
    n = t(k, 1);
    y(k) = cnw_stage3(t(k, 3:2+n), t(k, 11:10+n));
  end
  write_table(fullfile(outputs, 'cnw_stage3.csv'), {'heading_deg'}, y);

  t = read_table(fullfile(inputs, 'covariance_intersection.csv'));
  y = zeros(size(t, 1), 13);
  objectives = {'det', 'trace'};
  for k = 1:size(t, 1)
    angles = 3*ones(1, t(k, 2));
    [c, C, omega] = covariance_intersection(t(k, 3:5)', square(t(k, 6:14)), t(k, 15:17)', square(t(k, 18:26)), ...
                                            objectives{1 + t(k, 1)}, angles);
    y(k, :) = [c' reshape(C', 1, 9) omega];
  end
  write_table(fullfile(outputs, 'covariance_intersection.csv'), [numbered('c', 3) numbered('C', 9) {'omega'}], y);

  t = read_table(fullfile(inputs, 'ekf.csv'));
  y = zeros(size(t, 1), 36);
  for k = 1:size(t, 1)
    angles = 3*ones(1, t(k, 1));
    P = square(t(k, 2:10));
    fx = t(k, 11:13)';
    F = square(t(k, 14:22));
    Q = square(t(k, 23:31));
    z = t(k, 32:34)';
    H = square(t(k, 35:43));
    R = square(t(k, 44:52));
    hx = t(k, 53:55)';
    [x1, P1] = ekf_predict(P, fx, F, Q);
    [x2, P2] = ekf_update(x1, P1, z, H, R, hx, angles);
    [x3, P3] = ekf_step(P, z, fx, F, Q, H, R);
    y(k, :) = [x1' reshape(P1', 1, 9) x2' reshape(P2', 1, 9) x3' reshape(P3', 1, 9)];
  end
  write_table(fullfile(outputs, 'ekf.csv'), ...
              [numbered('predicted_x', 3) numbered('predicted_P', 9) numbered('updated_x', 3) ...
               numbered('updated_P', 9) numbered('stepped_x', 3) numbered('stepped_P', 9)], y);

  t = read_table(fullfile(inputs, 'heading_ekf.csv'));
  y = zeros(size(t, 1), 12);
  deg2 = (pi/180)^2;
  Q = diag([0.01 0.01 10*deg2]);
  R = diag([0.3 0.07 0.03*deg2]);
  H = eye(3);
  x = [0; 0; 3];
  P = diag([10 10 100*deg2]);
  for k = 1:size(t, 1)
    [fx, F] = heading_model(x, t(k, 1), t(k, 2), t(k, 3), t(k, 4));
    [x, P] = ekf_predict(P, fx, F, Q*t(k, 4));
    rows = find(t(k, 5:7));
    if ~isempty(rows)
      z = t(k, 8:10)';
      [x, P] = ekf_update(x, P, z(rows), H(rows, :), R(rows, rows), x(rows), find(rows == 3));
      x(3) = wrap_pi(x(3));
    end
    y(k, :) = [x' reshape(P', 1, 9)];
  end
  write_table(fullfile(outputs, 'heading_ekf.csv'), [numbered('x', 3) numbered('P', 9)], y);
end

function X = square(row)
% A 3 by 3 matrix from nine numbers, row by row.
  X = reshape(row, 3, 3)';
end

function names = numbered(name, count)
  names = arrayfun(@(i) sprintf('%s%d', name, i), 1:count, 'UniformOutput', false);
end
