"""The current, from a swing: at constant water speed the ground velocity of a turning boat draws a circle around it.

The boat's sideslip in the turn changes where on the circle she is at a heading, not the circle. Two legs on opposite
headings at one water speed show it too; but nothing in a recording says that the speed was the same: the user does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tinyekf_py.calibrate.track import Floats, Track

#: A swing turns at least so far, degrees, the same way, at least so fast, degrees/s.
MIN_TURN_DEG = 300.0
MIN_RATE_DPS = 1.2
MIN_WATER_SPEED_MPS = 0.8
#: The water speed counts as constant while the velocities lie so near to their circle (RMS) and its radius changes no
#: more than by the other from the first third of the swing to the last: m/s, or this share of the radius.
MAX_RESIDUAL_MPS = 0.14
MAX_CHANGE_MPS = 0.1
MAX_SHARE = 0.03

#: A leg is as long, its ends left out, and turns no faster; two are reciprocal when their headings differ by so much.
MIN_LEG_S = 30
MAX_LEG_RATE_DPS = 1.0
MIN_BETWEEN_DEG = 150.0

_LEG_ENDS = 8  # bins in which she still gains speed
_LEG_SIGMA_MPS = 0.05  # how well "the same speed" is kept
_LEG_SIGMA_DEG = 2.0  # of the compass, from one heading to the opposite one
_SMOOTH = 5  # bins
_LEAD = 6  # bins at the beginning of a turn in which she still loses speed
_CORRELATED = 3.0  # neighbouring bins err alike (waves, receivers): so many count as one


@dataclass(frozen=True, slots=True)
class Current:
    """A current and how well it is known."""

    north_mps: float
    east_mps: float
    sigma_mps: float  #: of either component
    water_speed_mps: float  #: in the swing
    swings: int
    pairs: int = 0  #: of reciprocal legs

    @property
    def set_deg(self) -> float:
        """Direction in which the water moves, true."""
        return math.degrees(math.atan2(self.east_mps, self.north_mps)) % 360.0

    @property
    def drift_mps(self) -> float:
        """Its speed."""
        return math.hypot(self.north_mps, self.east_mps)


def find_current(track: Track) -> Current | None:
    """The current as the centre of the circles of all swings in a track; None without a swing at constant speed."""
    return combined(list(_found(track)))


def combined(found: Sequence[Current]) -> Current | None:
    """The weighted mean of several swings' currents."""
    if not found:
        return None
    weights = np.array([current.sigma_mps**-2.0 for current in found])
    total = float(weights.sum())
    return Current(
        float(np.dot(weights, [current.north_mps for current in found]) / total),
        float(np.dot(weights, [current.east_mps for current in found]) / total),
        total**-0.5,
        float(np.dot(weights, [current.water_speed_mps for current in found]) / total),
        sum(current.swings for current in found),
        sum(current.pairs for current in found),
    )


def current_by_legs(track: Track) -> Current | None:
    """The current by all pairs of reciprocal legs, sailed at the same water speed; None when there is none."""
    legs = _legs(track)
    return combined([pair for i, one in enumerate(legs) for other in legs[i + 1 :] if (pair := _pair(one, other))])


def _legs(track: Track) -> list[tuple[float, float, float]]:
    """Ground velocity north and east, m/s, and compass heading, rad, of each straight leg."""
    straight = (np.abs(track.smooth_rate_dps(_SMOOTH)) < MAX_LEG_RATE_DPS).astype(int)
    straight[1:][np.diff(track.t_s) > 3.0] = 0
    edges = np.flatnonzero(np.diff(straight, prepend=0, append=0))
    legs = []
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        part = slice(int(start) + _LEG_ENDS, int(stop) - 2)
        if part.stop - part.start < MIN_LEG_S:
            continue
        angle = np.exp(1j * np.radians(track.compass_deg[part])).mean()
        legs.append((float(track.north_mps[part].mean()), float(track.east_mps[part].mean()), float(np.angle(angle))))
    return legs


def _pair(one: tuple[float, float, float], other: tuple[float, float, float]) -> Current | None:
    """The point from which both velocities are as long, and as far apart in direction as the compass says."""
    between = math.remainder(other[2] - one[2], math.tau)
    if abs(between) < math.radians(MIN_BETWEEN_DEG):
        return None
    north, east = other[0] - one[0], other[1] - one[1]
    speed = math.hypot(north, east) / (2.0 * math.sin(abs(between) / 2.0))
    if speed < MIN_WATER_SPEED_MPS:
        return None
    heading = math.atan2(east, north) - between / 2.0 - math.copysign(math.pi / 2.0, between)
    sigma = math.hypot(_LEG_SIGMA_MPS, speed * math.radians(_LEG_SIGMA_DEG) / 2.0)
    return Current(
        one[0] - speed * math.cos(heading), one[1] - speed * math.sin(heading), sigma, speed, swings=0, pairs=1
    )


def _found(track: Track) -> Iterator[Current]:
    for part in swings(track):
        current = _circle(track.north_mps[part], track.east_mps[part])
        if current is not None:
            yield current


def swings(track: Track) -> list[slice]:
    """Where the boat turned by `MIN_TURN_DEG` or more, all the same way, without a gap."""
    smooth = track.smooth_rate_dps(_SMOOTH)
    parts = []
    for sign in (1.0, -1.0):
        turning = sign * smooth > MIN_RATE_DPS
        follows = np.concatenate([[False], turning[1:] & turning[:-1] & (np.diff(track.t_s) < 3.0)])
        starts = np.flatnonzero(turning & ~follows)
        for start in starts:
            stops = np.flatnonzero(~follows[start + 1 :])
            stop = start + 1 + int(stops[0]) if len(stops) else len(turning)
            begin = min(int(start) + _LEAD, stop)
            steps = np.diff(track.t_s[begin:stop])
            if float(np.sum(sign * track.rate_dps[begin : stop - 1] * steps)) >= MIN_TURN_DEG:
                parts.append(slice(begin, stop))
    return sorted(parts, key=lambda part: part.start)


def _circle(north: Floats, east: Floats) -> Current | None:
    """Centre and radius by least squares of the radial distances; None where they do not lie on a circle."""
    a = np.stack([2.0 * north, 2.0 * east, np.ones_like(north)], axis=1)
    x, y, rest = np.linalg.lstsq(a, north**2 + east**2, rcond=None)[0]
    radius = math.sqrt(max(rest + x * x + y * y, 1e-9))
    jacobian = residuals = np.empty(0)
    for _ in range(20):
        dn, de = north - x, east - y
        distance = np.maximum(np.hypot(dn, de), 1e-6)
        residuals = distance - radius
        jacobian = np.stack([-dn / distance, -de / distance, -np.ones_like(dn)], axis=1)
        step = np.linalg.lstsq(jacobian, -residuals, rcond=None)[0]
        x, y, radius = x + step[0], y + step[1], radius + step[2]
    rms = float(np.sqrt(np.mean(residuals**2)))
    third = len(residuals) // 3
    change = abs(float(np.mean(residuals[-third:]) - np.mean(residuals[:third])))
    most = MAX_SHARE * radius
    if radius < MIN_WATER_SPEED_MPS or rms > max(MAX_RESIDUAL_MPS, most) or change > max(MAX_CHANGE_MPS, most):
        return None
    covariance = rms**2 * _CORRELATED * np.linalg.inv(jacobian.T @ jacobian)
    sigma = math.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1]))
    return Current(float(x), float(y), sigma, float(radius), 1)
