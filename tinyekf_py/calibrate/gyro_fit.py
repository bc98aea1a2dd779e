"""The gyro's bias: what it shows of turning that the compass does not confirm in the long run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinyekf_py.calibrate.track import CalibrationError, Floats
from tinyekf_py.evaluate.decoded import Decoded, held

MIN_SECONDS = 60.0
_MAX_GAP_S = 1.0
_CALM_DPS = 2.0


@dataclass(frozen=True, slots=True)
class GyroFit:
    """Bias of the three axes in the boat's frame (x, y, z), degrees/s."""

    bias_dps: tuple[float, float, float]
    sigma_dps: tuple[float, float, float]
    drift_dps: float  #: how much z's bias changed from the recording's first third to its last
    seconds: float
    referenced: bool  #: whether a compass took the boat's own turning out of z


def fit_gyro(decoded: Decoded) -> GyroFit:
    """Bias by a recording: z against the compass, x and y as the mean while she does not turn.

    Without a compass the recording must be of a boat at rest. CalibrationError when it is too short.
    """
    t_s, gyro_dps, _ = decoded.imu
    if len(t_s) < 2 or t_s[-1] - t_s[0] < MIN_SECONDS:
        raise CalibrationError(f"less than {MIN_SECONDS:.0f} s of gyro in it; record for longer")
    steps = np.diff(t_s, prepend=t_s[0])
    turned = np.cumsum(np.where(steps < _MAX_GAP_S, gyro_dps[:, 2] * steps, 0.0))
    grid = np.arange(t_s[0], t_s[-1], 1.0)
    compass_s, shown_deg, _ = decoded.compass
    shown = held(compass_s, shown_deg, grid, _MAX_GAP_S)
    known = np.isfinite(shown)
    referenced = bool(known.sum() > 0.8 * len(grid))
    excess = np.interp(grid, t_s, turned)
    if referenced:
        # The compass is unwound by the gyro: even a minute without it does not lose a turn.
        lag = np.degrees(np.unwrap(np.radians((excess - shown)[known])))
        grid, excess = grid[known], lag
    bias_z, sigma_z = _slope(grid, excess)
    thirds = np.array_split(np.arange(len(grid)), 3)
    drift = _slope(grid[thirds[2]], excess[thirds[2]])[0] - _slope(grid[thirds[0]], excess[thirds[0]])[0]
    calm = np.abs(gyro_dps[:, 2] - bias_z) < _CALM_DPS
    if calm.sum() < 100:
        raise CalibrationError("she never stops turning in it; record a straight leg, or at the dock")
    x, y = (float(np.mean(gyro_dps[calm, axis])) for axis in (0, 1))
    sigmas = [_block_sigma(gyro_dps[calm, axis]) for axis in (0, 1)]
    return GyroFit((x, y, bias_z), (sigmas[0], sigmas[1], sigma_z), drift, float(t_s[-1] - t_s[0]), referenced)


def _slope(t_s: Floats, values: Floats) -> tuple[float, float]:
    """Slope of a line through values, and its standard error from the slopes of ten pieces' mean residuals."""
    middle = t_s - t_s.mean()
    slope = float(np.dot(middle, values) / np.dot(middle, middle))
    residuals = values - values.mean() - slope * middle
    spread = float(np.std(residuals)) * np.sqrt(min(len(t_s), 30.0))  # errors are correlated over some 30 s
    return slope, spread / float(np.sqrt(np.dot(middle, middle)))


def _block_sigma(values: Floats, blocks: int = 20) -> float:
    """Standard error of a mean of correlated values, from the means of blocks."""
    means = [float(np.mean(block)) for block in np.array_split(values, blocks)]
    return float(np.std(means, ddof=1) / np.sqrt(blocks))
