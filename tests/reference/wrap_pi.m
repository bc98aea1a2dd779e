function a = wrap_pi(a)
% WRAP_PI  Angles in radians brought to (-pi, pi], element by element.
  a = a - 2*pi*ceil((a - pi) / (2*pi));
end
