"""Single sensors as methods: what a sailor would steer by who has nothing but that instrument.

A reading is held until the next, for a second at most.
"""

from __future__ import annotations

import time

import numpy as np

from tinyekf_py.evaluate.decoded import Decoded, held
from tinyekf_py.evaluate.outcome import Outcome
from tinyekf_py.evaluate.truth import Floats

MAX_AGE_S = 1.0


def compass(decoded: Decoded) -> Outcome:
    """The compass alone, with the configured deviation and the variation."""
    began = time.perf_counter()
    t_s, _, true_deg = decoded.compass
    return _outcome("compass", decoded, held(t_s, true_deg, decoded.rows_s, MAX_AGE_S), began)


def course_of(decoded: Decoded, number: int) -> Outcome:
    """Course over ground of one receiver (1 for gps1), as its sentences give it."""
    began = time.perf_counter()
    return _outcome(f"gps{number}-course", decoded, _course(decoded, number)[0], began)


def course(decoded: Decoded) -> Outcome:
    """Direction of the mean ground velocity of all receivers."""
    began = time.perf_counter()
    north = np.zeros(len(decoded.rows_s))
    east = np.zeros(len(decoded.rows_s))
    for number in decoded.gps_numbers:
        course_deg, speed_mps = _course(decoded, number)
        known = np.isfinite(course_deg) & np.isfinite(speed_mps)
        north += np.where(known, speed_mps * np.cos(np.radians(course_deg)), 0.0)
        east += np.where(known, speed_mps * np.sin(np.radians(course_deg)), 0.0)
    moving = np.hypot(north, east) > 0.0
    heading = np.where(moving, np.degrees(np.arctan2(east, north)) % 360.0, np.nan)
    return _outcome("course", decoded, heading, began)


def _course(decoded: Decoded, number: int) -> tuple[Floats, Floats]:
    """Course (degrees) and speed (m/s) of one receiver at every row."""
    samples = decoded.of_gps(number)
    values = np.stack([samples["course_deg"], samples["speed_mps"]], axis=1)
    values[samples["code"] < 1] = np.nan
    rows = held(samples["t_us"] / 1e6, values, decoded.rows_s, MAX_AGE_S)
    return rows[:, 0], rows[:, 1]


def _outcome(method: str, decoded: Decoded, heading_deg: Floats, began: float) -> Outcome:
    unknown = np.full(len(heading_deg), np.nan)
    return Outcome(method, decoded.rows_s, heading_deg, unknown, time.perf_counter() - began)
