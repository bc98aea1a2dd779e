"""The output process with the web alone, fed with a made-up boat, and raw HTTP to attack it with."""

from __future__ import annotations

import json
import os
import re
import select
import socket
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from tinyekf_py.control_socket import Request
from tinyekf_py.estimate import Estimate
from tinyekf_py.outputs.launcher import OutputProcess
from tinyekf_py.view_state import Navigation, SensorRow, TaskRow, ViewState

NAN = float("nan")
DEADLINE_S = 20.0
TASKS = ("gps1", "gps2", "compass", "imu", "cnw-s1")


def free_port() -> int:
    """A TCP port that nobody has now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def boat(elapsed_s: float, running: Mapping[str, bool], heading_deg: float = 123.4) -> ViewState:
    """A boat on a straight course; what its devices say is hostile."""
    mode = "invalid" if heading_deg != heading_deg else "ok"
    estimate = Estimate(
        round(elapsed_s * 1e6), heading_deg, 1.0, -0.5, 35.9 + elapsed_s * 1e-5, 126.5, mode, "gps", (3.0, 2.0),
    )  # fmt: skip
    hostile = "<img src=x onerror=\"document.title='owned'\">"
    sensors = (
        SensorRow(
            "gps1", "open", 10.0, 0.05, 2, 0.9, 3.0, heading_deg=122.0, heading_sigma_deg=4.0, lines=9, samples=3
        ),
        SensorRow("gps2", "missing", errors=3, last_error=hostile, port_text=hostile, dropped=(('a"\\\n', 3),)),
        SensorRow("compass", "open", 10.0, 0.05, heading_deg=125.0, heading_sigma_deg=3.0),
        SensorRow("imu", "open", 100.0, 0.01),
    )
    tasks = tuple(TaskRow(str(i), name, running[name]) for i, name in enumerate(TASKS, 1))
    navigation = Navigation(1.8e9, 4.0, 122.0)
    return ViewState(
        estimate, 0.0, sensors, elapsed_s, "adaptive", notices=(hostile,), tasks=tasks, navigation=navigation
    )


class Reply(NamedTuple):
    """An HTTP answer."""

    status: int
    headers: Mapping[str, str]  #: names in lower case
    body: bytes

    def json(self) -> Any:
        """The body; what JSON proper does not have is an error."""

        def refuse(word: str) -> None:
            raise AssertionError(f"{word} is not JSON")

        return json.loads(self.body, parse_constant=refuse)


class WebProcess:
    """Runs until closed; frames at 10 Hz, unless told to be silent."""

    def __init__(self, **settings: Any) -> None:
        self.port = free_port()
        self.host = settings.get("host", "127.0.0.1")
        self.address = "127.0.0.1" if self.host == "0.0.0.0" else self.host  #: where its client finds it
        defaults = {"rate_hz": 10.0, "names": [], "read_token": False, "token_file": "", "allow_simulated": False}
        self.running = dict.fromkeys(TASKS, True)
        self.heading_deg = 123.4
        self.simulated = False
        self.silent = threading.Event()
        self._ended = threading.Event()
        self.process = OutputProcess(
            {"web": {"host": self.host, "port": self.port, **defaults, **settings}}, self._answer
        )
        self.process.__enter__()
        self._thread = threading.Thread(target=self._sail, daemon=True)
        self._thread.start()
        self.until_heard()

    def _sail(self) -> None:
        began = time.monotonic()
        while not self._ended.wait(0.1):
            if not self.silent.is_set():
                state = boat(time.monotonic() - began, self.running, self.heading_deg)
                self.process.offer(state._replace(simulated=self.simulated))

    def _answer(self, request: Request) -> None:
        verb, name = request.words
        if name not in (*TASKS, "all"):
            request.answer.put({"error": f"no task {name!r}"})
            return
        for task in TASKS if name == "all" else (name,):
            self.running[task] = verb == "start"
        request.answer.put({"tasks": dict(self.running)})

    def until_heard(self) -> None:
        """Wait until it answers."""
        end = time.monotonic() + DEADLINE_S
        while True:
            try:
                if self.get("/api/access").status:
                    return
            except OSError:
                assert time.monotonic() < end, "the web does not answer"
                select.select([], [], [], 0.05)

    def sail_quickly(self, began_s: float, length_s: float, step_s: float = 0.5) -> None:
        """Let so much of the boat's time pass in some seconds; silent before and after."""
        self.silent.set()
        for step in range(1, round(length_s / step_s) + 1):
            self.process.offer(boat(began_s + step * step_s, self.running))
            while self.get("/api/state").json()["elapsed_s"] < began_s + step * step_s:  # so that none is lost
                pass

    def connect(self) -> socket.socket:
        """A connection of the test's own."""
        return socket.create_connection((self.address, self.port), DEADLINE_S)

    def send(self, request: bytes) -> bytes:
        """All that comes back for `request`, until the server hangs up; empty when it does so at once."""
        with self.connect() as connection:
            try:
                connection.sendall(request)
                answer = b""
                while chunk := connection.recv(65536):
                    answer += chunk
            except (ConnectionResetError, BrokenPipeError):
                pass
            return answer

    def request(self, method: str, path: str, body: bytes = b"", **headers: str) -> Reply:
        """An ordinary request; `headers` by name with _ for -, of which Host has a default."""
        given = {"Host": f"{self.address}:{self.port}", **{name.replace("_", "-"): v for name, v in headers.items()}}
        if body:
            given["Content-Length"] = str(len(body))
        lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in given.items() if value), "", ""]
        return parsed(self.send("\r\n".join(lines).encode() + body))

    def get(self, path: str, **headers: str) -> Reply:
        """GET."""
        return self.request("GET", path, **headers)

    def post(self, path: str, body: bytes = b"", **headers: str) -> Reply:
        """POST."""
        return self.request("POST", path, body, **headers)

    def upgrade(self, path: str = "/api/stream", **headers: str) -> tuple[socket.socket, int]:
        """A WebSocket handshake: the connection, and the status of the answer."""
        given = {
            "Host": f"{self.address}:{self.port}", "Connection": "Upgrade", "Upgrade": "websocket",
            "Sec-WebSocket-Version": "13", "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
            **{name.replace("_", "-"): value for name, value in headers.items()},
        }  # fmt: skip
        connection = self.connect()
        lines = [f"GET {path} HTTP/1.1", *(f"{name}: {value}" for name, value in given.items()), "", ""]
        connection.sendall("\r\n".join(lines).encode())
        head = b""
        while not head.endswith(b"\r\n\r\n") and (byte := connection.recv(1)):
            head += byte
        return connection, int(head.split()[1])

    def rss_kb(self) -> int:
        """Memory of the process, kB."""
        found = re.search(r"^VmRSS:\s+(\d+)", Path(f"/proc/{self.process.pid}/status").read_text(), re.MULTILINE)
        assert found
        return int(found[1])

    def close(self) -> None:
        """End it."""
        self._ended.set()
        self._thread.join()
        self.process.__exit__(None, None, None)


def parsed(answer: bytes) -> Reply:
    """The reply in `answer`; status 0 for none."""
    head, _, body = answer.partition(b"\r\n\r\n")
    first, *rest = head.decode("latin-1").split("\r\n")
    headers = {name.lower(): value for name, _, value in (line.partition(": ") for line in rest)}
    return Reply(int(first.split()[1]) if first else 0, headers, body)


def read_frame(connection: socket.socket) -> tuple[int, bytes]:
    """One frame of a WebSocket's server: its opcode and payload."""

    def exactly(n: int) -> bytes:
        read = b""
        while len(read) < n:
            chunk = connection.recv(n - len(read))
            if not chunk:
                raise ConnectionResetError("the server hung up")
            read += chunk
        return read

    first, size = exactly(2)
    if size == 126:
        size = int.from_bytes(exactly(2), "big")
    elif size == 127:
        size = int.from_bytes(exactly(8), "big")
    return first & 0x0F, exactly(size)


def client_frame(opcode: int, payload: bytes) -> bytes:
    """A whole, masked frame of a WebSocket's client."""
    mask = os.urandom(4)
    size = len(payload)
    length = bytes((0x80 | size,)) if size < 126 else b"\xfe" + size.to_bytes(2, "big")
    return bytes((0x80 | opcode,)) + length + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload))
