"""The boat: where she is, how she moves, at 100 Hz. This is the truth that the simulated sensors blur.

A displacement boat of some 10 m. Through the water she makes headway `u` and, sideways, what a turn and the wind do to
her: in a turn she pivots about a point forward of midships, so that her bow points inside the turn and she slides
outwards; the wind presses her to lee. The water itself moves over the ground (set and drift). Waves roll, pitch and yaw
her and carry her to and fro; in a turn she heels outwards.

Axes and signs are those of the whole project: x forward, y starboard, z down; yaw positive to starboard, roll positive
starboard down, pitch positive bow up.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

from acquisition.simulator.helm import Helm, Leg

STEP_US = 10_000
STEP_S = STEP_US * 1e-6
GRAVITY_MPS2 = 9.80665

_WGS84_A_M = 6378137.0
_WGS84_E2 = 6.69437999014e-3

_TURN_LAG_S = 0.8  # from the rudder to the rate of turn
_SLIP_LAG_S = 1.0  # from the rate of turn to the sideslip
_SPEED_LAG_S = 4.0
_MAX_ACCELERATION_MPS2 = 0.3
_PIVOT_FORWARD_M = 1.8  # sideslip per rate of turn: 4 degrees of drift angle at 5 m/s and 10 degrees/s
_HEEL_PER_LATERAL_G = 0.6  # rad of outward heel per g of centripetal acceleration


@dataclass(frozen=True, slots=True)
class Sea:
    """What the waves do to the boat: RMS values of each motion, and their period."""

    period_s: float = 4.5
    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0
    surge_mps: float = 0.0
    sway_mps: float = 0.0
    heave_mps: float = 0.0


@dataclass(frozen=True, slots=True)
class Waters:
    """Where the boat is and what moves her there, apart from her own engine."""

    lat_deg: float = 35.96
    lon_deg: float = 126.52
    variation_deg: float = -8.0  #: magnetic, east positive
    set_deg: float = 0.0  #: direction in which the water moves, true
    drift_mps: float = 0.0  #: its speed
    wind_from_deg: float = 250.0  #: true
    leeway_deg: float = 0.3  #: with the wind abeam
    sea: Sea = Sea()


class Motion:
    """The state of motion at one moment: all that a sensor can sense. Changed in place from step to step."""

    __slots__ = (
        "accel_down",
        "accel_east",
        "accel_north",
        "down_mps",
        "east_mps",
        "heading_rad",
        "lat_deg",
        "lon_deg",
        "north_mps",
        "pitch_rad",
        "pitch_rate",
        "roll_rad",
        "roll_rate",
        "step",
        "yaw_rate",
    )

    def __init__(self) -> None:
        self.step = 0  #: number of the 100 Hz step
        self.lat_deg = self.lon_deg = 0.0  #: WGS-84, of the boat's reference point
        self.heading_rad = 0.0  #: true; goes on over a full circle, never wrapped
        self.roll_rad = self.pitch_rad = 0.0
        self.yaw_rate = self.roll_rate = self.pitch_rate = 0.0  #: rad/s, of the three angles (not body rates)
        self.north_mps = self.east_mps = self.down_mps = 0.0  #: over ground, of the reference point
        self.accel_north = self.accel_east = self.accel_down = 0.0  #: m/s^2

    @property
    def t_s(self) -> float:
        """Seconds since the start."""
        return self.step * STEP_US / 1e6

    @property
    def heading_deg(self) -> float:
        """True heading, [0, 360)."""
        return math.degrees(self.heading_rad) % 360.0

    def body_rates(self) -> tuple[float, float, float]:
        """What a perfect gyro reads, rad/s about x, y, z."""
        sin_roll, cos_roll = math.sin(self.roll_rad), math.cos(self.roll_rad)
        sin_pitch, cos_pitch = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        return (
            self.roll_rate - self.yaw_rate * sin_pitch,
            self.pitch_rate * cos_roll + self.yaw_rate * cos_pitch * sin_roll,
            -self.pitch_rate * sin_roll + self.yaw_rate * cos_pitch * cos_roll,
        )

    def body_gravity(self) -> tuple[float, float, float]:
        """What a perfect accelerometer reads as the local gravity vector, g in body axes: level at rest (0, 0, 1)."""
        sin_yaw, cos_yaw = math.sin(self.heading_rad), math.cos(self.heading_rad)
        x = -(self.accel_north * cos_yaw + self.accel_east * sin_yaw) / GRAVITY_MPS2
        y = (self.accel_north * sin_yaw - self.accel_east * cos_yaw) / GRAVITY_MPS2
        z = 1.0 - self.accel_down / GRAVITY_MPS2
        sin_roll, cos_roll = math.sin(self.roll_rad), math.cos(self.roll_rad)
        sin_pitch, cos_pitch = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        along = sin_pitch * x + cos_pitch * z
        return (
            cos_pitch * x - sin_pitch * z,
            sin_roll * along + cos_roll * y,
            cos_roll * along - sin_roll * y,
        )


def metres_per_degree(lat_deg: float) -> tuple[float, float]:
    """Metres per degree of latitude and of longitude at `lat_deg` on WGS-84."""
    lat = math.radians(lat_deg)
    w2 = 1.0 - _WGS84_E2 * math.sin(lat) ** 2
    prime_vertical = _WGS84_A_M / math.sqrt(w2)
    return math.radians(prime_vertical * (1.0 - _WGS84_E2) / w2), math.radians(prime_vertical * math.cos(lat))


class _Waves:
    """Three sinusoids near one period, of which each motion is its own mixture: irregular, smooth, differentiable."""

    def __init__(self, sea: Sea, rng: random.Random) -> None:
        base = math.tau / sea.period_s
        self._omega = tuple(base * factor * rng.uniform(0.93, 1.07) for factor in (0.72, 1.0, 1.31))
        scales = (sea.roll_deg, sea.pitch_deg, sea.yaw_deg, sea.surge_mps, sea.sway_mps, sea.heave_mps)
        self._mixtures = tuple(self._mixture(scale, rng) for scale in scales)
        self.is_calm = not any(scales)

    @staticmethod
    def _mixture(rms: float, rng: random.Random) -> tuple[float, ...]:
        mixture: list[float] = []
        for share in (0.3, 0.5, 0.2):
            amplitude, phase = rms * math.sqrt(2.0 * share), rng.uniform(0.0, math.tau)
            mixture += (amplitude * math.cos(phase), amplitude * math.sin(phase))
        return tuple(mixture)

    def at(self, t_s: float) -> list[tuple[float, float]]:
        """Value and derivative (per second) of roll, pitch, yaw (degrees), surge, sway and heave velocity (m/s)."""
        w1, w2, w3 = self._omega
        s1, c1 = math.sin(w1 * t_s), math.cos(w1 * t_s)
        s2, c2 = math.sin(w2 * t_s), math.cos(w2 * t_s)
        s3, c3 = math.sin(w3 * t_s), math.cos(w3 * t_s)
        return [
            (
                a1 * s1 + b1 * c1 + a2 * s2 + b2 * c2 + a3 * s3 + b3 * c3,
                w1 * (a1 * c1 - b1 * s1) + w2 * (a2 * c2 - b2 * s2) + w3 * (a3 * c3 - b3 * s3),
            )
            for a1, b1, a2, b2, a3, b3 in self._mixtures
        ]


_CALM = [(0.0, 0.0)] * 6


class Vessel:
    """Sails a plan in the given waters; `motion` is her state, `advance` takes it one step (10 ms) further."""

    def __init__(
        self,
        plan: Sequence[Leg],
        waters: Waters,
        *,
        heading_deg: float,
        speed_mps: float,
        seed: object = 0,
        prefix: Sequence[Leg] = (),
    ) -> None:
        self.motion = Motion()
        self._helm = Helm(plan, speed_mps, prefix)
        self._waves = _Waves(waters.sea, random.Random(f"waves {seed}"))
        self._set_rad = math.radians(waters.set_deg)
        self._drift_mps = waters.drift_mps
        self._wind_from_rad = math.radians(waters.wind_from_deg)
        self._leeway = math.tan(math.radians(waters.leeway_deg))
        self._course_rad = math.radians(heading_deg)  # the heading without the waves' yaw
        self._turn_rate = 0.0
        self._turn_rate_change = 0.0
        self._speed_mps = speed_mps
        self._slip_mps = 0.0
        self.motion.lat_deg, self.motion.lon_deg = waters.lat_deg, waters.lon_deg
        self._m_per_deg = metres_per_degree(waters.lat_deg)
        self._place()
        # At the start there is no step before this one to take the acceleration from.
        self.motion.accel_north = self.motion.accel_east = self.motion.accel_down = 0.0

    def advance(self) -> None:
        """Go on by one step of 10 ms."""
        motion = self.motion
        motion.step += 1
        wanted_rate = self._helm.turn_rate(motion.t_s, self._course_rad)
        self._turn_rate_change = (wanted_rate - self._turn_rate) / _TURN_LAG_S
        before = self._turn_rate
        self._turn_rate += self._turn_rate_change * STEP_S
        self._course_rad += 0.5 * (before + self._turn_rate) * STEP_S
        push = (self._helm.speed_mps - self._speed_mps) / _SPEED_LAG_S
        self._speed_mps += min(max(push, -_MAX_ACCELERATION_MPS2), _MAX_ACCELERATION_MPS2) * STEP_S
        self._slip_mps += (-_PIVOT_FORWARD_M * self._turn_rate - self._slip_mps) * STEP_S / _SLIP_LAG_S
        north_mps, east_mps = motion.north_mps, motion.east_mps
        self._place()
        if motion.step % 100 == 0:
            self._m_per_deg = metres_per_degree(motion.lat_deg)
        lat_m, lon_m = self._m_per_deg
        motion.lat_deg += 0.5 * (north_mps + motion.north_mps) * STEP_S / lat_m
        motion.lon_deg += 0.5 * (east_mps + motion.east_mps) * STEP_S / lon_m

    def _place(self) -> None:
        """Attitude, rates, velocity and acceleration of this step into `motion`."""
        motion = self.motion
        waves = _CALM if self._waves.is_calm else self._waves.at(motion.t_s)
        (roll, roll_rate), (pitch, pitch_rate), (yaw, yaw_rate), (surge, _), (sway, _), (heave, _) = waves
        heel = -_HEEL_PER_LATERAL_G / GRAVITY_MPS2
        motion.heading_rad = self._course_rad + math.radians(yaw)
        motion.yaw_rate = self._turn_rate + math.radians(yaw_rate)
        motion.roll_rad = heel * self._speed_mps * self._turn_rate + math.radians(roll)
        motion.roll_rate = heel * self._speed_mps * self._turn_rate_change + math.radians(roll_rate)
        motion.pitch_rad = math.radians(pitch)
        motion.pitch_rate = math.radians(pitch_rate)
        leeway = -self._leeway * self._speed_mps * math.sin(self._wind_from_rad - motion.heading_rad)
        ahead = self._speed_mps + surge
        aside = self._slip_mps + leeway + sway
        sin_yaw, cos_yaw = math.sin(motion.heading_rad), math.cos(motion.heading_rad)
        north = ahead * cos_yaw - aside * sin_yaw + self._drift_mps * math.cos(self._set_rad)
        east = ahead * sin_yaw + aside * cos_yaw + self._drift_mps * math.sin(self._set_rad)
        motion.accel_north = (north - motion.north_mps) / STEP_S
        motion.accel_east = (east - motion.east_mps) / STEP_S
        motion.accel_down = (heave - motion.down_mps) / STEP_S
        motion.north_mps, motion.east_mps, motion.down_mps = north, east, heave
