"""The program's log on standard error, written behind its back: a reader that stalls must not stall fusion.

Workers' messages come here by way of their pipes and the supervisor. A message that repeats is held back after a few
times a minute, and how often is told. Under systemd each line carries its priority and leaves the time to the journal.
"""

from __future__ import annotations

import logging
import os
import queue
import sys
import threading
import time
from typing import TextIO

MAX_WAITING = 1000  # lines
BURST = 10  # times that one kind of message is logged
BURST_S = 60.0  # in this time
CLOSE_TIMEOUT_S = 1.0
_PRIORITIES = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}


class RepeatFilter(logging.Filter):
    """Lets one kind of message (one place of the code, one subject) pass `BURST` times in `BURST_S` seconds."""

    def __init__(self) -> None:
        super().__init__()
        self._seen: dict[tuple[object, ...], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether `record` is logged; the first one after a pause tells how many were not."""
        subject = record.args[0] if isinstance(record.args, tuple) and record.args else None
        kind = (record.pathname, record.lineno, record.levelno, str(subject)[:80])
        now = time.monotonic()
        began, count = self._seen.get(kind, (now, 0))
        if now - began >= BURST_S:
            if count > BURST:
                record.msg, record.args = f"{record.getMessage()} (and {count - BURST} like it before)", ()
            began, count = now, 0
        if len(self._seen) > MAX_WAITING:
            self._seen.clear()
        self._seen[kind] = (began, count + 1)
        return count < BURST


class JournalFormatter(logging.Formatter):
    """A line as the journal takes it: its priority first, and the same before each further line of a traceback."""

    def format(self, record: logging.LogRecord) -> str:
        prefix = f"<{_PRIORITIES.get(record.levelno, 6)}>"
        return "\n".join(prefix + line for line in super().format(record).splitlines())


class BackgroundLog(logging.Handler):
    """Writes to `stream` in a thread; lines that it cannot take in time are dropped and counted."""

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(MAX_WAITING)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        self._thread.start()
        self.addFilter(RepeatFilter())
        if _is_journal(stream):
            self.setFormatter(JournalFormatter())
        else:
            self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S"))

    def emit(self, record: logging.LogRecord) -> None:
        """Queue the line of `record`."""
        try:
            self._lines.put_nowait(self.format(record))
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Write what waits, for a second at most."""
        try:
            self._lines.put_nowait(None)
        except queue.Full:
            pass
        else:
            self._thread.join(CLOSE_TIMEOUT_S)
        super().close()

    def _write(self) -> None:
        try:
            while (line := self._lines.get()) is not None:
                dropped, self._dropped = self._dropped, 0
                note = f"({dropped} lines of log were dropped)\n" if dropped else ""
                self._stream.write(f"{line}\n{note}")
                self._stream.flush()
        except (OSError, ValueError):  # nobody reads, or the stream was closed: there is nowhere to say so
            return


def _is_journal(stream: TextIO) -> bool:
    """Whether systemd's journal is at the other end ($JOURNAL_STREAM, see systemd.exec(5))."""
    try:
        status = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"


def start_program_log() -> None:
    """Log from INFO on to standard error, unless the program that called us has its own logging."""
    root = logging.getLogger()
    if not root.handlers:
        root.addHandler(BackgroundLog(sys.stderr))
        root.setLevel(logging.INFO)
