function true_deg = compass_true(reference, heading_deg, deviation_deg, variation_deg, o, gps_variation_deg)
% COMPASS_TRUE  True heading in degrees of one compass reading; NaN when it cannot be made true.
%   REFERENCE 1: true already. Else compass + deviation = magnetic, magnetic + variation = true, east positive. The
%   sentence's own deviation replaces the configured table o.deviation = [A B C D E]; variation is o.variation_deg, else
%   the sentence's own, else the last a GPS gave.
  if reference == 1
    true_deg = wrap_360(heading_deg);
    return
  end
  if ~isfinite(deviation_deg)
    z = heading_deg * pi/180;
    deviation_deg = o.deviation * [1; sin(z); cos(z); sin(2*z); cos(2*z)];
  end
  if isfinite(o.variation_deg)
    variation_deg = o.variation_deg;
  elseif ~isfinite(variation_deg)
    variation_deg = gps_variation_deg;
  end
  true_deg = wrap_360(heading_deg + deviation_deg + variation_deg);
end
