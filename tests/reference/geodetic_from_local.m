function [lat_deg, lon_deg] = geodetic_from_local(origin, north_m, east_m)
% GEODETIC_FROM_LOCAL  Latitude and longitude (to (-180, 180]) of a point in the frame of ORIGIN = [lat_deg lon_deg].
  [north_radius, east_radius] = local_frame(origin(1));
  lat_deg = origin(1) + north_m / north_radius * 180/pi;
  lon_deg = wrap_180(origin(2) + east_m / east_radius * 180/pi);
end
