function [phi, theta, state] = attitude(state, dt, gyro, accel)
% ATTITUDE  Roll and pitch in radians from gyro (rad/s) and gravity vector (g), by a complementary filter.
%   STATE is [phi theta levelled must_level]; start with [0 0 0 1]. dt is the time in s since the IMU's previous
%   sample, 0 for the first. levelled: the accelerometer has given an attitude at least once; must_level: the next
%   usable accelerometer reading is taken as it is.
  tau = 5;
  phi = state(1);
  theta = state(2);
  levelled = state(3);
  must_level = state(4) || dt > 1;
  if levelled && dt > 0 && dt <= 1
    phi_rate = gyro(1) + tan(theta) * (gyro(2)*sin(phi) + gyro(3)*cos(phi));
    theta_rate = gyro(2)*cos(phi) - gyro(3)*sin(phi);
    phi = phi + dt*phi_rate;
    theta = theta + dt*theta_rate;
  end
  g = sqrt(accel(1)^2 + accel(2)^2 + accel(3)^2);
  if g > 0.1 && g < Inf
    phi_a = atan2(accel(2), accel(3));
    theta_a = atan2(-accel(1), hypot(accel(2), accel(3)));
    if must_level
      phi = phi_a;
      theta = theta_a;
    else
      alpha = dt / (tau + dt);
      phi = phi + alpha*wrap_pi(phi_a - phi);
      theta = theta + alpha*(theta_a - theta);
    end
    levelled = 1;
    must_level = 0;
  end
  phi = wrap_pi(phi);
  theta = max(min(theta, 80*pi/180), -80*pi/180);
  state = [phi theta levelled must_level];
end
