function gpsec_deg = cnw_stage2(headings_deg, weights, compass_deg)
% CNW_STAGE2  Classification and weighing, stage 2: GPS headings and the compass to GPSEC_yaw (the paper's (2)).
%   Degrees in, [0, 360) out; NaN is a missing heading. All GPS count in the ideal sum 3 n, also the missing ones.
  present = isfinite(headings_deg);
  h = headings_deg(present);
  w = weights(present);
  has_compass = isfinite(compass_deg);
  h_all = NaN;
  w_all = 0;
  if sum(w) > 0
    h_all = circular_mean(h, w);
    w_all = sum(w) / (3 * numel(headings_deg));
  elseif ~has_compass && ~isempty(h)
    h_all = circular_mean(h, ones(size(h)));
  end
  if has_compass && isfinite(h_all)
    gpsec_deg = wrap_360(compass_deg + w_all * wrap_180(h_all - compass_deg));
  elseif has_compass
    gpsec_deg = wrap_360(compass_deg);
  else
    gpsec_deg = h_all;
  end
end
