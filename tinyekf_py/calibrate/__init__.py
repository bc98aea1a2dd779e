"""Calibration: what a recording tells of the compass' deviation and of the gyro's bias.

`track` brings a recording's ground velocity, compass headings and rates of turn to one clock; `current` finds the
current as the centre of the circle that a swing draws; `deviation_fit` fits the coefficients A to E; `gyro_fit` the
bias. `card` shows the result, `config_edit` puts it into a configuration file.
"""
