"""What every connection has to keep to before the HTTP server sees it: how many, how long, how much.

One connection carries one request, or becomes a WebSocket; so a client can neither queue requests nor hold a
connection by saying little.
"""

from __future__ import annotations

import asyncio
import re
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import cast

MAX_CONNECTIONS = 64
MAX_OF_ONE_ADDRESS = 32
#: From the connection to the end of the answer; a WebSocket has its own pings.
REQUEST_PATIENCE_S = 15.0
#: Request line, headers and body together, bytes.
MAX_REQUEST = 16384
#: What a WebSocket's client may send: so much at once, and so much a second, bytes. It has little to say.
SOCKET_BURST, SOCKET_BYTES_PER_S = 16384, 1024
#: The kernel's share of what waits for a slow client, bytes.
SEND_BUFFER = 32768
_REFUSAL = b"HTTP/1.1 %s\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
#: All that a request is made of; parsers differ, and fail, in what they make of other bytes.
_PRINTABLE = bytes((*b"\t\r\n", *range(0x20, 0x7F)))
_FIRST_LINE = re.compile(rb"[A-Z]{3,7} /(?:[!-.0-~][!-~]{0,254})? HTTP/1\.[01]\r\n")
_LONGEST_FIRST_LINE = 280  # bytes


class Connections:
    """The connections there are, and what was refused."""

    def __init__(self) -> None:
        self.open: set[Guard] = set()
        self.refused: Counter[str] = Counter()  #: by reason
        self._of_address: Counter[str] = Counter()

    def admit(self, guard: Guard) -> bool:
        """Count `guard` in, unless there are too many."""
        if len(self.open) >= MAX_CONNECTIONS or self._of_address[guard.address] >= MAX_OF_ONE_ADDRESS:
            self.refused["connections"] += 1
            return False
        self.open.add(guard)
        self._of_address[guard.address] += 1
        return True

    def leave(self, guard: Guard) -> None:
        """Count `guard` out."""
        if guard in self.open:
            self.open.remove(guard)
            self._of_address[guard.address] -= 1
            if not self._of_address[guard.address]:
                del self._of_address[guard.address]

    def abort(self) -> None:
        """End all of them."""
        for guard in tuple(self.open):
            guard.abort()


class Guard(asyncio.Protocol):
    """Stands between a transport and the HTTP server's protocol."""

    def __init__(self, connections: Connections, inner: Callable[[], asyncio.Protocol]) -> None:
        self._connections = connections
        self._make_inner = inner
        self._inner: asyncio.Protocol | None = None
        self._transport: asyncio.Transport | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._allowed = float(MAX_REQUEST)
        self._first_line: bytes | None = b""  # until it is whole
        self._refilled_at_s = 0.0
        self.address = ""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Let the connection in, or turn it away."""
        self._transport = cast(asyncio.Transport, transport)
        peer = transport.get_extra_info("peername")
        self.address = str(peer[0]) if peer else ""
        if not self._connections.admit(self):
            self._hang_up(b"503 Service Unavailable")
            return
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
        self._deadline = asyncio.get_running_loop().call_later(REQUEST_PATIENCE_S, self._expire)
        self._inner = self._make_inner()
        self._inner.connection_made(transport)

    def is_socket(self) -> None:
        """The request was a WebSocket's: its rules hold from now on."""
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None
        self._allowed, self._refilled_at_s = float(SOCKET_BURST), time.monotonic()

    def abort(self) -> None:
        """End the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    def data_received(self, data: bytes) -> None:
        """Pass on what is within the limits."""
        if self._inner is None or self._transport is None or self._transport.is_closing():
            return
        if self._refilled_at_s:
            now = time.monotonic()
            refill = (now - self._refilled_at_s) * SOCKET_BYTES_PER_S
            self._allowed, self._refilled_at_s = min(self._allowed + refill, float(SOCKET_BURST)), now
        self._allowed -= len(data)
        if self._allowed < 0.0:
            self._connections.refused["size"] += 1
            self._transport.abort()
            return
        if not self._refilled_at_s:
            if data.translate(None, _PRINTABLE):
                self._refuse_malformed()
                return
            if self._first_line is not None:
                data = self._first_line + data
                if b"\n" not in data and len(data) < _LONGEST_FIRST_LINE:
                    self._first_line = data
                    return
                if not _FIRST_LINE.match(data):
                    self._refuse_malformed()
                    return
                self._first_line = None
        self._inner.data_received(data)

    def eof_received(self) -> bool | None:
        """The client has said all it will."""
        return self._inner.eof_received() if self._inner is not None else None

    def connection_lost(self, error: Exception | None) -> None:
        """The connection is gone."""
        self._connections.leave(self)
        if self._deadline is not None:
            self._deadline.cancel()
        if self._inner is not None:
            self._inner.connection_lost(error)

    def pause_writing(self) -> None:
        """The client is slow."""
        if self._inner is not None:
            self._inner.pause_writing()

    def resume_writing(self) -> None:
        """The client has caught up."""
        if self._inner is not None:
            self._inner.resume_writing()

    def _refuse_malformed(self) -> None:
        self._connections.refused["malformed"] += 1
        self._hang_up(b"400 Bad Request")

    def _hang_up(self, status: bytes) -> None:
        if self._transport is not None:
            self._transport.write(_REFUSAL % status)
            self._transport.close()

    def _expire(self) -> None:
        self._connections.refused["time"] += 1
        self.abort()
