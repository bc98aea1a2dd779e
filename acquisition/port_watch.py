"""The port watch: keeps one device's port open through everything a boat does to a cable.

Opens the port, opens it again when it vanished or has been silent too long, and reports each change of state once.
It owns no clock and no loop: the worker calls `tick` when `due_us` has come, and `read` when there is something.
All times are microseconds on the worker's clock.
"""

from __future__ import annotations

import errno
from collections.abc import Callable

from acquisition.message import ABSENT, CLOSED, LOST, OPEN, SILENT
from acquisition.port import Port, open_port
from acquisition.port_error import PortError

SECOND_US = 1_000_000
NEVER_US = 1 << 62

RETRY_US = SECOND_US  # a missing device path is looked for this often: a look costs one system call
RETRY_LIMIT_US = 4 * SECOND_US  # of the back-off where a try disturbs somebody: a network peer, a user without rights
MIN_SILENCE_US = SECOND_US  # stale is silent for longer than max(3 periods, 1 s)
PERIODS = 3
LEARN_LIMIT_US = 4 * SECOND_US  # a longer gap is an outage, not a habit
REOPEN_US = 5 * SECOND_US
REOPEN_LIMIT_US = 60 * SECOND_US


class PortWatch:
    """One device's port, open or waited for."""

    def __init__(self, name: str, baud: int, period_us: int, report: Callable[[int, str, str], None]) -> None:
        """`period_us` between two bursts of the device, 0 to learn it; `report(now_us, state, text)` at each change."""
        self._name = name
        self._baud = baud
        self._report = report
        self._port: Port | None = None
        self._running = False
        self._open_at_us = NEVER_US
        self._retry_us = RETRY_US
        self._reopen_us = REOPEN_US
        self._heard_us = 0
        self._fixed_period = period_us > 0
        self._period_us = period_us
        self._state_since_us = 0
        self._down_us = 0
        self.state = CLOSED
        self.opens = 0  #: how often the port was opened

    @property
    def fd(self) -> int:
        """The file descriptor to poll, -1 while there is none."""
        return -1 if self._port is None else self._port.fileno()

    @property
    def due_us(self) -> int:
        """When `tick` is to be called, if nothing else happens first."""
        if not self._running:
            return NEVER_US
        if self._port is None:
            return self._open_at_us
        reopen_at_us = self._heard_us + self._reopen_us
        return reopen_at_us if self.state == SILENT else min(reopen_at_us, self._heard_us + self._silence_us)

    def down_us(self, now_us: int) -> int:
        """How long in all the device was wanted and did not speak."""
        return self._down_us + (now_us - self._state_since_us if self.state not in (OPEN, CLOSED) else 0)

    def start(self, now_us: int) -> None:
        """Open the port now, or as soon as it can be."""
        if not self._running:
            self._running = True
            self.retry(now_us)

    def stop(self, now_us: int) -> None:
        """Close the port and leave it closed."""
        self._running = False
        self._close()
        self._change(now_us, CLOSED, "polling is stopped")

    def retry(self, now_us: int) -> None:
        """Look for the device at once: somebody saw it being plugged in."""
        self._open_at_us = now_us
        self._retry_us = RETRY_US

    def tick(self, now_us: int) -> None:
        """Do what is due: open, find silent, open again."""
        port = self._port
        if not self._running:
            return
        if port is None:
            if now_us >= self._open_at_us:
                self._open(now_us)
        elif not port.connected:
            self._heard_us = now_us
        elif self.state not in (OPEN, SILENT):
            self._change(now_us, OPEN, self._name)
        else:
            self._judge_silence(now_us)

    def read(self, now_us: int, size: int) -> bytes:
        """What the port has, at most `size` bytes; b"" when that is nothing or when the port went."""
        if self._port is None:
            return b""
        try:
            chunk = self._port.read(size)
        except PortError as error:
            self._fail(now_us, error)
            return b""
        if chunk:
            gap_us = now_us - self._heard_us
            self._heard_us = now_us
            if gap_us <= LEARN_LIMIT_US and not self._fixed_period:
                # The longest recent gap: a GPS sends its sentences of one second in a burst.
                self._period_us = max(gap_us, self._period_us - self._period_us // 64)
            if self.state != OPEN:
                self._change(now_us, OPEN, self._name)
                self._reopen_us = REOPEN_US
        return chunk

    @property
    def _silence_us(self) -> int:
        return max(PERIODS * self._period_us, MIN_SILENCE_US)

    def _judge_silence(self, now_us: int) -> None:
        silence_us = now_us - self._heard_us
        if self.state == OPEN and silence_us >= self._silence_us:
            self._change(now_us, SILENT, f"{self._name} is open but silent for {silence_us / SECOND_US:.1f} s")
        if silence_us >= self._reopen_us:
            self._reopen_us = min(2 * self._reopen_us, REOPEN_LIMIT_US)
            self._close()
            self._open(now_us)

    def _open(self, now_us: int) -> None:
        try:
            self._port = open_port(self._name, self._baud)
        except PortError as error:
            self._fail(now_us, error)
            return
        self.opens += 1
        self._heard_us = now_us
        if self._port.connected and self.state != SILENT:  # a silent device stays so until it speaks
            self._change(now_us, OPEN, self._name)

    def _fail(self, now_us: int, error: PortError) -> None:
        self._close()
        if error.errno == errno.ECONNREFUSED or error.state not in (ABSENT, LOST):
            self._open_at_us = now_us + self._retry_us
            self._retry_us = min(2 * self._retry_us, RETRY_LIMIT_US)
        else:
            self._open_at_us = now_us + RETRY_US
        self._change(now_us, error.state, error.strerror or str(error))

    def _close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _change(self, now_us: int, state: str, text: str) -> None:
        if state == self.state:
            return
        self._down_us = self.down_us(now_us)
        self._state_since_us = now_us
        self.state = state
        if state == OPEN:
            self._retry_us = RETRY_US
        self._report(now_us, state, text)
