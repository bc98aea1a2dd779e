"""A boat on real ptys whose cables a test can pull, and the live program as a process that reads them."""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from acquisition.simulator.grades import GRADES
from acquisition.simulator.ptys import LINK_NAMES
from acquisition.simulator.scenarios import SCENARIOS
from acquisition.simulator.vessel import STEP_US
from acquisition.simulator.voyage import Voyage
from tinyekf_py.control_socket import ControlError, call

DEADLINE_S = 30.0
ROOT = Path(__file__).resolve().parents[1]
SENSORS = tuple(LINK_NAMES)

#: From a device's line to what it sends instead: other bytes, or None for nothing.
Mangle = Callable[[bytes], bytes | None]
#: What a test waits for in the program's status.
Found = Callable[[dict[str, Any]], object]


class Cable:
    """One device: a pty behind a link of a constant name, as udev makes it."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.mode = 0o620
        self.lock = threading.Lock()
        self.mangle: Mangle | None = None
        self.master = -1
        self.sent = 0  # lines that went out while it was plugged in
        self.held: list[int] = []  # ptys kept open so that the next one gets another name
        self.plug()

    def plug(self) -> None:
        """Appear, under whatever name the kernel gives."""
        with self.lock:
            self.master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(self.master, False)
            os.fchmod(slave, self.mode)
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(os.ttyname(slave))
            os.close(slave)

    def unplug(self) -> None:
        """Vanish, with the link."""
        with self.lock:
            if self.master >= 0:
                self.link.unlink(missing_ok=True)
                os.close(self.master)
                self.master = -1

    def plug_elsewhere(self) -> None:
        """Appear under a name that the kernel has not given this device before."""
        self.held += os.openpty()  # takes the number that became free
        self.plug()

    def send(self, line: bytes) -> None:
        with self.lock:
            sent = line + b"\r\n" if self.mangle is None else self.mangle(line)
            if self.master >= 0 and sent:
                self.write(sent)
                self.sent += sent.count(b"\n")

    def write(self, chunk: bytes) -> None:
        """Send bytes as they are; what a reader that sleeps leaves no room for is lost, as on a wire."""
        with contextlib.suppress(BlockingIOError, OSError):
            os.write(self.master, chunk)

    def close(self) -> None:
        self.unplug()
        for fd in self.held:
            os.close(fd)


class Boat:
    """Sails in a thread, at real time."""

    def __init__(self, folder: Path, *, start_utc: datetime | None = None) -> None:
        self.cables = {name: Cable(folder / LINK_NAMES[name]) for name in SENSORS}
        self.voyage = Voyage(SCENARIOS["tour"], GRADES["typical"], start_utc=start_utc or datetime.now(UTC))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._sail, daemon=True)
        self._thread.start()

    @property
    def links(self) -> dict[str, Path]:
        """Where each device is."""
        return {name: cable.link for name, cable in self.cables.items()}

    def _sail(self) -> None:
        due = time.monotonic()
        while not self._ended.is_set():
            due += STEP_US / 1e6
            self._ended.wait(max(0.0, due - time.monotonic()))
            for _, source, line in self.voyage.advance():
                self.cables[source].send(line)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        for cable in self.cables.values():
            cable.close()


class SimulatedBoat:
    """Sails in a process of its own, `tinyekf simulate --ptys`; to the live program it is a real one."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.links = {name: folder / link for name, link in LINK_NAMES.items()}
        command = [sys.executable, "-m", "acquisition.simulator", "--ptys", "--links", str(folder), *options]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, env=environment)
        assert self._process.stdout is not None
        assert self._process.stdout.readline(), "the simulator has ended"  # it says where its ptys are

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(DEADLINE_S)
        assert self._process.stdout is not None
        self._process.stdout.close()


def is_whole(status: dict[str, Any]) -> bool:
    """Whether every sensor speaks and the heading is ok."""
    return status["mode"] == "ok" and all(sensor["port_state"] == "open" for sensor in status["sensors"].values())


def output_pid(program_pid: int) -> int:
    """The output process of a live program; 0 when there is none now."""
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            command = (entry / "cmdline").read_bytes() if entry.name.isdigit() else b""
            if b"tinyekf_py.outputs.process" in command:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                if parent == program_pid:
                    return int(entry.name)
    return 0


def free_port() -> int:
    """A port that nothing listens at, below those that the kernel gives to connections."""
    while True:
        number = random.randrange(20_000, 32_000)
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", number)):
            return number


class Program:
    """The live program on a boat, recording and writing its heading CSV."""

    def __init__(
        self,
        folder: Path,
        boat: Boat | SimulatedBoat,
        *options: str,
        config: str = "",
        env: Mapping[str, str] | None = None,
        wrapper: Sequence[str] = (),
    ) -> None:
        self.folder = folder
        self.recording, self.csv, self.log = folder / "run.rec", folder / "run.csv", folder / "run.log"
        self.config = folder / "tinyekf.toml"
        self.config.write_text(
            "".join(f'[sensors.{name}]\nport = "{link}"\n' for name, link in boat.links.items()) + config
        )
        command = [*wrapper, sys.executable, "-m", "tinyekf_py.run", "--config", str(self.config)]
        if "--record" in options:
            self.recording = Path(options[options.index("--record") + 1])
        else:
            command += ["--record", str(self.recording)]
        command += ["--output", str(self.csv), *options]
        self.environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder), "PYTHONPATH": str(ROOT), **(env or {})}
        self.environment.pop("RUNTIME_DIRECTORY", None)
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=log, env=self.environment
            )
        self.socket = folder / "tinyekf" / "ctl.sock"

    def ask(self, *words: str) -> dict[str, Any]:
        """Its answer at the control socket."""
        answer = call(self.socket, *words)
        assert "error" not in answer, answer
        return answer

    def until(self, found: Found, what: str, limit_s: float = DEADLINE_S) -> dict[str, Any]:
        """Ask for the status until it is so; that status."""
        end = time.monotonic() + limit_s
        while True:
            assert self.process.poll() is None, f"the program ended: {self.log.read_text()}"
            with contextlib.suppress(ControlError):
                status = self.ask("status")
                if found(status):
                    return status
                assert time.monotonic() < end, f"{what}: not within {limit_s} s: {json.dumps(status)}"
            assert time.monotonic() < end, f"{what}: no answer within {limit_s} s: {self.log.read_text()}"
            select.select([], [], [], 0.02)

    def until_whole(self, limit_s: float = DEADLINE_S) -> dict[str, Any]:
        """Wait until every sensor speaks and the heading is ok."""
        return self.until(is_whole, "whole", limit_s)

    def end(self) -> int:
        """SIGTERM; the exit status."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(DEADLINE_S)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def replayed(self, *recordings: Path) -> bytes:
        """The heading CSV of its recording's replay."""
        output = self.folder / "replay.csv"
        pieces = [str(path) for path in recordings or (self.recording,)]
        subprocess.run(
            [sys.executable, "-m", "tinyekf_py.run", "--replay", *pieces, "--output", str(output)],
            check=True, capture_output=True, env=self.environment, timeout=120,
        )  # fmt: skip
        return output.read_bytes()
