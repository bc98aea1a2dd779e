function r = yaw_rate(phi, theta, gyro)
% YAW_RATE  Rate of the heading in rad/s from the gyro (rad/s, body axes) at roll phi and pitch theta (rad).
  r = (gyro(2)*sin(phi) + gyro(3)*cos(phi)) / cos(theta);
end
