"""NMEA 0183 over a serial line or a pty.

A line slower than what it is given loses the sentences of whole moments, never parts of one, and never falls behind:
nothing is written while it has not sent what came before. A pty that nobody reads is flushed when it has been full for
a second, so that a late reader begins with little that is old: the 4 kB which the kernel keeps at its side.
"""

from __future__ import annotations

import asyncio
import fcntl
import logging
import os
import struct
import termios
from collections.abc import Mapping
from typing import Any

from acquisition.port import DevicePort
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.nmea_stream import chunks

LOOK_AGAIN_S = 1.0  # for a device that is not there
STALLED_S = 1.0

_log = logging.getLogger(__name__)


class SerialLine:
    """An open line for output. OSError from `send` means that it has vanished."""

    def __init__(self, path: str, baud: int) -> None:
        """PortError when it cannot be opened; its modem lines are left as they are."""
        self._port = DevicePort(path, baud)
        self._fd = self._port.fileno()
        self.is_pty = os.ttyname(self._fd).startswith("/dev/pts/")
        self._rest = b""  # of a chunk that the line has taken in part
        self._stalled_since_s: float | None = None
        self.lost = 0  #: chunks that it had no room for

    def send(self, chunk: bytes, now_s: float) -> None:
        """Write whole lines, or lose them; `now_s` is on any steady clock."""
        if self._rest:
            self._rest = self._rest[self._write(self._rest) :]
        if self._rest or self._waiting() > len(chunk) // 4:
            self.lost += 1
            if self._stalled_since_s is None:
                self._stalled_since_s = now_s
            elif self._rest and now_s - self._stalled_since_s > STALLED_S:
                termios.tcflush(self._fd, termios.TCOFLUSH)
                self._rest = b"\r\n"  # ends whatever was cut
                self._stalled_since_s = None
            return
        self._stalled_since_s = None
        self._rest = chunk[self._write(chunk) :]

    def close(self) -> None:
        """Give the device back."""
        self._port.close()

    def _write(self, chunk: bytes) -> int:
        try:
            return os.write(self._fd, chunk)
        except BlockingIOError:
            return 0

    def _waiting(self) -> int:
        """Bytes that the line has yet to send; a pty always says 0."""
        waiting: int = struct.unpack("i", fcntl.ioctl(self._fd, termios.TIOCOUTQ, bytes(4)))[0]
        return waiting


async def serve(feed: Feed, settings: Mapping[str, Any]) -> None:
    """Serve [outputs.nmea_serial] until the program ends; a device that vanishes is used again when it comes back."""
    clock = asyncio.get_running_loop().time
    line: SerialLine | None = None
    told = ""
    look_at = 0.0
    try:
        async for chunk in chunks(feed, settings):
            try:
                if line is None:
                    if clock() < look_at:
                        continue
                    line = SerialLine(settings["port"], settings["baud"])
                    _log.info("outputs.nmea_serial: %s is open", settings["port"])
                    told = ""
                line.send(chunk.everywhere + (chunk.here if line.is_pty else b""), clock())
            except (OSError, termios.error) as error:  # not there, or no more
                if line is not None:
                    line.close()
                line, look_at = None, clock() + LOOK_AGAIN_S
                why = str(error) if isinstance(error, OSError) and error.filename else error.args[-1]
                if why != told:
                    _log.warning("outputs.nmea_serial: %s: %s", settings["port"], why)
                told = why
    finally:
        if line is not None:
            line.close()
