function a = wrap_180(a)
% WRAP_180  Angles in degrees brought to (-180, 180], element by element.
  a = a - 360*ceil((a - 180) / 360);
end
