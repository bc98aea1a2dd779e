function o = fusion_options(row)
% FUSION_OPTIONS  The options of fusion_run from one row of numbers (a case's *_options.csv).
%   n_gps; configured, ten flags (gps1 to gps8, compass, IMU); variation_deg (NaN: not configured); deviation, five
%   coefficients in degrees; mount, the rotation from the IMU's axes to the vessel's, row by row; specific_force;
%   max_sigma_deg.
  o.n_gps = row(1);
  o.configured = row(2:11) ~= 0;
  o.variation_deg = row(12);
  o.deviation = row(13:17);
  o.mount = reshape(row(18:26), 3, 3)';
  o.specific_force = row(27) ~= 0;
  o.max_sigma_deg = row(28);
end
