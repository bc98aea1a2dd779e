"""What a method says about a recording."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tinyekf_py.evaluate.truth import Floats


def no_weights() -> Floats:
    return np.empty((0, 0))


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a method says, ten rows a second. NaN where it says nothing."""

    method: str
    t_s: Floats  #: shape (rows,): the 100 ms grid, seconds since the recording's start
    heading_deg: Floats  #: shape (rows,), true
    sigma_deg: Floats  #: shape (rows,): one standard deviation; all NaN for a method that knows none
    seconds: float  #: the time it took, without decoding
    lat_deg: Floats = field(default_factory=lambda: np.empty(0))  #: shape (rows,), or (0,) for a method without
    lon_deg: Floats = field(default_factory=lambda: np.empty(0))
    weights: Floats = field(default_factory=no_weights)  #: shape (rows, receivers): stage 1's, or (0, 0)
    mean_nis: float = np.nan  #: mean normalised innovation squared of the heading, where the method tells it
