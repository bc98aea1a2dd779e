function [m, variance] = weighted_mean(o, rows, z, dt)
% WEIGHTED_MEAN  Mean of the finite observations Z, of numbers ROWS, by inverse variances; NaN without any.
  there = isfinite(z);
  rows = rows(there);
  z = z(there);
  w = arrayfun(@(row, value) 1 / row_variance(o, row, value, dt), rows, z);
  if isempty(w)
    m = NaN;
    variance = NaN;
  else
    m = sum(w .* z) / sum(w);
    variance = 1 / sum(w);
  end
end
