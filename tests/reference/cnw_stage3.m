function heading_deg = cnw_stage3(headings_deg, weights)
% CNW_STAGE3  Classification and weighing, stage 3: the filters' headings to one (the paper's (13)).
%   Degrees in, [0, 360) out; NaN is a missing heading; all weights zero: equal weights; NaN when nothing is left
%   or the headings cancel.
  present = isfinite(headings_deg);
  h = headings_deg(present);
  w = weights(present);
  if isempty(h)
    heading_deg = NaN;
    return
  end
  if sum(w) == 0
    w = ones(size(h));
  end
  heading_deg = circular_mean(h, w);
end
