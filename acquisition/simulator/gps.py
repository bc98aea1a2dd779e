"""Simulated GPS receivers: GGA, GSA and RMC ten times a second, as a u-blox prints them.

A receiver knows the place of its antenna, which swings around the boat's reference point as she turns and rolls. Its
position errs by what all receivers share (atmosphere), by its own reflections, and by a little white noise; its
velocity, measured by Doppler, errs apart from that. All of it grows with the HDOP.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from datetime import datetime, timedelta

from acquisition.simulator.faults import Fault, Jumps, NoFix
from acquisition.simulator.grades import GpsGrade
from acquisition.simulator.nmea import angle_field, sentence
from acquisition.simulator.noise import GaussMarkov, SmoothGaussMarkov
from acquisition.simulator.vessel import STEP_US, Motion, metres_per_degree

EPOCH_S = 0.1
#: A receiver leaves its course blank below this speed.
MIN_COURSE_SPEED_MPS = 0.2
_MPS_PER_KNOT = 1852.0 / 3600.0
_GEOID_SEPARATION_M = 25.1
_SATELLITES = (2, 5, 6, 9, 12, 13, 17, 19, 22, 25, 28, 30)
_FIX_CYCLE_S = 150.0  # mean time from one loss of the differential correction to the next
_US_PER_BYTE = 10e6 / 115200

Printed = list[tuple[int, bytes]]  # lines, each with the microseconds from the moment sensed to its arrival


class SharedError:
    """The position error, north and east in metres, that all receivers of a boat have in common."""

    def __init__(self, grade: GpsGrade, seed: object) -> None:
        rng = random.Random(f"shared gps error {seed}")
        self._north = SmoothGaussMarkov(grade.shared_m, grade.shared_time_s, EPOCH_S, rng)
        self._east = SmoothGaussMarkov(grade.shared_m, grade.shared_time_s, EPOCH_S, rng)

    def step(self) -> tuple[float, float]:
        """The error of the next epoch."""
        return self._north.step(), self._east.step()


class GpsReceiver:
    """One receiver; `antenna_m` is its antenna's place: forward, to starboard, up."""

    def __init__(
        self,
        source: str,
        grade: GpsGrade,
        antenna_m: tuple[float, float, float],
        faults: Sequence[Fault],
        start_utc: datetime,
        seed: object,
    ) -> None:
        rng = random.Random(f"{source} {seed}")
        self._rng = rng
        self._grade = grade
        self._antenna_m = antenna_m
        self._start_utc = start_utc
        self._no_fix = [fault for fault in faults if isinstance(fault, NoFix) and source in fault.sources]
        self._jumps = [fault for fault in faults if isinstance(fault, Jumps) and source in fault.sources]
        self.latency_s = rng.uniform(*grade.latency_s)
        self._own = [SmoothGaussMarkov(grade.own_m, grade.own_time_s, EPOCH_S, rng) for _ in range(3)]
        half = grade.velocity_mps / math.sqrt(2.0)
        self._velocity = [GaussMarkov(half, grade.velocity_time_s, EPOCH_S, rng) for _ in range(2)]
        self._white_velocity_mps = half
        self._log_hdop = SmoothGaussMarkov(grade.hdop_spread, 90.0, EPOCH_S, rng)
        self._has_dgps = rng.random() < grade.dgps_share
        self._jump_rng = random.Random(f"jumps of {source} {seed}")
        self._jump_m = (0.0, 0.0)
        self._jump_mps = (0.0, 0.0)
        self._next_jump_s = 0.0

    def epoch(self, motion: Motion, shared_m: tuple[float, float]) -> Printed:
        """The three sentences of the epoch at this moment, with the shared error in metres north and east."""
        gauss, grade = self._rng.gauss, self._grade
        offset, offset_rate = self._lever_arm(motion)
        # Every draw is made in every epoch, fix or not, so that a fault changes nothing but itself.
        scale = math.exp(self._log_hdop.step())
        hdop = max(0.6, grade.hdop * scale)
        own_north, own_east, own_up = (error.step() for error in self._own)
        velocity_errors = [error.step() + gauss(0.0, self._white_velocity_mps) for error in self._velocity]
        white_m = (gauss(0.0, grade.white_m), gauss(0.0, grade.white_m))
        jitter_s = abs(gauss(0.0, grade.jitter_s))
        self._change_fix_quality()
        utc = self._start_utc + timedelta(microseconds=motion.step * STEP_US)
        if any(fault.active(motion.t_s) for fault in self._no_fix):
            return self._arrivals(_sentences_without_fix(utc), jitter_s)
        jump_m, jump_mps = self._jump(motion.t_s)
        north_m = offset[0] + scale * (shared_m[0] + own_north) + white_m[0] + jump_m[0]
        east_m = offset[1] + scale * (shared_m[1] + own_east) + white_m[1] + jump_m[1]
        lat_m, lon_m = metres_per_degree(motion.lat_deg)
        north_mps = motion.north_mps + offset_rate[0] + scale * velocity_errors[0] + jump_mps[0]
        east_mps = motion.east_mps + offset_rate[1] + scale * velocity_errors[1] + jump_mps[1]
        lines = _sentences(
            utc,
            motion.lat_deg + north_m / lat_m,
            motion.lon_deg + east_m / lon_m,
            max(0.0, -offset[2] + 1.5 * scale * own_up),
            math.hypot(north_mps, east_mps),
            math.degrees(math.atan2(east_mps, north_mps)),
            2 if self._has_dgps else 1,
            hdop,
            max(4, min(12, round(12.0 - 3.0 * hdop))),
        )
        return self._arrivals(lines, jitter_s)

    def _lever_arm(self, motion: Motion) -> tuple[tuple[float, float, float], tuple[float, float]]:
        """Place of the antenna against the reference point (north, east, down; m), and its speed north and east."""
        x, y, up = self._antenna_m
        rate_x, rate_y, rate_z = motion.body_rates()
        arm = (x, y, -up)
        speed = (rate_y * -up - rate_z * y, rate_z * x + rate_x * up, rate_x * y - rate_y * x)
        north, east, down = _to_earth(motion, arm)
        north_mps, east_mps, _ = _to_earth(motion, speed)
        return (north, east, down), (north_mps, east_mps)

    def _change_fix_quality(self) -> None:
        share = self._grade.dgps_share if self._has_dgps else 1.0 - self._grade.dgps_share
        if self._rng.random() < EPOCH_S / (share * _FIX_CYCLE_S):
            self._has_dgps = not self._has_dgps

    def _jump(self, t_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Errors of position (m) and velocity (m/s), north and east, that the receiver does not admit."""
        fault = next((fault for fault in self._jumps if fault.active(t_s)), None)
        fade = math.exp(-EPOCH_S)
        self._jump_mps = (self._jump_mps[0] * fade, self._jump_mps[1] * fade)
        if fault is None:
            self._jump_m = (0.0, 0.0)
        elif t_s >= self._next_jump_s:
            self._next_jump_s = t_s + self._jump_rng.uniform(*fault.hold_s)
            direction = self._jump_rng.uniform(0.0, math.tau)
            sin, cos = math.sin(direction), math.cos(direction)
            self._jump_m = (0.0, 0.0) if any(self._jump_m) else (fault.size_m * cos, fault.size_m * sin)
            self._jump_mps = (fault.velocity_mps * cos, fault.velocity_mps * sin)
        return self._jump_m, self._jump_mps

    def _arrivals(self, lines: Sequence[bytes], jitter_s: float) -> Printed:
        # The latency is that of the closing sentence; the ones before it arrive as the wire carries them.
        last_us = (self.latency_s + jitter_s) * 1e6
        waiting = sum(len(line) + 2 for line in lines)
        printed: Printed = []
        for line in lines:
            waiting -= len(line) + 2
            printed.append((round(last_us - waiting * _US_PER_BYTE), line))
        return printed


def _to_earth(motion: Motion, vector: tuple[float, float, float]) -> tuple[float, float, float]:
    """A vector of body axes in north, east, down."""
    x, y, z = vector
    sin_roll, cos_roll = math.sin(motion.roll_rad), math.cos(motion.roll_rad)
    sin_pitch, cos_pitch = math.sin(motion.pitch_rad), math.cos(motion.pitch_rad)
    sin_yaw, cos_yaw = math.sin(motion.heading_rad), math.cos(motion.heading_rad)
    aside = cos_roll * y - sin_roll * z
    below = sin_roll * y + cos_roll * z
    ahead = cos_pitch * x + sin_pitch * below
    return ahead * cos_yaw - aside * sin_yaw, ahead * sin_yaw + aside * cos_yaw, cos_pitch * below - sin_pitch * x


def _clock(utc: datetime) -> str:
    return f"{utc.hour:02d}{utc.minute:02d}{utc.second:02d}.{utc.microsecond // 10_000:02d}"


def _date(utc: datetime) -> str:
    return f"{utc.day:02d}{utc.month:02d}{utc.year % 100:02d}"


def _sentences(
    utc: datetime,
    lat_deg: float,
    lon_deg: float,
    altitude_m: float,
    speed_mps: float,
    course_deg: float,
    fix_quality: int,
    hdop: float,
    satellites: int,
) -> list[bytes]:
    clock = _clock(utc)
    place = (
        f"{angle_field(lat_deg, 2)},{'N' if lat_deg >= 0 else 'S'},"
        f"{angle_field(lon_deg, 3)},{'E' if lon_deg >= 0 else 'W'}"
    )
    used = ",".join(f"{number:02d}" for number in _SATELLITES[:satellites]) + "," * (12 - satellites)
    course = f"{round(course_deg % 360.0, 2) % 360.0:.2f}" if speed_mps >= MIN_COURSE_SPEED_MPS else ""
    vdop = 1.5 * hdop
    return [
        sentence(
            f"GPGGA,{clock},{place},{fix_quality},{satellites:02d},{hdop:.2f},"
            f"{altitude_m:.1f},M,{_GEOID_SEPARATION_M},M,,"
        ),
        sentence(f"GPGSA,A,3,{used},{math.hypot(hdop, vdop):.2f},{hdop:.2f},{vdop:.2f}"),
        sentence(
            f"GPRMC,{clock},A,{place},{speed_mps / _MPS_PER_KNOT:.3f},{course},{_date(utc)},,,"
            f"{'D' if fix_quality == 2 else 'A'}"
        ),
    ]


def _sentences_without_fix(utc: datetime) -> list[bytes]:
    clock = _clock(utc)
    return [
        sentence(f"GPGGA,{clock},,,,,0,00,99.99,,,,,,"),
        sentence("GPGSA,A,1,,,,,,,,,,,,,99.99,99.99,99.99"),
        sentence(f"GPRMC,{clock},V,,,,,,,{_date(utc)},,,N"),
    ]
