"""Fits the deviation coefficients A to E to what a recording shows of compass heading and movement.

Where the boat points, the course through the water says: ground velocity less current. What it cannot say: whether a
deviation of the form B sin z + C cos z is one, or a current; so these two are fitted only when a swing gave the
current. (A steady leeway imitates them too, by its own size.) In turns the course through the water is off by the
boat's sideslip and by the delays of both instruments, all of them in proportion to the rate of turn: two more unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tinyekf_py.calibrate.current import Current, combined, current_by_legs, find_current
from tinyekf_py.calibrate.track import CalibrationError, Floats, Track
from tinyekf_py.deviation import deviation_deg, deviation_terms
from tinyekf_py.evaluate.truth import wrap_deg

NAMES = "ABCDE"
MIN_WATER_SPEED_MPS = 1.0
MAX_RATE_DPS = 8.0
#: Between headings further apart than these, second-order terms (D, E), and first-order ones, are not fitted.
MAX_GAP_SECOND_DEG, MAX_GAP_FIRST_DEG = 90.0, 150.0
#: From this gap on, what the card says in it is guesswork.
WARN_GAP_DEG = 45.0

_SMOOTH = 9  # bins
_BLOCK_S = 20.0  # errors within a block of this length are not independent
_MIN_BIN_S = 2.0  # what counts as a heading covered
_SECTOR_DEG = 10.0
_SECTORS = 36


@dataclass(frozen=True, slots=True)
class DeviationFit:
    """What was found. Coefficients that were not fitted are 0, their standard errors NaN."""

    coefficients_deg: tuple[float, ...]  #: A to E
    sigma_deg: tuple[float, ...]  #: their standard errors
    current: Current | None
    residual_deg: float  #: RMS of what the fit leaves
    seconds: float  #: of the recordings that were used
    compass_deg: Floats  #: the headings compared, and
    observed_deg: Floats  #: the deviation seen at each
    warnings: tuple[str, ...]


def fit_deviation(tracks: Sequence[Track], *, reciprocal_legs: bool = False) -> DeviationFit:
    """Fit A to E to one or several recordings of one boat; CalibrationError when they cannot tell anything.

    `reciprocal_legs`: where there is no circle, legs on opposite headings were sailed at the same water speed.
    """
    # The current of one day is not that of another: each recording has its own, where it has a swing.
    currents = [find_current(track) or (current_by_legs(track) if reciprocal_legs else None) for track in tracks]
    swung = [(track, current) for track, current in zip(tracks, currents, strict=True) if current is not None]
    usable: list[tuple[Track, Current | None]] = [*swung] or [(track, None) for track in tracks]
    warnings = []
    if not swung:
        warnings.append(
            "no full circle at constant water speed: the current is unknown, and B and C (which it imitates) are not "
            "fitted; record a slow circle each way, or legs on opposite headings at one speed (--reciprocal-legs)"
        )
    elif len(swung) < len(tracks):
        warnings.append(f"{len(tracks) - len(swung)} of {len(tracks)} recordings have no full circle and were left out")
    parts = [_compare(number, track, current) for number, (track, current) in enumerate(usable)]
    compass, observed, rate, speed, block = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if len(compass) < 30:
        raise CalibrationError(f"less than 30 s above {MIN_WATER_SPEED_MPS:g} m/s in it; sail faster, or for longer")
    gap_from, gap_deg = largest_gap(compass)
    terms = 5 if gap_deg <= MAX_GAP_SECOND_DEG else 3 if gap_deg <= MAX_GAP_FIRST_DEG else 1
    if gap_deg > WARN_GAP_DEG:
        lost = {5: "", 3: "; D and E are not fitted", 1: "; A alone is fitted"}[terms]
        gap_to = (gap_from + gap_deg) % 360.0
        warnings.append(f"no headings between {gap_from:03.0f} and {gap_to:03.0f} degrees by compass{lost}")
    # Without a known current B and C are fitted, so that A, D and E are not bent by it, but are not believed.
    design = np.concatenate([deviation_terms(compass)[:, :terms], (rate / speed)[:, None], rate[:, None]], axis=1)
    solution, covariance, residuals = _robust_fit(design, observed, block)
    coefficients, sigma = np.zeros(5), np.full(5, np.nan)
    coefficients[:terms], sigma[:terms] = solution[:terms], np.sqrt(np.diag(covariance)[:terms])
    current = combined([known for _, known in swung])
    if current is None:
        coefficients[1:3], sigma[1:3] = 0.0, np.nan
    elif terms > 1:
        sigma[1:3] = np.hypot(sigma[1:3], math.degrees(current.sigma_mps / float(np.median(speed))))
    if sigma[0] > 1.0:
        warnings.append("A cannot be told from the boat's sideslip: circle the other way too, or sail straight legs")
    turn_part = design[:, terms:] @ solution[terms:]
    return DeviationFit(
        tuple(coefficients.tolist()),
        tuple(sigma.tolist()),
        current,
        float(np.sqrt(np.mean(residuals**2))),
        float(len(compass)),
        compass,
        observed - turn_part,
        tuple(warnings),
    )


def _compare(number: int, track: Track, current: Current | None) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Compass heading, deviation seen, rate of turn, water speed and number of the block, where all are usable."""
    north = track.north_mps - (current.north_mps if current else 0.0)
    east = track.east_mps - (current.east_mps if current else 0.0)
    speed = np.hypot(north, east)
    rate = track.smooth_rate_dps(_SMOOTH)  # waves turn the boat without making her slip
    usable = (speed >= MIN_WATER_SPEED_MPS) & (np.abs(rate) <= MAX_RATE_DPS)
    observed = wrap_deg(np.degrees(np.arctan2(east, north)) - track.variation_deg - track.compass_deg)
    block = number * 1e6 + track.t_s // _BLOCK_S
    return track.compass_deg[usable], observed[usable], rate[usable], speed[usable], block[usable]


def _covered(compass_deg: Floats) -> NDArray[np.bool_]:
    """Whether the boat pointed into each sector for long enough."""
    counts = np.bincount((compass_deg // _SECTOR_DEG).astype(int) % _SECTORS, minlength=_SECTORS)
    return counts >= _MIN_BIN_S


def was_sailed(fit: DeviationFit, compass_deg: float) -> bool:
    """Whether the card rests on what was seen at this compass heading, or near it."""
    beside = np.array([compass_deg - _SECTOR_DEG / 2, compass_deg + _SECTOR_DEG / 2])
    return bool(_covered(fit.compass_deg)[(beside // _SECTOR_DEG).astype(int) % _SECTORS].any())


def largest_gap(compass_deg: Floats) -> tuple[float, float]:
    """Where the largest gap between the headings covered begins, and how wide it is, degrees."""
    covered = np.flatnonzero(_covered(compass_deg))
    if not len(covered):
        return 0.0, 360.0
    gaps = (np.diff(np.append(covered, covered[0] + _SECTORS)) - 1) * _SECTOR_DEG
    widest = int(np.argmax(gaps))
    return float((covered[widest] + 1) * _SECTOR_DEG % 360.0), float(gaps[widest])


def _robust_fit(design: Floats, observed: Floats, block: Floats) -> tuple[Floats, Floats, Floats]:
    """Least squares that a magnetic disturbance does not bend (Huber), and a covariance for correlated errors."""
    # A deviation beyond all reason first: the fit starts from the median.
    start = float(np.median(observed))
    observed = start + wrap_deg(observed - start)
    weights = np.ones(len(observed))
    solution: Floats = np.empty(0)
    residuals: Floats = np.empty(0)
    for _ in range(30):
        root = np.sqrt(weights)
        solution = np.asarray(np.linalg.lstsq(design * root[:, None], observed * root, rcond=1e-6)[0], np.float64)
        residuals = observed - design @ solution
        scale = max(1.4826 * float(np.median(np.abs(residuals))), 1e-3)
        weights = np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(residuals), 1e-9))
    bread = np.linalg.pinv(design.T @ (design * weights[:, None]), rcond=1e-9)
    _, numbers = np.unique(block, return_inverse=True)
    scores = np.zeros((numbers.max() + 1, design.shape[1]))
    np.add.at(scores, numbers, design * (weights * residuals)[:, None])
    count = len(scores)
    freedom = count / max(count - design.shape[1], 1)
    return solution, bread @ (scores.T @ scores) @ bread * freedom, residuals


def deviation_sigma_deg(fit: DeviationFit, compass_deg: ArrayLike) -> Floats:
    """Standard error of the deviation at compass headings, by the coefficients' own, degrees."""
    sigma: Floats = np.sqrt(deviation_terms(compass_deg) ** 2 @ np.nan_to_num(np.array(fit.sigma_deg)) ** 2)
    return sigma


def card_deg(fit: DeviationFit, compass_deg: ArrayLike) -> Floats:
    """The deviation card's values at compass headings, degrees."""
    return deviation_deg(fit.coefficients_deg, compass_deg)
