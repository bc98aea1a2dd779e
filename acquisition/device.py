"""A device as the config describes it, and what the program knows about it while it runs.

`DeviceSettings` goes from the config to the supervisor and on to the worker; `DeviceState` is kept by the supervisor
and read by the console and the outputs.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

from acquisition.message import CLOSED, OPEN
from acquisition.sample import SOURCES

#: Counters that tell of work done; every other one counts something dropped, by its reason.
_WORK = frozenset(("lines", "samples", "bytes", "unused", "wakeups", "opens", "down_ms"))


class DeviceError(ValueError):
    """Settings of a device that cannot be right, whatever is plugged in."""


@dataclass(frozen=True, slots=True)
class DeviceSettings:
    """Where a device is and how it speaks.

    `options` go to the decoder (`acquisition.decoder.make_decoder`); of them the worker itself takes `period_ms`, the
    time between two lines or bursts of lines (without it, it is learned from the device).
    """

    name: str  #: the source: gps1 to gps8, compass, imu
    port: str  #: a device path, or a URL as pyserial's serial_for_url opens it
    driver: str  #: of the decoder: nmea, ebimu-ascii, ebimu-hex
    baud: int = 115200  #: bits per second; a pty and a network port ignore it
    enabled: bool = True  #: polled from the start
    options: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.name not in SOURCES:
            raise DeviceError(f"device {self.name!r}: no such source; there are {', '.join(SOURCES)}")
        if not self.port:
            raise DeviceError(f"device {self.name}: the port is empty; give a path such as /dev/fjGPS1, or a URL")
        if not 0 < self.baud <= 10_000_000:
            raise DeviceError(f"device {self.name}: {self.baud} baud; give bits per second, e.g. 115200")


@dataclass(slots=True)
class DeviceState:
    """What is known about a device now; counters go on across restarts of its worker."""

    name: str
    polling: bool  #: wanted to run; False when the user stopped it
    port_state: str = CLOSED  #: one of `acquisition.message.PORT_STATES`
    port_text: str = ""  #: why, for people
    pid: int = 0  #: of the worker; 0 when there is none
    restarts: int = 0  #: of the worker, since the program started
    last_line_us: int = -1  #: stamp of the last line, microseconds since the start; -1 before the first
    measured_hz: float = float("nan")  #: samples per second when they were last counted; NaN before that
    counts: Counter[str] = field(default_factory=Counter)  #: lines, samples, bytes, and what was dropped, by reason
    last_error: str = ""  #: of the decoder or the worker, one line

    @property
    def rate_hz(self) -> float:
        """Samples per second over the last second or so; NaN before that has passed, and while none can come."""
        return self.measured_hz if self.polling and self.port_state == OPEN else float("nan")

    @property
    def dropped(self) -> dict[str, int]:
        """Lines and bytes dropped since the start, by reason."""
        return {reason: count for reason, count in self.counts.items() if reason not in _WORK and count}

    @property
    def errors(self) -> int:
        """Lines and bytes dropped, for any reason, since the start."""
        return sum(self.dropped.values())
