"""What goes wrong on a voyage, as values: which sensor, from when to when (seconds of the run), and how."""

from __future__ import annotations

import math
from dataclasses import dataclass

ALL_GPS = ("gps1", "gps2", "gps3")


@dataclass(frozen=True, slots=True)
class Fault:
    """Something wrong with `sources` between `start_s` and `end_s`."""

    start_s: float
    end_s: float = math.inf
    sources: tuple[str, ...] = ()

    def active(self, t_s: float) -> bool:
        """Whether it is so at `t_s`."""
        return self.start_s <= t_s < self.end_s


@dataclass(frozen=True, slots=True)
class Silence(Fault):
    """The device prints nothing: a broken cable, a blown fuse."""


@dataclass(frozen=True, slots=True)
class NoFix(Fault):
    """The receiver goes on printing, without a fix: a bridge, a jammer."""

    sources: tuple[str, ...] = ALL_GPS


@dataclass(frozen=True, slots=True)
class Jumps(Fault):
    """The receiver's position jumps to and fro while its fix quality and HDOP stay good: reflections of a quay."""

    size_m: float = 25.0
    hold_s: tuple[float, float] = (3.0, 12.0)  #: range of the time from one jump to the next
    velocity_mps: float = 1.5  #: speed error that a jump leaves in the receiver's filter for about a second


@dataclass(frozen=True, slots=True)
class Disturbance(Fault):
    """Iron or a current near the compass turns its field."""

    sources: tuple[str, ...] = ("compass",)
    offset_deg: float = 35.0  #: added to the magnetic heading that the compass senses
    ramp_s: float = 3.0  #: time in which it comes and goes

    def offset_at(self, t_s: float) -> float:
        """The offset at `t_s`, degrees."""
        if not self.active(t_s):
            return 0.0
        return self.offset_deg * min(1.0, (t_s - self.start_s) / self.ramp_s, (self.end_s - t_s) / self.ramp_s)
