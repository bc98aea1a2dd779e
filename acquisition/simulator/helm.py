"""Course plans: what the helmsman has been told, as data, and how he steers it.

A plan is a tuple of legs. A leg either steers a heading (turning the shorter way) or holds a rate of turn, and may ask
for another speed through the water; what it leaves open stays as it was.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

#: How hard the helmsman answers a heading error, 1/s: slow enough that the rudder's lag makes no overshoot.
_HEADING_GAIN = 0.3


@dataclass(frozen=True, slots=True)
class Leg:
    """One part of a course plan, `duration_s` long."""

    duration_s: float
    heading_deg: float | None = None  #: to be steered; None: the rate of turn below
    turn_dps: float = 0.0  #: rate of turn held while no heading is steered, to starboard positive
    speed_mps: float | None = None  #: through the water; None: as before
    max_turn_dps: float = 6.0  #: limit of the rate of turn towards `heading_deg`

    def __post_init__(self) -> None:
        if not self.duration_s > 0:
            raise ValueError(f"a leg lasts longer than 0 s, not {self.duration_s}")


def circle(turn_dps: float, speed_mps: float | None = None) -> Leg:
    """A full circle at `turn_dps` (negative: to port) and a few degrees more, at unchanged or given water speed."""
    return Leg(365.0 / abs(turn_dps), turn_dps=turn_dps, speed_mps=speed_mps)


def zigzag(heading_deg: float, amplitude_deg: float, leg_s: float, count: int = 2) -> tuple[Leg, ...]:
    """`count` legs of `leg_s` seconds, by turns `amplitude_deg` to starboard and to port of `heading_deg`."""
    return tuple(Leg(leg_s, (heading_deg + (-1) ** i * amplitude_deg) % 360.0) for i in range(count))


class Helm:
    """Follows a plan, over and over: the rate of turn and the speed wanted at each moment."""

    def __init__(self, plan: Sequence[Leg], speed_mps: float, prefix: Sequence[Leg] = ()) -> None:
        self._legs = [*prefix, *plan]
        self._repeat_from = len(prefix)
        self._index = -1
        self._leg_end_s = 0.0
        self.speed_mps = speed_mps  #: wanted, through the water
        self._next_leg()

    def _next_leg(self) -> None:
        self._index += 1
        if self._index == len(self._legs):
            self._index = self._repeat_from
        self._leg = self._legs[self._index]
        self._leg_end_s += self._leg.duration_s
        if self._leg.speed_mps is not None:
            self.speed_mps = self._leg.speed_mps

    def turn_rate(self, t_s: float, heading_rad: float) -> float:
        """The rate of turn wanted at `t_s` (never going back) on `heading_rad`, rad/s."""
        while t_s >= self._leg_end_s:
            self._next_leg()
        leg = self._leg
        if leg.heading_deg is None:
            return math.radians(leg.turn_dps)
        limit = math.radians(leg.max_turn_dps)
        error = math.remainder(math.radians(leg.heading_deg) - heading_rad, math.tau)
        return min(max(_HEADING_GAIN * error, -limit), limit)
