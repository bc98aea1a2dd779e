function names = heading_columns(n_gps)
% HEADING_COLUMNS  Names of the columns that fusion_run returns: those of the heading CSV.
  n = max(3, n_gps);
  numbered = @(form) arrayfun(@(i) sprintf(form, i), 1:n, 'UniformOutput', false);
  names = [{'t_s', 'heading_deg', 'heading_sigma_deg', 'rate_of_turn_dps', 'lat_deg', 'lon_deg', 'mode', 'pos_mode'} ...
           numbered('w%d') numbered('faz%d_deg') {'gpsec_deg'} numbered('ekf%d_deg')];
end
