"""A worker as its parent holds it: the process, the pipe of its messages and the pipe of commands to it."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import subprocess
import time

from acquisition.child_process import start_module
from acquisition.device import DeviceSettings
from acquisition.message import MAX_MESSAGE, Message, MessageParser


class WorkerProcess:
    """One started worker. Nothing here waits, but `ended_by`."""

    def __init__(self, settings: DeviceSettings, start_us: int, polling: bool) -> None:
        """Start the worker of a device; `start_us` on the monotonic clock. OSError when the system cannot."""
        self._parser = MessageParser()
        self._out_fd = self._control_fd = -1
        theirs: list[int] = []
        try:
            self._out_fd, out_fd = os.pipe()
            theirs.append(out_fd)
            control_fd, self._control_fd = os.pipe()
            theirs.append(control_fd)
            fcntl.fcntl(out_fd, fcntl.F_SETPIPE_SZ, MAX_MESSAGE)  # what waits for a slow reader is old: keep it little
            os.set_blocking(self._out_fd, False)
            os.set_blocking(self._control_fd, False)
            self._process = self._start(settings, start_us, polling, out_fd, control_fd)
        except OSError:
            self.release()
            raise
        finally:
            for fd in theirs:
                os.close(fd)
        self.pid = self._process.pid

    def fileno(self) -> int:
        """The end of the message pipe to select on."""
        return self._out_fd

    def receive(self) -> list[Message] | None:
        """The messages of one read; None when the worker is gone. MessageError when it sends nonsense."""
        try:
            chunk = os.read(self._out_fd, MAX_MESSAGE)
        except BlockingIOError:
            return []
        return self._parser.feed(chunk) if chunk else None

    def command(self, word: str) -> None:
        """Say one of start, stop, retry, reset, quit; a worker that is gone or hangs is found out elsewhere."""
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(self._control_fd, word.encode() + b"\n")

    def ask(self) -> None:
        """First step of ending it: let it close its port and go."""
        self.command("quit")

    def terminate(self) -> None:
        """Second step."""
        self._process.terminate()

    def kill(self) -> None:
        """Last step; it works on a stopped process too."""
        self._process.kill()

    def ended(self) -> bool:
        """Whether the process ended; then it is reaped."""
        return self._process.poll() is not None

    def ended_by(self, deadline: float) -> bool:
        """Wait for the end until `deadline` (monotonic seconds); whether it came."""
        try:
            self._process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        return True

    def release(self) -> None:
        """Close the pipes."""
        for fd in (self._out_fd, self._control_fd):
            if fd >= 0:
                os.close(fd)
        self._out_fd = self._control_fd = -1

    def _start(
        self, settings: DeviceSettings, start_us: int, polling: bool, out_fd: int, control_fd: int
    ) -> subprocess.Popen[bytes]:
        worker_settings = {
            "name": settings.name,
            "port": settings.port,
            "driver": settings.driver,
            "baud": settings.baud,
            "options": dict(settings.options),
            "polling": polling,
            "start_us": start_us,
            "parent_pid": os.getpid(),
        }
        arguments = [str(out_fd), str(control_fd), json.dumps(worker_settings)]
        return start_module("acquisition.worker", arguments, (out_fd, control_fd))
