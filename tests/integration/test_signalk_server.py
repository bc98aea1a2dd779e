"""A real signalk-server understands the program every way: NMEA 0183 and deltas over TCP, deltas over WebSocket."""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import shutil
import socket
import subprocess
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from live_boat import Program, SimulatedBoat, free_port
from signalk_server import NODE, SignalKServer, install

from acquisition.recording import read_recording
from tinyekf_py.estimate import Estimate
from tinyekf_py.heading_csv import read_heading_csv
from tinyekf_py.outputs.signalk_delta import delta, hello, vessel_context
from tinyekf_py.view_state import Navigation, ViewState

TOLERANCE_RAD = 0.001
#: The server's stamp is of when a value was made or received, the row's of the sample clock: they belong together
#: when they are this near, seconds.
NEAR_S = 0.3
ANSWERS = 25

if shutil.which("npm") is None and not os.environ.get("CI"):
    pytest.skip("npm, which installs the server, is not here", allow_module_level=True)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Callable[..., SignalKServer]]:
    servers: list[SignalKServer] = []

    def start(*source: str | int) -> SignalKServer:
        servers.append(SignalKServer(tmp_path / "server", *source))
        return servers[-1]

    yield start
    for started in servers:
        started.close()


@pytest.fixture
def boat(tmp_path: Path) -> Iterator[SimulatedBoat]:
    boat = SimulatedBoat(tmp_path)
    yield boat
    boat.close()


def serves(port: int) -> bool:
    with contextlib.suppress(ConnectionRefusedError), socket.create_connection(("127.0.0.1", port)):
        return True
    return False


def output(name: str, port: int) -> str:
    return f"[outputs.{name}]\nenabled = true\nport = {port}\n"


@pytest.mark.parametrize(
    ("name", "data_type", "by"),
    [("nmea_tcp", "NMEA0183", "tcp"), ("signalk", "SignalK", "tcp"), ("web", "SignalK", "ws")],
)
def test_the_servers_heading_is_the_programs(
    tmp_path: Path, boat: SimulatedBoat, server: Callable[..., SignalKServer], name: str, data_type: str, by: str
) -> None:
    port = free_port()
    live = Program(tmp_path, boat, config=output(name, port))
    try:
        live.until_whole()
        live.until(lambda _status: serves(port), "serving")
        asked = server(data_type, port, by)
        answers = []
        stamp = ""
        while len(answers) < ANSWERS:
            answer = asked.until(
                "navigation/headingTrue",
                lambda a: a["value"] is not None and a["timestamp"] != stamp,  # noqa: B023
                "a new heading",
            )
            stamp = answer["timestamp"]
            answers.append((datetime.fromisoformat(stamp), answer["value"]))
            select.select([], [], [], 0.1)
        position = asked.get("navigation/position")["value"]
        assert live.end() == 0
    finally:
        live.kill()
    start_utc = read_recording(live.recording).start_utc
    rows = read_heading_csv(live.csv)
    worst, behind = 0.0, []
    for moment, heading_rad in answers:
        at_s = (moment - start_utc).total_seconds()
        near = rows[np.abs(rows["t_s"] - at_s) <= NEAR_S]
        apart = np.radians(near["heading_deg"]) - heading_rad
        apart = np.abs(np.arctan2(np.sin(apart), np.cos(apart)))
        worst = max(worst, float(np.min(apart)))
        behind.append(at_s - near["t_s"][np.argmin(apart)])
    print(f"{name}: {len(answers)} headings, worst {worst:.6f} rad, {min(behind):.3f} to {max(behind):.3f} s behind")
    assert worst <= TOLERANCE_RAD
    assert position["latitude"] == pytest.approx(np.nanmean(rows["lat_deg"]), abs=0.01)
    assert position["longitude"] == pytest.approx(np.nanmean(rows["lon_deg"]), abs=0.01)


def test_the_server_hears_of_a_heading_that_is_lost_and_found(
    tmp_path: Path, boat: SimulatedBoat, server: Callable[..., SignalKServer]
) -> None:
    port = free_port()
    live = Program(tmp_path, boat, config=output("signalk", port))
    try:
        asked = server("SignalK", port)
        live.until_whole()
        path = "notifications/navigation/headingTrue"
        asked.until(path, lambda a: a["value"]["state"] == "normal", "all well")
        live.ask("stop", "gps2")
        notification = asked.until(path, lambda a: a["value"]["state"] == "warn", "degraded")
        assert "gps2" in notification["value"]["message"]
        live.ask("stop", "all")
        asked.until(path, lambda a: a["value"]["state"] == "alarm", "no heading")
        asked.until("navigation/headingTrue", lambda a: a["value"] is None, "null")
        live.ask("start", "all")
        asked.until(path, lambda a: a["value"]["state"] == "normal", "all well again")
        asked.until("navigation/headingTrue", lambda a: a["value"] is not None, "a heading")
    finally:
        live.kill()


def test_every_message_is_valid_by_the_formats_own_schemas() -> None:
    modules = install()
    now_utc = datetime(2026, 11, 24, 3, tzinfo=UTC)
    estimate = Estimate(0, 359.9999, 0.5, -1.0, 35.96, 126.52, "ok", "gps")
    navigation = Navigation(sog_mps=4.0, cog_deg=10.0, roll_deg=-2.0, pitch_deg=math.nan, variation_deg=-8.0)
    deltas = [
        delta(ViewState(estimate, navigation=navigation), 0.0, now_utc, (), context=vessel_context()),
        delta(None, math.inf, now_utc, (), context=vessel_context()),
    ]
    script = """
        const schema = require('@signalk/signalk-schema')
        const [hello, deltas] = JSON.parse(require('fs').readFileSync(0))
        const greeting = require('@signalk/signalk-schema/schemas/hello.json')
        const verdicts = deltas.map((delta) => schema.validateDelta(delta))
        console.log(JSON.stringify([...verdicts, schema.getTv4().validateResult(hello, greeting, true, true)]))
    """
    done = subprocess.run(
        [modules / NODE / "bin" / "node", "-e", script],
        input=json.dumps([hello(now_utc), deltas]), capture_output=True, text=True, cwd=modules, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    verdicts = json.loads(done.stdout)
    assert len(verdicts) == 3
    for verdict in verdicts:
        assert verdict["valid"], verdict
        assert not verdict["missing"], verdict
