"""What the web output serves: state, history, streams, tasks, metrics, health."""

from __future__ import annotations

import json
import logging
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path

import pytest
from web_process import DEADLINE_S, NAN, TASKS, WebProcess, boat, read_frame

from tinyekf_py.outputs.process import MODULES
from tinyekf_py.outputs.web.history import COLUMNS, LENGTH_S, PERIOD_S
from tinyekf_py.outputs.web.streams import text_frame


@pytest.fixture(scope="module")
def one() -> Iterator[WebProcess]:
    web = WebProcess()
    yield web
    web.close()


@pytest.fixture
def web(one: WebProcess) -> WebProcess:
    one.running.update(dict.fromkeys(TASKS, True))
    one.heading_deg = 123.4
    one.silent.clear()
    end = time.monotonic() + DEADLINE_S
    while not all(task["running"] for task in one.get("/api/state").json()["tasks"]):
        assert time.monotonic() < end, "the tasks do not start"
    return one


def messages(connection: socket.socket) -> Iterator[dict[str, object]]:
    """What a watcher is told."""
    while True:
        opcode, payload = read_frame(connection)
        if opcode == 1:
            yield json.loads(payload, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))


def until(web: WebProcess, path: str, status: int) -> bytes:
    """The body once the answer has this status."""
    connection, _ = web.upgrade()
    with connection:
        for _ in messages(connection):  # as often as there is something new
            reply = web.get(path)
            if reply.status == status:
                return reply.body
    raise AssertionError(path)


def test_the_state_is_the_view_state_by_its_names(web: WebProcess) -> None:
    until(web, "/healthz", 200)
    state = web.get("/api/state").json()
    assert state["estimate"]["heading_deg"] == 123.4
    assert state["navigation"]["cog_deg"] == 122.0
    assert state["sensors"][1]["rate_hz"] is None
    assert [row["fix_quality"] for row in state["sensors"]] == [2, None, None, None]
    assert (state["navigation"]["fix_quality"], state["navigation"]["satellites"]) == (None, None)
    assert state["sensors"][1]["last_error"].startswith("<img")
    assert state["sensors"][1]["dropped"] == [['a"\\\n', 3]]
    assert [task["name"] for task in state["tasks"]] == list(TASKS)
    assert state["is_stale"] is False
    made = boat(1.0, web.running)
    assert set(made._fields) < set(state)
    assert set(made.estimate._fields) == set(state["estimate"])


def test_the_log_tells_the_pages_address(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    web = WebProcess()
    try:
        end = time.monotonic() + DEADLINE_S
        while f"page at http://127.0.0.1:{web.port}" not in caplog.messages:
            assert time.monotonic() < end, caplog.text
            time.sleep(0.02)  # the line comes over the link when it will
    finally:
        web.close()


def test_a_watcher_is_greeted_and_then_told_of_each_frame(web: WebProcess) -> None:
    connection, status = web.upgrade()
    assert status == 101
    with connection:
        told = messages(connection)
        assert set(next(told)) == {"hello"}
        assert set(next(told)) == {"history"}
        times = [next(told)["state"]["elapsed_s"] for _ in range(12)]
    assert all(t > 0 for t in times)
    assert len(set(times)) > 8  # about ten a second


def test_the_rate_can_be_lower() -> None:
    web = WebProcess(rate_hz=2.0)
    try:
        connection, _ = web.upgrade()
        with connection:
            told = [message["state"] for message in islice(messages(connection), 8) if "state" in message]
        times = [state["elapsed_s"] for state in told]
        gaps = [b - a for a, b in pairwise(times[1:])]
        assert all(gap > 0.25 for gap in gaps)
    finally:
        web.close()


def test_without_a_heading_it_is_not_healthy(web: WebProcess) -> None:
    until(web, "/healthz", 200)
    web.heading_deg = NAN
    assert json.loads(until(web, "/healthz", 503)) == {"heading": "invalid"}
    assert web.get("/api/state").json()["estimate"]["heading_deg"] is None
    web.heading_deg = 359.99999
    until(web, "/healthz", 200)
    web.silent.set()  # an old heading is none
    until(web, "/healthz", 503)
    assert web.get("/api/state").json()["is_stale"] is True


def test_tasks_are_started_and_stopped(web: WebProcess) -> None:
    for verb, running in (("stop", False), ("start", True)):
        assert web.post(f"/api/tasks/gps2/{verb}").json() == {"tasks": {**dict.fromkeys(TASKS, True), "gps2": running}}
    assert web.post("/api/tasks/all/stop").json() == {"tasks": dict.fromkeys(TASKS, False)}
    reply = web.post("/api/tasks/gps7/stop")
    assert (reply.status, reply.json()) == (404, {"error": "no task 'gps7'"})


def test_promtool_finds_no_fault_with_the_metrics(web: WebProcess) -> None:
    promtool = shutil.which("promtool")
    if promtool is None:
        why = "no promtool: apt install prometheus"
        pytest.fail(why) if os.environ.get("CI") else pytest.skip(why)
    until(web, "/healthz", 200)
    reply = web.get("/metrics")
    assert reply.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    checked = subprocess.run([promtool, "check", "metrics"], input=reply.body, capture_output=True)
    assert (checked.returncode, checked.stdout, checked.stderr) == (0, b"", b"")
    lines = reply.body.decode().splitlines()
    assert "tinyekf_heading_degrees 123.4" in lines
    assert 'tinyekf_heading_mode{mode="ok"} 1' in lines
    assert 'tinyekf_task_running{task="gps2"} 1' in lines
    assert 'tinyekf_sensor_dropped_total{sensor="gps2",reason="a\\"\\\\\\n"} 3' in lines
    assert not any("nan" in line.lower().rpartition(" ")[2] for line in lines if not line.startswith("#"))


def test_a_page_opened_late_is_shown_five_minutes_at_once() -> None:
    """Seven minutes of the boat's time pass in some seconds."""
    web = WebProcess()
    try:
        web.sail_quickly(10_000.0, 420.0, PERIOD_S)
        history = web.get("/api/history").json()
        assert tuple(history["columns"]) == COLUMNS
        assert history["sensors"] == ["gps1", "gps2", "compass", "imu"]
        times = [point[0] for point in history["points"]]
        assert times[-1] - times[0] >= LENGTH_S - 5 * PERIOD_S
        assert times == sorted(times)
        late, _ = web.upgrade()
        with late:
            told = messages(late)
            next(told)
            assert len(next(told)["history"]["points"]) >= len(times) - 2
        assert len(json.dumps(history)) < 90_000
    finally:
        web.close()


def test_signal_k_comes_over_a_websocket(web: WebProcess) -> None:
    assert web.get("/signalk").json()["endpoints"]["v1"]["signalk-ws"] == f"ws://127.0.0.1:{web.port}/signalk/v1/stream"
    connection, status = web.upgrade("/signalk/v1/stream?subscribe=self")
    assert status == 101
    with connection:
        told = messages(connection)
        greeting, delta = next(told), next(told)
        assert greeting["name"] == "tinyekf"
        assert greeting["self"] == delta["context"] == web.get("/signalk/v1/api/self").json()
        values = {value["path"]: value["value"] for value in delta["updates"][0]["values"]}
    assert values["navigation.headingTrue"] == pytest.approx(123.4 * 3.14159265 / 180, abs=1e-5)


def test_the_output_process_imports_no_numpy() -> None:
    imports = "; ".join(f"import {module}" for module in MODULES.values())
    code = f"import sys; import tinyekf_py.outputs.process; {imports}; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[2]).returncode == 0


@pytest.mark.parametrize(("size", "head"), [(0, 2), (125, 2), (126, 4), (65535, 4), (65536, 10), (200_000, 10)])
def test_a_frame_has_its_length_in_the_shortest_form(size: int, head: int) -> None:
    frame = text_frame("x" * size)
    assert len(frame) == head + size
    ours, theirs = socket.socketpair()
    with ours, theirs:
        sender = threading.Thread(target=ours.sendall, args=(frame,))
        sender.start()
        assert read_frame(theirs) == (1, b"x" * size)
        sender.join()
