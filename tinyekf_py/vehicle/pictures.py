"""The third paper's Figures 7 to 12: trajectory, displacement from GPS, velocity against the optical sensor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tinyekf_py.vehicle.epoch import Epochs, Estimates
from tinyekf_py.vehicle.table import DriveError
from tinyekf_py.vehicle.track import Truth


def draw_pictures(folder: Path, epochs: Epochs, tracks: Mapping[str, Estimates], truth: Truth | None) -> list[Path]:
    """Write trajectory.png, displacement.png and velocity.png into `folder`, which is made; their paths."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DriveError("pictures need matplotlib: pip install 'tinyekf-py[plots]'") from error
    folder.mkdir(parents=True, exist_ok=True)
    t = epochs["t_s"] - epochs["t_s"][0]
    drawn = {}

    figure = Figure(figsize=(8, 8))
    axes: Any = figure.add_subplot()
    axes.plot(epochs["gps_y_m"], epochs["gps_x_m"], ".", color="0.7", label="GPS")
    if truth:
        axes.plot(truth.y_m, truth.x_m, "k--", lw=1, label="truth")
    for method, track in tracks.items():
        axes.plot(track["y_m"], track["x_m"], lw=1, label=method)
    axes.set(xlabel="east (m)", ylabel="north (m)", title="Trajectory", aspect="equal")
    axes.legend()
    drawn["trajectory"] = figure

    figure = Figure(figsize=(10, 6))
    both: Any = figure.subplots(2, 1, sharex=True)
    for axes, ours, theirs, name in ((both[0], "x_m", "gps_x_m", "x"), (both[1], "y_m", "gps_y_m", "y")):
        there = np.isfinite(epochs[theirs])
        for method, track in tracks.items():
            axes.plot(t[there], (track[ours] - epochs[theirs])[there], lw=1, label=method)
        axes.set(ylabel=f"{name} - GPS (m)")
        axes.grid(visible=True)
    both[0].set_title("Displacement from GPS")
    both[1].set_xlabel("t (s)")
    both[0].legend()
    drawn["displacement"] = figure

    figure = Figure(figsize=(10, 5))
    axes = figure.add_subplot()
    oss = epochs["oss_m"] / np.diff(epochs["t_s"], prepend=np.nan)
    axes.plot(t, oss, ".", ms=2, color="0.7", label="optical sensor")
    for method, track in tracks.items():
        axes.plot(t, track["speed_mps"], lw=1, label=method)
    axes.set(xlabel="t (s)", ylabel="speed (m/s)", title="Velocity against the optical sensor")
    axes.legend()
    drawn["velocity"] = figure

    paths = []
    for name, figure in drawn.items():
        figure.tight_layout()
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=100)
    return paths
