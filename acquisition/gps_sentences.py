"""What each GPS sentence says, as values: GGA, RMC, GNS and GLL give a time and a position; VTG, GSA and ZDA add to it.

Every function takes the fields of one sentence (without address and checksum) and raises ValueError when their number
or one of the values cannot be true: a sentence with one impossible value is not believed in the rest either. A field
that is blank is missing.

Two exceptions, for what real receivers send. Numbers beside "no fix" (status V, quality 0, mode N) are never looked at:
some put 8960 degrees there. And a date or a variation that cannot be is missing, and the position beside it stands:
firmware past its GPS week rollover sends the year -1, others 999.9 for an unknown variation.
"""

from __future__ import annotations

from datetime import date
from functools import lru_cache
from typing import NamedTuple

from .nmea import angle_deg, latitude_deg, longitude_deg, number, time_of_day_s
from .sample import NAN

KNOT_MPS = 1852.0 / 3600.0
KMH_MPS = 1.0 / 3.6

DAY_S = 86400.0
_EPOCH_ORDINAL = date(1970, 1, 1).toordinal()

#: Mode indicator of RMC, GLL and GNS -> fix quality as in GGA.
QUALITY_OF_MODE = {"A": 1, "D": 2, "P": 3, "R": 4, "F": 5, "E": 6, "M": 7, "S": 8, "N": 0}
#: GNS has a mode per constellation; the best of them tells what the solution is.
_GNS_BEST_FIRST = "RFPDAEMS"

_MAX_SPEED_KNOTS = 2000.0
_MAX_DOP = 1e4


class Reading(NamedTuple):
    """One sentence with a position."""

    tod_s: float | None  #: UTC, seconds since midnight; None where the receiver does not know it yet
    quality: int = 0  #: fix quality as in GGA; 0 no fix, -1 not said
    lat_deg: float = NAN
    lon_deg: float = NAN
    speed_mps: float = NAN
    course_deg: float = NAN
    altitude_m: float = NAN
    day_s: float = NAN  #: midnight of the UTC date, seconds since 1970
    variation_deg: float = NAN  #: east positive
    satellites: int = -1
    hdop: float = NAN

    @property
    def has_position(self) -> bool:
        return self.lat_deg == self.lat_deg and self.lon_deg == self.lon_deg

    def says_more_or_other_than(self, first: Reading) -> bool:
        """Whether this is not merely the solution of `first` as another constellation's talker counts it."""
        return self.has_position and self[:-2] != first[:-2]


def read_gga(fields: list[str]) -> Reading:
    """Time, position, quality, satellites, HDOP, altitude."""
    if not 13 <= len(fields) <= 15:
        raise ValueError(f"GGA has 14 fields, not {len(fields)}")
    quality = int(fields[5]) if fields[5] else -1
    satellites = int(fields[6]) if fields[6] else -1
    if not (-1 <= quality <= 9 and -1 <= satellites < 200):
        raise ValueError(f"quality {fields[5]} or number of satellites {fields[6]} cannot be")
    tod_s = time_of_day_s(fields[0])
    hdop = number(fields[7], 0.0, _MAX_DOP)
    if quality == 0:
        return Reading(tod_s, satellites=satellites, hdop=hdop)
    return Reading(
        tod_s,
        quality,
        latitude_deg(fields[1], fields[2]),
        longitude_deg(fields[3], fields[4]),
        NAN,
        NAN,
        number(fields[8], -2e4, 1e6),
        NAN,
        NAN,
        satellites,
        hdop,
    )


def read_rmc(fields: list[str]) -> Reading:
    """Time, status, position, speed, course, date, variation, mode; status V or mode N means no fix."""
    count = len(fields)
    if not 11 <= count <= 14:
        raise ValueError(f"RMC has 11 to 13 fields, not {count}")
    tod_s = time_of_day_s(fields[0])
    day_s = day_of_ddmmyy(fields[8])
    quality = _quality(fields[1], fields[11] if count > 11 else "")
    if quality == 0:
        return Reading(tod_s, day_s=day_s)
    return Reading(
        tod_s,
        quality,
        latitude_deg(fields[2], fields[3]),
        longitude_deg(fields[4], fields[5]),
        number(fields[6], 0.0, _MAX_SPEED_KNOTS) * KNOT_MPS,
        angle_deg(fields[7]),
        NAN,
        day_s,
        _variation_deg(fields[9], fields[10]),
    )


def read_gns(fields: list[str]) -> Reading:
    """Time, position, a mode per constellation, satellites, HDOP, altitude."""
    if not 12 <= len(fields) <= 13:
        raise ValueError(f"GNS has 12 or 13 fields, not {len(fields)}")
    modes = fields[5]
    quality = next((QUALITY_OF_MODE[mode] for mode in _GNS_BEST_FIRST if mode in modes), 0 if modes else -1)
    tod_s = time_of_day_s(fields[0])
    satellites = int(number(fields[6], 0.0, 200.0)) if fields[6] else -1
    hdop = number(fields[7], 0.0, _MAX_DOP)
    if quality == 0:
        return Reading(tod_s, satellites=satellites, hdop=hdop)
    return Reading(
        tod_s,
        quality,
        latitude_deg(fields[1], fields[2]),
        longitude_deg(fields[3], fields[4]),
        altitude_m=number(fields[8], -2e4, 1e6),
        satellites=satellites,
        hdop=hdop,
    )


def read_gll(fields: list[str]) -> Reading:
    """Position, time, status, mode."""
    count = len(fields)
    if not 6 <= count <= 7:
        raise ValueError(f"GLL has 6 or 7 fields, not {count}")
    tod_s = time_of_day_s(fields[4])
    quality = _quality(fields[5], fields[6] if count > 6 else "")
    if quality == 0:
        return Reading(tod_s)
    return Reading(
        tod_s,
        quality,
        latitude_deg(fields[0], fields[1]),
        longitude_deg(fields[2], fields[3]),
    )


def read_vtg(fields: list[str]) -> tuple[float, float]:
    """Speed over ground in m/s and course in degrees; both missing in mode N."""
    count = len(fields)
    if not 8 <= count <= 9:
        raise ValueError(f"VTG has 8 or 9 fields, not {count}")
    if count > 8 and fields[8] == "N":
        return NAN, NAN
    course_deg = angle_deg(fields[0])
    if fields[4]:
        speed_mps = number(fields[4], 0.0, _MAX_SPEED_KNOTS) * KNOT_MPS
    else:
        speed_mps = number(fields[6], 0.0, _MAX_SPEED_KNOTS) * KMH_MPS
    return speed_mps, course_deg


def read_gsa(fields: list[str]) -> float:
    """HDOP. GSA names 12 satellites; a form with 24 exists."""
    count = len(fields)
    if not (17 <= count <= 18 or count == 29):
        raise ValueError(f"GSA has 17 or 18 fields, not {count}")
    return number(fields[27 if count == 29 else 15], 0.0, _MAX_DOP)


def read_zda(fields: list[str]) -> tuple[float | None, float]:
    """Time of day in seconds, and midnight of the date in seconds since 1970; None and NaN where blank."""
    if not 4 <= len(fields) <= 6:
        raise ValueError(f"ZDA has 6 fields, not {len(fields)}")
    return time_of_day_s(fields[0]), _midnight_s(fields[3], fields[2], fields[1])


def _quality(status: str, mode: str) -> int:
    if status == "A":
        return QUALITY_OF_MODE.get(mode, 1)
    if status == "V" or not status:
        return 0
    raise ValueError(f"the status {status} is neither A nor V")


def _variation_deg(text: str, side: str) -> float:
    if side not in ("E", "W"):  # blank, or left out as one receiver does
        return NAN
    variation_deg = number(text, -1e4, 1e4)
    if abs(variation_deg) <= 180.0:
        return -variation_deg if side == "W" else variation_deg
    return NAN


@lru_cache(maxsize=16)
def day_of_ddmmyy(text: str) -> float:
    """Midnight of an RMC date in seconds since 1970; the years 80 to 99 are 1980 to 1999. NaN for no date."""
    if len(text) != 6:
        return NAN
    year = text[4:]
    return _midnight_s(("19" if year >= "80" else "20") + year, text[2:4], text[:2])


def _midnight_s(year: str, month: str, day: str) -> float:
    if not (year.isdigit() and month.isdigit() and day.isdigit()):
        return NAN
    try:
        return (date(int(year), int(month), int(day)).toordinal() - _EPOCH_ORDINAL) * DAY_S
    except ValueError:
        return NAN
