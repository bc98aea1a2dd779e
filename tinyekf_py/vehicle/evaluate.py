"""How good tracks are: the third paper's Tables 1 and 2, against GPS as there, and against a truth if any."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from tinyekf_py.vehicle.epoch import Epochs, Estimates, covariances
from tinyekf_py.vehicle.table import Floats
from tinyekf_py.vehicle.track import Truth, truth_at


class Result(NamedTuple):
    """One track against one reference; NaN where it says nothing."""

    method: str
    against: str
    n: int
    mean_dx_m: float
    std_dx_m: float
    mean_dy_m: float
    std_dy_m: float
    rmse_m: float  #: of the position, both coordinates together
    mean_azimuth_deg: float
    std_azimuth_deg: float
    rmse_azimuth_deg: float
    drift_percent: float  #: largest error after GPS was lost, as a share of the distance driven without
    nees: float  #: mean normalised estimation error squared of x, y, azimuth: 3 when the covariance is right


def gps_azimuth_deg(epochs: Epochs, least_m: float = 1.0) -> Floats:
    """Azimuth of the chord from the GPS position before, at each epoch with one; NaN within `least_m`."""
    azimuth = np.full(len(epochs), np.nan)
    rows = np.flatnonzero(np.isfinite(epochs["gps_x_m"]))
    dx, dy = np.diff(epochs["gps_x_m"][rows]), np.diff(epochs["gps_y_m"][rows])
    far = np.hypot(dx, dy) >= least_m
    azimuth[rows[1:][far]] = np.degrees(np.arctan2(dy, dx))[far] % 360.0
    return azimuth


def evaluate_methods(epochs: Epochs, tracks: Mapping[str, Estimates], truth: Truth | None) -> list[Result]:
    """Every track against GPS and, where there is one, against the truth; and GPS against the truth."""
    results = []
    at = truth_at(truth, epochs["t_s"]) if truth else None
    if at:
        x, y, azimuth = at
        results.append(
            _result("raw GPS", "truth", epochs["gps_x_m"] - x, epochs["gps_y_m"] - y, gps_azimuth_deg(epochs) - azimuth)
        )
    for method, track in tracks.items():
        azimuth_deg = np.degrees(track["azimuth_rad"])
        dx, dy = track["x_m"] - epochs["gps_x_m"], track["y_m"] - epochs["gps_y_m"]
        results.append(_result(method, "GPS", dx, dy, azimuth_deg - gps_azimuth_deg(epochs)))
        if at:
            x, y, azimuth = at
            dx, dy, da = track["x_m"] - x, track["y_m"] - y, azimuth_deg - azimuth
            result = _result(method, "truth", dx, dy, da)
            nees = epoch_nees(track, truth) if truth else np.zeros(0)
            mean = float(np.nanmean(nees)) if np.isfinite(nees).any() else np.nan
            results.append(result._replace(drift_percent=_drift(track, dx, dy), nees=mean))
    return results


def _wrapped(degrees: Floats) -> Floats:
    return (degrees + 180.0) % 360.0 - 180.0


def _result(method: str, against: str, dx: Floats, dy: Floats, azimuth_deg: Floats) -> Result:
    there = np.isfinite(dx) & np.isfinite(dy)
    dx, dy = dx[there], dy[there]
    azimuth = _wrapped(azimuth_deg)
    azimuth = azimuth[np.isfinite(azimuth)]
    if not len(dx):
        return Result(method, against, 0, *([np.nan] * 10))

    def of(function: object, values: Floats) -> float:
        return float(function(values)) if len(values) else np.nan  # type: ignore[operator]

    return Result(
        method,
        against,
        len(dx),
        *(of(np.mean, dx), of(np.std, dx), of(np.mean, dy), of(np.std, dy)),
        float(np.sqrt(np.mean(dx**2 + dy**2))),
        *(of(np.mean, azimuth), of(np.std, azimuth), of(lambda a: np.sqrt(np.mean(a**2)), azimuth)),
        np.nan,
        np.nan,
    )


def _drift(track: Estimates, dx: Floats, dy: Floats) -> float:
    """Percent: over each stretch of dead reckoning, what the error grew by at most, by the distance driven there."""
    reckoning = track["mode"] == 2
    worst = np.nan
    starts = np.flatnonzero(reckoning & ~np.roll(reckoning, 1))
    for start in starts:
        if start == 0:
            continue
        stop = start + int(np.argmin(np.append(reckoning[start:], False)))
        t = track["t_s"][start - 1 : stop]
        way = float(np.sum(track["speed_mps"][start:stop] * np.diff(t)))
        grown = np.hypot(dx[start:stop] - dx[start - 1], dy[start:stop] - dy[start - 1])
        if way > 1.0 and np.isfinite(grown).any():
            worst = np.fmax(worst, 100.0 * float(np.nanmax(grown)) / way)
    return float(worst)


def epoch_nees(track: Estimates, truth: Truth) -> Floats:
    """Normalised estimation error squared of x, y, azimuth at each epoch, shape (n,); NaN before the start and outside
    the truth. The mean over N independent runs is a chi-square of 3 N degrees, by N."""
    x, y, azimuth = truth_at(truth, track["t_s"])
    dx, dy, da = track["x_m"] - x, track["y_m"] - y, np.degrees(track["azimuth_rad"]) - azimuth
    error = np.stack([dx, dy, np.radians(_wrapped(da))], axis=1)
    there = np.isfinite(error).all(axis=1) & (track["mode"] != 0)
    nees = np.full(len(track), np.nan)
    scaled = np.linalg.solve(covariances(track)[there], error[there][:, :, None])[:, :, 0]
    nees[there] = np.sum(error[there] * scaled, axis=1)
    return nees


def mean_nees_bounds(runs: int) -> tuple[float, float]:
    """Between what 95 % of the mean NEES of x, y, azimuth over so many runs lies when the covariance is right."""
    degrees = 3.0 * runs  # Wilson and Hilferty: to 0.1 % from ten runs on
    spread = 2.0 / (9.0 * degrees)
    low, high = (3.0 * (1.0 - spread + z * spread**0.5) ** 3 for z in (-1.959964, 1.959964))
    return low, high


def results_text(results: list[Result]) -> str:
    """The table."""
    lines = [
        f"{'method':16} {'against':7} {'n':>6} {'dx mean':>8} {'std':>7} {'dy mean':>8} {'std':>7} {'RMSE':>7} "
        f"{'azimuth':>8} {'std':>7} {'RMSE':>7} {'drift':>7} {'NEES':>8}",
        f"{'':16} {'':7} {'':>6} {'m':>8} {'m':>7} {'m':>8} {'m':>7} {'m':>7} {'deg':>8} {'deg':>7} {'deg':>7} {'%':>7}"
        f" {'(3)':>8}",
    ]
    for r in results:
        numbers = (r.mean_dx_m, r.std_dx_m, r.mean_dy_m, r.std_dy_m, r.rmse_m)
        azimuths = (r.mean_azimuth_deg, r.std_azimuth_deg, r.rmse_azimuth_deg)
        line = f"{r.method:16} {r.against:7} {r.n:6d} {numbers[0]:8.3f} {numbers[1]:7.3f} {numbers[2]:8.3f} "
        line += f"{numbers[3]:7.3f} {numbers[4]:7.3f} {azimuths[0]:8.3f} {azimuths[1]:7.3f} {azimuths[2]:7.3f} "
        line += f"{r.drift_percent:7.2f} {r.nees:8.3g}"
        lines.append(line.replace("nan", "  -").rstrip())
    return "\n".join(lines)
