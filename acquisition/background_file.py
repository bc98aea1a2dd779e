"""A file written behind the caller's back: what the fusion process puts here never makes it wait.

An SD card may stall for half a second while fusion has a sample every few milliseconds. `put` therefore only appends
to a list; a thread of this file takes what has gathered, renders it to bytes, writes and syncs it at least every
second, so that a power cut costs no more than that. The order of `put` is the order in the file.

Nothing of this ever raises into fusion: when writing fails (disk full, card gone), one line is logged, `failure`
says why, and what comes later is counted in `lost`, until the disk has room again: then writing goes on behind the
last whole entry, and a second line says so. Only `close` raises, when that did not happen before the end. A file may
be cut into pieces by size or age, the oldest removed; while a further piece cannot be begun, writing goes on in the one
that there is.
"""

from __future__ import annotations

import logging
import os
import re
import stat
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

Entry = TypeVar("Entry")

WRITE_PERIOD_S = 0.5
#: Entries that may wait for a stalled disk: over ten minutes of five sensors, some 50 MB.
MAX_WAITING = 200_000
CLOSE_TIMEOUT_S = 10.0
#: A disk that was full is written again when it has this much room: a minute of five sensors.
RESUME_BYTES = 1 << 20
RETRY_S = 1.0  # doubled up to the limit while writing fails again and again
RETRY_LIMIT_S = 60.0
ROTATION_RETRY_S = 60.0  # after a further piece could not be begun

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Rotation:
    """When a file is continued in another one, and how many are kept; 0 is never, and all."""

    max_bytes: int = 0
    max_s: float = 0.0
    keep: int = 0


ONE_PIECE = Rotation()


class UnfinishedFileError(OSError):
    """A file that lacks its end: one line saying which, how much is missing and why."""


class BackgroundFile(Generic[Entry]):
    """`path`, created anew with `header`, to which `render(entries)` is appended by a thread.

    The constructor raises OSError when the file cannot be created, `close` when it lacks its end; nothing else raises.
    """

    def __init__(
        self,
        path: str | Path,
        header: bytes,
        render: Callable[[list[Entry]], bytes],
        *,
        rotation: Rotation = ONE_PIECE,
        continued: Callable[[], bytes] | None = None,
        gap: Callable[[int, str], bytes] | None = None,
    ) -> None:
        """`continued()` heads a further piece, by default as `header` does; `gap(lost, why)` is written after a gap."""
        self.path = Path(path)
        #: Why writing has ended, one line; empty while all is well.
        self.failure = ""
        self._refused = 0  # entries that were lost at once, counted by the caller of `put`
        self._unwritten = 0  # lost later, counted by the thread
        self._render = render
        self._rotation = rotation
        self._continued = continued or (lambda: header)
        self._gap = gap
        self._pieces = [self.path]
        self._piece_number = 0
        self._size = 0  # of the piece, whole entries
        self._begun_at = time.monotonic()
        self._rotate_at = 0.0  # not before
        self._lost_before_gap = 0
        self._retry_at = 0.0
        self._retry_s = RETRY_S
        self._waiting: list[Entry] = []
        self._written = threading.Condition()
        self._wake = threading.Event()
        self._closing = False
        self._put_count = 0
        self._done_count = 0
        self._fd = _create(self.path)
        self._on_disk = stat.S_ISREG(os.fstat(self._fd).st_mode)  # a pipe or /dev/null cannot be synced
        if rotation.max_bytes or rotation.max_s:
            for old in pieces_of(self.path):  # of an earlier run: the file that they continue is replaced
                old.unlink(missing_ok=True)
        try:
            self._append(header)
        except OSError:
            os.close(self._fd)
            raise
        self._thread = threading.Thread(target=self._run, name=f"writer of {self.path.name}", daemon=True)
        self._thread.start()

    @property
    def lost(self) -> int:
        """Entries that were put and will not be in the file."""
        return self._refused + self._unwritten

    def put(self, entry: Entry) -> None:
        """Append `entry`; for one calling thread. Costs a list append."""
        if self.failure or self._closing:
            self._refused += 1
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
        """Write what is left and close the file; harmless when repeated. UnfinishedFileError when it lacks its end."""
        if self._closing:
            return
        self._closing = True
        self._wake.set()
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            self._fail(f"the disk did not take the last entries within {timeout_s:g} s")
        if self.failure:
            missing = self.lost + self._put_count - self._done_count
            raise UnfinishedFileError(f"{self.path}: {missing} lines are missing, to the end: {self.failure}")

    def _run(self) -> None:
        while True:
            self._wake.wait(WRITE_PERIOD_S)
            self._wake.clear()
            closing = self._closing  # read before the entries are taken: whatever was put before close() is seen below
            entries = self._waiting[:]
            del self._waiting[: len(entries)]  # not a new list: `put` may have hold of this one
            if self.failure:
                self._unwritten += len(entries)
                if not closing:  # when the end is lost, writing does not go on
                    self._try_again()
            elif entries:
                self._write_entries(entries)
            with self._written:
                self._done_count += len(entries)
                self._written.notify_all()
            if closing:
                os.close(self._fd)
                return

    def _write_entries(self, entries: list[Entry]) -> None:
        try:
            self._append(self._render(entries))
            if self._on_disk:
                os.fdatasync(self._fd)
        except OSError as error:
            self._unwritten += len(entries)
            self._fail(error.strerror or str(error))
            return
        self._retry_s = RETRY_S
        if self._on_disk and self._rotation_is_due():
            self._rotate()

    def _append(self, text: bytes) -> None:
        """Write all of it, or leave the file as it was."""
        view = memoryview(text)
        try:
            while view:
                view = view[os.write(self._fd, view) :]
        except OSError:
            if self._on_disk:
                os.ftruncate(self._fd, self._size)
                os.lseek(self._fd, self._size, os.SEEK_SET)
            raise
        self._size += len(text)

    def _rotation_is_due(self) -> bool:
        limits, now = self._rotation, time.monotonic()
        too_old = 0 < limits.max_s <= now - self._begun_at
        return now >= self._rotate_at and (too_old or 0 < limits.max_bytes <= self._size)

    def _rotate(self) -> None:
        """Go on in another piece; where that cannot be begun, in this one."""
        number = self._piece_number + 1
        path = self.path.with_name(f"{self.path.stem}.{number:04d}{self.path.suffix}")
        before, size = self._fd, self._size
        try:
            self._fd = _create(path)
            self._size = 0
            self._append(self._continued())
        except OSError as error:
            if self._fd != before:
                os.close(self._fd)
                self._remove(path)
            self._fd, self._size = before, size
            self._rotate_at = time.monotonic() + ROTATION_RETRY_S
            _log.error("%s cannot be begun (%s): writing goes on in %s", path, error.strerror, self._pieces[-1])
            return
        os.close(before)
        self._begun_at = time.monotonic()
        self._piece_number = number
        self._pieces.append(path)
        while self._rotation.keep and len(self._pieces) > self._rotation.keep:
            self._remove(self._pieces.pop(0))

    def _remove(self, piece: Path) -> None:
        try:
            piece.unlink(missing_ok=True)
        except OSError as error:
            _log.error("%s cannot be removed: %s", piece, error.strerror)

    def _try_again(self) -> None:
        """After a failure: go on when the disk has room."""
        now = time.monotonic()
        if not self._on_disk or now < self._retry_at:
            return
        self._retry_at = now + RETRY_S
        try:
            room = os.fstatvfs(self._fd)
            if room.f_bavail * room.f_frsize < RESUME_BYTES:
                return
            lost = self.lost - self._lost_before_gap
            if self._gap is not None:
                self._append(self._gap(lost, self.failure))
        except OSError:
            self._retry_later()
            return
        _log.warning("%s: writing goes on; %d entries were lost", self.path, lost)
        self._lost_before_gap = self.lost
        self._retry_later()
        self.failure = ""

    def _retry_later(self) -> None:
        self._retry_at = time.monotonic() + self._retry_s
        self._retry_s = min(2 * self._retry_s, RETRY_LIMIT_S)

    def _fail(self, reason: str) -> None:
        if not self.failure:
            self.failure = reason
            _log.error("%s: writing has stopped: %s", self.path, reason)


def _create(path: Path) -> int:
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)


def pieces_of(path: Path) -> list[Path]:
    """The further pieces of the file `path`, as they are named; none where there is no such folder."""
    if not path.parent.is_dir():
        return []
    name = re.compile(re.escape(path.stem) + r"\.\d{4,}" + re.escape(path.suffix))
    return [other for other in path.parent.iterdir() if name.fullmatch(other.name)]
