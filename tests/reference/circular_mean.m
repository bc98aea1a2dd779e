function mean_deg = circular_mean(angles_deg, weights)
% CIRCULAR_MEAN  Weighted mean direction in degrees, [0, 360); NaN when the directions cancel.
%   The mean is missing when the resultant is shorter than 1e-9 of the summed weights: 0 and 180 with equal
%   weights point nowhere.
  y = sum(weights .* sin(angles_deg * pi/180));
  x = sum(weights .* cos(angles_deg * pi/180));
  if hypot(x, y) < 1e-9 * sum(weights)
    mean_deg = NaN;
  else
    mean_deg = wrap_360(atan2(y, x) * 180/pi);
  end
end
