"""A small boat that is sailed into samples: the raw material of the reference streams.

Everything comes from one seed through the standard library's generator and is rounded as a device would print it, so
that the same samples come out on every machine. The devices are crude on purpose; the realistic boat is
`acquisition.simulator`.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from acquisition.sample import COMPASS, IMU, CompassSample, GpsSample, ImuSample, Sample

NAN = float("nan")
STEP_US = 10_000
EARTH_RADIUS_M = 6_371_000.0


class TaskSwitch(NamedTuple):
    """A task stopped or started between two samples."""

    t_us: int
    name: str
    running: bool


class Loss(NamedTuple):
    """A port hung up between two samples."""

    t_us: int
    name: str


Item = Sample | TaskSwitch | Loss


@dataclass(frozen=True, slots=True)
class Boat:
    """Where the boat starts, how it is steered and what it carries."""

    seed: int
    duration_s: float = 30.0
    lat_deg: float = 35.96
    lon_deg: float = 126.52
    heading_deg: float = 0.0
    speed_mps: float = 5.0
    rate_dps: Callable[[float], float] = field(default=lambda t_s: 3.0 * math.cos(t_s))
    roll_deg: Callable[[float], float] = field(default=lambda t_s: 5.0 * math.sin(0.8 * t_s))
    pitch_deg: float = 1.5
    start_us: int = 0
    gps: tuple[int, ...] = (0, 1, 2)
    gps_period_us: int = 100_000
    compass: bool = True
    compass_error_deg: float = 0.0
    imu: bool = True


def turn(rate_dps: float) -> Callable[[float], float]:
    """A steady turn."""
    return lambda t_s: rate_dps


def sail(boat: Boat) -> list[Sample]:
    """Samples of a voyage in the order of their stamps."""
    chance = random.Random(boat.seed)
    lat, lon, heading = boat.lat_deg, boat.lon_deg, boat.heading_deg
    samples: list[Sample] = []
    gps_bias = {i: (chance.gauss(0.0, 2e-6), chance.gauss(0.0, 2e-6)) for i in boat.gps}
    for step in range(round(boat.duration_s * 1e6) // STEP_US):
        t_us = boat.start_us + step * STEP_US
        t_s = step * STEP_US / 1e6
        rate = boat.rate_dps(t_s)
        heading += rate * STEP_US / 1e6
        north = boat.speed_mps * math.cos(math.radians(heading)) * STEP_US / 1e6
        east = boat.speed_mps * math.sin(math.radians(heading)) * STEP_US / 1e6
        lat += math.degrees(north / EARTH_RADIUS_M)
        lon += math.degrees(east / EARTH_RADIUS_M / math.cos(math.radians(lat)))
        if boat.imu:
            samples.append(_imu(chance, boat, t_us, t_s, rate))
        for i in boat.gps:
            if (step * STEP_US) % boat.gps_period_us == 20_000 + 10_000 * i:
                place = (lat + gps_bias[i][0], lon + gps_bias[i][1])
                samples.append(_gps(chance, boat, t_us + 137 * (i + 1), i, place, heading))
        if boat.compass and step % 10 == 7:
            reading = (heading + boat.compass_error_deg + chance.gauss(0.0, 1.0)) % 360.0
            samples.append(CompassSample(t_us + 811, COMPASS, heading_deg=round(reading, 1)))
    return samples


def _imu(chance: random.Random, boat: Boat, t_us: int, t_s: float, rate_dps: float) -> ImuSample:
    roll = math.radians(boat.roll_deg(t_s))
    pitch = math.radians(boat.pitch_deg)
    roll_rate = boat.roll_deg(t_s + 0.005) - boat.roll_deg(t_s - 0.005)
    gyro = (
        roll_rate / 0.01 - rate_dps * math.sin(pitch),
        rate_dps * math.cos(pitch) * math.sin(roll),
        rate_dps * math.cos(pitch) * math.cos(roll),
    )
    accel = (-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll))
    gx, gy, gz = (round(value + chance.gauss(0.05, 0.1), 3) for value in gyro)
    ax, ay, az = (round(value + chance.gauss(0.0, 0.01), 4) for value in accel)
    return ImuSample(t_us, IMU, gyro_x_dps=gx, gyro_y_dps=gy, gyro_z_dps=gz, accel_x_g=ax, accel_y_g=ay, accel_z_g=az)


def _gps(
    chance: random.Random, boat: Boat, t_us: int, i: int, place: tuple[float, float], heading_deg: float
) -> GpsSample:
    lat = place[0] + chance.gauss(0.0, 3e-7)
    lon = place[1] + chance.gauss(0.0, 3e-7)
    return GpsSample(
        t_us,
        i,
        fix_quality=chance.choice((1, 2, 2, 4)),
        lat_deg=round(lat, 9),
        lon_deg=round((lon + 180.0) % 360.0 - 180.0, 9),
        speed_mps=round(max(0.0, boat.speed_mps + chance.gauss(0.0, 0.1)), 3),
        course_deg=round((heading_deg + chance.gauss(0.0, 2.0)) % 360.0, 2),
        hdop=round(chance.uniform(0.7, 2.4), 2),
        satellites=8,
    )


def between(start_s: float, end_s: float, item: Sample) -> bool:
    return start_s * 1e6 <= item.t_us < end_s * 1e6


def without(samples: Iterable[Sample], gone: Callable[[Sample], bool]) -> list[Sample]:
    return [sample for sample in samples if not gone(sample)]
