"""The track that a method makes of a drive, as a CSV file; and truth files, from which it is judged."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinyekf_py.vehicle.drive import Drive, LocalFrame
from tinyekf_py.vehicle.epoch import MODES, OBSERVATIONS, Estimates
from tinyekf_py.vehicle.table import DriveError, Floats, read_table, write_table

#: Column -> format. x north, y east from the first GPS position; empty where nothing is known.
COLUMNS = {
    "t_s": "%.4f",
    "x_m": "%.4f",
    "y_m": "%.4f",
    "lat_deg": "%.9f",
    "lon_deg": "%.9f",
    "azimuth_deg": "%.4f",
    "speed_mps": "%.4f",
    "vx_mps": "%.4f",
    "vy_mps": "%.4f",
    "sigma_x_m": "%.4f",
    "sigma_y_m": "%.4f",
    "covariance_xy_m2": "%.6g",
    "azimuth_sigma_deg": "%.4f",
    "speed_sigma_mps": "%.4f",
    "mode": "%s",
    "model": "%s",
    "used": "%d",
    "refused": "%d",
    "chi_square": "%.3f",
    "degrees": "%d",
    "worst_w": "%.3f",
    "worst_observation": "%s",
}


def write_track(path: Path, estimates: Estimates, drive: Drive, method: str) -> None:
    """Write a track: a row an epoch, positions also in degrees where the drive's are."""
    n = len(estimates)
    lat, lon = np.full(n, np.nan), np.full(n, np.nan)
    if drive.frame:
        lat, lon = drive.frame.to_degrees(estimates["x_m"], estimates["y_m"])
    covariance = estimates["covariance"]
    azimuth = np.round(np.degrees(estimates["azimuth_rad"]), 4) % 360.0
    adjusts = method.startswith("lsa")
    models = ("straight", "circle") if adjusts else ("", "")
    worst = np.nan_to_num(estimates["worst_row"], nan=-1.0).astype(int).tolist()
    names = {-1: "", **dict(enumerate(OBSERVATIONS))}
    columns = [
        estimates["t_s"].tolist(),
        (estimates["x_m"] + drive.origin_m[0]).tolist(),
        (estimates["y_m"] + drive.origin_m[1]).tolist(),
        lat.tolist(),
        lon.tolist(),
        azimuth.tolist(),
        *(estimates[name].tolist() for name in ("speed_mps", "vx_mps", "vy_mps")),
        np.sqrt(covariance[:, 0]).tolist(),
        np.sqrt(covariance[:, 3]).tolist(),
        covariance[:, 1].tolist(),
        np.degrees(np.sqrt(covariance[:, 5])).tolist(),
        estimates["speed_sigma_mps"].tolist(),
        [MODES[int(mode)] for mode in estimates["mode"].tolist()],
        [models[int(circle)] for circle in estimates["circle"].tolist()],
        estimates["used"].astype(int).tolist(),
        estimates["refused"].astype(int).tolist(),
        estimates["chi_square"].tolist(),
        estimates["degrees"].astype(int).tolist(),
        estimates["worst_w"].tolist(),
        [names[row] for row in worst],
    ]
    write_table(path, COLUMNS, COLUMNS.values(), zip(*columns, strict=True))


class Truth(NamedTuple):
    """Where the vehicle was: shape (n,) each; NaN where a file does not say."""

    t_s: Floats
    x_m: Floats
    y_m: Floats
    azimuth_deg: Floats


def read_truth(path: Path, frame: LocalFrame | None, origin_m: tuple[float, float]) -> Truth:
    """A truth file: t_s, then x_m and y_m or lat_deg and lon_deg, and azimuth_deg, heading_deg or vn and ve."""
    table = read_table(path)
    t = table.column("t_s", "the truth")
    if frame and {"lat_deg", "lon_deg"} <= set(table.names):
        x, y = frame.to_metres(table.column("lat_deg", "the truth"), table.column("lon_deg", "the truth"))
    elif {"x_m", "y_m"} <= set(table.names):
        x = table.column("x_m", "the truth") - origin_m[0]
        y = table.column("y_m", "the truth") - origin_m[1]
    else:
        raise DriveError(f"{path}: no position: columns x_m and y_m, or lat_deg and lon_deg for a drive in degrees")
    azimuth = np.full(len(t), np.nan)
    for name in ("azimuth_deg", "heading_deg", "heading_deg_camera"):
        if name in table.names:
            azimuth = table.column(name, "the truth")
            break
    else:
        if {"vn", "ve"} <= set(table.names):
            azimuth = np.degrees(np.arctan2(table.column("ve", "the truth"), table.column("vn", "the truth"))) % 360
    return Truth(t, x, y, azimuth)


def truth_at(truth: Truth, t_s: Floats) -> tuple[Floats, Floats, Floats]:
    """x, y (m) and azimuth (deg, unwrapped) of the truth at the times, NaN outside it."""
    outside = (t_s < truth.t_s[0]) | (t_s > truth.t_s[-1])
    unwrapped = np.degrees(np.unwrap(np.radians(truth.azimuth_deg)))
    x, y, azimuth = (np.interp(t_s, truth.t_s, values) for values in (truth.x_m, truth.y_m, unwrapped))
    for values in (x, y, azimuth):
        values[outside] = np.nan
    return x, y, azimuth
