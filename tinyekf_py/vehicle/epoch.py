"""Epochs and estimates as NumPy arrays laid out like the C core's structs, and the call that turns one into the other.

An **epoch** is what was measured at a moment (the GPS position) and since the one before (rotations, distances).
Everything in SI units and radians, x north, y east, azimuths clockwise from north; NaN is missing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tinyekf_py._core import ffi, lib
from tinyekf_py.vehicle.noise import Noise

#: Method -> its number in the core.
METHODS = {
    "kinematic-paper": lib.VEHICLE_KINEMATIC_PAPER,
    "kinematic": lib.VEHICLE_KINEMATIC,
    "lsa-straight": lib.VEHICLE_LSA_STRAIGHT,
    "lsa-circle": lib.VEHICLE_LSA_CIRCLE,
    "lsa": lib.VEHICLE_LSA,
}

#: The observations in the order of the third paper's (4); bit i of `used` and `refused` is observation i.
OBSERVATIONS = (
    *("x", "y", "turn_odo", "turn_xsens", "turn_silicon", "turn_bosch"),
    *("way_odo", "way_xsens", "way_bosch", "way_oss"),
)

MODES = ("waiting", "gps", "dead-reckoning", "standstill")

#: As `vehicle_epoch_t`: t_s, position and its sigma (m), rotations of odometer, XSENS, Silicon, Bosch (rad), way of
#: the odometer (m), accelerations of XSENS and Bosch (m/s^2), distance of the optical sensor (m).
EPOCH = np.dtype(
    [
        *((name, float) for name in ("t_s", "gps_x_m", "gps_y_m", "gps_sigma_m")),
        ("turn_rad", float, (4,)),
        *((name, float) for name in ("odo_m", "xsens_mps2", "bosch_mps2", "oss_m")),
    ]
)

#: As `vehicle_estimate_t`; `covariance` holds xx, xy, xa, yy, ya, aa of position (m) and azimuth (rad).
ESTIMATE = np.dtype(
    [
        *((name, float) for name in ("t_s", "x_m", "y_m", "vx_mps", "vy_mps", "azimuth_rad", "speed_mps")),
        ("covariance", float, (6,)),
        *((name, float) for name in ("speed_sigma_mps", "mode", "used", "refused", "chi_square", "degrees")),
        *((name, float) for name in ("worst_w", "worst_row", "circle")),
    ]
)

Epochs = NDArray[np.void]  #: of dtype EPOCH
Estimates = NDArray[np.void]  #: of dtype ESTIMATE

_CHUNK = 50_000


def empty_epochs(t_s: NDArray[np.float64]) -> Epochs:
    """Epochs at the times `t_s`, shape (n,), with nothing measured."""
    epochs = np.empty(len(t_s), EPOCH)
    epochs.view(float)[:] = np.nan
    epochs["t_s"] = t_s
    return epochs


def estimate_track(
    epochs: Epochs,
    method: str,
    noise: Noise | None = None,
    *,
    lever_m: tuple[float, float] = (0.0, 0.0),
    standstill_mps: float = 0.1,
    start_azimuth_rad: float = np.nan,
    progress: Callable[[int, int], None] | None = None,
) -> Estimates:
    """One estimate an epoch, by a method of `METHODS`.

    `lever_m`: the GPS antenna forward and to starboard of the reference point; `standstill_mps`: below it the vehicle
    stands; `start_azimuth_rad`: NaN finds the start from the first metres; `progress(done, all)` is called at times.
    """
    if method not in METHODS:
        raise ValueError(f"no method {method!r}; there are {', '.join(METHODS)}")
    vehicle = ffi.new("vehicle_t *")
    options = ffi.new("vehicle_options_t *")
    (noise or Noise()).fill(options)
    options.method = METHODS[method]
    options.lever_m = lever_m
    options.standstill_mps = standstill_mps
    options.start_azimuth_rad = start_azimuth_rad
    lib.vehicle_init(vehicle, options)
    taken = np.ascontiguousarray(epochs, EPOCH)
    if noise is not None and noise.preset == "paper":
        taken = taken.copy()
        taken["gps_sigma_m"] = np.nan  # the paper's variance is one for all positions
    estimates = np.empty(len(taken), ESTIMATE)
    if not len(taken):
        return estimates
    first, into = ffi.from_buffer("vehicle_epoch_t[]", taken), ffi.from_buffer("vehicle_estimate_t[]", estimates)
    for start in range(0, len(taken), _CHUNK):
        lib.vehicle_run(vehicle, first + start, into + start, min(_CHUNK, len(taken) - start))
        if progress:
            progress(min(start + _CHUNK, len(taken)), len(taken))
    return estimates


def covariances(estimates: Estimates) -> NDArray[np.float64]:
    """Covariances of x, y (m) and azimuth (rad), shape (n, 3, 3)."""
    return np.asarray(estimates["covariance"])[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
