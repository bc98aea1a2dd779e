"""From the bytes of a port to its lines: where a device's stream is cut.

Bytes come in whatever pieces the port returns; lines go out whole, one for each call of the decoder. Everything is
bounded: a stream that never ends its line costs no memory, and what was thrown away is counted in `dropped`.
"""

from __future__ import annotations

from collections import Counter

MAX_LINE_BYTES = 1024


class LineFraming:
    """Cuts a text stream at its line feeds.

    A line loses its ending (``\\n``, and one ``\\r`` before it); an empty line is skipped. A line longer than
    `MAX_LINE_BYTES` is discarded up to its end and counted once as ``overlong``.
    """

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        self._rest = b""
        self._discarding = False

    def feed(self, chunk: bytes) -> list[bytes]:
        """The lines that `chunk` completes, in order."""
        *ended, rest = (self._rest + chunk).split(b"\n")
        lines: list[bytes] = []
        for line in ended:
            if self._discarding:
                self._discarding = False
                continue
            if line.endswith(b"\r"):
                line = line[:-1]
            if len(line) > MAX_LINE_BYTES:
                self.dropped["overlong"] += 1
            elif line:
                lines.append(line)
        if self._discarding:
            rest = b""
        elif len(rest) > MAX_LINE_BYTES + 1:  # one more for the carriage return that may end it
            self.dropped["overlong"] += 1
            self._discarding = True
            rest = b""
        self._rest = rest
        return lines


class HexFraming:
    """Finds binary frames of one known length in a stream: ``55 55``, the content, a 16-bit sum.

    The sum is the low 16 bits of the sum of all bytes before it, the two ``55`` included, big-endian. A frame whose
    sum is wrong is counted as ``checksum`` and the search goes on one byte after its start, so that a ``55 55`` inside
    the content cannot keep the stream out of step. Bytes outside frames are counted as ``noise``.
    """

    START = b"\x55\x55"

    def __init__(self, frame_bytes: int) -> None:
        """`frame_bytes`: the length of a frame in bytes, start and sum included."""
        if frame_bytes < 5:
            raise ValueError(f"a frame of {frame_bytes} bytes has no content: start and sum take 2 bytes each")
        self.dropped: Counter[str] = Counter()
        self._frame_bytes = frame_bytes
        self._rest = b""
        self._suspect_bytes = 0  # bytes ahead that belong to a frame already counted as bad

    def feed(self, chunk: bytes) -> list[bytes]:
        """The frames that `chunk` completes, in order, each with its start and its sum."""
        buffer = self._rest + chunk
        length = self._frame_bytes
        frames: list[bytes] = []
        position = 0
        while True:
            start = buffer.find(self.START, position)
            if start < 0:
                # Nothing begins here, except perhaps with the very last byte.
                end = len(buffer) - 1 if buffer[position:].endswith(b"\x55") else len(buffer)
                self._skip(end - position)
                position = end
                break
            self._skip(start - position)
            position = start
            if start + length > len(buffer):
                break
            frame = buffer[start : start + length]
            if frame_sum_is_right(frame):
                frames.append(frame)
                position += length
                self._suspect_bytes = 0
            else:
                if self._suspect_bytes == 0:
                    self.dropped["checksum"] += 1
                    self._suspect_bytes = length
                self._skip(1)
                position += 1
        self._rest = buffer[position:]
        return frames

    def _skip(self, count: int) -> None:
        if count:
            self.dropped["noise"] += count
            self._suspect_bytes = max(0, self._suspect_bytes - count)


def frame_sum_is_right(frame: bytes) -> bool:
    """Whether the last two bytes are the big-endian 16-bit sum of all bytes before them."""
    return sum(frame[:-2]) & 0xFFFF == frame[-2] << 8 | frame[-1]
