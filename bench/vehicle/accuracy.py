"""Accuracy and consistency of the vehicle's methods on simulated drives, and the time of a long run.

python bench/vehicle/accuracy.py [RUNS]     50 runs of each by default
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tinyekf_py.vehicle.command import main, run_method
from tinyekf_py.vehicle.config import VehicleConfig, load_config
from tinyekf_py.vehicle.drive import hide_gps, read_drive
from tinyekf_py.vehicle.epoch import Epochs
from tinyekf_py.vehicle.evaluate import epoch_nees, evaluate_methods, mean_nees_bounds
from tinyekf_py.vehicle.noise import PAPER_VARIANCES
from tinyekf_py.vehicle.simulate import Grade, simulate_drive, write_drive
from tinyekf_py.vehicle.track import Truth, read_truth

METHODS = ("kinematic-paper", "kinematic", "lsa")
NO_CONSTANTS = {"gyro_bias_dps": 0.0, "odo_scale": 0.0, "accel_bias_mps2": 0.0}


def drive(shape: str, seed: int, grade: Grade, folder: Path) -> tuple[Epochs, Truth, VehicleConfig]:
    write_drive(folder, simulate_drive(shape, duration_s=80.0, seed=seed, grade=grade), grade)
    config = load_config(folder / "config.toml", folder / "calibration.toml")
    read = read_drive(folder / "drive.csv", config)
    return read.epochs, read_truth(folder / "truth.csv", read.frame, read.origin_m), config


def table(title: str, runs: int, gap: tuple[float, float] | None = None, **grade: float) -> None:
    print(f"\n{title}")
    for shape in ("straight", "circle"):
        found: dict[str, list[tuple[float, float, float, float]]] = {}
        ensembles: dict[str, list[np.ndarray]] = {method: [] for method in METHODS}
        for seed in range(runs):
            with tempfile.TemporaryDirectory() as folder:
                epochs, truth, config = drive(shape, seed, Grade(**grade), Path(folder))
            hidden = hide_gps(epochs, *gap) if gap else epochs
            tracks = {method: run_method(hidden, method, config) for method in METHODS}
            for r in evaluate_methods(hidden, tracks, truth):
                if r.method in tracks and r.against == "truth":
                    ensembles[r.method].append(epoch_nees(tracks[r.method], truth))
                if r.against == "truth":
                    found.setdefault(r.method, []).append((r.rmse_m, r.rmse_azimuth_deg, r.nees, r.drift_percent))
        low, high = mean_nees_bounds(runs)
        for method, values in found.items():
            consistency = ""
            if method in tracks:
                # All runs have the same epochs; those of a start that came later in one are left out.
                mean = np.mean(ensembles[method], axis=0)
                mean = mean[np.isfinite(mean)]
                within = 100.0 * np.mean((mean >= low) & (mean <= high))
                consistency = f"  mean within {low:.2f} .. {high:.2f} at {within:.0f} % of epochs"
            rmse, azimuth, nees, drift = np.array(values).T
            worst = np.max(drift) if np.isfinite(drift).any() else np.nan
            print(
                f"{shape:9} {method:16} position {np.sqrt(np.mean(rmse**2)):7.3f} m  "
                f"azimuth {np.sqrt(np.mean(azimuth**2)):7.3f} deg  NEES {np.mean(nees):9.3g}  "
                f"drift median {np.median(drift):6.2f} worst {worst:6.2f} %{consistency}"
            )


def paper_gap(runs: int) -> None:
    """30 s without GPS where gyro and odometer are as bad as the paper's variances say."""
    print("\n30 s gap, rotations and distances as noisy as the paper's variances, kinematic told so")
    rng = np.random.default_rng(1)
    ends = []
    for seed in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            epochs, truth, config = drive("straight", seed, Grade(gps_m=0.02, gyro_bias_dps=0.0), Path(folder))
        sigma = np.sqrt(PAPER_VARIANCES)
        n = len(epochs)
        for column in range(4):
            epochs["turn_rad"][:, column] = rng.normal(0, sigma[2 + column], n)
        moving = epochs["odo_m"] > 0.01
        epochs["odo_m"] += moving * rng.normal(0, sigma[6], n)
        epochs["oss_m"] += moving * rng.normal(0, sigma[9], n)
        epochs["xsens_mps2"] = epochs["bosch_mps2"] = np.nan
        turns = {
            name: (float(np.degrees(s)), 0.0, 0.0)
            for name, s in zip(("turn_odo", "turn_xsens", "turn_silicon", "turn_bosch"), sigma[2:6], strict=True)
        }
        ways = {"way_odo": (float(sigma[6]), 0.0, 0.0), "way_oss": (float(sigma[9]), 0.0, 0.0)}
        told = dataclasses.replace(config, noise=dataclasses.replace(config.noise, **turns, **ways))
        track = run_method(hide_gps(epochs, 45.0, 75.0), "kinematic", told)
        at = int(np.searchsorted(track["t_s"], 74.9))
        x = np.interp(track["t_s"][at], truth.t_s, truth.x_m)
        y = np.interp(track["t_s"][at], truth.t_s, truth.y_m)
        ends.append(np.hypot(track["x_m"][at] - x, track["y_m"][at] - y))
        way = 10.0 * 30.0
    fused = 1 / np.sqrt(np.sum(1 / np.array(PAPER_VARIANCES[2:6])))
    k = np.arange(1, 301)
    bound = np.sqrt(np.sum((way * (301 - k) / 300 * fused) ** 2))
    rms = float(np.sqrt(np.mean(np.square(ends))))
    print(
        f"error at the end {rms:.1f} m rms, {100 * rms / way:.1f} % of the way; bound sqrt(sum sigma^2) {bound:.1f} m"
    )


def long_run() -> None:
    """An hour at 100 Hz from file to file."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_drive(folder, simulate_drive("mixed", duration_s=3600.0))
        arguments = ["run", str(folder / "drive.csv"), "--config", str(folder / "config.toml")]
        arguments += ["--calibration", str(folder / "calibration.toml"), "--output", str(folder / "track.csv")]
        for method in ("kinematic", "lsa"):
            start = time.perf_counter()
            main([*arguments, "--method", method])
            print(f"1 h at 100 Hz, {method}, epochs of 0.1 s: {time.perf_counter() - start:.2f} s")
        text = (folder / "config.toml").read_text().replace("[drive]", "[drive]\nepoch_s = 0.01")
        (folder / "config.toml").write_text(text)
        start = time.perf_counter()
        main([*arguments, "--method", "kinematic"])
        print(f"1 h at 100 Hz, kinematic, an epoch a row: {time.perf_counter() - start:.2f} s")


if __name__ == "__main__":
    RUNS = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    table("cheap GPS, 1.5 m", RUNS, gps_m=1.5)
    table("RTK, 0.02 m", RUNS, gps_m=0.02)
    table("cheap GPS, no constant errors", RUNS, gps_m=1.5, **NO_CONSTANTS)
    table("RTK, no constant errors", RUNS, gps_m=0.02, **NO_CONSTANTS)
    table("30 s without GPS, cheap GPS before", RUNS, (45.0, 75.0), gps_m=1.5)
    paper_gap(RUNS)
    long_run()
