"""Serves a voyage on five ptys, in real time, like five serial devices.

Times come from one absolute schedule on the monotonic clock, so that rates do not drift. Nothing that a reader does, or
fails to do, delays the others: a line that does not fit is dropped, as by a serial port that nobody reads; what
nobody listens to is not kept for the next one who opens the port.
"""

from __future__ import annotations

import fcntl
import os
import select
import time
import tty
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import IO

from acquisition.simulator.recorder import TRUTH_HEADER, TRUTH_PERIOD_STEPS, truth_row
from acquisition.simulator.vessel import STEP_US
from acquisition.simulator.voyage import Voyage

#: The udev link of each source.
LINK_NAMES = {"gps1": "fjGPS1", "gps2": "fjGPS2", "gps3": "fjGPS3", "compass": "fjEC", "imu": "fjIMU"}

_GRID_US = STEP_US * TRUTH_PERIOD_STEPS
#: A simulator that was held up for longer does not send what it has missed.
_MAX_LATE_US = 1_000_000


class LinkError(ValueError):
    """A link to a pty that cannot be made."""


class Pty:
    """One simulated serial port: `path` is the end that a program opens."""

    def __init__(self) -> None:
        self.fd, reader_fd = os.openpty()
        tty.setraw(reader_fd)
        self.path = os.ttyname(reader_fd)
        # With nobody at the other end, poll() tells so; that end must therefore not be held open here.
        os.close(reader_fd)
        os.set_blocking(self.fd, False)
        self.dropped_lines = 0
        self._rest = b""  # of a line that was cut because the pty was full: a line is sent whole or not at all

    def send(self, lines: Iterable[bytes]) -> None:
        """Write `lines`, each with its ending; drop what does not fit."""
        for line in lines:
            if self._rest:
                self._rest = self._rest[self._write(self._rest) :]
            if self._rest:
                self.dropped_lines += 1
                continue
            ended = line + b"\r\n"
            sent = self._write(ended)
            if sent:
                self._rest = ended[sent:]
            else:
                self.dropped_lines += 1

    def _write(self, octets: bytes) -> int:
        try:
            return os.write(self.fd, octets)
        except BlockingIOError:
            return 0

    def forget(self) -> None:
        """The reader has gone: what he did not get is not for the next one."""
        self._rest = b""

    def discard_commands(self) -> None:
        """Read away what a program sends to the device; the simulated ones obey nothing."""
        try:
            os.read(self.fd, 4096)
        except OSError:
            return  # taken already, or the reader has just gone

    def close(self) -> None:
        """End the port: a reader gets a hang-up, as from a USB device that was pulled out."""
        os.close(self.fd)


@contextmanager
def claimed(directory: Path) -> Iterator[None]:
    """Keeps `directory` ours meanwhile; LinkError when another simulator has it."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise LinkError(f"cannot make the links in {directory}: {error.strerror}") from error
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LinkError(f"another simulator has its links in {directory}; end it, or give another folder") from None
        yield
    finally:
        os.close(fd)


def make_links(ptys: dict[str, Pty], directory: Path) -> dict[str, Path]:
    """Links like udev's (fjGPS1, ..., fjEC, fjIMU) in `directory`; LinkError when something else is in the way."""
    links = {}
    try:
        for source, pty in ptys.items():
            link = directory / LINK_NAMES[source]
            if link.is_symlink():
                link.unlink()
            link.symlink_to(pty.path)
            links[source] = link
    except OSError as error:
        where = error.filename2 or error.filename
        raise LinkError(f"cannot make the links in {directory}: {error.strerror}: {where}") from error
    return links


def remove_links(ptys: dict[str, Pty], links: dict[str, Path]) -> None:
    """Remove those links that still lead to these ptys."""
    for source, link in links.items():
        if link.is_symlink() and os.readlink(link) == ptys[source].path:
            link.unlink()


def next_grid_point(start_us: int) -> int:
    """The next monotonic microsecond that lies a whole number of 100 ms from `start_us`."""
    now_us = time.monotonic_ns() // 1000
    return start_us + ((now_us - start_us) // _GRID_US + 1) * _GRID_US


def utc_tenth(monotonic_us: int) -> datetime:
    """The UTC of a monotonic time, to the next tenth of a second: receivers sense at whole tenths."""
    ahead_us = monotonic_us - time.monotonic_ns() // 1000
    utc = datetime.now(UTC) + timedelta(microseconds=ahead_us + _GRID_US // 2)
    return utc.replace(microsecond=utc.microsecond // _GRID_US * _GRID_US)


def serve(
    voyage: Voyage,
    ptys: dict[str, Pty],
    departure_us: int,
    ended: Callable[[], bool],
    truth: tuple[IO[str], int] | None = None,
) -> None:
    """Sail `voyage` from `departure_us` (monotonic) in real time until `ended`, which is asked ten times a second.

    `truth` is a file and the monotonic microsecond of its zero; rows before that are left out.
    """
    poll = select.poll()
    source_of = {pty.fd: source for source, pty in ptys.items()}
    for fd in source_of:
        poll.register(fd, select.POLLIN)
    if truth:
        truth[0].write(TRUTH_HEADER)
    lines: dict[str, list[bytes]] = {source: [] for source in ptys}
    step = 0
    while step % TRUTH_PERIOD_STEPS or not ended():
        step += 1
        due_us = departure_us + step * STEP_US
        late_us = time.monotonic_ns() // 1000 - due_us
        if late_us < 0:
            time.sleep(-late_us * 1e-6)
        for _, source, line in voyage.advance():
            lines[source].append(line)
        listening = set(ptys)
        for fd, events in poll.poll(0):
            source = source_of[fd]
            if events & select.POLLIN:
                ptys[source].discard_commands()
            if events & select.POLLHUP:
                ptys[source].forget()
                listening.discard(source)
        for source, waiting in lines.items():
            if waiting:
                if source in listening and late_us < _MAX_LATE_US:
                    ptys[source].send(waiting)
                waiting.clear()
        if truth and step % TRUTH_PERIOD_STEPS == 0 and due_us >= truth[1]:
            truth[0].write(truth_row((due_us - truth[1]) / 1e6, voyage.motion))
