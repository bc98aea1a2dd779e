"""Scale, offset and latency of every channel against GPS on a recorded drive, with standard errors.

GPS positions are smoothed by a local quadratic over two seconds, which gives speed and course without delay. Each
channel's running integral I then explains a GPS quantity Y (course of a gyro, distance of a wheel, speed of an
accelerometer) as `Y(t) = c + scale I(t - latency) + offset t`, by Gauss-Newton on the four. The standard errors are of
residuals as correlated as they are found to be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinyekf_py.vehicle.channels import Series, read_channels
from tinyekf_py.vehicle.config import CHANNELS, UNITS, VehicleConfig
from tinyekf_py.vehicle.drive import increments, synchronise
from tinyekf_py.vehicle.table import DriveError, Floats

_WINDOW_S = 2.0
_SLOWEST_MPS = 2.0  #: below it GPS has no course
_LATENCIES_S = np.arange(-2.0, 2.01, 0.1)


class Fit(NamedTuple):
    """What a channel's calibration came to; factors on the value it has now, SI."""

    scale: float
    scale_sigma: float
    offset: float  #: SI per second of what it measures
    offset_sigma: float
    latency_s: float  #: behind GPS, as the stamps are now; negative: GPS lags
    latency_sigma_s: float
    residual: float  #: rms, rad or m or m/s
    n: int


def smooth(t: Floats, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Course (rad, unwrapped; NaN when slow), speed (m/s) and distance (m) of GPS positions, shape (n,) each."""
    vx, vy = np.full(len(t), np.nan), np.full(len(t), np.nan)
    for i in range(len(t)):
        first, last = np.searchsorted(t, (t[i] - _WINDOW_S / 2, t[i] + _WINDOW_S / 2))
        if last - first >= 5 and t[i] - t[first] > _WINDOW_S / 4 and t[last - 1] - t[i] > _WINDOW_S / 4:
            s = t[first:last] - t[i]
            powers = np.stack([np.ones_like(s), s, s * s], axis=1)
            (_, vx[i], _), (_, vy[i], _) = np.linalg.lstsq(
                powers, np.stack([x[first:last], y[first:last]], 1), rcond=None
            )[0].T
    speed = np.hypot(vx, vy)
    course = np.where(speed > _SLOWEST_MPS, np.arctan2(vy, vx), np.nan)
    there = np.isfinite(course)
    course[there] = np.unwrap(course[there])
    dt = np.diff(t, prepend=t[0])
    mean = np.nan_to_num((speed + np.roll(speed, 1)) / 2)
    return course, speed, np.cumsum(mean * dt)


def fit_channel(series: Series, t: Floats, target: Floats, *, with_offset: bool = True) -> Fit | None:
    """Explain `target` at times `t` by the channel's integral; None where there is too little to tell."""
    there = np.isfinite(target)
    if there.sum() < 50:
        return None
    t, target = t[there], target[there]
    drifting = (t - t[0]) * with_offset  # all 0: least squares of smallest norm leaves the offset 0

    def integral(latency: float) -> tuple[Floats, np.ndarray]:
        gained = increments(series, t + latency, 0.5)
        known = np.isfinite(gained)
        known[0] = True
        return np.cumsum(np.nan_to_num(gained)), known

    def solve(latency: float) -> tuple[Floats, Floats, Floats]:
        total, _ = integral(latency)
        slope = (integral(latency + 0.05)[0] - integral(latency - 0.05)[0]) / 0.1
        design = np.stack([np.ones_like(t), total, drifting], axis=1)
        solution = np.linalg.lstsq(design, target, rcond=None)[0]
        return solution, target - design @ solution, slope

    costs = [float(np.sum(solve(latency)[1] ** 2)) for latency in _LATENCIES_S]
    latency = float(_LATENCIES_S[int(np.argmin(costs))])
    for _ in range(5):
        total, _ = integral(latency)
        solution, residual, slope = solve(latency)
        design = np.stack([np.ones_like(t), total, drifting, solution[1] * slope], axis=1)
        full = np.linalg.lstsq(design, target, rcond=None)[0]
        step = float(np.clip(full[3], -0.2, 0.2))
        latency += step
        if abs(step) < 1e-4:
            break
    total, _ = integral(latency)
    solution, residual, slope = solve(latency)
    design = np.stack([np.ones_like(t), total, drifting, solution[1] * slope], axis=1)
    lag = float(np.clip(np.sum(residual[1:] * residual[:-1]) / np.sum(residual**2), 0.0, 0.995))
    inflation = (1 + lag) / (1 - lag)  # of the variance of a mean of residuals so correlated
    variance = float(np.sum(residual**2)) / max(len(t) - 4, 1) * inflation
    sigma = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)) * variance)
    rms = math.sqrt(float(np.mean(residual**2)))
    return Fit(solution[1], sigma[1], solution[2], sigma[2], latency, sigma[3], rms, len(t))


def calibrate_drive(path: Path, config: VehicleConfig) -> Mapping[str, Fit]:
    """A fit for each channel that the drive has and GPS can judge."""
    channels = read_channels(path, config)
    epochs = synchronise(path, channels, config).epochs
    rows = np.isfinite(epochs["gps_x_m"])
    t = epochs["t_s"][rows]
    if len(t) < 100:
        raise DriveError(f"{path}: {len(t)} GPS positions are too few to calibrate by; drive for a minute or more")
    course, speed, distance = smooth(t, epochs["gps_x_m"][rows], epochs["gps_y_m"][rows])
    fits = {}
    for name, series in channels.series.items():
        quantities = CHANNELS[name][0]
        if name.startswith("gps_"):
            continue
        target = course if "rotation rate" in quantities else speed if "acceleration" in quantities else distance
        target = np.where(np.isfinite(speed), target, np.nan)
        # A wheel that stands is at 0; only a voltage may be off.
        with_offset = "speed" not in quantities or config.channels[name].raw == "V"
        fit = fit_channel(series, t, target, with_offset=with_offset)
        if fit:
            fits[name] = fit
    if not fits:
        raise DriveError(f"{path}: no channel but GPS, or no part of the drive faster than {_SLOWEST_MPS} m/s")
    return fits


def gps_latency(fits: Mapping[str, Fit]) -> tuple[float, float]:
    """How late GPS is stamped by the sensors' account, weighted mean, and its standard error, s."""
    weights = np.array([1 / max(fit.latency_sigma_s, 1e-3) ** 2 for fit in fits.values()])
    latencies = np.array([-fit.latency_s for fit in fits.values()])
    return float(np.sum(weights * latencies) / np.sum(weights)), float(1 / math.sqrt(np.sum(weights)))


def calibration_text(fits: Mapping[str, Fit], config: VehicleConfig) -> str:
    """The calibration file: what the configuration says now, corrected; standard errors as comments."""
    lag, lag_sigma = gps_latency(fits)
    lines = ["# Against GPS, by `tinyekf vehicle calibrate`. Standard errors behind the values.", ""]
    lines += ["[gps]", f"latency_s = {config.gps.latency_s + lag:.4f}  # +- {lag_sigma:.4f}", ""]
    for name, fit in fits.items():
        channel = config.channels[name]
        unit = channel.unit or CHANNELS[name][1]
        size = UNITS[unit][1]
        counter = UNITS[unit][0] == "distance" or not fit.offset_sigma
        lines.append(f"[channels.{name}]")
        lines.append(f"scale = {fit.scale * channel.scale:.8g}  # +- {abs(fit.scale_sigma * channel.scale):.2g}")
        offset = fit.scale * channel.offset + (0.0 if counter else fit.offset / size)
        lines.append(f"offset = {offset:.6g}" + ("" if counter else f"  # +- {fit.offset_sigma / size:.2g}"))
        lines.append(f'unit = "{unit}"')
        lines.append(
            f"# latency behind GPS {fit.latency_s:.3f} +- {fit.latency_sigma_s:.3f} s, residual {fit.residual:.3g}"
        )
        lines.append("")
    return "\n".join(lines)
