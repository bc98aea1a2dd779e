function [s, must] = note_refused(s, t, o)
% NOTE_REFUSED  A position was refused at T; MUST: for so long that it has to be taken.
  if isnan(s.refused_t)
    s.refused_t = t;
  end
  must = t - s.refused_t >= o.reaccept_s;
end
