"""The feed: how the outputs in this process see the live program."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import socket
import time
from collections.abc import AsyncIterator, Mapping
from typing import Any

from tinyekf_py.alarms import Alarm, Alarms
from tinyekf_py.estimate import Estimate
from tinyekf_py.outputs.frame import MAX_PACKET, Answer, Frame, LogLine, Request, decode, encode
from tinyekf_py.view_state import ViewState, current_estimate

ANSWER_PATIENCE_S = 5.0
FRAME_SPACING_S = 0.1  # between two frames, about


class Feed:
    """The newest view state, as it comes, and a way to ask for tasks to be started and stopped.

    Used within one event loop. Frames that come faster than a reader takes them are skipped: a reader always gets
    the newest.
    """

    def __init__(self, link: socket.socket) -> None:
        """`link` is the datagram socket to the live program."""
        self._link = link
        self._link.setblocking(False)
        self._frame: Frame | None = None
        self._alarms = Alarms()
        self._changed = asyncio.Event()
        self._ended = asyncio.Event()
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[Mapping[str, Any]]] = {}

    @property
    def state(self) -> ViewState | None:
        """The newest view state; None before the first."""
        return self._frame.state if self._frame is not None else None

    @property
    def age_s(self) -> float:
        """How long ago the newest view state was made; infinite before the first."""
        return time.monotonic() - self._frame.made_at_s if self._frame is not None else float("inf")

    @property
    def estimate(self) -> Estimate:
        """The estimate as it may be given out now: an invalid one when it is missing or more than a second old."""
        return current_estimate(self._frame.state, self.age_s) if self._frame is not None else Estimate(0)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The alarms raised now, worst first."""
        return self._alarms.update(self.state, self.age_s)

    async def frames(self, longest_s: float = 1.0) -> AsyncIterator[None]:
        """Yields whenever there is a new frame, and after `longest_s` without one, until the program ends."""
        seen = None
        while not self._ended.is_set():
            if self._frame is seen:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), longest_s)
            seen = self._frame
            if not self._ended.is_set():
                yield

    async def paced(self, rate_hz: float) -> AsyncIterator[None]:
        """Yields with the newest frame about `rate_hz` times a second, twice a second when there is none."""
        period_s, due_s = 1.0 / rate_hz, 0.0
        async for _ in self.frames(0.5):
            now_s = time.monotonic()
            if now_s >= due_s - 0.5 * FRAME_SPACING_S:
                due_s = max(due_s, now_s - period_s) + period_s
                yield

    async def ask(self, *words: str) -> Mapping[str, Any]:
        """What the live program answers to status, start TASK or stop TASK; {"error": ...} when it does not."""
        number = next(self._numbers)
        answer: asyncio.Future[Mapping[str, Any]] = asyncio.get_running_loop().create_future()
        self._waiting[number] = answer
        try:
            self._link.send(encode(Request(number, words)))
            return await asyncio.wait_for(answer, ANSWER_PATIENCE_S)
        except (TimeoutError, OSError):
            return {"error": "the program does not answer"}
        finally:
            del self._waiting[number]

    async def run(self) -> None:
        """Receive until the live program ends."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._link.fileno(), self._receive)
        try:
            await self._ended.wait()
        finally:
            loop.remove_reader(self._link.fileno())
            self._changed.set()

    def _receive(self) -> None:
        """Take all that waits; of frames, only the newest is looked at."""
        newest = b""
        while True:
            try:
                datagram = self._link.recv(MAX_PACKET)
            except BlockingIOError:
                break
            except OSError:
                datagram = b""
            if not datagram:
                self._ended.set()
                break
            if datagram.startswith(b'["frame"'):
                newest = datagram
                continue
            packet = decode(datagram)
            if isinstance(packet, Answer) and packet.number in self._waiting:
                self._waiting[packet.number].set_result(packet.answer)
        if newest:
            frame = decode(newest)
            assert isinstance(frame, Frame)
            self._frame = frame
            self._changed.set()
            self._changed = asyncio.Event()


class LinkLog(logging.Handler):
    """Sends log lines to the live program, which alone owns the terminal and the journal."""

    def __init__(self, link: socket.socket) -> None:
        super().__init__()
        self._link = link

    def emit(self, record: logging.LogRecord) -> None:
        """Send the first line of `record`; one that the link does not take is lost."""
        text = self.format(record)
        if record.exc_info is None:
            text = text.partition("\n")[0]
        with contextlib.suppress(OSError):
            self._link.send(encode(LogLine(record.levelno, text[:8192])))
