"""How good the simulated devices are: every error's size, in three grades.

`typical` is what a boat's own electronics are like: u-blox receivers, a tilt-compensated compass near iron, a MEMS gyro
without temperature control.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class GpsGrade:
    """Errors of a GPS receiver; standard deviations."""

    shared_m: float = 1.2  #: position error common to all receivers (atmosphere, orbits), per axis
    shared_time_s: float = 240.0  #: its correlation time
    own_m: float = 0.6  #: position error of each receiver (multipath), per axis
    own_time_s: float = 100.0
    white_m: float = 0.03
    velocity_mps: float = 0.09  #: per axis; half of its variance white, half correlated
    velocity_time_s: float = 1.0
    latency_s: tuple[float, float] = (0.07, 0.18)  #: from the epoch to its last sentence: range over receivers
    jitter_s: float = 0.004
    hdop: float = 1.1  #: median; it varies slowly
    hdop_spread: float = 0.2  #: of its logarithm
    dgps_share: float = 0.85  #: of the time with fix quality 2


@dataclass(frozen=True, slots=True)
class CompassGrade:
    """Errors of the compass; standard deviations, and magnitudes of the deviation's coefficients."""

    deviation_deg: tuple[float, float, float, float, float] = (
        1.0,
        2.0,
        2.0,
        0.7,
        0.5,
    )  #: A to E, each drawn within 40 %
    lag_s: float = 0.3
    latency_s: float = 0.05
    jitter_s: float = 0.003
    white_deg: float = 0.4
    slow_deg: float = 0.4
    slow_time_s: float = 8.0
    tilt_deg: float = 0.08  #: of heading per degree of roll: tilt compensation is never perfect


@dataclass(frozen=True, slots=True)
class ImuGrade:
    """Errors of the IMU; standard deviations unless said otherwise."""

    bias_dps: float = 0.5  #: magnitude of the gyro's bias, by half more or less
    warm_up_dps: float = 0.15  #: bias change while it warms up
    warm_up_time_s: float = 400.0
    wander_dps: float = 0.004  #: random walk of the bias, per square root of a second
    noise_dps: float = 0.1  #: per sample at 100 Hz
    scale: float = 0.005  #: gyro scale error
    accel_bias_g: float = 0.01
    accel_noise_g: float = 0.006
    latency_s: float = 0.007
    jitter_s: float = 0.0006


@dataclass(frozen=True, slots=True)
class Grade:
    """A set of devices."""

    gps: GpsGrade = field(default_factory=GpsGrade)
    compass: CompassGrade = field(default_factory=CompassGrade)
    imu: ImuGrade = field(default_factory=ImuGrade)


GRADES: dict[str, Grade] = {
    "good": Grade(
        GpsGrade(
            shared_m=0.8, own_m=0.3, white_m=0.015, velocity_mps=0.05, latency_s=(0.06, 0.1), hdop=0.8, dgps_share=0.97
        ),
        CompassGrade(deviation_deg=(0.6, 1.2, 1.2, 0.4, 0.3), lag_s=0.15, white_deg=0.2, slow_deg=0.2, tilt_deg=0.03),
        ImuGrade(bias_dps=0.2, warm_up_dps=0.05, wander_dps=0.001, noise_dps=0.05, scale=0.002, accel_bias_g=0.004),
    ),
    "typical": Grade(),
    "poor": Grade(
        GpsGrade(
            shared_m=2.0,
            own_m=1.5,
            own_time_s=60.0,
            white_m=0.08,
            velocity_mps=0.15,
            latency_s=(0.1, 0.2),
            jitter_s=0.01,
            hdop=2.0,
            hdop_spread=0.4,
            dgps_share=0.4,
        ),
        CompassGrade(
            deviation_deg=(1.5, 2.8, 2.8, 1.2, 1.0),
            lag_s=0.5,
            latency_s=0.08,
            white_deg=0.8,
            slow_deg=0.8,
            tilt_deg=0.15,
        ),
        ImuGrade(
            bias_dps=0.8,
            warm_up_dps=0.3,
            wander_dps=0.008,
            noise_dps=0.2,
            scale=0.01,
            accel_bias_g=0.02,
            jitter_s=0.0015,
        ),
    ),
}
