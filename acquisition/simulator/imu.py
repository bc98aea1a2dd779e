"""The simulated IMU: an EBIMU-9DOFV3 printing attitude, gyro and accelerometer a hundred times a second.

Its gyro has a bias that drifts as the sensor warms up and wanders; its accelerometer feels every turn as a heel. The
attitude it prints is its own estimate: its yaw is a magnetic heading with slow errors.
"""

from __future__ import annotations

import math
import random

from acquisition.simulator.grades import ImuGrade
from acquisition.simulator.noise import GaussMarkov
from acquisition.simulator.vessel import STEP_S, Motion

_ATTITUDE_PERIOD = 10  # steps between two draws of the slow errors of attitude
_ROLL_ERROR_DEG, _YAW_ERROR_DEG = 0.4, 2.5


class Imu:
    """The IMU of one boat; `bias_dps` is its gyro's present bias about x, y, z."""

    def __init__(self, grade: ImuGrade, variation_deg: float, seed: object) -> None:
        rng = random.Random(f"imu {seed}")
        self._rng = rng
        self._grade = grade
        self._variation_deg = variation_deg
        self.bias_dps = [grade.bias_dps * rng.uniform(0.5, 1.5) * rng.choice((-1.0, 1.0)) for _ in range(3)]
        per_step = grade.warm_up_dps * STEP_S / grade.warm_up_time_s
        self._warming_dps = [per_step * rng.uniform(-1.0, 1.0) for _ in range(3)]
        self._warming_keep = math.exp(-STEP_S / grade.warm_up_time_s)
        self._wander_dps = grade.wander_dps * math.sqrt(STEP_S)
        self._gain = [math.degrees(1.0 + rng.gauss(0.0, grade.scale)) for _ in range(3)]
        self._accel_bias_g = [rng.gauss(0.0, grade.accel_bias_g) for _ in range(3)]
        period_s = _ATTITUDE_PERIOD * STEP_S
        sizes = (_ROLL_ERROR_DEG, _ROLL_ERROR_DEG, _YAW_ERROR_DEG)
        self._attitude_errors = [GaussMarkov(size, 60.0, period_s, rng) for size in sizes]

    def reading(self, motion: Motion) -> list[tuple[int, bytes]]:
        """The line of this moment, with the microseconds until it arrives."""
        gauss, grade = self._rng.gauss, self._grade
        noise, wander = grade.noise_dps, self._wander_dps
        bias, warming, keep = self.bias_dps, self._warming_dps, self._warming_keep
        for axis in (0, 1, 2):
            warming[axis] *= keep
            bias[axis] += warming[axis] + gauss(0.0, wander)
        if motion.step % _ATTITUDE_PERIOD == 0:
            for error in self._attitude_errors:
                error.step()
        roll_error, pitch_error, yaw_error = self._attitude_errors
        rate_x, rate_y, rate_z = motion.body_rates()
        accel_x, accel_y, accel_z = motion.body_gravity()
        gain_x, gain_y, gain_z = self._gain
        offset_x, offset_y, offset_z = self._accel_bias_g
        yaw_deg = math.degrees(motion.heading_rad) - self._variation_deg + yaw_error.value
        line = b"*%.2f,%.2f,%.2f,%.2f,%.2f,%.2f,%.3f,%.3f,%.3f" % (
            math.degrees(motion.roll_rad) + roll_error.value,
            math.degrees(motion.pitch_rad) + pitch_error.value,
            math.remainder(yaw_deg, 360.0),
            gain_x * rate_x + bias[0] + gauss(0.0, noise),
            gain_y * rate_y + bias[1] + gauss(0.0, noise),
            gain_z * rate_z + bias[2] + gauss(0.0, noise),
            accel_x + offset_x + gauss(0.0, grade.accel_noise_g),
            accel_y + offset_y + gauss(0.0, grade.accel_noise_g),
            accel_z + offset_z + gauss(0.0, grade.accel_noise_g),
        )
        return [(round((grade.latency_s + abs(gauss(0.0, grade.jitter_s))) * 1e6), line)]
