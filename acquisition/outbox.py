"""The outbox: what a worker still has to tell, kept short when the fusion process is slow to read.

Raw lines wait here *before* they are decoded. What has to be dropped is dropped here, so the decoder sees exactly the
lines that are sent, and hence recorded: a replay that decodes the recording arrives at the same samples. A line is
decoded only when the pipe is empty and will take it. Until then it may grow too old: fusion refuses what is a second
older than the newest sample of any device, so after a stall each worker sends its last moments, not its backlog.
"""

from __future__ import annotations

import os
import select
from collections import Counter, deque
from collections.abc import Callable

from acquisition.message import LINE, MAX_MESSAGE

MAX_AGE_US = 800_000  #: of a line that is still sent; what it takes to be read comes on top
BACKLOG = 256  #: entries that wait at most; in that time only an IMU, or a device that floods, has so many

#: Makes the message of an entry (t_us, kind, payload): decodes a line, encodes a text.
Encode = Callable[[int, int, bytes], bytes]


class Outbox:
    """Messages on their way into a pipe; never blocks, drops the oldest lines instead."""

    __slots__ = ("_encode", "_entries", "_fd", "_room", "_spare", "dropped")

    def __init__(self, fd: int, encode: Encode) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self._room = select.poll()
        self._room.register(fd, select.POLLOUT)
        self._encode = encode
        self._entries: deque[tuple[int, int, bytes]] = deque()
        self._spare = b""  # the message that did not fit into the last write; its line has been through the decoder
        self.dropped: Counter[str] = Counter()  #: "slow-reader": lines dropped because the pipe was full

    @property
    def waiting(self) -> bool:
        """Whether something is left that the pipe did not take."""
        return bool(self._spare or self._entries)

    def add(self, t_us: int, kind: int, payload: bytes) -> None:
        """Let a message follow those before it."""
        self._entries.append((t_us, kind, payload))
        if len(self._entries) > BACKLOG:
            self._drop_oldest()

    def holds(self, kind: int) -> bool:
        """Whether a message of this kind still waits."""
        return any(entry[1] == kind for entry in self._entries)

    def flush(self, now_us: int) -> None:
        """Send what the pipe takes, and no line that is too old by now. BrokenPipeError when the reader is gone."""
        if self._entries and self._entries[0][0] < now_us - MAX_AGE_US:
            self._drop_older(now_us - MAX_AGE_US)
        while (self._spare or self._entries) and self._room.poll(0):
            os.write(self._fd, self._block())  # of at most PIPE_BUF bytes: taken whole where poll says there is room

    def _block(self) -> bytes:
        """As many entries, encoded, as an atomic write takes."""
        messages, size = [self._spare], len(self._spare)
        self._spare = b""
        while self._entries:
            message = self._encode(*self._entries.popleft())
            size += len(message)
            if size > MAX_MESSAGE:
                self._spare = message
                break
            messages.append(message)
        return b"".join(messages)

    def _drop_older(self, t_us: int) -> None:
        """Drop the lines stamped before `t_us`; what says how the device is doing stays."""
        kept = deque(entry for entry in self._entries if entry[0] >= t_us or entry[1] != LINE)
        self.dropped["slow-reader"] += len(self._entries) - len(kept)
        self._entries = kept

    def _drop_oldest(self) -> None:
        """Make room: the oldest line goes."""
        for index, (_, kind, _) in enumerate(self._entries):
            if kind == LINE:
                del self._entries[index]
                self.dropped["slow-reader"] += 1
                return
        self._entries.popleft()
