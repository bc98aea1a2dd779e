"""Decoders: what all of them are, and which one a configured sensor gets.

A decoder turns the lines of one device into samples. It is a pure function of the sequence of (stamp, line): it reads
no clock and sets no timer, so that a replayed recording gives what the live run gave.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Protocol

from .compass import CompassDecoder
from .ebimu import EbimuAsciiDecoder, EbimuHexDecoder
from .framing import HexFraming, LineFraming
from .gps import GpsDecoder
from .sample import COMPASS, IMU, MAX_GPS, SOURCES, Sample


class DecoderConfigError(ValueError):
    """A sensor's driver or an option of it does not exist, or has a value it cannot have."""


class Decoder(Protocol):
    """From the lines of one device to samples.

    `counts` has "lines", "samples" and one key for each reason for which a line gave nothing; `last_error` describes
    the last one refused, in one line.
    """

    counts: Counter[str]
    last_error: str

    def decode(self, t_us: int, line: bytes) -> Sequence[Sample]:
        """The samples that `line`, received `t_us` microseconds after the recording's start, completes."""
        ...

    def framing(self) -> LineFraming | HexFraming:
        """A fresh framing that cuts this device's bytes into lines."""
        ...


#: Drivers by kind of source, the default first.
DRIVERS: dict[str, tuple[str, ...]] = {
    "gps": ("nmea",),
    "compass": ("nmea",),
    "imu": ("ebimu-ascii", "ebimu-hex"),
}
#: Options by driver, with their type.
OPTIONS: dict[str, dict[str, type]] = {
    "nmea": {"checksum": bool},
    "ebimu-ascii": {"groups": str},
    "ebimu-hex": {"groups": str},
}


def make_decoder(source: str, driver: str, options: Mapping[str, object]) -> Decoder:
    """A fresh decoder for `source` (a name of `SOURCES`); DecoderConfigError names what is wrong and what exists.

    Options: `checksum` (bool, default true) of "nmea"; `groups` (default "gyro,accel") of the EBIMU drivers.
    """
    number = SOURCES.get(source)
    if number is None:
        raise DecoderConfigError(f"no source is called {source}{_hint(source, SOURCES)}")
    kind = "gps" if number < MAX_GPS else source
    if driver not in DRIVERS[kind]:
        raise DecoderConfigError(f"{source} has no driver {driver}; there is {' and '.join(DRIVERS[kind])}")
    known = OPTIONS[driver]
    for name, value in options.items():
        if name not in known:
            raise DecoderConfigError(f"{source}: driver {driver} has no option {name}{_hint(name, known)}")
        if not isinstance(value, known[name]):
            raise DecoderConfigError(f"{source}: option {name} is a {known[name].__name__}, not {value!r}")
    if number == IMU:
        groups = str(options.get("groups", "gyro,accel"))
        try:
            return EbimuHexDecoder(groups) if driver == "ebimu-hex" else EbimuAsciiDecoder(groups)
        except ValueError as error:
            raise DecoderConfigError(f"{source}: {error}") from error
    checksum = bool(options.get("checksum", True))
    return CompassDecoder(checksum=checksum) if number == COMPASS else GpsDecoder(number, checksum=checksum)


def _hint(name: str, known: Mapping[str, object]) -> str:
    close = get_close_matches(name, known, 1)
    return f"; did you mean {close[0]}?" if close else f"; there is {', '.join(known)}"
