"""Every task can be started and stopped while the rest runs, by whoever may, and a replay does the same."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import stat
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from live_boat import DEADLINE_S, ROOT, SENSORS, Boat, Program

from acquisition.recording import Event, read_recording
from tinyekf_py.heading_csv import read_heading_csv
from tinyekf_py.tasks import Switch, TaskError, Tasks, task_key, task_names

PAPERS_TASKS = (*SENSORS, "cnw-s1", "cnw-s2", "ekf1", "ekf2", "ekf3", "cnw-s3")


@pytest.fixture
def boat(tmp_path: Path) -> Iterator[Boat]:
    boat = Boat(tmp_path)
    yield boat
    boat.close()


@pytest.fixture
def program(tmp_path: Path, boat: Boat) -> Iterator[Callable[..., Program]]:
    programs: list[Program] = []

    def start(*options: str, **more: str) -> Program:
        programs.append(Program(tmp_path, boat, *options, **more))
        return programs[-1]

    yield start
    for started in programs:
        started.kill()


def test_the_papers_tasks_are_all_there_each_with_a_key_of_its_own() -> None:
    names = task_names(("gps1", "gps2", "gps3", "compass", "imu"), 3)
    assert names == PAPERS_TASKS
    eight = task_names((*(f"gps{i}" for i in range(1, 9)), "compass", "imu"), 8)
    assert len({task_key(name) for name in eight} | {"a"}) == len(eight) + 1


def test_an_unknown_task_is_named_with_its_nearest() -> None:
    with pytest.raises(TaskError, match="did you mean gps1"):
        Tasks(PAPERS_TASKS).switch(Switch("gpss1", running=False))


def test_the_key_for_all_starts_all_as_long_as_one_is_stopped() -> None:
    tasks = Tasks(PAPERS_TASKS, ["ekf2"])
    assert tasks.toggled("a") == Switch("all", running=True)
    assert tasks.switch(Switch("all", running=True)) == ("ekf2",)
    assert tasks.toggled("a") == Switch("all", running=False)
    assert tasks.toggled("%") is None


def test_each_task_is_stopped_and_started_live_and_the_replay_is_byte_identical(program) -> None:
    live = program()
    live.until_whole()
    for task in PAPERS_TASKS:
        status = live.ask("stop", task)
        assert [name for name, running in status["tasks"].items() if not running] == [task]
        if task in SENSORS:
            live.until(lambda s, task=task: s["sensors"][task]["port_state"] == "stopped", "stopped")
        if task != "cnw-s1":  # without it the weights alone change
            live.until(lambda s: s["mode"] == "degraded", "degraded")
        live.ask("start", task)
        live.until_whole()
    live.ask("stop", "all")
    live.until(lambda s: s["mode"] == "invalid", "no heading")
    live.ask("start", "all")
    live.until_whole()
    assert live.end() == 0
    events = [entry for entry in read_recording(live.recording) if isinstance(entry, Event)]
    assert len(events) == 4 * len(PAPERS_TASKS)
    assert live.csv.read_bytes() == live.replayed()
    rows = read_heading_csv(live.csv)
    ordinary = rows["mode"] == "ok"
    assert not np.isnan(rows["heading_deg"][ordinary]).any()


def test_a_task_can_be_stopped_from_the_start(program) -> None:
    live = program(config='[tasks]\nstopped = ["gps2", "ekf1"]\n')
    live.until(lambda s: s["mode"] == "degraded" and s["sensors"]["gps1"]["samples"] > 3, "running")
    sensor = live.ask("status")["sensors"]["gps2"]
    assert (sensor["port_state"], sensor["lines"]) == ("stopped", 0)
    live.ask("start", "all")
    live.until_whole()
    assert live.end() == 0
    assert live.csv.read_bytes() == live.replayed()


def ctl(live: Program, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tinyekf_py.ctl", *words]
    return subprocess.run(command, capture_output=True, text=True, env=live.environment, timeout=DEADLINE_S)


def test_a_second_terminal_sees_and_switches_tasks(program) -> None:
    live = program()
    live.until_whole()
    assert stat.S_IMODE(live.socket.stat().st_mode) == 0o600
    shown = ctl(live, "status")
    assert shown.returncode == 0
    assert "ekf3     running" in shown.stdout
    stopped = ctl(live, "stop", "compass", "--json")
    assert json.loads(stopped.stdout)["tasks"]["compass"] is False
    assert json.loads(stopped.stdout)["sensors"]["compass"]["rate_hz"] is None
    live.until(lambda s: s["t_s"] > json.loads(stopped.stdout)["t_s"] + 1.5, "counted again")
    assert re.search(r"^compass +stopped +--- ", ctl(live, "status").stdout, re.M)
    wrong = ctl(live, "stop", "compas")
    assert (wrong.returncode, wrong.stderr) == (2, "tinyekf ctl: no task 'compas'; did you mean compass?\n")
    assert ctl(live, "stop").returncode == 2
    assert live.end() == 0
    assert not live.socket.exists()
    gone = ctl(live, "status")
    assert gone.returncode == 1
    assert "no tinyekf is running" in gone.stderr


def test_the_console_shows_the_keys_and_obeys_them(tmp_path: Path, boat: Boat, program) -> None:
    pytest.importorskip("rich", reason="the full screen needs the extra [console]")
    config = program().config  # only for its file
    other = tmp_path / "console"
    other.mkdir()
    environment = {**os.environ, "TERM": "xterm", "XDG_RUNTIME_DIR": str(other), "PYTHONPATH": str(ROOT)}
    pid, terminal = pty.fork()
    if pid == 0:
        command = [sys.executable, "-m", "tinyekf_py.run", "--config", str(config)]
        os.execve(command[0], command, environment)
    shown = b""

    def until(text: bytes) -> None:
        nonlocal shown
        end = time.monotonic() + DEADLINE_S
        while text not in shown:
            assert time.monotonic() < end, shown[-2000:].decode("utf-8", "replace")
            if select.select([terminal], [], [], 0.2)[0]:
                shown += os.read(terminal, 65536)

    try:
        until(b"2 gps2")
        os.write(terminal, b"2")
        until(b"STOPPED")
        os.write(terminal, b"\x03")
        assert os.waitpid(pid, 0)[1] == 0
    finally:
        os.close(terminal)
