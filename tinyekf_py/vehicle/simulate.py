"""Simulated drives with every sensor of the third paper, raw as converters and counters give them, and the truth.

The stated grade: three gyros of 0.035 deg/sqrt(s) each (0.02 fused) with residual biases of at most 0.02 deg/s, wheel
pulses of 2 cm, an optical sensor of 1 cm/sqrt(s), GPS positions at 10 Hz with independent errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinyekf_py.vehicle.table import Floats, write_table

SHAPES = ("straight", "circle", "mixed")
TRUTH_COLUMNS = ("t_s", "x_m", "y_m", "azimuth_deg", "speed_mps")

#: V = rate / scale + 2.5 and so on: what the simulated converters do, and the calibration file undoes.
BOSCH_DPS_PER_V, SILICON_DPS_PER_V, BOSCH_MPS2_PER_V, OSS_MPS_PER_V, ZERO_V = 50.0, 25.0, 20.0, 5.0, 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Grade:
    """How good the simulated sensors are."""

    gps_m: float = 1.5  #: standard deviation of each coordinate
    gyro_walk_deg: float = 0.035  #: of each gyro, deg/sqrt(s)
    gyro_bias_dps: float = 0.02  #: largest residual bias of a gyro
    pulse_m: float = 0.02  #: distance of an odometer's impulse
    odo_scale: float = 0.001  #: standard deviation of the wheels' residual scale
    oss_walk_m: float = 0.01  #: m/sqrt(s)
    accel_mps2: float = 0.05  #: standard deviation of an accelerometer's sample
    accel_bias_mps2: float = 0.02
    track_width_m: float = 1.5
    rate_hz: float = 100.0


class SimulatedDrive(NamedTuple):
    """Columns of DATA.csv, and the truth at its rows."""

    columns: dict[str, Floats]
    truth: Floats  #: shape (n, 5), columns TRUTH_COLUMNS


def true_motion(shape: str, duration_s: float, rate_hz: float) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
    """Times (s), x, y (m), azimuth and its rate (rad, rad/s), speed (m/s): at rest for 3 s, then up to 10 m/s."""
    t = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    moving = np.clip(t - 3.0, 0.0, None)
    speed = np.minimum(2.0 * moving, 10.0 + np.sin(2 * math.pi * np.clip(moving - 5.0, 0.0, None) / 20.0))
    if shape == "straight":
        curvature = np.zeros_like(t)
    elif shape == "circle":
        curvature = np.full_like(t, 1 / 30.0)
    elif shape == "mixed":
        curvature = np.where(np.sin(2 * math.pi * t / 40.0) > 0.3, 1 / 40.0, 0.0)
        curvature -= np.where(np.sin(2 * math.pi * t / 40.0) < -0.8, 1 / 25.0, 0.0)
    else:
        raise ValueError(f"no shape {shape!r}; there are {', '.join(SHAPES)}")
    rate = speed * curvature
    dt = 1.0 / rate_hz
    azimuth = 0.6 + np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * dt)))
    step = (speed[1:] + speed[:-1]) / 2 * dt
    half = (azimuth[1:] + azimuth[:-1]) / 2
    x = np.concatenate(([0.0], np.cumsum(step * np.cos(half))))
    y = np.concatenate(([0.0], np.cumsum(step * np.sin(half))))
    return t, x, y, azimuth, rate, speed


def simulate_drive(
    shape: str, *, duration_s: float = 120.0, seed: int = 1, grade: Grade | None = None
) -> SimulatedDrive:
    """A drive of `shape` (one of SHAPES) with all sensors. Missing is NaN: GPS stands in every tenth row."""
    g = grade or Grade()
    chance = np.random.default_rng(seed)
    t, x, y, azimuth, rate, speed = true_motion(shape, duration_s, g.rate_hz)
    n, dt = len(t), 1.0 / g.rate_hz
    rate_dps = np.degrees(rate)

    def gyro() -> Floats:
        bias = chance.uniform(-g.gyro_bias_dps, g.gyro_bias_dps)
        return rate_dps + bias + chance.normal(0, g.gyro_walk_deg / math.sqrt(dt), n)

    acceleration = np.gradient(speed, dt)

    def accelerometer() -> Floats:
        return acceleration + chance.normal(0, g.accel_bias_mps2) + chance.normal(0, g.accel_mps2, n)

    def counter(side: float) -> Floats:
        wheel = speed + rate * side * g.track_width_m / 2
        way = np.concatenate(([0.0], np.cumsum((wheel[1:] + wheel[:-1]) / 2 * dt)))
        return np.floor(way * (1 + chance.normal(0, g.odo_scale)) / g.pulse_m + chance.uniform())

    oss = speed + np.where(speed > 0, chance.normal(0, g.oss_walk_m / math.sqrt(dt), n), 0.0)
    every = round(g.rate_hz / 10)
    gps = np.full((2, n), np.nan)
    gps[:, ::every] = np.array([x, y])[:, ::every] + chance.normal(0, g.gps_m, (2, len(t[::every])))
    columns = {
        "t_s": t,
        "gps_x_m": gps[0],
        "gps_y_m": gps[1],
        "odo_left": counter(1.0),
        "odo_right": counter(-1.0),
        "bosch_yaw_V": gyro() / BOSCH_DPS_PER_V + ZERO_V,
        "bosch_accel_V": accelerometer() / BOSCH_MPS2_PER_V + ZERO_V,
        "xsens_yaw_dps": gyro(),
        "xsens_accel_mps2": accelerometer(),
        "silicon_V": gyro() / SILICON_DPS_PER_V + ZERO_V,
        "oss_V": oss / OSS_MPS_PER_V,
    }
    truth = np.column_stack([t, x, y, np.degrees(azimuth) % 360.0, speed])
    return SimulatedDrive(columns, truth)


def config_toml(grade: Grade) -> str:
    """The configuration that reads a simulated drive."""
    return f"""\
# A simulated drive: which column is which channel. calibration.toml makes units of the raw values.
[drive]
track_width_m = {grade.track_width_m}

[noise]
gps_m = {grade.gps_m}

[channels]
gps_x = {{ column = "gps_x_m" }}
gps_y = {{ column = "gps_y_m" }}
odo_left = {{ column = "odo_left", raw = "impulses" }}
odo_right = {{ column = "odo_right", raw = "impulses" }}
bosch_yaw_rate = {{ column = "bosch_yaw_V", raw = "V" }}
bosch_accel = {{ column = "bosch_accel_V", raw = "V" }}
xsens_yaw_rate = {{ column = "xsens_yaw_dps" }}
xsens_accel = {{ column = "xsens_accel_mps2" }}
silicon_yaw_rate = {{ column = "silicon_V", raw = "V" }}
oss = {{ column = "oss_V", raw = "V" }}
"""


def calibration_toml(grade: Grade) -> str:
    """The calibration file of a simulated drive."""
    lines = []
    for name, scale, zero, unit in (
        ("odo_left", grade.pulse_m, 0.0, "m"),
        ("odo_right", grade.pulse_m, 0.0, "m"),
        ("bosch_yaw_rate", BOSCH_DPS_PER_V, ZERO_V, "deg/s"),
        ("bosch_accel", BOSCH_MPS2_PER_V, ZERO_V, "m/s2"),
        ("silicon_yaw_rate", SILICON_DPS_PER_V, ZERO_V, "deg/s"),
        ("oss", OSS_MPS_PER_V, 0.0, "m/s"),
    ):
        lines.append(f'[channels.{name}]\nscale = {scale}\noffset = {-scale * zero}\nunit = "{unit}"\n')
    return "\n".join(lines)


def write_drive(folder: Path, drive: SimulatedDrive, grade: Grade | None = None) -> None:
    """Write drive.csv, truth.csv, config.toml and calibration.toml into `folder`, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    names = list(drive.columns)
    formats = ["%.3f" if name == "t_s" else "%.0f" if name.startswith("odo") else "%.6f" for name in names]
    rows = np.column_stack(list(drive.columns.values())).tolist()
    write_table(folder / "drive.csv", names, formats, rows)
    write_table(folder / "truth.csv", TRUTH_COLUMNS, ["%.3f", "%.4f", "%.4f", "%.5f", "%.4f"], drive.truth.tolist())
    (folder / "config.toml").write_text(config_toml(grade or Grade()), encoding="utf-8")
    (folder / "calibration.toml").write_text(calibration_toml(grade or Grade()), encoding="utf-8")
