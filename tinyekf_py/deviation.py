"""The compass' deviation: what the iron aboard does to it, as a function of the compass heading."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


def deviation_terms(compass_deg: ArrayLike) -> NDArray[np.float64]:
    """What A, B, C, D and E are multiplied by at each compass heading (shape (...)): shape (..., 5)."""
    zeta = np.radians(np.asarray(compass_deg, float))
    return np.stack([np.ones_like(zeta), np.sin(zeta), np.cos(zeta), np.sin(2.0 * zeta), np.cos(2.0 * zeta)], axis=-1)


def deviation_deg(coefficients_deg: Sequence[float], compass_deg: ArrayLike) -> NDArray[np.float64]:
    """Deviation A + B sin z + C cos z + D sin 2z + E cos 2z, degrees, east positive, at compass headings z (degrees).

    `coefficients_deg` are A to E; the result has the shape of `compass_deg`. Compass + deviation = magnetic.
    """
    deviation: NDArray[np.float64] = deviation_terms(compass_deg) @ np.asarray(coefficients_deg, float)
    return deviation
