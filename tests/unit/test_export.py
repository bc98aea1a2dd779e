"""Exports: what the formats' own readers find in them is what the recording holds."""

from __future__ import annotations

import csv
import gzip
import json
import math
import sys
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from acquisition.recording import Line, read_recording
from acquisition.simulator.command import main as simulate
from tinyekf_py.export.command import main
from tinyekf_py.replay import Replay, replay
from tinyekf_py.run import main as run

SENSORS = ("gps1", "gps2", "gps3", "compass", "imu")
START_UTC = datetime(2026, 11, 24, 3, tzinfo=UTC)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a minute of the simulated boat."""
    path = tmp_path_factory.mktemp("recording") / "today.log"
    assert simulate([str(path), str(path.with_suffix(".truth")), "--duration", "30"]) == 0
    return path


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def fixes_of(recording: Path, source: str) -> list[tuple[float, float]]:
    """Latitude and longitude of each GGA line, read by hand."""
    found = []
    for entry in read_recording(recording):
        if isinstance(entry, Line) and entry.source == source and b"GGA" in entry.line:
            fields = entry.line.decode().split(",")
            lat, lon = (
                float(fields[2][:2]) + float(fields[2][2:]) / 60,
                float(fields[4][:3]) + float(fields[4][3:]) / 60,
            )
            found.append((lat, lon))
    return found


def test_csv_has_a_file_for_each_sensor_and_the_heading_csv_itself(recording: Path, tmp_path: Path) -> None:
    folder = tmp_path / "tables"
    assert main([str(recording), "--csv", "--output", str(folder)]) == 0
    assert sorted(path.name for path in folder.iterdir()) == sorted(f"{name}.csv" for name in (*SENSORS, "heading"))
    assert run(["--replay", str(recording), "--output", str(tmp_path / "heading.csv")]) == 0
    assert (folder / "heading.csv").read_bytes() == (tmp_path / "heading.csv").read_bytes()
    rows = csv_rows(folder / "gps1.csv")
    fixes = fixes_of(recording, "gps1")
    assert abs(len(rows) - len(fixes)) <= 1  # the last epoch may be open
    for row, (lat, lon) in zip(rows, fixes, strict=False):
        assert float(row["lat_deg"]) == pytest.approx(lat, abs=1e-9)
        assert float(row["lon_deg"]) == pytest.approx(lon, abs=1e-9)
    stamps = [float(row["t_s"]) for row in rows]
    assert stamps == sorted(stamps)
    assert 0.0 < stamps[0] < 1.0
    assert 29.0 < stamps[-1] < 31.0
    imu = csv_rows(folder / "imu.csv")
    assert 2900 < len(imu) < 3100
    assert imu[0]["mag_x_ut"] == ""
    compass = csv_rows(folder / "compass.csv")
    assert compass[0]["reference"] == "compass"
    assert compass[0]["variation_deg"] == ""


def test_parquet_says_the_same_as_csv(recording: Path, tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra [parquet]")
    folder = tmp_path / "tables"
    for kind in ("--csv", "--parquet"):
        assert main([str(recording), kind, "--output", str(folder)]) == 0
    for name in (*SENSORS, "heading"):
        table = pq.read_table(folder / f"{name}.parquet").to_pylist()
        rows = csv_rows(folder / f"{name}.csv")
        assert len(table) == len(rows)
        assert [*table[0]] == ["t_s", "utc", *[*rows[0]][1:]]
        for values, texts in zip(table, rows, strict=True):
            assert values["utc"].timestamp() == pytest.approx(START_UTC.timestamp() + values["t_s"], abs=2e-6)
            for column, text in texts.items():
                value = values[column]
                if text == "":
                    assert value is None
                elif isinstance(value, str):
                    assert value == text
                else:
                    assert value == pytest.approx(
                        float(text), abs=5.1e-10 if column in ("lat_deg", "lon_deg") else 5.1e-5
                    )
                    assert len(text.partition(".")[2]) <= (9 if column in ("lat_deg", "lon_deg") else 6)
    schema = pq.read_schema(folder / "gps1.parquet")
    assert str(schema.field("fix_quality").type) == "int32"
    assert str(schema.field("utc").type) == "timestamp[us, tz=UTC]"


def mcap_messages(path: Path) -> dict[str, list[tuple[int, dict[str, Any]]]]:
    """The messages of each topic with their log time, each checked against its channel's schema."""
    reading = pytest.importorskip("mcap.reader", reason="needs the extra [mcap]")
    found: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    checks: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in reading.make_reader(file, validate_crcs=True).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            values = json.loads(message.data)
            check = checks.setdefault(schema.id, jsonschema.Draft202012Validator(json.loads(schema.data)))
            check.validate(values)
            assert values.keys() <= check.schema["properties"].keys()
            found.setdefault(channel.topic, []).append((message.log_time, values))
    return found


def test_mcap_has_a_channel_for_each_sensor_and_positions_for_a_map(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "boat.mcap"
    assert main([str(recording), "--mcap", "--output", str(path)]) == 0
    assert main([str(recording), "--csv", "--output", str(tmp_path)]) == 0
    messages = mcap_messages(path)
    locations = {"/location", *(f"/gps{number}/location" for number in (1, 2, 3))}
    assert messages.keys() == {"/heading", *(f"/{name}" for name in SENSORS), *locations}
    for name in (*SENSORS, "heading"):
        rows = csv_rows(tmp_path / f"{name}.csv")
        assert len(messages[f"/{name}"]) == len(rows)
        for (time_ns, values), texts in zip(messages[f"/{name}"], rows, strict=True):
            assert time_ns / 1e9 == pytest.approx(START_UTC.timestamp() + float(texts["t_s"]), abs=1e-5)
            assert values.keys() == {column for column, text in texts.items() if text}
    first_ns, fix = messages["/gps1/location"][0]
    assert fix["timestamp"]["sec"] * 10**9 + fix["timestamp"]["nsec"] == first_ns
    assert (fix["latitude"], fix["longitude"]) == pytest.approx(fixes_of(recording, "gps1")[0], abs=1e-9)
    schemas = pytest.importorskip("mcap.reader").make_reader(path.open("rb")).get_summary().schemas.values()
    assert Counter(schema.name for schema in schemas) == Counter(
        ["tinyekf.gps", "tinyekf.compass", "tinyekf.imu", "tinyekf.heading", "foxglove.LocationFix"]
    )


def test_a_cut_a_compressed_and_a_rotated_recording_are_read(
    recording: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = recording.read_bytes()
    cut = tmp_path / "cut.log"
    cut.write_bytes(whole[:-20])
    assert main([str(cut), "--csv"]) == 0
    assert capfd.readouterr().out.strip() == str(tmp_path / "cut-csv")
    packed = tmp_path / "packed.log.gz"
    packed.write_bytes(gzip.compress(whole))
    assert main([str(packed), "--csv"]) == 0
    assert (tmp_path / "packed-csv" / "heading.csv").exists()
    lines = whole.splitlines(keepends=True)
    header = [line for line in lines if line.startswith((b"#tinyekf", b"#start", b"#config"))]
    pieces = [tmp_path / "set.log", tmp_path / "set.log.0001"]
    middle = len(lines) // 2
    pieces[0].write_bytes(b"".join(lines[:middle]))
    pieces[1].write_bytes(b"".join(header + lines[middle:]))
    assert main([*map(str, pieces), "--csv"]) == 0
    for name in ("gps1", "imu", "heading"):
        table = (tmp_path / "set-csv" / f"{name}.csv").read_bytes()
        assert table == (tmp_path / "packed-csv" / f"{name}.csv").read_bytes()


def test_switches_and_method_count(recording: Path, tmp_path: Path) -> None:
    lines = recording.read_bytes().splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith(b"10."))
    switched = tmp_path / "switched.log"
    stops = [f"#event 10.000000 stop {name}\n".encode() for name in SENSORS]
    switched.write_bytes(b"".join([*lines[:at], *stops, *lines[at:]]))
    assert main([str(switched), "--csv", "--method", "cnw3"]) == 0
    rows = csv_rows(tmp_path / "switched-csv" / "heading.csv")
    assert {row["mode"] for row in rows if float(row["t_s"]) > 12.0} == {"invalid"}
    expected = replay(switched, method="cnw3")
    assert [row["heading_deg"] for row in rows] == [
        "" if math.isnan(value) else f"{value % 360.0:.4f}" for value in expected["heading_deg"]
    ]


def test_a_recording_without_a_start_has_times_since_it(recording: Path, tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra [parquet]")
    lines = [line for line in recording.read_bytes().splitlines(keepends=True) if not line.startswith(b"#start")]
    timeless = tmp_path / "timeless.log"
    timeless.write_bytes(b"".join(lines))
    assert Replay(read_recording(timeless)).reader.start_utc is None
    for kind in ("--parquet", "--mcap"):
        assert main([str(timeless), kind]) == 0
    assert "utc" not in pq.read_schema(tmp_path / "timeless-parquet" / "imu.parquet").names
    assert mcap_messages(tmp_path / "timeless.mcap")["/imu"][0][0] < 10**9


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nowhere.log", "--csv"], "nowhere.log"),
        (["{rec}"], "--csv"),
        (["{rec}", "--csv", "--mcap"], "not allowed with"),
        (["{rec}", "--mcap", "--output", "{rec}"], "is the recording"),
        (["{rec}", "--csv", "--output", "{rec}"], "is a file"),
        (["{rec}", "--mcap", "--output", "."], "is a folder"),
        (["{rec}", "--csv", "--method", "best"], "best"),
        (["{rec}", "--csv", "--config", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    recording: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    before = recording.read_bytes()
    try:
        status = main([argument.format(rec=recording) for argument in arguments])
    except SystemExit as error:
        status = int(error.code or 0)
    assert status == 2
    error = capfd.readouterr().err
    assert error.startswith("tinyekf export: ")
    assert error.count("\n") == 1
    assert complaint in error
    assert recording.read_bytes() == before


@pytest.mark.parametrize(("kind", "module"), [("parquet", "pyarrow"), ("mcap", "mcap")])
def test_a_missing_extra_is_named(
    recording: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    kind: str,
    module: str,
) -> None:
    for name in [name for name in sys.modules if name.startswith((module, "tinyekf_py.export."))]:
        if name != "tinyekf_py.export.command":
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, module, None)
    assert main([str(recording), f"--{kind}", "--output", str(tmp_path / "tables")]) == 2
    assert f"install the extra [{kind}]" in capfd.readouterr().err
    assert not (tmp_path / "tables").exists()


def test_an_export_that_fails_leaves_nothing_half_done(
    recording: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "tables"
    (folder / "imu.csv").mkdir(parents=True)  # a folder where a file must go
    assert main([str(recording), "--csv", "--output", str(folder)]) == 1
    assert capfd.readouterr().err.startswith("tinyekf export: cannot write: ")
    assert not list(folder.glob("*.part"))
