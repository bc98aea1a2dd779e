function v = row_variance(o, row, z, dt)
% ROW_VARIANCE  Variance of observation number ROW (1 to 10) with value Z over DT seconds.
  v = o.white(row)^2 + o.walk(row)^2*dt + (o.relative(row)*z)^2;
end
