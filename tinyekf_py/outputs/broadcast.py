"""Bytes to everybody who listens: a TCP server that reads nothing, and datagrams.

Whoever sends calls `send` with whole lines and never waits. A listener that is slow loses what it does not take, never
a part of a line; one that has taken nothing for a while is hung up on. Simulated and replayed data, which many formats
cannot mark, are sent with `local_only`: to listeners on this machine alone.
"""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import socket
from collections.abc import AsyncIterator, Callable
from typing import Any

MAX_CLIENTS = 32
#: What may wait for one client, in the kernel and here together: seconds of sentences, not minutes.
_KERNEL_BYTES, _WAITING_BYTES = 16_384, 8_192
#: A client that takes nothing for so long is hung up on, seconds.
STALLED_S = 30.0

_log = logging.getLogger(__name__)


class BroadcastServer:
    """Everybody who is connected; made by `listening`."""

    def __init__(self, greeting: Callable[[], bytes] | None, max_clients: int, stalled_s: float) -> None:
        self._greeting = greeting
        self._max_clients = max_clients
        self.stalled_s = stalled_s
        self.clients: set[_Client] = set()
        self.refused = 0  #: connections over the limit
        self.lost = 0  #: chunks that slow clients have not been given
        self._told_local_only = False

    def send(self, chunk: bytes, *, local_only: bool = False) -> None:
        """Give whole lines to every client that takes them; `local_only`: to those on this machine."""
        for client in tuple(self.clients):
            if client.is_local or not local_only:
                client.send(chunk)
            elif not self._told_local_only:
                self._told_local_only = True
                _log.warning("simulated data are not sent to other machines; outputs.allow_simulated would send them")

    def connected(self, client: _Client) -> bool:
        """Take `client` in, or say that there are enough."""
        if len(self.clients) >= self._max_clients:
            self.refused += 1
            return False
        self.clients.add(client)
        if self._greeting is not None:
            client.send(self._greeting())
        return True


class _Client(asyncio.Protocol):
    def __init__(self, server: BroadcastServer) -> None:
        self._server = server
        self._transport: asyncio.Transport | None = None
        self._stalled_since: float | None = None
        self.is_local = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        # Nothing that a client says is read, ever; asyncio begins to read only after this.
        asyncio.get_running_loop().call_soon(transport.pause_reading)
        self._transport = transport
        self.is_local = is_loopback(transport.get_extra_info("peername")[0])
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _KERNEL_BYTES)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(self._server.stalled_s * 1000))
        if not self._server.connected(self):
            transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        self._server.clients.discard(self)

    def send(self, chunk: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() <= _WAITING_BYTES:
            self._stalled_since = None
            self._transport.write(chunk)
            return
        self._server.lost += 1
        now = asyncio.get_running_loop().time()
        if self._stalled_since is None:
            self._stalled_since = now
        elif now - self._stalled_since > self._server.stalled_s:
            self.hang_up()

    def hang_up(self) -> None:
        """End the connection; what waits for it is lost."""
        if self._transport is not None:
            self._transport.abort()


@contextlib.asynccontextmanager
async def listening(
    host: str,
    port: int,
    *,
    greeting: Callable[[], bytes] | None = None,
    max_clients: int = MAX_CLIENTS,
    stalled_s: float = STALLED_S,
) -> AsyncIterator[BroadcastServer]:
    """A `BroadcastServer` on `host`, `port` while the context lasts; `greeting()` is a client's first chunk.

    OSError when the port cannot be had.
    """
    broadcast = BroadcastServer(greeting, max_clients, stalled_s)
    server = await asyncio.get_running_loop().create_server(lambda: _Client(broadcast), host, port)
    for listener in server.sockets:  # its connections inherit it: room for the little that is never read
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    try:
        yield broadcast
    finally:
        server.close()
        for client in tuple(broadcast.clients):
            client.hang_up()


class DatagramSender:
    """Datagrams to one address, which may be a network's broadcast address; a context manager."""

    def __init__(self, host: str, port: int) -> None:
        """OSError when `host` has no address."""
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._address: tuple[Any, ...] = address
        self.is_local = is_loopback(self._address[0])
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self.lost = 0  #: datagrams that could not be sent
        self._told_local_only = False

    def send(self, chunk: bytes, *, local_only: bool = False) -> None:
        """Send one datagram, or lose it; `local_only`: not when it would leave this machine."""
        if local_only and not self.is_local:
            if not self._told_local_only:
                self._told_local_only = True
                _log.warning("simulated data are not sent to %s; outputs.allow_simulated would", self._address[0])
            return
        try:
            self._socket.sendto(chunk, self._address)
        except OSError:  # no network yet, nobody there, no room: the next one may get through
            self.lost += 1

    def __enter__(self) -> DatagramSender:
        return self

    def __exit__(self, *_: Any) -> None:
        self._socket.close()


def is_loopback(address: object) -> bool:
    """Whether the numeric address is this machine's loopback."""
    try:
        parsed = ipaddress.ip_address(str(address).partition("%")[0])
    except ValueError:
        return False
    mapped = parsed.ipv4_mapped if isinstance(parsed, ipaddress.IPv6Address) else None
    return (mapped or parsed).is_loopback
