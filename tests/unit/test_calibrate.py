"""Calibration finds what the simulator put in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.simulator.grades import GRADES
from acquisition.simulator.helm import Leg, circle
from acquisition.simulator.recorder import record
from acquisition.simulator.scenarios import SCENARIOS, Scenario
from acquisition.simulator.voyage import Voyage
from tinyekf_py.calibrate.card import card_text
from tinyekf_py.calibrate.command import main
from tinyekf_py.calibrate.config_edit import set_key
from tinyekf_py.calibrate.current import find_current
from tinyekf_py.calibrate.deviation_fit import deviation_sigma_deg, fit_deviation, largest_gap
from tinyekf_py.calibrate.gyro_fit import fit_gyro
from tinyekf_py.calibrate.latency_fit import SIGMA_S, fit_latency, worth_writing
from tinyekf_py.calibrate.track import CalibrationError, track_of
from tinyekf_py.config import Config, ConfigError, config_text, load_config
from tinyekf_py.deviation import deviation_deg
from tinyekf_py.evaluate.decoded import decode
from tinyekf_py.sensor_config import ImuConfig

SWING = Scenario(
    "swing",
    "a circle each way, with legs between",
    (circle(3.0, speed_mps=3.0), Leg(30.0, 90.0), circle(-3.0, speed_mps=3.0), Leg(30.0, 180.0)),
    40.0,
    3.0,
)
CURRENT = replace(SWING, waters=replace(SWING.waters, set_deg=70.0, drift_mps=0.45))


def sailed(folder: Path, scenario: Scenario, seed: int = 1, duration_s: float = 400.0) -> tuple[Path, Voyage]:
    voyage = Voyage(scenario, GRADES["typical"], seed=seed)
    record(voyage, folder / "voyage.rec", folder / "voyage.truth.csv", duration_s)
    return folder / "voyage.rec", voyage


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("scenario", [SWING, CURRENT], ids=["still", "current"])
def test_a_swing_gives_the_deviation_in_spite_of_a_current(tmp_path: Path, scenario: Scenario, seed: int) -> None:
    recording, voyage = sailed(tmp_path, scenario, seed)
    fit = fit_deviation([track_of(decode(recording))])
    headings = np.arange(0.0, 360.0, 15.0)
    errors = deviation_deg(fit.coefficients_deg, headings) - deviation_deg(voyage.compass.deviation_deg, headings)
    assert np.abs(errors).max() < 1.2  # leeway, up to 0.3 degrees, cannot be told from B and C
    assert np.sqrt(np.mean(errors**2)) < 0.6
    assert (np.abs(errors) < 3.5 * deviation_sigma_deg(fit, headings) + 0.3).all()
    assert fit.current is not None
    assert fit.current.drift_mps == pytest.approx(scenario.waters.drift_mps, abs=0.06)
    assert fit.warnings == ()
    assert "not sailed" not in card_text(fit)


def test_without_a_circle_b_and_c_are_not_fitted_and_it_says_so(tmp_path: Path) -> None:
    legs = tuple(Leg(30.0, heading) for heading in (30.0, 100.0, 170.0, 240.0, 310.0, 250.0, 180.0, 110.0, 50.0, 350.0))
    recording, voyage = sailed(tmp_path, replace(CURRENT, plan=legs), duration_s=600.0)
    fit = fit_deviation([track_of(decode(recording))])
    assert fit.current is None
    assert fit.coefficients_deg[1:3] == (0.0, 0.0)
    assert np.isnan(fit.sigma_deg[1:3]).all()
    true = voyage.compass.deviation_deg
    for index in (0, 3, 4):  # the current of 0.45 m/s at 3 m/s must not have bent these
        assert fit.coefficients_deg[index] == pytest.approx(true[index], abs=0.8)
    assert "B and C" in fit.warnings[0]


def test_headings_that_were_not_sailed_are_named(tmp_path: Path) -> None:
    recording, _ = sailed(tmp_path, SCENARIOS["north"], duration_s=200.0)
    fit = fit_deviation([track_of(decode(recording))])
    assert any("no headings between" in warning and "A alone" in warning for warning in fit.warnings)
    assert fit.coefficients_deg[1:] == (0.0, 0.0, 0.0, 0.0)
    rows = [line.split() for line in card_text(fit).splitlines()[-24:]]
    assert [float(row[0]) for row in rows] == [15.0 * i for i in range(24)]
    for heading, *rest in rows:
        away_deg = np.abs((fit.compass_deg - float(heading) + 180.0) % 360.0 - 180.0).min()
        if away_deg > 10.0:
            assert rest[-2:] == ["not", "sailed"]
    assert 3 < sum(row[-1] == "sailed" for row in rows) < 24


def test_a_turn_at_falling_speed_is_no_swing(tmp_path: Path) -> None:
    recording, _ = sailed(tmp_path, SCENARIOS["tour"], duration_s=330.0)
    assert find_current(track_of(decode(recording))) is None


@given(st.floats(0.0, 359.9), st.floats(20.0, 300.0))
def test_the_largest_gap_is_found_across_north(start: float, width: float) -> None:
    covered = (start + width + np.arange(0.0, 360.0 - width, 0.5)) % 360.0
    _, gap = largest_gap(covered)
    assert width - 25.0 <= gap <= width + 10.0


def test_reciprocal_legs_give_the_current_to_those_who_ask(tmp_path: Path) -> None:
    legs = tuple(Leg(60.0, heading) for heading in (20.0, 140.0, 200.0, 260.0, 320.0, 80.0))
    scenario = replace(CURRENT, plan=legs)
    recording, voyage = sailed(tmp_path, scenario, duration_s=500.0)
    track = track_of(decode(recording))
    assert fit_deviation([track]).current is None
    fit = fit_deviation([track], reciprocal_legs=True)
    assert fit.current is not None
    assert fit.current.pairs >= 2
    north, east = 0.45 * np.cos(np.radians(70.0)), 0.45 * np.sin(np.radians(70.0))
    assert fit.current.north_mps == pytest.approx(north, abs=0.1)
    assert fit.current.east_mps == pytest.approx(east, abs=0.1)
    headings = np.arange(0.0, 360.0, 15.0)
    errors = deviation_deg(fit.coefficients_deg, headings) - deviation_deg(voyage.compass.deviation_deg, headings)
    assert np.sqrt(np.mean(errors**2)) < 1.5


def test_the_gyros_bias(tmp_path: Path) -> None:
    recording, voyage = sailed(tmp_path, SCENARIOS["harbour"], duration_s=300.0)
    fit = fit_gyro(decode(recording))
    assert fit.referenced
    # The simulated gyro warms up by 0.15 degrees/s over minutes: the mean bias is what the voyage ended with, or so.
    assert fit.bias_dps[2] == pytest.approx(voyage.imu.bias_dps[2], abs=0.15)


def test_the_gyros_bias_is_written_in_its_own_axes(tmp_path: Path) -> None:
    recording, voyage = sailed(tmp_path, SCENARIOS["harbour"], duration_s=300.0)
    config = tmp_path / "tinyekf.toml"
    assert main(["gyro", str(recording), "--write", str(config)]) == 0
    written = load_config(config).sensors["imu"]
    assert isinstance(written, ImuConfig)
    assert written.gyro_bias_dps == pytest.approx(voyage.imu.bias_dps, abs=0.2)
    config.write_text(config.read_text() + "mount = [0, 0, 90]\n")
    config.write_text(f"{config.read_text()}[vessel]\nvariation_deg = -8\n")
    assert main(["gyro", str(recording), "--config", str(config), "--write", str(config)]) == 0
    again = load_config(config).sensors["imu"]
    assert isinstance(again, ImuConfig)
    assert again.gyro_bias_dps == pytest.approx(written.gyro_bias_dps, abs=0.05)


def test_the_receivers_latencies_and_how_well_they_are_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, voyage = sailed(tmp_path, SCENARIOS["harbour"], seed=2, duration_s=500.0)
    found = fit_latency(decode(recording))
    assert [latency.source for latency in found] == ["gps1", "gps2", "gps3"]
    for latency in found:
        assert abs(latency.seconds - voyage.receivers[latency.source].latency_s) < 3.0 * latency.sigma_s
        assert latency.sigma_s < SIGMA_S
    config = tmp_path / "tinyekf.toml"
    assert main(["latency", str(recording), "--write", str(config)]) == 0
    if worth_writing(found):
        wanted = {latency.source: round(1e3 * latency.seconds) for latency in worth_writing(found)}
        assert {name: load_config(config).sensors[name].latency_ms for name in wanted} == wanted
    assert "±" in capsys.readouterr().out


def test_a_recording_without_turns_tells_no_latency(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, _ = sailed(tmp_path, SCENARIOS["straight"], duration_s=60.0)
    assert main(["latency", str(recording)]) == 1
    assert "turn" in capsys.readouterr().err


def test_a_recording_too_short_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, _ = sailed(tmp_path, SWING, duration_s=20.0)
    with pytest.raises(CalibrationError, match="less than 30 s"):
        track_of(decode(recording))
    assert main(["compass", str(recording)]) == 1
    assert main(["gyro", str(recording)]) == 1
    assert capsys.readouterr().err.count("\n") == 2


def test_the_card_is_printed_drawn_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, _ = sailed(tmp_path, SWING)
    config, card = tmp_path / "tinyekf.toml", tmp_path / "card.png"
    config.write_text('# my boat\n[sensors.compass]\nport = "/dev/ttyUSB7"  # aft\n')
    assert main(["compass", str(recording), "--card", str(card), "--write", str(config)]) == 0
    printed = capsys.readouterr().out
    assert "\n    345 " in printed
    assert card.stat().st_size > 5000
    assert config.read_text().startswith("# my boat\n")
    assert 'port = "/dev/ttyUSB7"  # aft' in config.read_text()
    written = load_config(config).sensors["compass"]
    assert any(written.deviation)  # type: ignore[attr-defined]
    assert max(load_config(config).fusion.adaptive.deviation_sigma_deg) < 1.0
    assert main(["compass", str(recording), "--write", str(config)]) == 0
    assert load_config(config).sensors["compass"] == written


def test_a_full_configuration_is_edited_in_one_line_only(tmp_path: Path) -> None:
    path = tmp_path / "tinyekf.toml"
    path.write_text(config_text(Config()))
    before = path.read_text().splitlines()
    set_key(path, "sensors.compass.deviation", [1.0, 2.0, 3.0, 0.5, -0.5])
    after = path.read_text().splitlines()
    assert [line for line in after if line not in before] == ["deviation = [1.0, 2.0, 3.0, 0.5, -0.5]"]
    assert len(after) == len(before)


def test_a_missing_configuration_is_made(tmp_path: Path) -> None:
    path = tmp_path / "new.toml"
    set_key(path, "sensors.compass.deviation", [1.0, 0.0, 0.0, 0.0, 0.0])
    assert path.read_text() == "[sensors.compass]\ndeviation = [1.0, 0.0, 0.0, 0.0, 0.0]\n"


@pytest.mark.parametrize(
    "text", ["[sensors]\ncompass = {checksum = false}\n", "[sensors.compass]\ndeviation = [\n 1, 2, 3, 4, 5,\n]\n"]
)
def test_what_cannot_be_edited_is_left_as_it_was(tmp_path: Path, text: str) -> None:
    path = tmp_path / "odd.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="by hand"):
        set_key(path, "sensors.compass.deviation", [1.0, 0.0, 0.0, 0.0, 0.0])
    assert path.read_text() == text
