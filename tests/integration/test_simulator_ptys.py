"""The simulated devices on real ptys, read as a program reads serial ports."""

from __future__ import annotations

import itertools
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pynmea2
import pytest

from acquisition.simulator.ptys import LINK_NAMES, LinkError, Pty, make_links, remove_links

PATIENCE_S = 30.0
COMMAND = [sys.executable, "-m", "acquisition.simulator", "--ptys"]


def open_port(path: str) -> int:
    return os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


@contextmanager
def simulator(*options: str) -> Iterator[tuple[subprocess.Popen[bytes], dict[str, Any]]]:
    process = subprocess.Popen([*COMMAND, *options], stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        yield process, json.loads(process.stdout.readline())
    finally:
        process.terminate()
        process.wait(PATIENCE_S)
        if process.stdout:
            process.stdout.close()


def read_lines(ports: dict[str, str], wanted: int, source: str) -> tuple[dict[str, list[bytes]], float, float]:
    """Whole lines of every port until `source` has `wanted`, and when (monotonic) its first and last came."""
    source_of = {open_port(path): name for name, path in ports.items()}
    received = dict.fromkeys(ports, b"")
    first_s = last_s = 0.0
    give_up_s = time.monotonic() + PATIENCE_S
    while received[source].count(b"\n") < wanted:
        assert time.monotonic() < give_up_s, f"{source} sent too few lines"
        for fd in select.select(list(source_of), [], [], 1.0)[0]:
            received[source_of[fd]] += os.read(fd, 4096)
            if source_of[fd] == source:
                last_s = time.monotonic()
                first_s = first_s or last_s
    for fd in source_of:
        os.close(fd)
    return {name: octets.split(b"\r\n")[1:-1] for name, octets in received.items()}, first_s, last_s


def test_five_devices_speak_their_protocols_at_their_rates(tmp_path: Path) -> None:
    links = tmp_path / "dev"
    with simulator("--links", str(links), "--seed", "4") as (process, ready):
        assert ready["variation_deg"] == -8.0
        assert set(ready["ports"]) == {"gps1", "gps2", "gps3", "compass", "imu"}
        lines, first_s, last_s = read_lines({name: str(links / LINK_NAMES[name]) for name in LINK_NAMES}, 61, "gps1")
        process.terminate()
        assert process.wait(PATIENCE_S) == 0
    assert not list(links.iterdir())
    fixes: list[Any] = [pynmea2.parse(line.decode(), check=True) for line in lines["gps1"]]
    clock = [fix.timestamp.second + fix.timestamp.microsecond / 1e6 for fix in fixes if fix.sentence_type == "RMC"]
    steps = [round((after - before) % 60.0, 3) for before, after in itertools.pairwise(clock)]
    assert set(steps) == {0.1}
    # The devices' clock and the computer's went the same way, however the machine was loaded.
    assert abs((clock[-1] - clock[0]) % 60.0 - (last_s - first_s)) < 1.0
    assert len(lines["imu"]) == pytest.approx(200, abs=30)
    assert len(lines["compass"]) == pytest.approx(40, abs=6)
    assert all(line.startswith(b"*") and line.count(b",") == 8 for line in lines["imu"])
    for line in lines["compass"]:
        assert pynmea2.parse(line.decode(), check=True).talker == "HC"


def test_truth_is_on_the_time_base_that_was_asked_for(tmp_path: Path) -> None:
    start_us = time.monotonic_ns() // 1000 - 5_000_000
    path = tmp_path / "truth.csv"
    options = ("--truth", str(path), "--start-us", str(start_us), "--duration", "0.5", "--scenario", "straight")
    with simulator(*options) as (process, _):
        assert process.wait(PATIENCE_S) == 0
    end_s = time.monotonic() - start_us / 1e6
    header, *rows = path.read_text().splitlines()
    assert header == "t_s,heading_deg,lat_deg,lon_deg"
    stamps = [round(float(row.split(",")[0]) * 10) for row in rows]
    assert stamps == list(range(stamps[0], stamps[0] + len(stamps)))
    assert len(stamps) >= 5
    assert stamps[0] > 50
    assert stamps[-1] / 10 <= end_s


def wait_for_hang_up(fd: int) -> None:
    poll = select.poll()
    poll.register(fd, 0)  # hang-ups alone
    assert poll.poll(PATIENCE_S * 1000)


def test_it_ends_with_its_parent() -> None:
    parent = subprocess.Popen(
        [sys.executable, "-c", f"import subprocess; subprocess.run({COMMAND!r})"], stdout=subprocess.PIPE
    )
    assert parent.stdout is not None
    ready = json.loads(parent.stdout.readline())
    fd = open_port(ready["ports"]["imu"])
    parent.kill()
    parent.wait()
    wait_for_hang_up(fd)
    os.close(fd)
    assert parent.stdout.read() == b""  # the last holder of the pipe has gone
    parent.stdout.close()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_at_once_and_cleanly(number: signal.Signals) -> None:
    with simulator() as (process, _):
        process.send_signal(number)
        assert process.wait(PATIENCE_S) == 0


def test_a_reader_who_does_not_read_loses_whole_lines_and_delays_nobody() -> None:
    pty = Pty()
    fd = open_port(pty.path)
    line = b"*" + b"1" * 60
    for _ in range(3000):
        pty.send([line])
    assert pty.dropped_lines > 0
    received = b""
    give_up_s = time.monotonic() + PATIENCE_S
    while not received.endswith(b"later\r\n"):
        assert time.monotonic() < give_up_s
        if select.select([fd], [], [], 0.05)[0]:
            received += os.read(fd, 4096)
        else:
            pty.send([b"later"])
    assert set(received.split(b"\r\n")[:-1]) == {line, b"later"}
    os.close(fd)
    pty.close()


def test_links_of_an_earlier_run_are_replaced_and_other_files_are_not(tmp_path: Path) -> None:
    pty = Pty()
    link = tmp_path / "fjIMU"
    link.symlink_to("/dev/pts/nonexistent")
    links = make_links({"imu": pty}, tmp_path)
    assert os.readlink(link) == pty.path
    remove_links({"imu": pty}, links)
    assert not link.is_symlink()
    link.write_text("mine")
    with pytest.raises(LinkError, match="fjIMU"):
        make_links({"imu": pty}, tmp_path)
    assert link.read_text() == "mine"
    pty.close()


def test_two_simulators_do_not_share_a_folder_and_a_killed_one_leaves_it(tmp_path: Path) -> None:
    with simulator("--links", str(tmp_path)) as (first, ready):
        links = {path.name: os.readlink(path) for path in tmp_path.iterdir()}
        second = subprocess.run(
            [*COMMAND, "--links", str(tmp_path)], capture_output=True, text=True, timeout=PATIENCE_S
        )
        assert second.returncode == 2
        assert second.stderr == (
            f"tinyekf simulate: another simulator has its links in {tmp_path}; end it, or give another folder\n"
        )
        assert {path.name: os.readlink(path) for path in tmp_path.iterdir()} == links
        assert os.path.exists(ready["links"]["imu"])
        first.kill()
        first.wait(PATIENCE_S)
    with simulator("--links", str(tmp_path)) as (_, ready):
        assert os.path.realpath(ready["links"]["imu"]) == ready["ports"]["imu"]


def test_what_nobody_listened_to_is_not_kept_for_the_next_reader() -> None:
    with simulator("--scenario", "dock") as (_, ready):
        # While gps2 is read for a second, nobody has the IMU open.
        read_lines({"gps2": ready["ports"]["gps2"]}, 30, "gps2")
        fd = open_port(ready["ports"]["imu"])
        assert select.select([fd], [], [], PATIENCE_S)[0]
        assert len(os.read(fd, 65536)) < 40 * 60  # of some 100 lines of 60 bytes
        os.close(fd)
