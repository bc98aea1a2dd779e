"""Estimates as rows of a NumPy structured array, with the heading CSV's columns as fields."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinyekf_py.estimate import MIN_GPS_COLUMNS, NAN, Estimate, heading_columns


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
