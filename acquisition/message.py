"""The message: how a worker tells the fusion process what came in at its port.

One message is a header of 12 bytes (stamp, kind, sample count, length of the line), the raw line or a text, and then
112 bytes per sample that the line completed. A message never exceeds `MAX_MESSAGE` = PIPE_BUF bytes, so a write of it
to a pipe is atomic: the reader never finds half of one left behind by a worker that was killed.

Written by `acquisition.worker`, read by `acquisition.supervisor`, which hands the messages on unchanged.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

from acquisition.sample import SAMPLE_SIZE, Sample

MAX_LINE = 1024  #: bytes of a raw line, as the framing cuts it
MAX_MESSAGE = 4096  #: PIPE_BUF of Linux: the largest write that a pipe takes whole or not at all
MAX_TEXT = MAX_MESSAGE - 12  #: bytes of text in a message without samples

#: Kinds of message. LINE is first and checked first: all but a few messages are of this kind.
LINE = 0  #: a raw line and the samples it completed
HELLO = 1  #: JSON {"pid", "driver"}: the worker is there, and from here on a fresh decoder decodes
PORT = 2  #: "STATE text": the state of the port changed (see `PORT_STATES`)
COUNTS = 3  #: JSON object of counters, once a second: also the heartbeat
ERROR = 4  #: traceback of the exception that ended the worker
LOG = 5  #: a line for the log
RESTART = 6  #: from the supervisor, before a HELLO that is not the device's first: the decoder starts anew
KIND_NAMES = ("line", "hello", "port", "counts", "error", "log", "restart")

#: What a PORT message can say.
OPEN = "open"  #: open, and bytes come or are awaited
SILENT = "silent"  #: open, but nothing came for longer than the device's habit
ABSENT = "absent"  #: no such device, or nobody answers at that address
DENIED = "denied"  #: the device is there, this user may not open it
BUSY = "busy"  #: another program holds it
LOST = "lost"  #: it was open and vanished
UNUSABLE = "unusable"  #: it is there but is no serial device, or does not take the settings
CLOSED = "closed"  #: polling is stopped
PORT_STATES = (OPEN, SILENT, ABSENT, DENIED, BUSY, LOST, UNUSABLE, CLOSED)

_HEADER = struct.Struct("<qBBH")
_HEADER_SIZE = _HEADER.size
_pack_header = _HEADER.pack
_unpack_header = _HEADER.unpack_from


class MessageError(ValueError):
    """Bytes that are no message, or a message too large for one write."""


class Message(NamedTuple):
    """One message, as read from a worker's pipe."""

    t_us: int  #: microseconds since the recording's start: for a line, when the read that completed it returned
    kind: int  #: LINE, HELLO, PORT, COUNTS, ERROR, LOG, RESTART
    line: bytes  #: the raw line without its ending; for other kinds a UTF-8 text
    samples: bytes = b""  #: records of 112 bytes, one per sample, as `acquisition.sample.unpack` takes them

    @property
    def text(self) -> str:
        """The line as text, for people; bytes that are not UTF-8 are replaced."""
        return self.line.decode("utf-8", "replace")


def pack_line(t_us: int, line: bytes, samples: Sequence[Sample] = ()) -> bytes:
    """The message of one raw line (at most `MAX_LINE` bytes) and its samples; MessageError when it is too large."""
    count = len(samples)
    size = _HEADER_SIZE + len(line) + count * SAMPLE_SIZE
    if len(line) > MAX_LINE or size > MAX_MESSAGE:
        raise MessageError(f"a line of {len(line)} bytes with {count} samples: {MAX_LINE} bytes, {MAX_MESSAGE} in all")
    header = _pack_header(t_us, LINE, count, len(line))
    if count == 0:
        return header + line
    if count == 1:
        return header + line + samples[0].pack()
    return b"".join((header, line, *(sample.pack() for sample in samples)))


def pack_text(t_us: int, kind: int, text: bytes) -> bytes:
    """The message of a UTF-8 text; one that is too long keeps its end, where a traceback says what happened."""
    body = text[-MAX_TEXT:]
    return _pack_header(t_us, kind, 0, len(body)) + body


class MessageParser:
    """Cuts the bytes read from one worker's pipe into messages, wherever the reads happened to split them."""

    __slots__ = ("_rest",)

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, chunk: bytes) -> list[Message]:
        """The messages that `chunk` completes, in order; MessageError when the stream is not one of messages."""
        stream = self._rest + chunk if self._rest else chunk
        size = len(stream)
        messages: list[Message] = []
        start = 0
        while size - start >= _HEADER_SIZE:
            t_us, kind, count, length = _unpack_header(stream, start)
            body = start + _HEADER_SIZE
            tail = body + length
            end = tail + count * SAMPLE_SIZE
            if kind > RESTART or end - start > MAX_MESSAGE:
                self._rest = b""
                raise MessageError(f"not a message: kind {kind}, {length} bytes of line, {count} samples")
            if end > size:
                break
            messages.append(Message(t_us, kind, stream[body:tail], stream[tail:end]))
            start = end
        self._rest = stream[start:]
        return messages
