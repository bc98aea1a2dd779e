"""Recordings: what is written is read back, and what is damaged is dropped, counted and no more."""

from __future__ import annotations

import gzip
import logging
import os
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acquisition.background_file import Rotation, UnfinishedFileError
from acquisition.recording import (
    Event,
    Line,
    RecordingError,
    escape,
    format_seconds,
    parse_seconds,
    read_recording,
    unescape,
)
from acquisition.recording_writer import RecordingWriter
from acquisition.sample import SOURCES

START = datetime(2026, 11, 24, 3, 0, 0, tzinfo=UTC)
HEADER = b"#tinyekf-recording 1\n#start 2026-11-24T03:00:00.000000Z\n"


def write(path: Path, *texts: bytes, header: bytes = HEADER) -> Path:
    path.write_bytes(header + b"".join(text + b"\n" for text in texts))
    return path


def stamps(path: Path | list[Path]) -> list[float]:
    return [entry.t_us / 1e6 for entry in read_recording(path)]


@given(st.binary(max_size=1024))
def test_any_bytes_survive_escaping(line: bytes) -> None:
    text = escape(line)
    assert all(0x20 <= byte <= 0x7E for byte in text)
    assert unescape(text) == line


@given(st.integers(min_value=0, max_value=10**15))
def test_stamps_are_exact_to_the_microsecond(t_us: int) -> None:
    assert parse_seconds(format_seconds(t_us).encode()) == t_us


@pytest.mark.parametrize("text", [b"", b".", b"-1.0", b"+1.0", b"1_0.0", b"1e3", b"nan", b"1.0000000", b"1.-5", b" 1"])
def test_what_is_no_stamp_is_refused(text: bytes) -> None:
    with pytest.raises(ValueError, match="not a stamp"):
        parse_seconds(text)


@given(
    entries=st.lists(
        st.one_of(
            st.builds(Line, st.integers(0, 1_000_000), st.sampled_from(sorted(SOURCES)), st.binary(max_size=1024)),
            st.builds(
                Event,
                st.integers(0, 1_000_000),
                st.sampled_from(["start", "stop", "restart"]),
                st.sampled_from(["gps2", "cnw-s1", "imu"]),
            ),
        ),
        max_size=30,
    )
)
def test_what_is_recorded_is_read_back(tmp_path_factory: pytest.TempPathFactory, entries: list[Line | Event]) -> None:
    path = tmp_path_factory.mktemp("recording") / "r.log"
    writer = RecordingWriter(path, START, {})
    for entry in entries:
        if isinstance(entry, Line):
            writer.line(*entry)
        else:
            writer.event(*entry)
    writer.close()
    reader = read_recording(path)
    assert list(reader) == entries
    assert not reader.dropped


def test_header_carries_start_and_configuration(tmp_path: Path) -> None:
    config = {
        "fusion.method": 'the "best" \\ one\x7f\n',
        "vessel.variation_deg": -1.5,
        "sensors.imu.mount": [0, 90.0, -180],
        "sensors.gps1.checksum": False,
        "fusion.cnw-ekf.gps": 2,
    }
    RecordingWriter(tmp_path / "r.log", START, config).close()
    reader = read_recording(tmp_path / "r.log")
    assert reader.start_utc == START
    assert reader.config == config


def test_the_format_is_the_documented_one(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.log", START, {"fusion.method": "cnw3"})
    writer.line(68_566, "gps1", b"$GPGGA*65")
    writer.line(70_850, "imu", b"UU\x00\\\xff~ ")
    writer.event(12_345_678, "stop", "gps2")
    writer.close()
    assert (tmp_path / "r.log").read_bytes() == (
        HEADER + b'#config fusion.method="cnw3"\n'
        b"0.068566 gps1 $GPGGA*65\n0.070850 imu UU\\x00\\x5C\\xFF~ \n#event 12.345678 stop gps2\n"
    )


def test_flush_puts_everything_on_the_disk(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.log", START, {})
    writer.line(1, "imu", b"*1")
    writer.flush()
    assert list(read_recording(tmp_path / "r.log")) == [Line(1, "imu", b"*1")]
    writer.close()


def test_a_full_disk_stops_the_recording_with_one_line(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(RecordingError, match="No space left on device"):
        RecordingWriter("/dev/full", START, {})


def test_a_write_that_fails_later_reaches_the_caller_at_the_end_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    fifo = tmp_path / "r.log"
    os.mkfifo(fifo)
    reader = os.open(fifo, os.O_RDONLY | os.O_NONBLOCK)
    writer = RecordingWriter(fifo, START, {})
    os.close(reader)
    with caplog.at_level(logging.ERROR):
        for t_us in range(100):
            writer.line(t_us, "imu", b"*1")
            writer.flush()
        with pytest.raises(UnfinishedFileError, match=r"r\.log: 100 lines are missing, to the end: Broken pipe"):
            writer.close()
    assert "Broken pipe" in writer.failure
    assert len(caplog.records) == 1
    assert str(fifo) in caplog.text


def test_lines_after_the_end_are_not_an_error(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.log", START, {})
    writer.close()
    writer.line(1, "imu", b"*1")
    writer.close()
    assert list(read_recording(tmp_path / "r.log")) == []


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "is not a recording"),
        (b"t_s,heading_deg\n0.0,1\n", "is not a recording"),
        (b"#tinyekf-recording 7\n", "version 7"),
        (b"#tinyekf-recording 1\n#start yesterday\n", "line 2: malformed #start"),
        (b"#tinyekf-recording 1\n#config fusion.method=cnw3\n", "line 2: malformed #config"),
        (b"#tinyekf-recording 1\n#config fusion.method=" + b"[" * 4000 + b"\n", "line 2: malformed #config"),
        (b"\x1f\x8bnot gzip at all", "gzip"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "r.log"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as refusal:
        read_recording(path)
    assert says in str(refusal.value)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(("name", "says"), [("missing.log", "No such file"), (".", "Is a directory")])
def test_unreadable_files_are_named(tmp_path: Path, name: str, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        read_recording(tmp_path / name)


def test_a_recording_to_where_nothing_can_be_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="No such file"):
        RecordingWriter(tmp_path / "missing" / "r.log", START, {})
    with pytest.raises(RecordingError, match=r"\.gz"):
        RecordingWriter(tmp_path / "r.log.gz", START, {})


def test_a_cut_last_line_is_dropped_and_counted(tmp_path: Path) -> None:
    path = write(tmp_path / "r.log", b"0.1 imu *1")
    path.write_bytes(path.read_bytes() + b"0.2 imu *1.2")
    reader = read_recording(path)
    assert [entry.t_us for entry in reader] == [100_000]
    assert reader.dropped == {"cut last line": 1}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"rubbish", "malformed"),
        (b"0.2 imu", "malformed"),
        (b"0.2.2 imu *1", "malformed"),
        (b"-0.2 imu *1", "malformed"),
        (b"0.2 imu *\\n", "malformed"),
        (b"0.2 imu *\\xg0", "malformed"),
        (b"0.2 imu " + 1025 * b"*", "malformed"),
        (b"\x00" * 4096, "malformed"),
        (b"#event 0.2 explode gps1", "malformed"),
        (b"#event 0.2 stop", "malformed"),
        (b"#event \xff stop gps1", "malformed"),
        (b"0.2 radar *1", "unknown source"),
        (b"61.0 imu *1", "forward jump"),
        (b"86500.0 imu *1", "forward jump"),
        (b"#event 99999999.0 stop imu", "forward jump"),
    ],
)
def test_a_damaged_line_is_counted_and_the_rest_goes_on(tmp_path: Path, text: bytes, reason: str) -> None:
    reader = read_recording(write(tmp_path / "r.log", b"0.1 imu *1", text, b"0.3 imu *1"))
    assert [entry.t_us for entry in reader] == [100_000, 300_000]
    assert reader.dropped == {reason: 1}


def test_steps_back_are_the_fusions_affair(tmp_path: Path) -> None:
    reader = read_recording(write(tmp_path / "r.log", b"50.0 imu *", b"49.0 gps1 $", b"3.999999 gps1 $", b"50.1 imu *"))
    assert [entry.t_us for entry in reader] == [50_000_000, 49_000_000, 3_999_999, 50_100_000]
    assert not reader.dropped


def test_a_long_silence_is_no_damage(tmp_path: Path) -> None:
    seconds = [*range(9), 90_000, 90_001, 300_000, 300_001]
    path = write(tmp_path / "r.log", *(b"%d.0 imu *" % second for second in seconds))
    assert stamps(path) == seconds


@pytest.mark.parametrize("damaged", [b"0.000001 imu *", b"999999999.0 imu *"])
def test_a_damaged_first_stamp_does_not_condemn_the_rest(tmp_path: Path, damaged: bytes) -> None:
    path = write(tmp_path / "r.log", damaged, *(b"20000%d.0 imu *" % i for i in range(9)))
    assert stamps(path) == [200000.0 + i for i in range(9)]


def test_a_megabyte_without_an_end_is_one_malformed_line(tmp_path: Path) -> None:
    reader = read_recording(write(tmp_path / "r.log", b"0.1 imu *1", b"0.2 imu " + (1 << 20) * b"x", b"0.3 imu *1"))
    assert [entry.t_us for entry in reader] == [100_000, 300_000]
    assert reader.dropped == {"malformed": 1}


def test_comments_blank_lines_and_foreign_line_ends_are_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "r.log"
    path.write_bytes(HEADER.replace(b"\n", b"\r\n") + b"# a remark\r\n\r\n0.5 gps1 $A*00\r\n")
    reader = read_recording(path)
    assert list(reader) == [Line(500_000, "gps1", b"$A*00")]
    assert not reader.dropped


def test_gzip_is_read_as_is(tmp_path: Path) -> None:
    texts = [b"%d.000000 imu *1.0,%d" % (i, i * i) for i in range(5000)]
    plain = write(tmp_path / "r.log", *texts)
    packed = tmp_path / "r.log.gz"
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    reader = read_recording(packed)
    assert list(reader) == list(read_recording(plain))
    assert reader.bytes_read == reader.bytes_total == packed.stat().st_size


def test_a_cut_gzip_yields_what_precedes_the_cut(tmp_path: Path) -> None:
    plain = write(tmp_path / "r.log", *(b"%d.0 imu *1.0,%d" % (i, i * 7919 % 1013) for i in range(50_000)))
    packed = gzip.compress(plain.read_bytes())
    (tmp_path / "r.gz").write_bytes(packed[: len(packed) // 2])
    reader = read_recording(tmp_path / "r.gz")
    assert 15_000 < sum(1 for _ in reader) < 50_000
    assert reader.dropped == {"cut last line": 1}


def test_a_rotated_set_reads_as_one_in_any_order(tmp_path: Path) -> None:
    first = write(tmp_path / "a.log", b"0.1 imu *", b"0.9 imu *")
    second = write(tmp_path / "b.log", b"1.1 imu *", b"80000.9 imu *")
    headless = write(tmp_path / "c.log", b"100000.1 imu *", header=b"")
    assert stamps([headless, second, first]) == [0.1, 0.9, 1.1, 80000.9, 100000.1]


def test_two_different_recordings_are_not_one(tmp_path: Path) -> None:
    first = write(tmp_path / "a.log", b"0.1 imu *")
    second = write(tmp_path / "b.log", b"0.1 imu *", header=HEADER.replace(b"03:00:00", b"04:00:00"))
    with pytest.raises(RecordingError, match="different times"):
        read_recording([first, second])


def test_progress_ends_at_the_whole(tmp_path: Path) -> None:
    reader = read_recording([write(tmp_path / f"{i}.log", b"%d.0 imu *" % i) for i in range(3)])
    assert reader.bytes_read == 0
    assert len(list(reader)) == len(list(reader)) == 3
    assert reader.bytes_read == reader.bytes_total > 0


def test_the_real_recordings_are_read_without_loss(recordings: Path) -> None:
    for name in ("alinghi/alinghi.log", "comma2k19/comma.log"):
        reader = read_recording(recordings / name)
        assert sum(1 for _ in reader) > 7000
        assert not reader.dropped


def _rotated(tmp_path: Path, keep: int) -> list[Path]:
    """A recording of 60 lines in pieces of about ten, gps2 being stopped at the 15th."""
    writer = RecordingWriter(tmp_path / "r.rec", START, {"fusion.method": "cnw3"}, Rotation(300, keep=keep))
    for n in range(60):
        if n == 15:
            writer.event(n * 10_000, "stop", "gps2")
        writer.line(n * 10_000, "imu", b"*1.0,2.0,%d" % n)
        writer.flush()
    writer.close()
    return sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns)


def test_pieces_replay_as_one(tmp_path: Path) -> None:
    pieces = _rotated(tmp_path, keep=0)
    assert len(pieces) > 3
    assert {path.name for path in pieces} >= {"r.rec", "r.0001.rec", "r.0002.rec"}
    reader = read_recording(pieces)
    entries = list(reader)
    assert [entry.line for entry in entries if isinstance(entry, Line)] == [b"*1.0,2.0,%d" % n for n in range(60)]
    assert entries.index(Event(150_000, "stop", "gps2")) == 15
    assert reader.config == {"fusion.method": "cnw3"}


def test_a_piece_that_cannot_be_begun_costs_no_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    writer = RecordingWriter(tmp_path / "r.rec", START, {}, Rotation(300))
    (tmp_path / "r.0001.rec").mkdir()  # in its place
    for n in range(60):
        writer.line(n * 10_000, "imu", b"*1.0,2.0,%d" % n)
        writer.flush()
    assert (writer.lost, writer.failure) == (0, "")
    writer.close()
    assert len(list(read_recording(tmp_path / "r.rec"))) == 60
    assert caplog.text.count("cannot be begun") == 1


def test_old_pieces_are_removed_and_the_rest_does_without_them(tmp_path: Path) -> None:
    pieces = _rotated(tmp_path, keep=2)
    assert len(pieces) == 2
    reader = read_recording(pieces)
    assert reader.start_utc == START
    assert reader.config == {"fusion.method": "cnw3", "tasks.stopped": ["gps2"]}
    assert list(reader)[-1] == Line(590_000, "imu", b"*1.0,2.0,59")


def test_a_new_recording_sets_the_earlier_one_aside_with_its_pieces(tmp_path: Path) -> None:
    for name in ("r.rec", "r.0001.rec", "r.0042.rec"):
        write(tmp_path / name, b"0.1 imu *1,2,3\n")
    (tmp_path / "r.truth.csv").write_text("t_s,heading_deg\n")
    for name in ("r.old.rec", "other.0001.rec"):
        (tmp_path / name).write_text("somebody else's")
    RecordingWriter(tmp_path / "r.rec", START, {}, Rotation(1000)).close()
    RecordingWriter(tmp_path / "r.rec", START, {}, Rotation(1000)).close()
    aside = f"r.{START:%Y%m%dT%H%M%SZ}"
    pieces = {f"{aside}.rec", f"{aside}.0001.rec", f"{aside}.0042.rec"}
    assert {path.name for path in tmp_path.iterdir()} == {
        "r.rec",
        f"{aside}.truth.csv",
        f"{aside}-2.rec",
        *pieces,
        "r.old.rec",
        "other.0001.rec",
    }
    assert len(list(read_recording([tmp_path / name for name in pieces]))) == 3


def test_a_recording_never_replaces_a_file_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "boat.toml").write_text("[fusion]\n")
    with pytest.raises(RecordingError, match="what is there is no recording"):
        RecordingWriter(tmp_path / "boat.toml", START, {})
    assert (tmp_path / "boat.toml").read_text() == "[fusion]\n"
