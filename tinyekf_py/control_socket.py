"""The control socket: how a second terminal speaks to a running program.

A client connects, sends one line (``status``, ``start TASK``, ``stop TASK``), and gets one line of JSON back. The
server is a thread that only carries words: it hands each request to the fusion loop and waits for the answer, so that
a switch falls between two messages of the stream, and a client that stalls delays nobody but other clients.
"""

from __future__ import annotations

import contextlib
import grp
import json
import logging
import os
import queue
import socket
import stat
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

SERVICE_DIRECTORY = Path("/run/tinyekf")
SERVICE_GROUP = "tinyekf"
SOCKET_NAME = "ctl.sock"
MAX_REQUEST = 256  # bytes
CLIENT_PATIENCE_S = 2.0
ANSWER_PATIENCE_S = 5.0

_log = logging.getLogger(__name__)


class ControlError(RuntimeError):
    """No answer from a running program: one line saying why and what to do."""


class Request(NamedTuple):
    """A client's words, and where the answer goes."""

    words: tuple[str, ...]
    answer: queue.SimpleQueue[Mapping[str, object]]


def listening_path() -> Path:
    """Where a program started here listens: the service's directory, the user's, or one of his in /tmp."""
    service = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return Path(service) / SOCKET_NAME if service else _user_path()


def _user_path() -> Path:
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    return Path(runtime) / "tinyekf" / SOCKET_NAME if runtime else Path(f"/tmp/tinyekf-{os.getuid()}") / SOCKET_NAME


def calling_path() -> Path:
    """Where a client looks: the user's own program first, then the service."""
    own, service = _user_path(), SERVICE_DIRECTORY / SOCKET_NAME
    return service if service.exists() and not own.exists() else own


class ControlServer:
    """Serves the socket at `path` until left; a context manager. A socket that cannot be had is a warning, no more."""

    def __init__(self, path: Path, ask: Callable[[Request], None]) -> None:
        """`ask` is called in the server's thread with each request, and must not block."""
        self.path = path
        self._ask = ask
        self._socket: socket.socket | None = None
        self._inode = 0
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        try:
            self._socket = self._listen()
        except (OSError, ControlError) as error:
            _log.warning("no control socket at %s: %s", self.path, error)
            return self
        threading.Thread(target=self._serve, args=(self._socket,), name="control", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._socket is not None:
            self._socket.close()
            with contextlib.suppress(OSError):
                if self.path.stat().st_ino == self._inode:  # not one that a successor has made
                    self.path.unlink()

    def _listen(self) -> socket.socket:
        directory = self.path.parent
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = directory.lstat()
        if not stat.S_ISDIR(status.st_mode) or (status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX):
            raise ControlError("its directory is one that anybody may write")
        if self.path.exists():
            if _answers(self.path):
                raise ControlError("another tinyekf listens there")
            self.path.unlink()  # left behind by a program that was killed
        for_service = bool(os.environ.get("RUNTIME_DIRECTORY"))
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_CLOEXEC)
        try:
            before = os.umask(0o177)  # never open to others, not even for a moment
            try:
                listener.bind(str(self.path))
            finally:
                os.umask(before)
            if for_service:
                with contextlib.suppress(KeyError, PermissionError):  # without the group it stays with its owner
                    os.chown(self.path, -1, grp.getgrnam(SERVICE_GROUP).gr_gid)
                    self.path.chmod(0o660)
            self._inode = self.path.stat().st_ino
            listener.listen(8)
            listener.settimeout(0.5)
        except OSError:
            listener.close()
            raise
        return listener

    def _serve(self, listener: socket.socket) -> None:
        while not self._ended.is_set():
            try:
                client, _ = listener.accept()
            except TimeoutError:
                continue
            except OSError:  # closed: the program ends
                return
            with client, contextlib.suppress(OSError):  # a client that went away is its own affair
                client.settimeout(CLIENT_PATIENCE_S)
                client.sendall(json.dumps(self._reply(client)).encode() + b"\n")

    def _reply(self, client: socket.socket) -> Mapping[str, object]:
        words = _line(client).decode("ascii", "replace").split()
        if not words:
            return {"error": "say status, start TASK or stop TASK"}
        request = Request(tuple(words), queue.SimpleQueue())
        self._ask(request)
        try:
            return request.answer.get(timeout=ANSWER_PATIENCE_S)
        except queue.Empty:
            return {"error": "the program does not answer"}


def _line(peer: socket.socket, limit: int = MAX_REQUEST) -> bytes:
    line = b""
    while b"\n" not in line and len(line) < limit:
        chunk = peer.recv(min(65536, limit))
        if not chunk:
            break
        line += chunk
    return line.partition(b"\n")[0]


def _answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(CLIENT_PATIENCE_S)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            return False
        return True


def call(path: Path, *words: str) -> dict[str, Any]:
    """Send a request to the program at `path`, and give its answer; ControlError when there is none."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
        peer.settimeout(ANSWER_PATIENCE_S + 1.0)
        try:
            peer.connect(str(path))
            peer.sendall(" ".join(words).encode() + b"\n")
            answer: dict[str, Any] = json.loads(_line(peer, 1 << 20))
        except (FileNotFoundError, ConnectionRefusedError):
            raise ControlError(
                f"no tinyekf is running (nothing listens at {path}); start it with tinyekf run"
            ) from None
        except PermissionError:
            raise ControlError(f"{path} may not be used by you; join the group {SERVICE_GROUP}") from None
        except (OSError, ValueError) as error:
            raise ControlError(f"{path} gave no answer ({error})") from error
    return answer
