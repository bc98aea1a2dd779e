"""The outbox: what a worker still has to tell, kept short when the fusion process is slow to read.

Raw lines wait here *before* they are decoded. What has to be dropped is dropped here, so the decoder sees exactly the
lines that are sent, and hence recorded: a replay that decodes the recording arrives at the same samples. One write
holds as many messages as one atomic write of a pipe takes.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable

from acquisition.message import LINE, MAX_MESSAGE

BACKLOG = 256  #: entries that wait at most: 2.5 s of an IMU at 100 Hz

#: Makes the message of an entry (t_us, kind, payload): decodes a line, encodes a text.
Encode = Callable[[int, int, bytes], bytes]


class Outbox:
    """Messages on their way into a non-blocking pipe; never blocks, drops the oldest lines instead."""

    __slots__ = ("_block", "_encode", "_entries", "_fd", "_spare", "dropped")

    def __init__(self, fd: int, encode: Encode) -> None:
        os.set_blocking(fd, False)
        self._fd = fd
        self._encode = encode
        self._entries: deque[tuple[int, int, bytes]] = deque()
        # Encoded, hence bound to be sent: their lines have been through the decoder.
        self._block = b""  # the next write
        self._spare = b""  # the message that did not fit into it
        self.dropped: Counter[str] = Counter()  #: "slow-reader": lines dropped because the pipe was full

    @property
    def waiting(self) -> bool:
        """Whether something is left that the pipe did not take."""
        return bool(self._block or self._spare or self._entries)

    def add(self, t_us: int, kind: int, payload: bytes) -> None:
        """Let a message follow those before it."""
        self._entries.append((t_us, kind, payload))
        if len(self._entries) > BACKLOG:
            self._drop_oldest()

    def holds(self, kind: int) -> bool:
        """Whether a message of this kind still waits."""
        return any(entry[1] == kind for entry in self._entries)

    def flush(self) -> None:
        """Send what the pipe takes. BrokenPipeError when the reader is gone."""
        while self._block or self._spare or self._entries:
            if not self._block:
                self._fill()
            try:
                os.write(self._fd, self._block)
            except BlockingIOError:
                return
            self._block = b""

    def _fill(self) -> None:
        """Encode entries into one block, as many as an atomic write takes."""
        messages, size = [self._spare], len(self._spare)
        self._spare = b""
        while self._entries:
            message = self._encode(*self._entries.popleft())
            size += len(message)
            if size > MAX_MESSAGE:
                self._spare = message
                break
            messages.append(message)
        self._block = b"".join(messages)

    def _drop_oldest(self) -> None:
        """Make room: the oldest line goes; what says how the device is doing stays."""
        for index, (_, kind, _) in enumerate(self._entries):
            if kind == LINE:
                del self._entries[index]
                self.dropped["slow-reader"] += 1
                return
        self._entries.popleft()
