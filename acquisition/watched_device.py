"""A device under supervision: its settings, its worker, what is known of it, and when what is due.

The supervisor decides; here stands what it remembers, and how a worker's messages become a `DeviceState`.
"""

from __future__ import annotations

import json
import logging
import time
from collections import Counter

from acquisition.device import DeviceSettings, DeviceState
from acquisition.message import CLOSED, COUNTS, ERROR, LOG, OPEN, PORT, Message
from acquisition.worker_process import WorkerProcess

BACKOFF_S = 0.5
BACKOFF_LIMIT_S = 10.0
GOOD_S = 60.0  #: a worker that lived this long starts again without back-off
NEVER = float("inf")

_log = logging.getLogger(__name__)


class WatchedDevice:
    """What the supervisor keeps about one device. Times in monotonic seconds."""

    def __init__(self, settings: DeviceSettings) -> None:
        self.settings = settings
        self.name = settings.name
        self.state = DeviceState(settings.name, settings.enabled)
        self.process: WorkerProcess | None = None
        self.greeted = False  # some worker of this device said hello
        self.here = False  # this one did
        self.started_at = 0.0
        self.heard_at = 0.0
        self.restart_at = NEVER
        self.backoff_s = BACKOFF_S
        self._past: Counter[str] = Counter()  # counts of workers that ended
        self._current: Counter[str] = Counter()  # of this one
        self._counted_us = 0

    def plan_restart(self) -> float:
        """Set the time of the next start; seconds until then."""
        now = time.monotonic()
        if now - self.started_at >= GOOD_S:
            self.backoff_s = BACKOFF_S
        wait = self.backoff_s
        self.backoff_s = min(2 * wait, BACKOFF_LIMIT_S)
        self.restart_at = now + wait
        return wait

    def greet(self) -> None:
        """A decoder begins: of a new worker, or anew in the same one."""
        self.greeted = self.here = True

    def lose(self) -> None:
        """The worker is gone: keep its counts, forget what it said of the port."""
        self._past += self._current
        self._current = Counter()
        self.state.pid = 0
        self.state.measured_hz = float("nan")
        self.state.port_state = CLOSED
        self.state.port_text = "its worker is being restarted"

    def note(self, message: Message) -> None:
        """Keep what a message says about the device, and log what people should know."""
        state = self.state
        if message.kind == COUNTS:
            self._count(message)
        elif message.kind == PORT:
            state.port_state, _, state.port_text = message.text.partition(" ")
            state.measured_hz = float("nan")
            level = logging.INFO if state.port_state in (OPEN, CLOSED) else logging.WARNING
            _log.log(level, "%s: %s: %s", self.name, state.port_state, state.port_text)
        elif message.kind == ERROR:
            state.last_error = message.text.strip().rpartition("\n")[2]
            _log.error("%s: its worker failed:\n%s", self.name, message.text)
        elif message.kind == LOG:
            state.last_error = message.text.partition("; last: ")[2] or state.last_error
            _log.warning("%s: %s", self.name, message.text)

    def _count(self, message: Message) -> None:
        """Take over the worker's counters, and the rate of samples since the last ones."""
        current: Counter[str] = Counter(json.loads(message.line))
        seconds = (message.t_us - self._counted_us) / 1e6
        if self._current and seconds > 0:
            self.state.measured_hz = (current["samples"] - self._current["samples"]) / seconds
        self._counted_us = message.t_us
        self._current = current
        self.state.counts = self._past + current
