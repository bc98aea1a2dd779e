function v = gps_variance(o, e)
% GPS_VARIANCE  Variance of each coordinate: the epoch's own sigma, else that of the options.
  v = o.white(1)^2;
  if e.gps_sigma > 0
    v = e.gps_sigma^2;
  end
end
