function psi_deg = forward_azimuth(lat_prev, lon_prev, lat_curr, lon_curr)
% FORWARD_AZIMUTH  Course in degrees of the track at its current end, on the sphere (the paper's (1)).
%   Degrees in, [0, 360) out; equal positions give NaN. Element by element.
%   psi = atan2(sin dl cos p1, cos p2 sin p1 - sin p2 cos p1 cos dl) + 180 with p1 the previous latitude and dl the
%   previous longitude less the current; the second argument is written without the cancellation that costs 1e-5
%   degrees at a step of 2 cm. Differences are taken before the conversion to radians, for the same reason.
  dl = wrap_180(lon_prev - lon_curr) * pi/180;
  dp = (lat_prev - lat_curr) * pi/180;
  p1 = lat_prev * pi/180;
  p2 = lat_curr * pi/180;
  y = sin(dl) .* cos(p1);
  x = sin(dp) + 2 * sin(p2) .* cos(p1) .* sin(dl/2).^2;
  psi_deg = wrap_360(atan2(y, x) * 180/pi + 180);
  psi_deg(dl == 0 & dp == 0) = NaN;
  psi_deg(isnan(dl) | isnan(dp)) = NaN;
end
