"""The live program's outputs, read by real clients: on the ptys of a separate simulator, as on a boat."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
import tty
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_boat import DEADLINE_S, ROOT, free_port, output_pid

from acquisition.simulator.ptys import LINK_NAMES
from tinyekf_py.control_socket import ControlError, call
from tinyekf_py.heading_csv import read_heading_csv

Found = Callable[[dict[str, Any]], object]


def environment(folder: Path) -> dict[str, str]:
    kept = {key: value for key, value in os.environ.items() if key != "RUNTIME_DIRECTORY"}
    return {**kept, "XDG_RUNTIME_DIR": str(folder), "PYTHONPATH": str(ROOT)}


@pytest.fixture
def boat(tmp_path: Path) -> Iterator[Path]:
    """The folder in which a simulator of its own has its five devices."""
    links = tmp_path / "devices"
    command = [sys.executable, "-m", "acquisition.simulator", "--ptys", "--links", str(links)]
    simulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert simulator.stdout is not None
    assert simulator.stdout.readline()
    yield links
    simulator.terminate()
    simulator.wait(DEADLINE_S)
    simulator.stdout.close()


class Program:
    """`tinyekf run` on the boat's devices, with outputs."""

    def __init__(self, folder: Path, links: Path | None, *options: str, config: str = "") -> None:
        self.folder, self.csv = folder, folder / "heading.csv"
        self.socket = folder / "tinyekf" / "ctl.sock"
        command = [sys.executable, "-m", "tinyekf_py.run", "--output", str(self.csv), *options]
        if links is not None:
            ports = (f'[sensors.{name}]\nport = "{links / link}"\n' for name, link in LINK_NAMES.items())
            (folder / "tinyekf.toml").write_text("[vessel]\nvariation_deg = -8.0\n" + "".join(ports) + config)
            command += ["--config", str(folder / "tinyekf.toml")]
        self.log = folder / "run.log"
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment(folder), cwd=folder
            )

    def until(self, found: Found, what: str) -> dict[str, Any]:
        """Ask for the status until it is so."""
        end = time.monotonic() + DEADLINE_S
        while True:
            assert self.process.poll() is None, self.log.read_text()
            with contextlib.suppress(ControlError):
                status = call(self.socket, "status")
                if found(status):
                    return status
            assert time.monotonic() < end, f"{what}: {self.log.read_text()}"
            select.select([], [], [], 0.05)

    def until_ok(self) -> None:
        self.until(lambda status: status["mode"] == "ok", "a heading")

    def output_pid(self) -> int:
        """The output process, once there is one."""
        end = time.monotonic() + DEADLINE_S
        while not (pid := output_pid(self.process.pid)):
            assert time.monotonic() < end, self.log.read_text()
            select.select([], [], [], 0.05)
        return pid

    def end(self) -> None:
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(DEADLINE_S) == 0, self.log.read_text()


@pytest.fixture
def program(tmp_path: Path) -> Iterator[Callable[..., Program]]:
    programs: list[Program] = []

    def start(links: Path | None, *options: str, config: str = "") -> Program:
        programs.append(Program(tmp_path, links, *options, config=config))
        return programs[-1]

    yield start
    for started in programs:
        started.process.kill()
        started.process.wait()


class Client:
    """A TCP client that reads lines."""

    def __init__(self, port: int) -> None:
        end = time.monotonic() + DEADLINE_S
        while True:
            try:
                self.socket = socket.create_connection(("127.0.0.1", port), DEADLINE_S)
                break
            except ConnectionRefusedError:
                assert time.monotonic() < end
                time.sleep(0.05)
        self._lines = self.socket.makefile("rb")

    def line(self, wanted: bytes = b"") -> bytes:
        """The next line that begins so; empty when the server has hung up."""
        while (line := self._lines.readline()) and not line.startswith(wanted):
            pass
        return line


def whole_grid(csv: Path) -> bool:
    """Whether the heading CSV has every row of the 100 ms grid."""
    tenths = [round(t_s * 10) for t_s in read_heading_csv(csv)["t_s"]]
    return tenths == list(range(tenths[0], tenths[0] + len(tenths)))


# --- gpsd ----------------------------------------------------------------------------------------------------------


class Gpsd:
    """A gpsd of our own on one source, and what `gpspipe -w` says of it."""

    def __init__(self, source: str) -> None:
        for tool in ("gpsd", "gpspipe"):
            if shutil.which(tool, path=f"{os.environ['PATH']}:/usr/sbin") is None:
                pytest.fail(f"no {tool}: install the Debian packages gpsd and gpsd-clients")
        port = free_port()
        path = {**os.environ, "PATH": f"{os.environ['PATH']}:/usr/sbin"}
        daemon = ["gpsd", "-N", "-n", "-b", "-S", str(port), source]
        self._processes = [subprocess.Popen(daemon, env=path, stderr=subprocess.DEVNULL)]
        Client(port).socket.close()
        self._processes.append(
            subprocess.Popen(["gpspipe", "-w", f"127.0.0.1:{port}"], stdout=subprocess.PIPE, env=path)
        )

    def until(self, kind: str, found: Found) -> dict[str, Any]:
        """The first report of this class for which it is so."""
        out = self._processes[1].stdout
        assert out is not None
        end = time.monotonic() + DEADLINE_S
        seen: dict[str, Any] = {}
        while True:
            assert select.select([out], [], [], max(0.0, end - time.monotonic()))[0], f"no {kind} so; the last: {seen}"
            report = json.loads(out.readline())
            if report["class"] == kind:
                seen = report
                if found(report):
                    return report

    def close(self) -> None:
        for process in reversed(self._processes):
            process.terminate()
            process.wait(DEADLINE_S)
            if process.stdout is not None:
                process.stdout.close()


@pytest.fixture
def gpsd() -> Iterator[Callable[[str], Gpsd]]:
    started: list[Gpsd] = []

    def start(source: str) -> Gpsd:
        started.append(Gpsd(source))
        return started[-1]

    yield start
    for daemon in started:
        daemon.close()


def test_gpsd_takes_heading_and_position_from_tcp(
    boat: Path, program: Callable[..., Program], gpsd: Callable[[str], Gpsd]
) -> None:
    port = free_port()
    run = program(boat, "--nmea-tcp", str(port))
    run.until_ok()
    daemon = gpsd(f"tcp://127.0.0.1:{port}")
    attitude = daemon.until("ATT", lambda report: "heading" in report)
    fix = daemon.until("TPV", lambda report: report.get("mode", 0) >= 2 and "lat" in report and "time" in report)
    run.end()
    rows = read_heading_csv(run.csv)
    assert np.isclose(rows["heading_deg"], attitude["heading"], atol=0.0051).any()
    assert (
        np.isclose(rows["lat_deg"], fix["lat"], atol=2e-7) & np.isclose(rows["lon_deg"], fix["lon"], atol=2e-7)
    ).any()


def test_gpsd_takes_heading_and_position_from_a_serial_line(
    tmp_path: Path, boat: Path, program: Callable[..., Program], gpsd: Callable[[str], Gpsd]
) -> None:
    with Wire() as wire:
        config = f'[outputs.nmea_serial]\nenabled = true\nport = "{wire.near}"\n'
        run = program(boat, config=config)
        run.until_ok()
        daemon = gpsd(wire.far)
        daemon.until("ATT", lambda report: "heading" in report)
        daemon.until("TPV", lambda report: report.get("mode", 0) >= 2 and "lat" in report)


@pytest.mark.parametrize("formatters", [("HDT", "RMC"), ("HDT", "RMC", "GGA")])
def test_gpsd_takes_no_real_fix_from_a_simulation(
    tmp_path: Path, program: Callable[..., Program], gpsd: Callable[[str], Gpsd], formatters: tuple[str, ...]
) -> None:
    port = free_port()
    config = tmp_path / "simulated.toml"
    config.write_text(f"[outputs.nmea]\nsentences = {json.dumps(formatters)}\n")
    run = program(None, "--simulate", "--config", str(config), "--nmea-tcp", str(port))
    run.until_ok()
    client = Client(port)
    for _ in range(5):
        fields = client.line(b"$GPRMC").decode().split(",")
        assert (fields[2], fields[12][0]) == ("V", "S")
    daemon = gpsd(f"tcp://127.0.0.1:{port}")
    daemon.until("ATT", lambda report: "heading" in report)  # it is read, being on this machine
    for _ in range(20):
        report = daemon.until("TPV", lambda _report: True)
        # RMC alone is no fix; with GGA of quality 8 gpsd has a position, of status 8: simulated.
        assert report.get("mode", 0) <= 1 or ("GGA" in formatters and report["status"] == 8), report


class Wire:
    """Two ptys as the two ends of a serial line."""

    def __enter__(self) -> Wire:
        self._masters, slaves = zip(*(os.openpty() for _ in range(2)), strict=True)
        for slave in slaves:
            tty.setraw(slave)
        self.near, self.far = (os.ttyname(slave) for slave in slaves)
        self._slaves = slaves
        copy = "import os,sys\na,b=map(int,sys.argv[1:])\nwhile True: os.write(b,os.read(a,4096))"
        self._copying = subprocess.Popen(
            [sys.executable, "-c", copy, *map(str, self._masters)], pass_fds=self._masters, stderr=subprocess.DEVNULL
        )
        return self

    def __exit__(self, *_: object) -> None:
        self._copying.kill()
        self._copying.wait()
        for fd in (*self._masters, *self._slaves):
            os.close(fd)


# --- many clients, bad clients, a dead or sleeping output process ----------------------------------------------------


def test_ten_clients_get_the_same_and_one_that_does_not_read_costs_them_nothing(
    boat: Path, program: Callable[..., Program]
) -> None:
    port = free_port()
    run = program(boat, "--nmea-tcp", str(port))
    run.until_ok()
    stuck = socket.socket()
    stuck.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    clients = [Client(port) for _ in range(10)]
    stuck.connect(("127.0.0.1", port))
    first = max(client.line(b"$GPHDT") and client.line(b"$GPRMC") for client in clients)
    times = []
    for client in clients:
        while client.line(b"$GPRMC") <= first:
            pass
        times.append([client.line(b"$GPRMC").split(b",")[1] for _ in range(100)])
    common = set(times[0]).intersection(*times[1:])
    for seen in times:
        inside = [t for t in seen if min(common) <= t <= max(common)]
        assert len(inside) == len(common) >= 80, "a client has lost sentences"
    stuck.close()
    run.end()
    assert whole_grid(run.csv)


def test_an_output_process_that_dies_is_started_again_and_the_heading_goes_on(
    boat: Path, program: Callable[..., Program]
) -> None:
    port = free_port()
    run = program(boat, "--nmea-tcp", str(port))
    run.until_ok()
    client = Client(port)
    assert client.line(b"$GPHDT")
    before, killed_s = run.output_pid(), run.until(lambda _status: True, "an answer")["t_s"]
    os.kill(before, signal.SIGKILL)
    with contextlib.suppress(ConnectionResetError):
        while client.line():
            pass
    end = time.monotonic() + DEADLINE_S
    while True:
        with contextlib.suppress(ConnectionResetError):  # taken in by the dying process' socket
            if Client(port).line(b"$GPHDT"):
                break
        assert time.monotonic() < end, run.log.read_text()
    assert run.output_pid() != before
    run.end()
    assert "output process ended" in run.log.read_text()
    assert whole_grid(run.csv)
    rows = read_heading_csv(run.csv)
    assert set(rows["mode"][rows["t_s"] >= killed_s]) == {"ok"}


def test_an_output_process_that_sleeps_delays_nothing(boat: Path, program: Callable[..., Program]) -> None:
    port = free_port()
    run = program(boat, "--nmea-tcp", str(port))
    run.until_ok()
    client = Client(port)
    assert client.line(b"$GPHDT")
    pid = run.output_pid()
    os.kill(pid, signal.SIGSTOP)
    began = run.until(lambda _status: True, "an answer")["t_s"]
    run.until(lambda status: status["t_s"] > began + 5.0 and status["mode"] == "ok", "5 s more")
    os.kill(pid, signal.SIGCONT)
    after = time.time()
    while True:  # what it is given on waking is new: frames that it slept through are skipped
        clock = re.match(rb"\$GPRMC,(\d\d)(\d\d)(\d\d\.\d\d)", client.line(b"$GPRMC"))
        assert clock is not None
        seconds = int(clock[1]) * 3600 + int(clock[2]) * 60 + float(clock[3])
        if abs((after % 86400) - seconds) < 3.0:
            break
    assert run.output_pid() == pid
    run.end()
    assert whole_grid(run.csv)


def test_a_replay_serves_and_has_no_tasks_to_switch(tmp_path: Path, program: Callable[..., Program]) -> None:
    recording = tmp_path / "rec.log"
    simulate = [sys.executable, "-m", "acquisition.simulator", str(recording), str(tmp_path / "truth.csv")]
    subprocess.run([*simulate, "--duration", "120"], check=True, env=environment(tmp_path), timeout=DEADLINE_S)
    port, web = free_port(), free_port()
    replay = program(None, "--replay", str(recording), "--speed", "2", "--nmea-tcp", str(port), "--web", str(web))
    client = Client(port)
    assert client.line(b"$GPHDT")
    assert client.line(b"$GPTHS").split(b"*")[0].endswith(b",S")
    asked = urllib.request.Request(f"http://127.0.0.1:{web}/api/tasks/gps2/stop", method="POST")
    Client(web).socket.close()
    with pytest.raises(urllib.error.HTTPError) as refused:
        urllib.request.urlopen(asked, timeout=DEADLINE_S)
    assert "replay" in json.load(refused.value)["error"]
    replay.end()
    assert whole_grid(replay.csv)
