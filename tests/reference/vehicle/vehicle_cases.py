"""The drives on which core and reference are compared: every sensor and its absence, gaps, outliers, standstills.

    python tests/reference/vehicle/vehicle_cases.py FOLDER    writes them for the reference

Epochs are made here from a fixed seed, without the core: positions, rotations and distances of a drive with curves and
stops, in local metres.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinyekf_py.vehicle.epoch import METHODS, Epochs, empty_epochs
from tinyekf_py.vehicle.noise import PAPER, Noise

NAN = math.nan


class Case(NamedTuple):
    """A drive and what the methods are told of it."""

    name: str
    epochs: Epochs
    noise: Noise
    lever_m: tuple[float, float] = (0.0, 0.0)
    start_azimuth_rad: float = NAN
    standstill_mps: float = 0.1


def drive(seed: int, n: int = 400, gps_m: float = 1.0, dt: float = 0.1, lever: tuple[float, float] = (0, 0)) -> Epochs:
    """At rest, off in a straight line, curves both ways, a stop, and on."""
    chance = np.random.RandomState(seed)
    k = np.arange(n)
    speed = np.clip((k - 15) * 0.25, 0, 8.0)
    speed = np.where((k > 240) & (k < 280), np.clip(8.0 - np.abs(260 - k) * -0.4 - 8.0, 0, 8.0), speed)
    speed[(k >= 252) & (k <= 268)] = 0.0
    rate = np.where((k > 80) & (k < 160), 0.25, 0.0) - np.where((k > 180) & (k < 230), 0.15, 0.0)
    rate = rate * (speed > 0)
    turn, way = rate * dt, speed * dt
    azimuth = 3.0 + np.cumsum(turn)
    middle = azimuth - turn / 2
    x, y = np.cumsum(way * np.cos(middle)), np.cumsum(way * np.sin(middle))
    epochs = empty_epochs(10.0 + k * dt)
    c, s = np.cos(azimuth), np.sin(azimuth)
    epochs["gps_x_m"] = x + c * lever[0] - s * lever[1] + chance.normal(0, gps_m, n)
    epochs["gps_y_m"] = y + s * lever[0] + c * lever[1] + chance.normal(0, gps_m, n)
    for column, sigma in enumerate((5e-3, 3e-4, 3e-4, 3e-4)):
        epochs["turn_rad"][:, column] = turn + chance.normal(0, sigma, n)
    moving = speed > 0
    epochs["odo_m"] = way * (1 + moving * chance.normal(0, 0.005, n))
    epochs["oss_m"] = way * (1 + moving * chance.normal(0, 0.005, n))
    acceleration = np.gradient(speed, dt)
    epochs["xsens_mps2"] = acceleration + chance.normal(0, 0.2, n)
    epochs["bosch_mps2"] = acceleration + chance.normal(0, 0.2, n)
    return epochs


def cases() -> list[Case]:
    """All drives."""
    plain = Case("plain", drive(1), Noise(gps_m=1.0))
    gaps = plain.epochs.copy()
    gaps["gps_x_m"][100:200] = NAN
    gaps["turn_rad"][150:170] = NAN
    gaps["turn_rad"][60:90, 1] = NAN
    gaps["odo_m"][120:180] = NAN
    gaps["oss_m"][140:150] = NAN
    gaps["bosch_mps2"][200:300] = NAN
    gaps["xsens_mps2"][220:320] = NAN
    outliers = plain.epochs.copy()
    outliers["gps_x_m"][90::20] += 30.0
    outliers["odo_m"][100:240:23] += 2.0
    outliers["turn_rad"][105::31, 3] += 0.6
    outliers["gps_y_m"][300:320] += 40.0
    moved = plain.epochs.copy()
    moved["gps_y_m"][300:] += 40.0
    lone = empty_epochs(plain.epochs["t_s"])
    for name in ("gps_x_m", "gps_y_m"):
        lone[name] = plain.epochs[name]
    gyro = lone.copy()
    gyro["turn_rad"][:, 2] = plain.epochs["turn_rad"][:, 2]
    gyro["oss_m"] = plain.epochs["oss_m"]
    repeated = plain.epochs.copy()
    repeated["t_s"][50] = repeated["t_s"][49]
    repeated["gps_sigma_m"][::3] = 0.7
    return [
        plain,
        Case("rtk", drive(2, gps_m=0.02, lever=(0.8, -0.3)), Noise(gps_m=0.02), lever_m=(0.8, -0.3)),
        Case("gaps", gaps, Noise(gps_m=1.0)),
        Case("outliers", outliers, Noise(gps_m=1.0)),
        Case("moved", moved, Noise(gps_m=1.0)),
        Case("gps_alone", lone, Noise(gps_m=1.0)),
        Case("one_gyro", gyro, Noise(gps_m=1.0)),
        Case("repeated", repeated, Noise(gps_m=1.0)),
        Case("given_azimuth", drive(3), Noise(gps_m=1.0), start_azimuth_rad=3.0),
        Case("paper", drive(4, gps_m=0.003), PAPER),
    ]


CASES = cases()
#: Every drive by the methods that one would use; the two models of the adjustment alone on two of them.
RUNS = [
    (case, method)
    for case in CASES
    for method in METHODS
    if method in ("kinematic-paper", "kinematic", "lsa") or case.name in ("plain", "rtk")
    # At rest the paper's filter follows the noise of positions it takes for exact: rounding grows without bound.
    if (case.name, method) != ("given_azimuth", "kinematic-paper")
    # While the adjustment finds back, several observations are suspected by the same: rounding decides between them.
    if (case.name, method) != ("moved", "lsa")
]


def noise_of(case: Case, method: str) -> Noise:
    """What a method is told: the paper's filter takes the paper's variances but for the position's in `plain`."""
    return dataclasses.replace(PAPER) if method == "kinematic-paper" else case.noise


def options_row(case: Case, method: str) -> list[float]:
    """The options as vehicle_options.m reads them."""

    class Options:
        white = [0.0] * 10
        walk = [0.0] * 10
        relative = [0.0] * 10

    o = Options()
    o.white, o.walk, o.relative = [0.0] * 10, [0.0] * 10, [0.0] * 10
    noise_of(case, method).fill(o)
    names = ("q_ww", "along_density", "lateral_density", "position_walk", "gate_gps", "gate_row", "reaccept_s")
    names += ("start_sigma_rad", "turn_threshold_rad", "turn_hysteresis")
    row = [*o.white, *o.walk, *o.relative, *o.accel_sigma_mps2, *(getattr(o, name) for name in names)]
    return [*row, case.standstill_mps, case.start_azimuth_rad, *case.lever_m]


def _write(path: Path, rows: np.ndarray) -> None:
    with path.open("w", encoding="ascii") as file:
        print(",".join(f"c{i + 1}" for i in range(rows.shape[1])), file=file)
        for row in rows:
            print(",".join(f"{value:.17g}" for value in row), file=file)


def main(folder: Path) -> None:
    """Write everything into `folder`, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    for case in CASES:
        epochs = case.epochs.copy()
        for method in METHODS:
            _write(folder / f"{case.name}_{method}_options.csv", np.array([options_row(case, method)]))
        _write(folder / f"{case.name}_epochs.csv", epochs.view(float).reshape(len(epochs), -1))
    lines = [f"{case.name} {method}\n" for case, method in RUNS]
    (folder / "runs.txt").write_text("".join(lines), encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
