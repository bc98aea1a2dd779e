"""Voyages as a whole: order, determinism, recordings, and the command line."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from acquisition.decoder import make_decoder
from acquisition.recording import Line, read_recording
from acquisition.simulator.command import main
from acquisition.simulator.grades import GRADES
from acquisition.simulator.recorder import record
from acquisition.simulator.scenarios import SCENARIOS, ScenarioError, scenario_named
from acquisition.simulator.voyage import START_UTC, Arrival, Voyage

DRIVERS = {"gps1": "nmea", "gps2": "nmea", "gps3": "nmea", "compass": "nmea", "imu": "ebimu-ascii"}


def sail(name: str = "tour", seconds: float = 10.0, seed: int = 1, **changes: object) -> list[Arrival]:
    scenario = replace(SCENARIOS[name], **changes)  # type: ignore[arg-type]
    voyage = Voyage(scenario, GRADES["typical"], seed=seed)
    return [arrival for _ in range(round(seconds * 100)) for arrival in voyage.advance()]


def test_the_seed_decides_everything() -> None:
    assert sail(seed=5) == sail(seed=5)
    assert sail(seed=5) != sail(seed=6)


def test_a_missing_device_leaves_the_others_as_they_were() -> None:
    without = sail(devices=("gps1", "compass"))
    assert without == [arrival for arrival in sail() if arrival.source in ("gps1", "compass")]


@pytest.mark.parametrize("grade", GRADES)
def test_lines_come_in_the_order_of_their_arrival(grade: str) -> None:
    voyage = Voyage(SCENARIOS["tour"], GRADES[grade])
    lines = [arrival for _ in range(1000) for arrival in voyage.advance()]
    stamps = [arrival.t_us for arrival in lines]
    assert stamps == sorted(stamps)
    for source in DRIVERS:
        own = [arrival.t_us for arrival in lines if arrival.source == source]
        assert all(before < after for before, after in itertools.pairwise(own))


def test_devices_print_at_their_rates() -> None:
    counts = Counter(arrival.source for arrival in sail(seconds=60.0))
    for source, a_second in {"gps1": 30, "gps2": 30, "gps3": 30, "compass": 20, "imu": 100}.items():
        assert counts[source] == pytest.approx(a_second * 60, abs=a_second)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_line_of_every_scenario_decodes(name: str) -> None:
    decoders = {source: make_decoder(source, driver, {}) for source, driver in DRIVERS.items()}
    for arrival in sail(name, seconds=15.0):
        decoders[arrival.source].decode(arrival.t_us, arrival.line)
    for source, decoder in decoders.items():
        assert set(decoder.counts) <= {"lines", "samples"}, (source, decoder.counts, decoder.last_error)
        assert decoder.counts["samples"] >= 140


def test_unknown_scenario_names_the_nearest() -> None:
    with pytest.raises(ScenarioError, match="harbour"):
        scenario_named("harbor")


def test_recording_holds_the_voyage_and_truth_its_grid(tmp_path: Path) -> None:
    recording, truth = tmp_path / "a.rec", tmp_path / "a.csv"
    record(Voyage(SCENARIOS["tour"], GRADES["typical"], seed=8), recording, truth, 10.0)
    reader = read_recording(recording)
    assert [tuple(entry) for entry in reader if isinstance(entry, Line)] == [tuple(line) for line in sail(seed=8)]
    assert not reader.dropped
    assert reader.start_utc == START_UTC
    assert reader.config == {
        "vessel.variation_deg": -8.0,
        "vessel.antennas_m": [[1.5, -0.8], [1.5, 0.8], [-1.2, 0.0]],
    }
    header, *rows = truth.read_text().splitlines()
    assert header == "t_s,heading_deg,lat_deg,lon_deg"
    assert [row.split(",")[0] for row in rows] == [f"{i / 10:.1f}" for i in range(101)]
    assert all(0.0 <= float(row.split(",")[1]) < 360.0 for row in rows)


def test_recording_says_which_device_is_not_aboard(tmp_path: Path) -> None:
    scenario = replace(SCENARIOS["tour"], devices=("gps1", "compass", "imu"))
    record(Voyage(scenario, GRADES["typical"]), tmp_path / "a.rec", tmp_path / "a.csv", 1.0)
    config = read_recording(tmp_path / "a.rec").config
    assert {key for key, value in config.items() if value is False} == {"sensors.gps2.enabled", "sensors.gps3.enabled"}


def test_command_writes_the_same_files_for_the_same_seed(tmp_path: Path) -> None:
    for name in ("a", "b"):
        files = [str(tmp_path / f"{name}.rec"), str(tmp_path / f"{name}.csv")]
        assert (
            main([*files, "--scenario", "north", "--seed", "3", "--duration", "5", "--grade", "poor", "--settled"]) == 0
        )
    assert (tmp_path / "a.rec").read_bytes() == (tmp_path / "b.rec").read_bytes()
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_command_lists_the_scenarios_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(SCENARIOS)


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        ([], "REC TRUTH"),
        (["a.rec"], "REC TRUTH"),
        (["same", "same"], "cannot both be"),
        (["a.rec", "a.csv", "--scenario", "harbor"], "'harbour'"),
        (["a.rec", "a.csv", "--grade", "best"], "--grade"),
        (["a.rec", "a.csv", "--duration", "-1"], "--duration"),
        (["a.rec", "a.csv", "--duration", "nan"], "--duration"),
        (["a.rec", "a.csv", "--start-utc", "noon"], "--start-utc"),
        (["a.rec", "a.csv", "--links", "there"], "--ptys"),
        (["a.rec", "a.csv", "--seeds", "1"], "--seeds"),
        (["a.rec", "--ptys"], "--truth FILE"),
        (["nowhere/a.rec", "a.csv"], "nowhere/a.rec"),
        (["a.rec", "nowhere/a.csv"], "nowhere/a.csv"),
    ],
)
def test_a_wrong_command_line_is_one_line_and_exit_2(
    argv: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(argv) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
