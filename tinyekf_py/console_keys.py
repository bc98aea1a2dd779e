"""Keys pressed at the console, a thread that waits for them; the terminal is given back as it was."""

from __future__ import annotations

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Self

_TerminalSettings = list[int | list[bytes | int]]


class ConsoleKeys:
    """Calls `pressed` with each key, in a thread of its own, while the program is the terminal's foreground."""

    def __init__(self, pressed: Callable[[str], None] | None) -> None:
        """Without `pressed` the terminal is left alone."""
        self._pressed = pressed
        self._fd = sys.stdin.fileno() if pressed is not None and sys.stdin is not None and sys.stdin.isatty() else -1
        self._before: _TerminalSettings | None = None
        self._thread: threading.Thread | None = None
        self._wake: tuple[int, int] | None = None

    def __enter__(self) -> Self:
        # A program in the background that touched the terminal would be stopped by it.
        if self._fd >= 0 and _in_foreground(self._fd):
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd)
            self._wake = os.pipe()
            self._thread = threading.Thread(target=self._read, args=(self._wake[0],), name="keys", daemon=True)
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._thread is not None and self._wake is not None and self._before is not None:
            os.write(self._wake[1], b".")
            self._thread.join(1.0)
            for fd in self._wake:
                os.close(fd)
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)
            self._thread = None

    def _read(self, wake_fd: int) -> None:
        while True:
            ready, _, _ = select.select([self._fd, wake_fd], [], [])
            if wake_fd in ready:
                return
            try:
                keys = os.read(self._fd, 64)
            except OSError:  # the terminal is gone
                return
            if not keys:
                return
            for key in keys.decode("ascii", "ignore"):
                if self._pressed is not None:
                    self._pressed(key)


def _in_foreground(fd: int) -> bool:
    try:
        return os.tcgetpgrp(fd) == os.getpgrp()
    except OSError:  # not this session's terminal: its keys belong to somebody else
        return False
