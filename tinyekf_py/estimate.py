"""The estimate: what fusion says about the boat at one point of its 100 ms grid.

`fusion` makes them, one per grid point; the heading CSV, the console and every other output are made of them. This file
needs no NumPy, as the output process has none; `estimate_array` makes arrays of them.
"""

from __future__ import annotations

from typing import NamedTuple

NAN = float("nan")

#: `Estimate.mode`, best first.
MODES = ("ok", "degraded", "dead-reckoning", "invalid")
#: `Estimate.pos_mode`, best first.
POSITION_MODES = ("gps", "dead-reckoning", "invalid")
#: Columns of the heading CSV exist for so many receivers even when fewer are configured.
MIN_GPS_COLUMNS = 3
#: So many decimals are worth giving of what is no position: no sensor tells more.
DECIMALS = 4


def decimals_of(field: str) -> int:
    """How many decimals of a number are worth giving, by its field's name."""
    return 9 if field in ("lat_deg", "lon_deg") else DECIMALS


class Estimate(NamedTuple):
    """Heading, position and what they were made of. What is not known is NaN."""

    t_us: int  #: grid point, microseconds since the recording's start
    heading_deg: float = NAN  #: true, [0, 360)
    heading_sigma_deg: float = NAN  #: one standard deviation
    rate_of_turn_dps: float = NAN  #: positive to starboard
    lat_deg: float = NAN  #: WGS-84, north positive
    lon_deg: float = NAN  #: WGS-84, east positive
    mode: str = "invalid"  #: of the heading, one of `MODES`
    pos_mode: str = "invalid"  #: of the position, one of `POSITION_MODES`
    weights: tuple[float, ...] = ()  #: per configured GPS, 0 to 3
    faz_deg: tuple[float, ...] = ()  #: per configured GPS: forward azimuth, true, [0, 360)
    gpsec_deg: float = NAN  #: the heading of stage 2, true, [0, 360)
    ekf_deg: tuple[float, ...] = ()  #: per configured GPS: heading of its filter, true, [0, 360)


def heading_columns(n_gps: int) -> tuple[str, ...]:
    """Names of the heading CSV's columns with `n_gps` receivers configured."""
    numbers = range(1, max(n_gps, MIN_GPS_COLUMNS) + 1)
    return (
        *("t_s", "heading_deg", "heading_sigma_deg", "rate_of_turn_dps", "lat_deg", "lon_deg", "mode", "pos_mode"),
        *(f"w{number}" for number in numbers),
        *(f"faz{number}_deg" for number in numbers),
        "gpsec_deg",
        *(f"ekf{number}_deg" for number in numbers),
    )
