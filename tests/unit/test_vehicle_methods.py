"""What the vehicle's methods promise on simulated drives, judged by their truth."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tinyekf_py.vehicle.command import main, run_method
from tinyekf_py.vehicle.config import VehicleConfig, load_config
from tinyekf_py.vehicle.drive import hide_gps, read_drive
from tinyekf_py.vehicle.epoch import Epochs, covariances, empty_epochs, estimate_track
from tinyekf_py.vehicle.evaluate import Result, evaluate_methods, mean_nees_bounds
from tinyekf_py.vehicle.simulate import Grade, simulate_drive, write_drive
from tinyekf_py.vehicle.track import Truth, read_truth


def simulated(folder: Path, shape: str, grade: Grade, seed: int = 3) -> tuple[Epochs, Truth, VehicleConfig]:
    write_drive(folder, simulate_drive(shape, duration_s=80.0, seed=seed, grade=grade), grade)
    config = load_config(folder / "config.toml", folder / "calibration.toml")
    drive = read_drive(folder / "drive.csv", config)
    return drive.epochs, read_truth(folder / "truth.csv", drive.frame, drive.origin_m), config


def against_truth(epochs: Epochs, truth: Truth, config: VehicleConfig, *methods: str) -> dict[str, Result]:
    tracks = {method: run_method(epochs, method, config) for method in methods}
    return {r.method: r for r in evaluate_methods(epochs, tracks, truth) if r.against == "truth"}


@pytest.mark.parametrize("gps_m", [1.5, 0.02])
@pytest.mark.parametrize("shape", ["straight", "circle", "mixed"])
def test_the_methods_beat_raw_gps(tmp_path: Path, shape: str, gps_m: float) -> None:
    epochs, truth, config = simulated(tmp_path, shape, Grade(gps_m=gps_m))
    results = against_truth(epochs, truth, config, "kinematic", "lsa")
    for method in ("kinematic", "lsa"):
        assert results[method].rmse_m < 0.75 * results["raw GPS"].rmse_m
        assert results[method].rmse_azimuth_deg < 1.5


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
@pytest.mark.parametrize("shape", ["straight", "circle"])
def test_a_gap_of_30_s_costs_less_than_a_percent(tmp_path: Path, shape: str, method: str) -> None:
    epochs, truth, config = simulated(tmp_path, shape, Grade(gps_m=1.5))
    result = against_truth(hide_gps(epochs, 45.0, 75.0), truth, config, method)[method]
    assert result.drift_percent <= 1.0


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
def test_the_covariance_grows_in_a_gap(tmp_path: Path, method: str) -> None:
    epochs, _, config = simulated(tmp_path, "straight", Grade())
    track = run_method(hide_gps(epochs, 45.0, 75.0), method, config)
    variance = track["covariance"][:, 0] + track["covariance"][:, 3]
    gap = (track["t_s"] > 46.0) & (track["t_s"] < 75.0)
    assert (np.diff(variance[gap]) > 0).all()
    assert (track["mode"][gap] == 2).all()


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
def test_covariances_stay_positive_definite(tmp_path: Path, method: str) -> None:
    epochs, _, config = simulated(tmp_path, "mixed", Grade(gps_m=0.02))
    track = run_method(epochs, method, config)
    assert (np.linalg.eigvalsh(covariances(track)[track["mode"] != 0])[:, 0] > 0).all()


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
def test_nothing_moves_at_a_standstill(tmp_path: Path, method: str) -> None:
    epochs, _, config = simulated(tmp_path, "straight", Grade())
    epochs["odo_m"][400:500] = epochs["oss_m"][400:500] = 0.0
    track = run_method(epochs, method, config)[400:500]
    assert (track["mode"] == 3).all()
    assert np.ptp(track["x_m"]) == np.ptp(track["azimuth_rad"]) == 0.0
    assert (track["speed_mps"] == 0.0).all()


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
@pytest.mark.parametrize(
    "absent", ["turn_rad", "odo_m", "oss_m", "xsens_mps2", "bosch_mps2", "all but GPS", "all but GPS and one gyro"]
)
def test_any_subset_of_sensors_works(tmp_path: Path, method: str, absent: str) -> None:
    epochs, truth, config = simulated(tmp_path, "mixed", Grade(gps_m=0.5))
    if absent.startswith("all but"):
        kept = epochs["turn_rad"][:, 2].copy()
        for name in ("turn_rad", "odo_m", "oss_m", "xsens_mps2", "bosch_mps2"):
            epochs[name] = np.nan
        if absent.endswith("gyro"):
            epochs["turn_rad"][:, 2] = kept
    else:
        epochs[absent] = np.nan
    result = against_truth(epochs, truth, config, method)[method]
    assert result.n > 600
    assert result.rmse_m < 1.5


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
def test_outlying_positions_are_refused_and_lasting_ones_taken(tmp_path: Path, method: str) -> None:
    epochs, _, config = simulated(tmp_path, "straight", Grade(gps_m=0.5))
    epochs["gps_x_m"][300:310] += 50.0
    epochs["gps_x_m"][500:] += 50.0
    track = run_method(epochs, method, config)
    assert all(int(bits) & 3 == 3 for bits in track["refused"][300:310])
    assert abs(track["x_m"][-1] - epochs["gps_x_m"][-1]) < 3.0


def test_the_adjustment_does_not_flutter_at_the_threshold() -> None:
    chance = np.random.default_rng(1)
    n = 400
    epochs = empty_epochs(np.arange(n) * 0.1)
    turn = np.full(n, 0.01)
    azimuth = np.cumsum(turn)
    epochs["gps_x_m"] = np.cumsum(np.cos(azimuth - turn / 2)) + chance.normal(0, 0.02, n)
    epochs["gps_y_m"] = np.cumsum(np.sin(azimuth - turn / 2)) + chance.normal(0, 0.02, n)
    epochs["odo_m"] = 1.0
    epochs["turn_rad"][:, 3] = turn + chance.normal(0, 5e-4, n)
    circle = estimate_track(epochs, "lsa")["circle"]
    assert np.abs(np.diff(circle)).sum() <= 2


def test_a_lever_arm_is_taken_off(tmp_path: Path) -> None:
    grade = Grade(gps_m=0.02)
    epochs, truth, config = simulated(tmp_path, "circle", grade)
    azimuth = np.interp(epochs["t_s"], truth.t_s, np.unwrap(np.radians(truth.azimuth_deg)))
    epochs["gps_x_m"] += 2.0 * np.cos(azimuth) - 0.5 * np.sin(azimuth)
    epochs["gps_y_m"] += 2.0 * np.sin(azimuth) + 0.5 * np.cos(azimuth)
    config = dataclasses.replace(config, gps=dataclasses.replace(config.gps, lever_m=(2.0, 0.5)))
    results = against_truth(epochs, truth, config, "kinematic", "lsa")
    for method in ("kinematic", "lsa"):
        assert results[method].rmse_m < 0.03


def test_calibration_finds_what_was_put_in(tmp_path: Path) -> None:
    grade = Grade(gps_m=0.1)
    drive = simulate_drive("mixed", duration_s=200.0, seed=2, grade=grade)
    late = round(0.3 * grade.rate_hz)
    for name in ("silicon_V", "oss_V"):
        drive.columns[name][late:] = drive.columns[name][:-late].copy()
    write_drive(tmp_path, drive, grade)
    out = tmp_path / "found.toml"
    arguments = [str(tmp_path / "drive.csv"), "--config", str(tmp_path / "config.toml"), "--output", str(out)]
    assert main(["calibrate", *arguments, "--calibration", str(tmp_path / "calibration.toml")]) == 0
    from tinyekf_py.vehicle.calibrate import calibrate_drive

    fits = calibrate_drive(tmp_path / "drive.csv", load_config(tmp_path / "config.toml", tmp_path / "calibration.toml"))
    assert fits["silicon_yaw_rate"].scale == pytest.approx(1.0, abs=0.01)
    assert fits["silicon_yaw_rate"].latency_s == pytest.approx(0.3, abs=0.03)
    assert fits["bosch_yaw_rate"].latency_s == pytest.approx(0.0, abs=0.03)
    assert fits["odo_left"].scale > 0.9


def test_evaluate_prints_the_tables_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed: pip install 'tinyekf-py[plots]'")
    simulated(tmp_path, "circle", Grade())
    status = main(
        [
            *("evaluate", str(tmp_path / "drive.csv"), "--config", str(tmp_path / "config.toml"), "--calibration"),
            *(str(tmp_path / "calibration.toml"), "--truth", str(tmp_path / "truth.csv"), "--out", str(tmp_path / "p")),
        ]
    )
    assert status == 0
    assert "kinematic-paper  truth" in capsys.readouterr().out
    assert {path.name for path in (tmp_path / "p").iterdir()} == {"trajectory.png", "displacement.png", "velocity.png"}


def test_the_bounds_of_a_mean_nees_are_those_of_chi_square() -> None:
    # Quantiles of chi-square at 2.5 and 97.5 % with 150 degrees of freedom, from tables.
    assert mean_nees_bounds(50) == pytest.approx((117.985 / 50, 185.800 / 50), rel=1e-3)
