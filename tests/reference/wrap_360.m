function a = wrap_360(a)
% WRAP_360  Angles in degrees brought to [0, 360), element by element.
  a = a - 360*floor(a / 360);
  a(a >= 360) = 0;   % a tiny negative angle rounds up to 360
end
