"""Signal K over TCP and UDP, and the broadcast below it: over real sockets, fed over the real link."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time
from collections.abc import AsyncIterator
from typing import Any

import pytest
from live_boat import free_port

from tinyekf_py.estimate import Estimate
from tinyekf_py.outputs import broadcast, signalk
from tinyekf_py.outputs.broadcast import BroadcastServer, DatagramSender, is_loopback, listening
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.frame import Frame, encode
from tinyekf_py.view_state import ViewState

DEADLINE_S = 20.0
STATE = ViewState(Estimate(0, 90.0, 0.5, 1.0, 35.0, 126.0, "ok", "gps"))


class Link:
    """The live program's end: sends frames until told otherwise."""

    def __init__(self) -> None:
        self.ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours.setblocking(False)
        self.feed = Feed(theirs)
        self.state = STATE

    async def run(self) -> None:
        while True:
            with contextlib.suppress(BlockingIOError):
                self.ours.send(encode(Frame(time.monotonic(), self.state)))
            await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def serving(**settings: Any) -> AsyncIterator[Link]:
    link = Link()
    table = {
        "host": "127.0.0.1", "port": 0, "udp_host": "", "udp_port": 8376, "rate_hz": 10.0, "allow_simulated": False,
        **settings,
    }  # fmt: skip
    tasks = [asyncio.create_task(work) for work in (link.feed.run(), link.run(), signalk.serve(link.feed, table))]
    try:
        yield link
    finally:
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, return_exceptions=True):
            assert ended is None or isinstance(ended, asyncio.CancelledError), ended
        link.ours.close()


async def connected(port: int) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    end = time.monotonic() + DEADLINE_S
    while True:
        try:
            return await asyncio.open_connection("127.0.0.1", port)
        except ConnectionRefusedError:
            assert time.monotonic() < end
            await asyncio.sleep(0.01)


async def message(reader: asyncio.StreamReader) -> dict[str, Any]:
    line = await asyncio.wait_for(reader.readline(), DEADLINE_S)
    assert line.endswith(b"\r\n")
    return dict(json.loads(line))


def heading_of(delta: dict[str, Any]) -> float | None:
    return next(v["value"] for v in delta["updates"][0]["values"] if v["path"] == "navigation.headingTrue")


def test_whoever_connects_is_greeted_and_given_deltas() -> None:
    async def scenario() -> None:
        port = free_port()
        async with serving(port=port):
            clients = [await connected(port) for _ in range(3)]
            for reader, writer in clients:
                assert (await message(reader))["roles"] == ["master", "main"]
                assert heading_of(await message(reader)) == pytest.approx(1.570796)
                writer.close()

    asyncio.run(scenario())


def test_deltas_come_in_datagrams() -> None:
    async def scenario() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            listener.bind(("127.0.0.1", 0))
            listener.setblocking(False)
            async with serving(udp_host="127.0.0.1", udp_port=listener.getsockname()[1]):
                received = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(listener, 4096), DEADLINE_S)
                assert heading_of(json.loads(received)) == pytest.approx(1.570796)

    asyncio.run(scenario())


def test_a_heading_that_is_no_longer_made_turns_null() -> None:
    async def scenario() -> None:
        port = free_port()
        async with serving(port=port) as link:
            reader, _ = await connected(port)
            await message(reader)
            assert heading_of(await message(reader)) is not None
            link.state = STATE._replace(estimate_age_s=1.5)
            while heading_of(await message(reader)) is not None:
                pass

    asyncio.run(scenario())


def test_a_port_that_is_taken_is_an_oserror() -> None:
    async def scenario() -> None:
        with socket.create_server(("127.0.0.1", 0)) as taken:
            async with listening("127.0.0.1", taken.getsockname()[1]):
                pass

    with pytest.raises(OSError, match="address already in use"):
        asyncio.run(scenario())


async def until(server: BroadcastServer, clients: int) -> None:
    end = time.monotonic() + DEADLINE_S
    while len(server.clients) != clients:
        assert time.monotonic() < end, f"{len(server.clients)} clients"
        server.send(b"line\n")
        await asyncio.sleep(0.01)


def test_a_client_that_does_not_read_loses_lines_and_is_hung_up_on_while_others_get_all() -> None:
    async def scenario() -> None:
        port = free_port()
        async with listening("127.0.0.1", port, stalled_s=0.3) as server:
            stuck = socket.create_connection(("127.0.0.1", port))
            reader, writer = await connected(port)
            await until(server, 2)
            line = b"x" * 1000 + b"\n"
            end = time.monotonic() + DEADLINE_S
            while len(server.clients) == 2:
                assert time.monotonic() < end
                server.send(line)
                while (await asyncio.wait_for(reader.readline(), DEADLINE_S)) != line:
                    pass  # the lines of `until`
            assert server.lost > 0
            await until(server, 1)
            writer.close()
            stuck.close()

    asyncio.run(scenario())


def test_a_slow_client_never_gets_a_part_of_a_line() -> None:
    async def scenario() -> None:
        port = free_port()
        async with listening("127.0.0.1", port, stalled_s=60.0) as server:
            reader, writer = await connected(port)
            await until(server, 1)
            for number in range(2000):
                server.send(b"%06d" % number * 100 + b"\n")
                await asyncio.sleep(0)
            assert server.lost > 0
            lines: list[bytes] = []
            while b"line\n" not in lines:
                server.send(b"line\n")
                lines.append(await asyncio.wait_for(reader.readline(), DEADLINE_S))
            assert len(lines) > 20
            for line in lines[:-1]:
                assert len(line) == 601
                assert line == line[:6] * 100 + b"\n"
            writer.close()


def test_nothing_that_clients_send_is_read() -> None:
    async def scenario() -> None:
        port = free_port()
        async with listening("127.0.0.1", port) as server:
            with socket.create_connection(("127.0.0.1", port)) as client:
                await until(server, 1)
                client.setblocking(False)
                sent = 0
                with contextlib.suppress(BlockingIOError):
                    while sent < 50_000_000:
                        sent += client.send(bytes(65536))
                        await asyncio.sleep(0)
                assert sent < 10_000_000  # the kernel's buffers alone
                client.settimeout(DEADLINE_S)
                server.send(b"line\n")
                await asyncio.sleep(0)
                assert client.recv(5) == b"line\n"  # and it is served as ever
            await until(server, 0)

    asyncio.run(scenario())


def test_connections_are_capped() -> None:
    async def scenario() -> None:
        port = free_port()
        async with listening("127.0.0.1", port, max_clients=2) as server:
            clients = [await connected(port) for _ in range(2)]
            await until(server, 2)
            refused, _ = await connected(port)
            with contextlib.suppress(ConnectionResetError):
                assert await asyncio.wait_for(refused.read(), DEADLINE_S) == b""
            assert server.refused == 1
            for _, writer in clients:
                writer.close()
            await until(server, 0)
            again, _ = await connected(port)
            await until(server, 1)
            server.send(b"line\n")
            assert await asyncio.wait_for(again.readline(), DEADLINE_S) == b"line\n"

    asyncio.run(scenario())


def test_simulated_data_stay_on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario(*, allow_simulated: bool) -> bool:
        port = free_port()
        async with serving(port=port, allow_simulated=allow_simulated) as link:
            link.state = STATE._replace(simulated=True)
            reader, _ = await connected(port)
            await message(reader)  # the greeting
            try:
                await asyncio.wait_for(message(reader), 0.5 if not allow_simulated else DEADLINE_S)
            except TimeoutError:
                return False
            return True

    assert asyncio.run(scenario(allow_simulated=False))  # a client on this machine
    monkeypatch.setattr(broadcast, "is_loopback", lambda _address: False)
    assert asyncio.run(scenario(allow_simulated=True))
    assert not asyncio.run(scenario(allow_simulated=False))


def test_simulated_datagrams_stay_on_this_machine() -> None:
    # 192.0.2.1 is nobody's address (RFC 5737), and nothing is sent to it.
    with DatagramSender("192.0.2.1", 9) as sender:
        assert not sender.is_local
        sender._socket.close()  # a send would be counted as lost
        sender.send(b"x", local_only=True)
        assert sender.lost == 0
        sender.send(b"x")
        assert sender.lost == 1


@pytest.mark.parametrize(
    ("address", "local"),
    [
        ("127.0.0.1", True), ("127.1.2.3", True), ("::1", True), ("::ffff:127.0.0.1", True), ("fe80::1%eth0", False),
        ("10.0.0.5", False), ("0.0.0.0", False), ("255.255.255.255", False), ("", False), ("nonsense", False),
    ],
)  # fmt: skip
def test_loopback_is_known(address: str, local: bool) -> None:
    assert is_loopback(address) is local
