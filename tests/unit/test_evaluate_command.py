"""The command: what it writes, and what it says when something is wrong."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from acquisition.simulator.command import main as simulate
from tinyekf_py.evaluate.command import main, seeds_of
from tinyekf_py.evaluate.paper import REFERENCE_DEG, paper_source, processing_times


@pytest.fixture(scope="module")
def voyage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    recording = tmp_path_factory.mktemp("voyage") / "harbour.rec"
    truth = recording.with_suffix(".truth.csv")
    assert simulate([str(recording), str(truth), "--scenario", "harbour", "--duration", "40"]) == 0
    return recording


def test_tables_and_pictures_are_written(voyage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(voyage), "--method", "cnw3,compass", "--out", str(tmp_path)]) == 0
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows] == ["cnw3", "compass"]
    assert 0.1 < float(rows[1]["rmse_deg"]) < 10.0
    assert rows[1]["nees"] == ""
    assert "| harbour" in capsys.readouterr().out
    assert "| harbour" in (tmp_path / "table.md").read_text()
    pictures = {path.name: path for path in tmp_path.glob("*.png")}
    assert set(pictures) == {f"harbour-{what}.png" for what in ("heading", "errors", "sigma", "weights", "map")}
    assert all(path.stat().st_size > 5000 for path in pictures.values())


def test_one_bad_recording_does_not_cost_the_others(
    voyage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = tmp_path / "bad.rec"
    bad.write_text("no recording\n")
    truth = voyage.with_suffix(".truth.csv")
    arguments = [str(voyage), str(bad), "--truth", str(truth), str(truth), "--method", "compass"]
    assert main([*arguments, "--jobs", "1"]) == 1
    printed = capsys.readouterr()
    assert "| harbour" in printed.out
    assert "bad: " in printed.err
    assert "not a recording" in printed.err


def test_processes_give_what_one_process_gives(voyage: Path, tmp_path: Path) -> None:
    truth = voyage.with_suffix(".truth.csv")
    twin = tmp_path / "twin.rec"
    twin.write_bytes(voyage.read_bytes())
    tables = []
    for jobs in ("1", "2"):
        out = tmp_path / jobs
        arguments = [str(voyage), str(twin), "--truth", str(truth), str(truth), "--method", "cnw3,ekf-ci"]
        assert main([*arguments, "--jobs", jobs, "--out", str(out), "--no-pictures"]) == 0
        with (out / "table.csv").open() as file:
            tables.append([{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)])
    assert tables[0] == tables[1]
    assert len(tables[0]) == 4


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "name recordings"),
        (["--scenario", "harbor"], "harbour"),
        (["a.rec", "--paper"], "one of"),
        (["nope.rec", "--truth", __file__], "nope.rec: no such file"),
        ([__file__, "--truth", "nope.csv"], "nope.csv: no such file"),
        (["a.rec", "--truth", "a", "b"], "1 recordings but 2 truths"),
        (["--scenario", "dock", "--method", "kalman"], "no method 'kalman'"),
        (["--scenario", "dock", "--seeds", "a"], "--seeds a"),
        (["--scenario", "dock", "--cluster", "tcp://127.0.0.1:9"], "no Dask scheduler answers"),
    ],
)
def test_a_wrong_command_line_is_said_in_one_line(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(arguments)
    except SystemExit as exit_:
        status = int(str(exit_.code))
    error = capsys.readouterr().err
    assert status == 2
    assert said in error
    assert error.count("\n") == 1


def test_seeds() -> None:
    assert seeds_of("1-3,7") == (1, 2, 3, 7)


def test_the_papers_reference_heading_holds_at_every_moment() -> None:
    _, truth = paper_source("straight", "data set 1").load(None)
    assert truth.heading_deg == pytest.approx(REFERENCE_DEG, abs=1e-3)


def test_processing_times_are_of_every_method_asked_for() -> None:
    decoded, _ = paper_source("straight", "data set 1").load(None)
    times = processing_times(decoded, ("cnw3", "ekf-ci"))
    assert set(times) == {"cnw3", "ekf-ci"}
    assert all(seconds > 0.0 for seconds in times.values())
