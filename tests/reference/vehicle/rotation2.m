function R = rotation2(a)
% ROTATION2  The matrix that turns a vector [north; east] clockwise (as seen on a chart) by A.
  R = [cos(a) -sin(a); sin(a) cos(a)];
end
