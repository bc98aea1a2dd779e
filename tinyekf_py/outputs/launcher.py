"""The output process as the live program holds it: started, fed, listened to, and started again when it dies."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import queue
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Self

from acquisition.child_process import start_module
from tinyekf_py import control_socket
from tinyekf_py.outputs.frame import MAX_PACKET, Answer, Frame, LogLine, Request, decode, encode
from tinyekf_py.view_state import ViewState

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 10.0
ANSWER_PATIENCE_S = 5.0
END_PATIENCE_S = 1.0
_SEND_BUFFER = 1 << 17  # bytes: some frames and an answer

_log = logging.getLogger(__name__)


class OutputProcess:
    """Runs the output process until left; a context manager. `offer` is all that the fusion's thread ever calls."""

    def __init__(self, outputs: Mapping[str, Mapping[str, Any]], ask: Callable[[control_socket.Request], None]) -> None:
        """`outputs` are the settings of each output that is on; `ask` is called in a thread of this object with the
        clients' requests, and must not block."""
        self._outputs = outputs
        self._ask = ask
        self._link: socket.socket | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="outputs", daemon=True)
        self.pid = 0  #: of the process; 0 when there is none
        self.restarts = 0  #: since the start
        self.lost = 0  #: frames that it did not take in time

    def offer(self, state: ViewState) -> None:
        """Give `state` to the outputs. Never waits, never fails: what the process does not take is lost."""
        link = self._link
        if link is None:
            return
        try:
            link.send(encode(Frame(time.monotonic(), state)), socket.MSG_DONTWAIT)
        except OSError:  # it is slow (full), or gone, which the thread finds out by itself
            self.lost += 1

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ended.set()
        with contextlib.suppress(OSError):
            if self._link is not None:
                self._link.shutdown(socket.SHUT_RDWR)
        self._thread.join(3.0 * END_PATIENCE_S)

    def _run(self) -> None:
        pause_s = FIRST_PAUSE_S
        while not self._ended.is_set():
            began_s = time.monotonic()
            try:
                process, link = self._start()
            except OSError as error:
                _log.error("the output process cannot be started: %s", error)
            else:
                with link:
                    self._link, self.pid = link, process.pid
                    self._listen(link)
                    self._link, self.pid = None, 0
                _end(process)
                if not self._ended.is_set():
                    _log.error("the output process ended with status %d; it is started again", process.returncode)
            if time.monotonic() - began_s > 60.0:
                pause_s = FIRST_PAUSE_S
            if not self._ended.wait(pause_s):
                self.restarts += 1
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)

    def _start(self) -> tuple[subprocess.Popen[bytes], socket.socket]:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            try:
                ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
                settings = json.dumps({"outputs": self._outputs, "parent_pid": os.getpid()})
                process = start_module(
                    "tinyekf_py.outputs.process", (str(theirs.fileno()), settings), (theirs.fileno(),)
                )
            except OSError:
                ours.close()
                raise
        return process, ours

    def _listen(self, link: socket.socket) -> None:
        """Carry requests and log lines until the process or the program ends."""
        while not self._ended.is_set():
            try:
                datagram = link.recv(MAX_PACKET)
            except OSError:
                return
            if not datagram:
                return
            packet = decode(datagram)
            if isinstance(packet, LogLine):
                _log.log(packet.level, "%s", packet.text)
            elif isinstance(packet, Request):
                request = control_socket.Request(packet.words, queue.SimpleQueue())
                self._ask(request)
                try:
                    answer = request.answer.get(timeout=ANSWER_PATIENCE_S)
                except queue.Empty:
                    continue  # it has stopped waiting as well
                with contextlib.suppress(OSError):
                    link.send(encode(Answer(packet.number, answer)))


def _end(process: subprocess.Popen[bytes]) -> None:
    """Wait a moment for the end that the closed link brings, then see to it."""
    try:
        process.wait(END_PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
