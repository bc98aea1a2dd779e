"""A recording as a calibration sees it: second by second how the boat moved, turned, and what the compass showed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tinyekf_py.evaluate.decoded import Decoded

Floats = NDArray[np.float64]

BIN_S = 1.0
#: A compass is swung slower than this; at faster changes from bin to bin the rate is not believed.
_MAX_RATE_DPS = 60.0


class CalibrationError(ValueError):
    """A recording that cannot calibrate: one line saying why, and what to do."""


@dataclass(frozen=True, slots=True)
class Track:
    """One row a second in which receivers and compass both spoke, in order; all of shape (n,)."""

    t_s: Floats
    north_mps: Floats  #: over ground, the mean of all receivers
    east_mps: Floats
    compass_deg: Floats  #: as the compass shows it, [0, 360)
    rate_dps: Floats  #: of turn, positive to starboard: the gyro's, else the compass' own
    variation_deg: float  #: magnetic, east positive

    def smooth_rate_dps(self, bins: int) -> Floats:
        """The rate of turn without the waves' yaw: the mean of `bins` (odd) neighbours, shape (n,)."""
        padded = np.pad(self.rate_dps, bins // 2, mode="edge")
        smooth: Floats = np.convolve(padded, np.full(bins, 1.0 / bins), "valid")
        return smooth


def track_of(decoded: Decoded) -> Track:
    """The track of a recording; CalibrationError without compass, receivers or a known variation."""
    compass_s, shown_deg, _ = decoded.compass
    is_shown = np.isfinite(shown_deg) & (decoded.compass_reference == 0)
    if not is_shown.any():
        raise CalibrationError("no compass heading in it that could have a deviation (HDM or HDG); record some")
    if not np.isfinite(decoded.variation_deg):
        raise CalibrationError("the magnetic variation is unknown; set vessel.variation_deg, or install [geomag]")
    edges = np.arange(decoded.rows_s[0], decoded.rows_s[-1] + BIN_S, BIN_S)
    north, east = _ground_velocity(decoded, edges)
    angle = np.radians(shown_deg[is_shown])
    cos = _means(compass_s[is_shown], np.cos(angle), edges)
    sin = _means(compass_s[is_shown], np.sin(angle), edges)
    heading = np.degrees(np.arctan2(sin, cos)) % 360.0
    known = np.isfinite(north) & np.isfinite(heading)
    if known.sum() < 30:
        raise CalibrationError("compass and GPS are both there for less than 30 s; record for longer")
    t_s = (edges[:-1] + 0.5 * BIN_S)[known]
    rate = _rate(decoded, edges)[known]
    own = np.gradient(np.degrees(np.unwrap(np.radians(heading[known]))), t_s)
    if np.isfinite(rate).any():
        rate = rate - np.nanmedian(rate - own)  # the gyro's bias, by the compass
    rate = np.where(np.isfinite(rate), rate, np.where(np.abs(own) < _MAX_RATE_DPS, own, 0.0))
    return Track(t_s, north[known], east[known], heading[known], rate, decoded.variation_deg)


def _ground_velocity(decoded: Decoded, edges: Floats) -> tuple[Floats, Floats]:
    velocities = []
    for number in decoded.gps_numbers:
        samples = decoded.of_gps(number)
        samples = samples[
            (samples["code"] >= 1) & np.isfinite(samples["speed_mps"]) & np.isfinite(samples["course_deg"])
        ]
        course = np.radians(samples["course_deg"])
        t_s = samples["t_us"] / 1e6
        speed = samples["speed_mps"]
        velocities.append(
            np.stack([_means(t_s, speed * np.cos(course), edges), _means(t_s, speed * np.sin(course), edges)])
        )
    if not velocities:
        raise CalibrationError("no GPS receiver in it; the course is what the compass is compared with")
    stack = np.array(velocities)
    count = np.isfinite(stack).sum(axis=0)
    mean = np.where(count > 0, np.nansum(stack, axis=0) / np.maximum(count, 1), np.nan)
    return mean[0], mean[1]


def _rate(decoded: Decoded, edges: Floats) -> Floats:
    """The gyro's mean rate in each bin; NaN without a gyro."""
    t_s, gyro_dps, _ = decoded.imu
    return _means(t_s, gyro_dps[:, 2], edges)


def _means(t_s: Floats, values: Floats, edges: Floats) -> Floats:
    """Mean of the values in each bin; NaN for an empty one."""
    bins = np.searchsorted(edges, t_s, side="right") - 1
    inside = (bins >= 0) & (bins < len(edges) - 1) & np.isfinite(values)
    count = np.bincount(bins[inside], minlength=len(edges) - 1)
    total = np.bincount(bins[inside], weights=values[inside], minlength=len(edges) - 1)
    means: Floats = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return means
