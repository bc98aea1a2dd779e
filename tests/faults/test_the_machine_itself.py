"""The program killed, its disk full, its rights taken, the wall clock turned: each row has a program of its own."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_boat import DEADLINE_S, SENSORS, Program, free_port, output_pid

from acquisition.port import open_port
from acquisition.recording import read_recording
from tinyekf_py.heading_csv import format_row, read_heading_csv
from tinyekf_py.replay import Replay

LIBFAKETIME = next(iter(sorted(Path("/usr/lib").glob("*/faketime/libfaketime.so.1"))), None)


def lacking(what: str) -> None:
    """Skip the row, or fail it in CI."""
    if os.environ.get("CI"):
        pytest.fail(what)
    pytest.skip(what)


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_until(found: Callable[[], object], limit_s: float) -> float:
    """How long it took, seconds."""
    began = time.monotonic()
    while not found():
        assert time.monotonic() - began < limit_s, f"not within {limit_s} s"
        time.sleep(0.01)
    return time.monotonic() - began


def test_the_parent_is_killed_and_started_again(own_life: Any, tmp_path: Path, row_of: Any) -> None:
    life = own_life()
    pids = [sensor["pid"] for sensor in life.live.until_whole()["sensors"].values()]
    life.live.kill()
    ended_s = wait_until(lambda: not any(alive(pid) for pid in pids), 2.0)
    for cable in life.boat.cables.values():
        open_port(str(cable.link), 9600).close()  # free
    assert all(entry.t_us >= 0 for entry in read_recording(life.live.recording))
    read_heading_csv(life.live.csv)
    began = time.monotonic()
    (tmp_path / "again").mkdir()
    again = Program(tmp_path / "again", life.boat)
    try:
        again.until_whole()
        row_of(life, "program: SIGKILL, started again", "last rows up to 0.5 s old", ended_s, time.monotonic() - began)
        assert again.end() == 0
        assert again.replayed() == again.csv.read_bytes()
    finally:
        again.kill()


def test_the_parent_is_told_to_end_in_the_middle_of_writing(own_life: Any, row_of: Any) -> None:
    life = own_life()
    life.live.until_whole()
    began = time.monotonic()
    assert life.live.end() == 0
    assert life.live.recording.read_bytes()[-1:] == life.live.csv.read_bytes()[-1:] == b"\n"
    reader = read_recording(life.live.recording)
    assert sum(1 for _ in reader) > 0
    assert not reader.dropped
    assert life.live.replayed() == life.live.csv.read_bytes()
    row_of(life, "program: SIGTERM in the middle of writing", "ends, files whole", time.monotonic() - began, None)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 4 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if os.getuid() or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "none", disk]).returncode:
        lacking("no right to mount: a full disk is tested as root")
    yield disk
    subprocess.run(["umount", "-l", disk], check=True)


def test_the_disk_is_full_for_a_while(own_life: Any, small_disk: Path, row_of: Any) -> None:
    life = own_life("--record", str(small_disk / "run.rec"))
    life.live.until_whole()
    began = time.monotonic()
    with (small_disk / "filler").open("wb", buffering=0) as filler:
        try:
            while filler.write(bytes(4096)):
                pass
        except OSError:
            filler.truncate(max(0, filler.tell() - 4096))  # room for a little, so that a write fails in its middle
    failed = life.live.until(lambda s: "No space" in s["recording"]["failure"], "full")
    full_s = time.monotonic() - began
    assert failed["mode"] == "ok"
    lost = failed["recording"]["lost"]
    life.live.until(lambda s: s["recording"]["lost"] > lost + 200, "fusion goes on")
    began = time.monotonic()
    (small_disk / "filler").unlink()
    status = life.live.until(lambda s: not s["recording"]["failure"], "written again")
    again_s = time.monotonic() - began
    life.live.until(lambda s: s["t_s"] > status["t_s"] + 2.0, "a while")
    assert life.live.end() == 0
    log = life.live.log.read_text()
    assert log.count("writing has stopped") == log.count("writing goes on") == 1
    reader = read_recording(life.live.recording)
    assert sum(1 for _ in reader) > 0
    assert not reader.dropped
    rows = read_heading_csv(life.live.csv)
    assert (rows["mode"][-10:] == "ok").all()
    row = row_of(life, "disk full, then room again", "ok; recording stopped with one message", full_s, again_s)
    row.lost = f"{status['recording']['lost']} not recorded, none not fused"


def test_the_right_to_a_port_is_lost(own_life: Any) -> None:
    if os.getuid() or shutil.which("setpriv") is None:
        lacking("permissions are tested as root, with setpriv")
    # A root that has to obey modes, like any other user.
    life = own_life(wrapper=["setpriv", "--bounding-set=-dac_override,-dac_read_search"])
    life.live.until_whole()
    cable = life.boat.cables["gps1"]

    def forbid() -> None:
        cable.unplug()
        cable.mode = 0o000
        cable.plug()

    def allow() -> None:
        os.chmod(os.path.realpath(cable.link), 0o600)

    life.row(
        "permission for gps1 lost (replugged with mode 0), given back",
        forbid,
        lambda s: s["sensors"]["gps1"]["port_state"] == "denied" and s["mode"] != "ok",
        allow,
        broken=("gps1",),
    )
    assert life.live.end() == 0
    assert life.live.replayed() == life.live.csv.read_bytes()


def test_the_wall_clock_is_set_back_a_day(own_life: Any, tmp_path: Path) -> None:
    if LIBFAKETIME is None:
        lacking("libfaketime is not installed (package faketime)")
    clock = tmp_path / "clock"
    clock.write_text("+0\n")
    life = own_life(
        env={
            "LD_PRELOAD": str(LIBFAKETIME),
            "FAKETIME_TIMESTAMP_FILE": str(clock),
            "FAKETIME_NO_CACHE": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",  # both names: it changed
            "DONT_FAKE_MONOTONIC": "1",
        }
    )
    life.live.until_whole()
    log = life.live.log.stat().st_size
    began = life.now_s()
    life.row("wall clock set back a day", lambda: clock.write_text("-1d\n"), lambda s: s["t_s"] > began + 5.0)
    assert life.live.log.stat().st_size == log  # nobody complains
    assert set(life.modes(began, life.now_s())) == {"ok"}
    life.live.kill()  # under libfaketime time.sleep fails, which an orderly end needs
    live, replay = life.live.csv.read_bytes(), life.live.replayed()
    both = min(len(live), len(replay))
    assert both > 1000
    assert live[:both] == replay[:both]


def test_the_program_itself_stands_still(own_life: Any) -> None:
    life = own_life()
    life.live.until_whole()

    def stand_still() -> None:
        life.live.process.send_signal(signal.SIGSTOP)
        time.sleep(5.0)  # that is the fault
        life.live.process.send_signal(signal.SIGCONT)

    life.row("program: SIGSTOP for 5 s", stand_still, lambda _: True, broken=SENSORS)
    assert life.live.end() == 0
    replay = Replay(read_recording(life.live.recording))
    assert b"".join(f"{format_row(row, 3)}\n".encode() for rows in replay for row in rows) in life.live.csv.read_bytes()
    assert replay.fusion.verdicts["backwards"] == 0


def test_signals_end_it_while_a_worker_hangs(own_life: Any, row_of: Any) -> None:
    life = own_life()
    sensor = life.live.until_whole()["sensors"]["imu"]
    os.kill(sensor["pid"], signal.SIGSTOP)
    began = time.monotonic()
    life.live.process.send_signal(signal.SIGTERM)
    assert life.live.process.wait(DEADLINE_S) == 0
    assert not alive(sensor["pid"])
    row_of(life, "SIGTERM while a worker hangs", "ends, the worker is killed", time.monotonic() - began, None)


def heading_heard(port: int) -> bool:
    """Whether whoever connects to the NMEA port is told a heading."""
    try:
        with socket.create_connection(("127.0.0.1", port), DEADLINE_S) as client:
            return any(line.startswith(b"$GPHDT") for line in client.makefile("rb"))
    except (ConnectionRefusedError, ConnectionResetError):
        return False


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_output_process_ends_or_stops(own_life: Any, row_of: Any, number: signal.Signals) -> None:
    port = free_port()
    life = own_life("--nmea-tcp", str(port))
    life.live.until_whole()
    wait_until(lambda: heading_heard(port), DEADLINE_S)
    before_s, pid = life.now_s(), output_pid(life.live.process.pid)
    os.kill(pid, number)
    if number == signal.SIGKILL:
        noticed_s = wait_until(lambda: not alive(pid), 2.0)
    else:
        noticed_s = None
        life.live.until(lambda status: status["t_s"] > before_s + 5.0, "5 s more")
        os.kill(pid, signal.SIGCONT)
    whole_s = wait_until(lambda: heading_heard(port), DEADLINE_S)
    assert set(life.modes(before_s, life.now_s())) == {"ok"}
    row_of(life, f"output process: {number.name}", "ok; outputs pause", noticed_s, whole_s)
    assert life.live.end() == 0
    tenths = np.round(read_heading_csv(life.live.csv)["t_s"] * 10).astype(int)
    assert (np.diff(tenths) == 1).all()  # every row of the grid
    assert life.live.replayed() == life.live.csv.read_bytes()
