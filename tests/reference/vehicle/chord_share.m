function s = chord_share(turn)
% CHORD_SHARE  Chord over arc of an arc that turns by TURN (NaN: not at all), to second order.
  s = 1;
  if isfinite(turn)
    s = 1 - turn^2/24;
  end
end
