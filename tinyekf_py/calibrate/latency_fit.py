"""How late the receivers' lines come: by how much their courses turn after the gyro does.

In a turn the ground velocity swings aside by `speed * rate of turn * latency`; it also swings aside because a boat
slides outwards, by `slip * rate of turn`, some moments after she has begun to turn. The two differ by the speed, and by
those moments; so both are fitted together, with the current, the gyro's bias and its change, and the slide's lag. Turns
at one speed tell them apart badly: what is believed of both beforehand decides then; the standard deviation says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tinyekf_py.calibrate.track import CalibrationError, Floats
from tinyekf_py.evaluate.decoded import Decoded

MIN_SPEED_MPS = 1.0
MIN_EPOCHS = 300
#: What the recording must have of turning: this many degrees in all, faster than the other.
MIN_TURNED_DEG = 270.0
TURNING_DPS = 1.5

_GRID_S = 0.01  # of the gyro's yaw
_MAX_GAP_S = 0.5
_SLIP_LAGS_S = (0.4, 0.6, 0.8, 1.0, 1.3, 1.7, 2.2)  # the slide's: the one that fits best is taken
_KNOT_S = 40.0  # the gyro's bias is thought to change no faster
_STEPS = 4  # the fit is repeated at the latencies that it found
_CALM_S = 6.0  # waves are shorter
_ALIKE = 2.0  # of means over that time, two have an epoch in common

#: What is believed beforehand, with its standard deviation: the latency, s; how far ahead of her reference point
#: the boat pivots, m; and a current, m/s.
LATENCY_S, SIGMA_S = 0.12, 0.06
PIVOT_M, PIVOT_SIGMA_M = 1.5, 0.8
CURRENT_MPS = 0.5


@dataclass(frozen=True, slots=True)
class Latency:
    """Of one receiver, against the gyro; seconds."""

    source: str
    seconds: float
    sigma_s: float


@dataclass(frozen=True, slots=True)
class _Epochs:
    """What all receivers said above `MIN_SPEED_MPS`; each of shape (n,)."""

    t_s: Floats
    north_mps: Floats
    east_mps: Floats
    receiver: Floats  # which one, from 0
    arm_m: Floats  # (n, 2): its antenna, ahead and to starboard


@dataclass(frozen=True, slots=True)
class _Gyro:
    """Yaw (rad, unwrapped, bias and all) and rate of turn (rad/s) every `_GRID_S`."""

    t_s: Floats
    yaw: Floats
    rate: Floats
    bias: float  # rad/s, roughly


def fit_latency(decoded: Decoded) -> list[Latency]:
    """The latency of each receiver's velocity by a recording with turns; CalibrationError when it cannot tell."""
    names, epochs = _epochs(decoded)
    gyro = _gyro(decoded, epochs)
    rate = np.interp(epochs.t_s, gyro.t_s, gyro.rate) - gyro.bias
    turning = np.abs(np.convolve(gyro.rate - gyro.bias, np.full(200, 1.0 / 200.0), "same"))
    turned_deg = float(np.degrees(np.sum(turning[turning > np.radians(TURNING_DPS)])) * _GRID_S)
    if len(rate) < MIN_EPOCHS or turned_deg < MIN_TURNED_DEG:
        raise CalibrationError(
            f"{turned_deg:.0f} degrees of turning above {MIN_SPEED_MPS:g} m/s in it; sail some turns, at two speeds"
        )
    fits = [_fit(gyro, epochs, len(names), lag_s) for lag_s in _SLIP_LAGS_S]
    costs = np.array([cost for _, _, cost in fits])
    chance = np.exp(-0.5 * (costs - costs.min()))
    chance /= chance.sum()
    means = np.array([mean for mean, _, _ in fits])
    mean = chance @ means
    sigma = np.sqrt(chance @ (np.array([s for _, s, _ in fits]) ** 2 + (means - mean) ** 2))
    return [Latency(*found) for found in zip(names, mean.tolist(), sigma.tolist(), strict=True)]


def _gyro(decoded: Decoded, epochs: _Epochs) -> _Gyro:
    t_s, gyro_dps, _ = decoded.imu
    if len(t_s) < 100:
        raise CalibrationError("no gyro in it; the courses' latency is measured against it")
    rate = np.radians(gyro_dps[:, 2])
    steps = np.diff(t_s, prepend=t_s[0])
    yaw = np.cumsum(np.where(steps < _MAX_GAP_S, rate * steps, 0.0))
    grid = np.arange(t_s[0], t_s[-1], _GRID_S)
    order = np.argsort(epochs.t_s, kind="stable")
    moment = epochs.t_s[order]
    excess = np.unwrap(np.arctan2(epochs.east_mps, epochs.north_mps)[order] - np.interp(moment, t_s, yaw))
    bias = -float(np.polyfit(moment - moment[0], excess, 1)[0])
    return _Gyro(grid, np.interp(grid, t_s, yaw), np.interp(grid, t_s, rate), bias)


def _epochs(decoded: Decoded) -> tuple[list[str], _Epochs]:
    names: list[str] = []
    parts = []
    antennas_m = decoded.config.vessel.antennas_m
    for number in decoded.gps_numbers:
        samples = decoded.of_gps(number)
        samples = samples[
            (samples["code"] >= 1) & (samples["speed_mps"] >= MIN_SPEED_MPS) & np.isfinite(samples["course_deg"])
        ]
        if not len(samples):
            continue
        arm_m = antennas_m[number - 1] if number <= len(antennas_m) else (0.0, 0.0)
        course = np.radians(samples["course_deg"])
        t_s = samples["t_us"] / 1e6
        ones = np.ones(len(samples))
        columns = (samples["speed_mps"] * np.cos(course), samples["speed_mps"] * np.sin(course))
        parts.append(np.stack([t_s, *columns, len(names) * ones, arm_m[0] * ones, arm_m[1] * ones], axis=1))
        names.append(f"gps{number}")
    if not parts:
        raise CalibrationError(f"no receiver above {MIN_SPEED_MPS:g} m/s in it; sail some turns, at two speeds")
    table = np.concatenate(parts)
    return names, _Epochs(table[:, 0], table[:, 1], table[:, 2], table[:, 3], table[:, 4:])


def _fit(gyro: _Gyro, epochs: _Epochs, receivers: int, slip_lag_s: float) -> tuple[Floats, Floats, float]:
    """Latency of each receiver with its standard deviation, s, and how badly it all fits, by one lag of the slide."""
    slide = _lagged(gyro.rate - gyro.bias, float(np.exp(-_GRID_S / slip_lag_s)))
    which = epochs.receiver.astype(int)
    bends = _tents(epochs.t_s)
    terms = bends.shape[1]
    # Unknowns: where the gyro's yaw is against north, the current north and east, the slip, the latencies.
    before = np.concatenate([np.zeros(terms + 2), [-PIVOT_M], np.full(receivers, LATENCY_S)])
    doubt = np.concatenate([np.full(terms, 1.0), [CURRENT_MPS] * 2, [PIVOT_SIGMA_M], np.full(receivers, SIGMA_S)])
    now = before.copy()
    sigma, cost = doubt[terms + 3 :], np.inf
    for step in range(_STEPS):
        moment = epochs.t_s - now[terms + 3 :][which]
        rate = np.interp(moment, gyro.t_s, gyro.rate) - gyro.bias
        yaw = np.interp(moment, gyro.t_s, gyro.yaw)
        if step == 0:
            order = np.argsort(epochs.t_s, kind="stable")
            off = np.unwrap((np.arctan2(epochs.east_mps, epochs.north_mps) - yaw)[order])
            now[:terms] = before[:terms] = np.linalg.lstsq(bends[order], off, rcond=None)[0]
        heading = yaw + bends @ now[:terms]
        sin, cos = np.sin(heading), np.cos(heading)
        ahead_m, aside_m = epochs.arm_m[:, 0], epochs.arm_m[:, 1]
        north = epochs.north_mps + rate * (aside_m * cos + ahead_m * sin) - now[terms]
        east = epochs.east_mps + rate * (aside_m * sin - ahead_m * cos) - now[terms + 1]
        ahead, aside = north * cos + east * sin, east * cos - north * sin
        slid = np.interp(moment, gyro.t_s, slide)
        late = np.zeros((len(which), receivers))
        late[np.arange(len(which)), which] = -ahead * rate
        columns = [ahead[:, None] * bends, -sin[:, None], cos[:, None], slid[:, None], late]
        columns.append((aside - now[terms + 2] * slid)[:, None])
        calm = _calmed(epochs.t_s, which, np.concatenate(columns, axis=1))
        change, covariance, cost = _robust(calm[:, :-1], calm[:, -1], (before - now) / doubt, doubt)
        now += change
        sigma = np.sqrt(np.diag(covariance)[terms + 3 :])
    return now[terms + 3 :], sigma, cost


def _calmed(t_s: Floats, which: NDArray[np.int64], rows: Floats) -> Floats:
    """Means of each receiver's rows over `_CALM_S`, every half of that.

    Waves yaw the boat and carry her aside at once, and in step: taken for a turn they would show any latency.
    """
    means = []
    for receiver in range(int(which.max()) + 1):
        mine = rows[which == receiver]
        length = max(2, round(_CALM_S / float(np.median(np.diff(t_s[which == receiver])))))
        sums = np.cumsum(np.concatenate([np.zeros((1, rows.shape[1])), mine]), axis=0)
        means.append((sums[length:] - sums[:-length])[:: length // 2] / length)
    return np.concatenate(means)


def _tents(t_s: Floats) -> Floats:
    """A base of broken lines with a knot every `_KNOT_S`, shape (n, knots)."""
    knots = np.linspace(t_s.min(), t_s.max(), max(2, round(float(np.ptp(t_s)) / _KNOT_S) + 1))
    base: Floats = np.maximum(0.0, 1.0 - np.abs(t_s[:, None] - knots) / (knots[1] - knots[0]))
    return base[:, base.max(axis=0) > 0.0]


def _lagged(values: Floats, keep: float) -> Floats:
    """`values` behind a first-order lag of which `keep` is left from one to the next."""
    out = np.empty(len(values))
    state = 0.0
    for i, value in enumerate(values.tolist()):
        state = keep * state + (1.0 - keep) * value
        out[i] = state
    return out


def _robust(design: Floats, observed: Floats, pull: Floats, doubt: Floats) -> tuple[Floats, Floats, float]:
    """Least squares with a prior (each unknown's pull, in units of its doubt), which outliers do not bend (Huber).

    Solution, covariance, and twice the negative logarithm of its likelihood, but for a constant.
    """
    weights = np.ones(len(observed))
    solution: Floats = np.zeros(design.shape[1])
    covariance: Floats = np.empty((len(doubt), len(doubt)))
    cost = np.inf
    for _ in range(6):
        residuals = observed - design @ solution
        scale = max(1.4826 * float(np.median(np.abs(residuals))), 1e-6)
        weights = np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(residuals), 1e-12))
        weighted = design * (weights / (scale**2 * _ALIKE))[:, None]
        covariance[:] = np.linalg.inv(design.T @ weighted + np.diag(doubt**-2.0))
        solution = covariance @ (weighted.T @ observed + pull / doubt)
    residuals = observed - design @ solution
    cost = float(np.sum(weights * residuals**2) / (scale**2 * _ALIKE) + np.sum((solution / doubt - pull) ** 2))
    return solution, covariance, cost + len(observed) / _ALIKE * 2.0 * float(np.log(scale))


def worth_writing(latencies: Sequence[Latency]) -> list[Latency]:
    """Those that the recording made better known than they were."""
    return [found for found in latencies if found.sigma_s <= 0.75 * SIGMA_S and 0.0 <= found.seconds <= 0.9]
