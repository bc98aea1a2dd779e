"""What systemd is told of a service of Type=notify: ready, still turning, stopping. Without systemd nothing happens.

The protocol is one datagram of KEY=VALUE lines to the socket that $NOTIFY_SOCKET names (sd_notify(3)); a library would
be longer than this.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping
from types import TracebackType
from typing import Self

STATUS_PERIOD_S = 10.0


class ServiceNotifier:
    """Speaks to systemd, never waits for it; a context manager that says READY and STOPPING."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        if self._address:
            kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
            self._socket = socket.socket(socket.AF_UNIX, kind)
        watched = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        limit_us = environment.get("WATCHDOG_USEC", "")
        #: How often the watchdog is fed, seconds: thrice in the time that it waits.
        self.period_s = int(limit_us) / 3e6 if watched and limit_us.isdigit() else STATUS_PERIOD_S
        self._due_at = 0.0

    def __enter__(self) -> Self:
        self._send("READY=1")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._send("STOPPING=1")
        if self._socket is not None:
            self._socket.close()

    def turned(self, now: float, status: str) -> None:
        """Called by the fusion loop each time around, at `now` seconds: that alone feeds the watchdog."""
        if self._socket is not None and now >= self._due_at:
            self._due_at = now + self.period_s
            self._send(f"WATCHDOG=1\nSTATUS={status}")

    def _send(self, text: str) -> None:
        if self._socket is not None:
            with contextlib.suppress(OSError):  # a service manager that does not listen is no fault of ours
                self._socket.sendto(text.encode(), self._address)
