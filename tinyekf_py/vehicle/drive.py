"""From channels to epochs: synchronisation to the GPS time stamps.

Every GPS position makes an epoch at its own time, latency taken off; between positions further apart epochs are
put in. Rates are integrated, and counters interpolated, to the epochs' times, so sensors need no common rate. What
is measured off the reference point is moved there by the rotation of the epoch.
"""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinyekf_py._core import ffi, lib
from tinyekf_py.vehicle.channels import Channels, Series, read_channels
from tinyekf_py.vehicle.config import VehicleConfig
from tinyekf_py.vehicle.epoch import Epochs, empty_epochs
from tinyekf_py.vehicle.table import DriveError, Floats

_DEGREE = math.pi / 180.0


class LocalFrame:
    """Metres north and east of an origin in degrees, on the WGS-84 radii there."""

    def __init__(self, lat_deg: float, lon_deg: float) -> None:
        frame = ffi.new("local_frame_t *")
        lib.local_frame_set(frame, lat_deg * _DEGREE, lon_deg * _DEGREE)
        self.lat_deg, self.lon_deg = lat_deg, lon_deg
        self._m_per_deg = (frame.metres_lat * _DEGREE, frame.metres_lon * _DEGREE)

    def to_metres(self, lat_deg: Floats, lon_deg: Floats) -> tuple[Floats, Floats]:
        east_deg = (lon_deg - self.lon_deg + 180.0) % 360.0 - 180.0
        return (lat_deg - self.lat_deg) * self._m_per_deg[0], east_deg * self._m_per_deg[1]

    def to_degrees(self, x_m: Floats, y_m: Floats) -> tuple[Floats, Floats]:
        lon = self.lon_deg + y_m / self._m_per_deg[1]
        return self.lat_deg + x_m / self._m_per_deg[0], (lon + 180.0) % 360.0 - 180.0


class Drive(NamedTuple):
    """A drive ready for the methods."""

    epochs: Epochs  #: x and y in metres from the origin
    frame: LocalFrame | None  #: where positions are in degrees
    origin_m: tuple[float, float]  #: where they are in metres: what was taken off x and y
    counts: Counter[str]


def read_drive(path: Path, config: VehicleConfig) -> Drive:
    """Read and synchronise a drive."""
    return synchronise(path, read_channels(path, config), config)


def synchronise(path: Path, channels: Channels, config: VehicleConfig) -> Drive:
    """The channels of the drive `path` as epochs."""
    series, counts = channels.series, Counter(channels.counts)
    t_gps, x, y, sigma, frame, origin = _positions(path, channels, config)
    end = max(one.t_s[-1] for one in series.values())
    edges = _edges(t_gps, end, config.drive.epoch_s)
    epochs = empty_epochs(edges)
    at = np.searchsorted(edges, t_gps)
    epochs["gps_x_m"][at], epochs["gps_y_m"][at], epochs["gps_sigma_m"][at] = x, y, sigma

    max_gap = config.drive.max_gap_s
    turn = epochs["turn_rad"]
    for column, name in enumerate(("xsens_yaw_rate", "silicon_yaw_rate", "bosch_yaw_rate"), start=1):
        if name in series:
            turn[:, column] = increments(series[name], edges, max_gap)
    _odometer(epochs, channels, config, edges)
    mean_turn = _mean_of_measured(turn)
    duration = np.diff(edges, prepend=np.nan)
    if "oss" in series:
        epochs["oss_m"] = increments(series["oss"], edges, max_gap)
        starboard = config.channels["oss"].position_m[1]
        epochs["oss_m"] += mean_turn * starboard if starboard else 0.0
    for name in ("xsens", "bosch"):
        if f"{name}_accel" in series:
            gained = increments(series[f"{name}_accel"], edges, max_gap)
            forward = config.channels[f"{name}_accel"].position_m[0]
            centripetal = (mean_turn / duration) ** 2 * forward if forward else 0.0
            epochs[f"{name}_mps2"] = gained / duration + centripetal
    _count_gaps(epochs, counts)
    return Drive(epochs, frame, origin, counts)


def _positions(
    path: Path, channels: Channels, config: VehicleConfig
) -> tuple[Floats, Floats, Floats, Floats, LocalFrame | None, tuple[float, float]]:
    series, fresh = channels.series, channels.fresh_gps.copy()
    in_degrees = "gps_lat" in series
    a, b = (series["gps_lat"], series["gps_lon"]) if in_degrees else (series["gps_x"], series["gps_y"])
    if len(a.t_s) != len(b.t_s):
        raise DriveError(f"{path}: the two columns of the GPS position must stand in one file")
    fresh &= np.isfinite(b.values)
    if in_degrees:
        fresh &= np.abs(a.values) <= 90.0
    if not config.gps.change_column:
        rows = np.flatnonzero(fresh)
        repeats = np.zeros(len(rows), bool)
        repeats[1:] = (np.diff(a.values[rows]) == 0) & (np.diff(b.values[rows]) == 0)
        # Rows faster than any receiver that say the same are one position held, not many measured.
        held = repeats & (np.diff(a.t_s[rows], prepend=-np.inf) < 0.6 * _typical_change_s(a.t_s[rows], repeats))
        fresh[rows[held]] = False
    if not fresh.any():
        raise DriveError(f"{path}: not one GPS position in {len(a.values)} rows")
    t, first, second = a.t_s[fresh], a.values[fresh], b.values[fresh]
    sigma = np.full(len(t), np.nan)
    if "gps_sigma" in series:
        told = series["gps_sigma"]
        sigma = np.interp(t, told.t_s, told.values) * config.gps.sigma_scale
        sigma[~(sigma > 0)] = np.nan
    if in_degrees:
        frame = LocalFrame(float(first[0]), float(second[0]))
        x, y = frame.to_metres(first, second)
        return t, x, y, sigma, frame, (0.0, 0.0)
    origin = (float(first[0]), float(second[0]))
    return t, first - origin[0], second - origin[1], sigma, None, origin


def _typical_change_s(t_s: Floats, repeats: np.ndarray) -> float:
    changes = t_s[~repeats]
    return float(np.median(np.diff(changes))) if len(changes) > 2 else 0.0


def _edges(t_gps: Floats, end: float, epoch_s: float) -> Floats:
    """Times of the epochs: the positions', and between and after them no further apart than 1.5 epochs."""
    bounds = np.append(t_gps, end) if end > t_gps[-1] + epoch_s else t_gps
    gaps = np.diff(bounds)
    pieces = np.maximum(np.rint(gaps / epoch_s).astype(int), 1)
    pieces[gaps <= 1.5 * epoch_s] = 1
    if int(pieces.sum()) > 50_000_000:
        raise DriveError(f"{gaps.max():.0f} s between GPS positions make too many epochs; are the time units right?")
    start = np.repeat(bounds[:-1], pieces)
    number = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    return np.append(start + number * np.repeat(gaps / pieces, pieces), bounds[-1])


def increments(series: Series, edges: Floats, max_gap_s: float) -> Floats:
    """What a channel gained since the edge before, shape of `edges`; NaN first, and where it was silent too long."""
    valid = np.isfinite(series.values)
    t, values = series.t_s[valid], series.values[valid]
    gained = np.full(len(edges), np.nan)
    if len(t) < 2:
        return gained
    dt = np.diff(t)
    steps = np.diff(values) if series.cumulative else dt * (values[1:] + values[:-1]) / 2
    silent = dt > max(max_gap_s, 3 * float(np.median(dt)))
    if series.cumulative:
        silent |= steps < 0  # a counter that fell was reset
        steps = np.where(silent, 0.0, steps)
    total = np.concatenate(([0.0], np.cumsum(steps)))
    gap = np.concatenate(([0.0], np.cumsum(np.where(silent, dt, 0.0))))
    outside = (edges < t[0] - np.median(dt)) | (edges > t[-1] + np.median(dt))
    at_edges, gap_at_edges = np.interp(edges, t, total), np.interp(edges, t, gap)
    gained[1:] = np.diff(at_edges)
    gained[1:][(np.diff(gap_at_edges) > 0) | outside[1:] | outside[:-1]] = np.nan
    return gained


def _odometer(epochs: Epochs, channels: Channels, config: VehicleConfig, edges: Floats) -> None:
    """Distance of the odometer, and from two wheels the rotation: to starboard when the left one goes farther."""
    series, max_gap = channels.series, config.drive.max_gap_s
    if "odo_left" in series and "odo_right" in series:
        left = increments(series["odo_left"], edges, max_gap)
        right = increments(series["odo_right"], edges, max_gap)
        epochs["odo_m"] = (left + right) / 2
        epochs["turn_rad"][:, 0] = (left - right) / config.drive.track_width_m
    for name in ("odo", "odo_left", "odo_right"):
        if name in series and not ("odo_left" in series and "odo_right" in series):
            epochs["odo_m"] = increments(series[name], edges, max_gap)
            break


def _mean_of_measured(turn: Floats) -> Floats:
    """Mean rotation of the gyros that measured, else the odometer's, else 0; shape (n,)."""
    gyros = turn[:, 1:]
    there = np.isfinite(gyros)
    n = there.sum(axis=1)
    mean = np.where(there, gyros, 0.0).sum(axis=1) / np.maximum(n, 1)
    return np.where(n > 0, mean, np.nan_to_num(turn[:, 0]))


def _count_gaps(epochs: Epochs, counts: Counter[str]) -> None:
    measured = {
        "turn_odo": epochs["turn_rad"][:, 0], "turn_xsens": epochs["turn_rad"][:, 1],
        "turn_silicon": epochs["turn_rad"][:, 2], "turn_bosch": epochs["turn_rad"][:, 3],
        "way_odo": epochs["odo_m"], "way_oss": epochs["oss_m"],
        "accel_xsens": epochs["xsens_mps2"], "accel_bosch": epochs["bosch_mps2"],
    }  # fmt: skip
    for name, values in measured.items():
        there = np.isfinite(values[1:])
        if there.any() and not there.all():
            counts[f"epochs without {name}"] += int((~there).sum())


def hide_gps(epochs: Epochs, from_s: float, to_s: float) -> Epochs:
    """A copy without GPS positions between two times since the first epoch, in seconds."""
    hidden = epochs.copy()
    t = hidden["t_s"] - hidden["t_s"][0]
    within = (t >= from_s) & (t < to_s)
    hidden["gps_x_m"][within] = hidden["gps_y_m"][within] = np.nan
    return hidden
