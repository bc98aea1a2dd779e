function [north_radius, east_radius] = local_frame(lat_deg)
% LOCAL_FRAME  Metres a radian of latitude and of longitude on WGS-84 at a latitude, height 0.
  a = 6378137;
  f = 1 / 298.257223563;
  e2 = f*(2 - f);
  p = lat_deg * pi/180;
  q = 1 - e2*sin(p)^2;
  north_radius = a*(1 - e2) / (q*sqrt(q));
  east_radius = a / sqrt(q) * cos(p);
end
