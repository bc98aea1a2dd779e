"""A file written behind the caller's back: what the fusion process puts here never makes it wait.

An SD card may stall for half a second while fusion has a sample every few milliseconds. `put` therefore only appends
to a list; a thread of this file takes what has gathered, renders it to bytes, writes and syncs it at least every
second, so that a power cut costs no more than that. The order of `put` is the order in the file.

Nothing of this ever raises into fusion: when writing fails (disk full, card gone), one line is logged, `failure`
says why, and what comes later is counted in `lost`.
"""

from __future__ import annotations

import logging
import os
import stat
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

Entry = TypeVar("Entry")

WRITE_PERIOD_S = 0.5
#: Entries that may wait for a stalled disk: over ten minutes of five sensors, some 50 MB.
MAX_WAITING = 200_000
CLOSE_TIMEOUT_S = 10.0

_log = logging.getLogger(__name__)


class BackgroundFile(Generic[Entry]):
    """`path`, created anew with `header`, to which `render(entries)` is appended by a thread.

    The constructor raises OSError when the file cannot be created; nothing after it raises.
    """

    def __init__(self, path: str | Path, header: bytes, render: Callable[[list[Entry]], bytes]) -> None:
        self.path = Path(path)
        #: Why writing has ended, one line; empty while all is well.
        self.failure = ""
        #: Entries that were put and will not be in the file.
        self.lost = 0
        self._render = render
        self._waiting: list[Entry] = []
        self._written = threading.Condition()
        self._wake = threading.Event()
        self._closing = False
        self._put_count = 0
        self._done_count = 0
        self._fd = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
        self._on_disk = stat.S_ISREG(os.fstat(self._fd).st_mode)  # a pipe or /dev/null cannot be synced
        try:
            self._write_all(header)
        except OSError:
            os.close(self._fd)
            raise
        self._thread = threading.Thread(target=self._run, name=f"writer of {self.path.name}", daemon=True)
        self._thread.start()

    def put(self, entry: Entry) -> None:
        """Append `entry`; for one calling thread. Costs a list append."""
        if self.failure or self._closing:
            self.lost += 1
            return
        self._waiting.append(entry)
        self._put_count += 1
        if len(self._waiting) > MAX_WAITING:
            self._fail(f"the disk has not taken anything while {MAX_WAITING} entries were waiting")

    def flush(self, timeout_s: float = CLOSE_TIMEOUT_S) -> None:
        """Wait until everything put so far is in the file, or writing has failed."""
        goal = self._put_count
        self._wake.set()
        with self._written:
            self._written.wait_for(lambda: self._done_count >= goal or bool(self.failure), timeout_s)

    def close(self, timeout_s: float = CLOSE_TIMEOUT_S) -> None:
        """Write what is left and close the file; harmless when repeated."""
        if self._closing:
            return
        self._closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._fail(f"the disk did not take the last entries within {timeout_s:g} s")

    def _run(self) -> None:
        while True:
            self._wake.wait(WRITE_PERIOD_S)
            self._wake.clear()
            closing = self._closing  # read before the entries are taken: whatever was put before close() is seen below
            entries = self._waiting[:]
            del self._waiting[: len(entries)]  # not a new list: `put` may have hold of this one
            if self.failure:
                self.lost += len(entries)
            elif entries:
                self._write_entries(entries)
            with self._written:
                self._done_count += len(entries)
                self._written.notify_all()
            if closing:
                os.close(self._fd)
                return

    def _write_entries(self, entries: list[Entry]) -> None:
        # The place where a later version may wait for room and resume: what failed here is still in `entries`.
        try:
            self._write_all(self._render(entries))
            if self._on_disk:
                os.fdatasync(self._fd)
        except OSError as error:
            self.lost += len(entries)
            self._fail(error.strerror or str(error))

    def _write_all(self, text: bytes) -> None:
        view = memoryview(text)
        while view:
            view = view[os.write(self._fd, view) :]

    def _fail(self, reason: str) -> None:
        if not self.failure:
            self.failure = reason
            _log.error("%s: writing has stopped: %s", self.path, reason)
