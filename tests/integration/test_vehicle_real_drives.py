"""The two real drives by one command each, with the configurations in tests/vehicle."""

from __future__ import annotations

from pathlib import Path

import pytest

from tinyekf_py.vehicle.command import main, run_method
from tinyekf_py.vehicle.config import load_config
from tinyekf_py.vehicle.drive import hide_gps, read_drive
from tinyekf_py.vehicle.evaluate import evaluate_methods
from tinyekf_py.vehicle.track import read_truth

CONFIGS = Path(__file__).resolve().parent.parent / "vehicle"
COMMA = "comma2k19/comma_GNSS_live_gnss_ublox.csv"
BALZER = "balzer82/2014-03-26-000-Data.csv"


@pytest.mark.parametrize("method", ["kinematic-paper", "kinematic", "lsa"])
@pytest.mark.parametrize(("name", "data"), [("comma2k19", COMMA), ("balzer82", BALZER)])
def test_a_real_drive_runs_by_one_command(recordings: Path, tmp_path: Path, name: str, data: str, method: str) -> None:
    track = tmp_path / "track.csv"
    arguments = ["run", str(recordings / data), "--config", str(CONFIGS / f"{name}.toml"), "--method", method]
    assert main([*arguments, "--output", str(track)]) == 0
    assert len(track.read_text().splitlines()) > 500


@pytest.mark.parametrize("method", ["kinematic", "lsa"])
def test_comma2k19_is_better_than_its_receiver(recordings: Path, method: str) -> None:
    config = load_config(CONFIGS / "comma2k19.toml")
    drive = read_drive(recordings / COMMA, config)
    truth = read_truth(recordings / "comma2k19/comma_truth.csv", drive.frame, drive.origin_m)
    truth = truth._replace(azimuth_deg=truth.azimuth_deg + 0.9)  # the camera's known offset
    track = run_method(drive.epochs, method, config)
    found = {r.method: r for r in evaluate_methods(drive.epochs, {method: track}, truth) if r.against == "truth"}
    assert found[method].rmse_m < 0.6  # 1.47 m the receiver's positions as stamped
    assert found[method].rmse_azimuth_deg <= 0.35

    hidden = run_method(hide_gps(drive.epochs, 30.0, 50.0), method, config)
    found = {r.method: r for r in evaluate_methods(drive.epochs, {method: hidden}, truth) if r.against == "truth"}
    assert found[method].drift_percent <= 1.5
