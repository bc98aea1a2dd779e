"""The estimate: what fusion says about the boat at one point of its 100 ms grid.

`fusion` makes them, one per grid point; the heading CSV, the console and every other output are made of them. As rows
of a NumPy structured array (`estimates_to_array`) they have the heading CSV's column names.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

NAN = float("nan")

#: `Estimate.mode`, best first.
MODES = ("ok", "degraded", "dead-reckoning", "invalid")
#: `Estimate.pos_mode`, best first.
POSITION_MODES = ("gps", "dead-reckoning", "invalid")
#: Columns of the heading CSV exist for so many receivers even when fewer are configured.
MIN_GPS_COLUMNS = 3


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


def estimate_dtype(n_gps: int) -> np.dtype[Any]:
    """The structured dtype of estimates: float64 for every column of `heading_columns`, text for the two modes."""
    return np.dtype([(name, "U14" if name in ("mode", "pos_mode") else "f8") for name in heading_columns(n_gps)])


def estimates_to_array(estimates: Iterable[Estimate], n_gps: int) -> NDArray[np.void]:
    """Estimates as an array of shape (number of estimates,) and dtype `estimate_dtype(n_gps)`."""
    width = max(n_gps, MIN_GPS_COLUMNS)
    blank = (NAN,) * width

    def row(estimate: Estimate) -> tuple[float | str, ...]:
        return (
            estimate.t_us / 1e6,
            *(estimate.heading_deg, estimate.heading_sigma_deg, estimate.rate_of_turn_dps),
            *(estimate.lat_deg, estimate.lon_deg, estimate.mode, estimate.pos_mode),
            *(estimate.weights + blank)[:width],
            *(estimate.faz_deg + blank)[:width],
            estimate.gpsec_deg,
            *(estimate.ekf_deg + blank)[:width],
        )

    return np.array([row(estimate) for estimate in estimates], dtype=estimate_dtype(n_gps))
