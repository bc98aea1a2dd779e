"""Drives read and synchronised: what is wrong is one line, what can go on goes on and is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tinyekf_py.vehicle.channels import Series
from tinyekf_py.vehicle.command import main
from tinyekf_py.vehicle.config import load_config
from tinyekf_py.vehicle.drive import increments, read_drive
from tinyekf_py.vehicle.simulate import Grade, SimulatedDrive, simulate_drive, write_drive
from tinyekf_py.vehicle.table import read_table


@pytest.fixture
def drive() -> SimulatedDrive:
    return simulate_drive("mixed", duration_s=30.0, seed=5)


def run(folder: Path, *extra: str) -> int:
    return main(
        [
            *("run", str(folder / "drive.csv"), "--config", str(folder / "config.toml"), "--calibration"),
            *(str(folder / "calibration.toml"), "--output", str(folder / "track.csv"), *extra),
        ]
    )


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    text = capsys.readouterr().err.strip()
    assert "\n" not in text
    return text


def test_a_simulated_drive_runs_with_every_method(tmp_path: Path, drive: SimulatedDrive) -> None:
    write_drive(tmp_path, drive)
    for method in ("kinematic-paper", "kinematic", "lsa-straight", "lsa-circle", "lsa"):
        assert run(tmp_path, "--method", method) == 0
        track = (tmp_path / "track.csv").read_text().splitlines()
        assert len(track) == 302
        assert track[0].startswith("t_s,x_m,y_m,lat_deg,lon_deg,azimuth_deg,speed_mps")


def test_a_missing_column_is_named(tmp_path: Path, drive: SimulatedDrive, capsys: pytest.CaptureFixture[str]) -> None:
    del drive.columns["silicon_V"]
    write_drive(tmp_path, drive)
    assert run(tmp_path) == 2
    assert "no column 'silicon_V' (for channel silicon_yaw_rate)" in one_line(capsys)


def test_a_voltage_of_300_is_told(tmp_path: Path, drive: SimulatedDrive, capsys: pytest.CaptureFixture[str]) -> None:
    drive.columns["oss_V"] = drive.columns["oss_V"] * 0 + 300.0
    write_drive(tmp_path, drive)
    assert run(tmp_path) == 2
    assert "channel oss has 300 V" in one_line(capsys)


def test_a_lone_implausible_value_is_skipped(tmp_path: Path, drive: SimulatedDrive) -> None:
    drive.columns["oss_V"][500] = 300.0
    write_drive(tmp_path, drive)
    config = load_config(tmp_path / "config.toml", tmp_path / "calibration.toml")
    assert read_drive(tmp_path / "drive.csv", config).counts["implausible values"] == 1


def test_an_unknown_channel_of_a_calibration_is_named(
    tmp_path: Path, drive: SimulatedDrive, capsys: pytest.CaptureFixture[str]
) -> None:
    write_drive(tmp_path, drive)
    with (tmp_path / "calibration.toml").open("a") as file:
        file.write("[channels.silicone_yaw_rate]\nscale = 1.0\n")
    assert run(tmp_path) == 2
    assert "channels.silicone_yaw_rate is not a channel of this drive; did you mean silicon_yaw_rate?" in one_line(
        capsys
    )


def test_a_unit_of_another_quantity_is_refused(
    tmp_path: Path, drive: SimulatedDrive, capsys: pytest.CaptureFixture[str]
) -> None:
    write_drive(tmp_path, drive)
    calibration = tmp_path / "calibration.toml"
    calibration.write_text(calibration.read_text().replace('"deg/s"', '"m/s"'))
    assert run(tmp_path) == 2
    assert "is no unit of a rotation rate" in one_line(capsys)


def test_unsorted_and_repeated_times_are_counted(tmp_path: Path, drive: SimulatedDrive) -> None:
    t = drive.columns["t_s"]
    t[100] = t[99]
    t[200] = t[150]
    write_drive(tmp_path, drive)
    config = load_config(tmp_path / "config.toml", tmp_path / "calibration.toml")
    read = read_drive(tmp_path / "drive.csv", config)
    assert read.counts["rows out of order or repeated"] == 2
    assert (np.diff(read.epochs["t_s"]) > 0).all()


def test_a_run_of_nan_leaves_its_epochs_without_the_sensor(tmp_path: Path, drive: SimulatedDrive) -> None:
    drive.columns["bosch_yaw_V"][1000:1200] = np.nan
    write_drive(tmp_path, drive)
    config = load_config(tmp_path / "config.toml", tmp_path / "calibration.toml")
    read = read_drive(tmp_path / "drive.csv", config)
    assert 20 <= read.counts["epochs without turn_bosch"] <= 22
    assert run(tmp_path) == 0


def test_text_in_a_number_s_place_is_missing_and_counted(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a,b\n1,2\n3,oops\n,4\n5\n")
    table = read_table(tmp_path / "t.csv")
    assert table.malformed == 2
    np.testing.assert_array_equal(table.rows, [[1, 2], [3, np.nan], [np.nan, 4]])


def test_empty_fields_are_missing(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("a,b,c\n,,1\n2,,\n,3,\n")
    nan = np.nan
    np.testing.assert_array_equal(read_table(tmp_path / "t.csv").rows, [[nan, nan, 1], [2, nan, nan], [nan, 3, nan]])


def test_increments_integrate_a_rate_and_know_its_silences() -> None:
    t = np.concatenate([np.arange(0, 1.0, 0.01), np.arange(3.0, 4.0, 0.01)])
    gained = increments(Series(t, 2.0 * t, False), np.array([0.0, 0.5, 0.9, 2.0, 3.5, 3.9]), 0.5)
    np.testing.assert_allclose(gained[[1, 2, 5]], [0.25, 0.81 - 0.25, 3.9**2 - 3.5**2], atol=1e-9)
    assert np.isnan(gained[[0, 3, 4]]).all()


def test_a_counter_that_is_reset_has_measured_nothing_then() -> None:
    t = np.arange(0, 4.0, 0.1)
    counts = np.where(t < 2.0, 10 * t, 10 * (t - 2.0))
    gained = increments(Series(t, counts, True), np.array([0.0, 1.0, 1.5, 2.5, 3.5]), 0.5)
    np.testing.assert_allclose(gained[[1, 2, 4]], [10, 5, 10], atol=1e-9)
    assert np.isnan(gained[3])


def test_a_latency_moves_a_channel_in_time(tmp_path: Path, drive: SimulatedDrive) -> None:
    write_drive(tmp_path, drive)
    config = load_config(tmp_path / "config.toml", tmp_path / "calibration.toml")
    now = read_drive(tmp_path / "drive.csv", config).epochs
    with (tmp_path / "calibration.toml").open("a") as file:
        file.write("[gps]\nlatency_s = 0.5\n")
    late = read_drive(
        tmp_path / "drive.csv", load_config(tmp_path / "config.toml", tmp_path / "calibration.toml")
    ).epochs
    first = np.flatnonzero(np.isfinite(late["gps_x_m"]))[0]
    assert late["t_s"][first] == pytest.approx(now["t_s"][0] - 0.5)


def test_grade_reaches_the_files(tmp_path: Path) -> None:
    grade = Grade(gps_m=0.02)
    write_drive(tmp_path, simulate_drive("circle", duration_s=5.0, grade=grade), grade)
    assert load_config(tmp_path / "config.toml").noise.gps_m == 0.02
