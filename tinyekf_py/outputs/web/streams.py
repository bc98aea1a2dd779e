"""WebSocket streams: a frame is encoded once, and offered to each client; one that has not taken the last is spared it.

Frames are written to the transport as they are, past aiohttp's writer, which would make each anew for each client and
hold the others up for a slow one. aiohttp answers pings, sends its own and closes; those are whole frames too, so they
may stand between ours.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import cast

from aiohttp import WSMsgType, web

from tinyekf_py.outputs.broadcast import is_loopback
from tinyekf_py.outputs.web.guard import Guard

PING_PERIOD_S = 10.0
#: A client that takes nothing for so long is let go, seconds.
STALL_PATIENCE_S = 15.0
MAX_CLIENTS = 48
_MAX_MESSAGE = 4096  # bytes, of what a client sends


def text_frame(text: str) -> bytes:
    """`text`, ASCII, as a server's WebSocket frame (RFC 6455, 5.2)."""
    payload = text.encode("ascii")
    size = len(payload)
    if size < 126:
        return bytes((0x81, size)) + payload
    if size < 1 << 16:
        return b"\x81\x7e" + size.to_bytes(2, "big") + payload
    return b"\x81\x7f" + size.to_bytes(8, "big") + payload


class _Client:
    def __init__(self, transport: asyncio.Transport) -> None:
        self.transport = transport
        self.took_at_s = time.monotonic()
        self.is_local = is_loopback(transport.get_extra_info("peername")[0])


class Stream:
    """Everybody who watches one thing."""

    def __init__(self) -> None:
        self._clients: set[_Client] = set()
        self.sent = 0  #: frames
        self.lost = 0  #: frames that slow clients were spared

    def __len__(self) -> int:
        return len(self._clients)

    def send(self, frame: bytes, *, local_only: bool = False) -> None:
        """Offer `frame` to all; `local_only`: to those on this machine."""
        now = time.monotonic()
        for client in tuple(self._clients):
            if client.transport.is_closing() or (local_only and not client.is_local):
                continue
            if client.transport.get_write_buffer_size():
                self.lost += 1
                if now - client.took_at_s > STALL_PATIENCE_S:
                    client.transport.abort()
                continue
            client.took_at_s = now
            client.transport.write(frame)
            self.sent += 1

    async def serve(self, request: web.Request, first: Callable[[], list[str]]) -> web.StreamResponse:
        """Take the client of `request` in until it goes; `first` makes what it is sent at once."""
        if len(self._clients) >= MAX_CLIENTS:
            raise web.HTTPServiceUnavailable(text="too many clients")
        response = web.WebSocketResponse(heartbeat=PING_PERIOD_S, compress=False, max_msg_size=_MAX_MESSAGE)
        await response.prepare(request)
        transport = request.transport
        if transport is None:
            return response
        cast(Guard, transport.get_protocol()).is_socket()
        client = _Client(transport)
        transport.write(b"".join(map(text_frame, first())))
        self._clients.add(client)
        try:
            # What it says is not asked for; reading it notices pings, pongs and the end.
            while (await response.receive()).type in (WSMsgType.TEXT, WSMsgType.BINARY):
                pass
        finally:
            self._clients.discard(client)
        return response
