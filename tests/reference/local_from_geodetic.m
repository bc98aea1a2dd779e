function [north_m, east_m] = local_from_geodetic(origin, lat_deg, lon_deg)
% LOCAL_FROM_GEODETIC  Metres north and east of ORIGIN = [lat_deg lon_deg], in the frame of that origin.
  [north_radius, east_radius] = local_frame(origin(1));
  north_m = north_radius * (lat_deg - origin(1)) * pi/180;
  east_m = east_radius * wrap_180(lon_deg - origin(2)) * pi/180;
end
