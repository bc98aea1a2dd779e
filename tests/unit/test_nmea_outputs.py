"""NMEA 0183 over TCP, UDP and serial lines: over real sockets and ptys, fed over the real link."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import socket
import time
import tty
from collections.abc import AsyncIterator, Mapping
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tinyekf_py.config import Config, ConfigError, apply_flat
from tinyekf_py.estimate import Estimate
from tinyekf_py.outputs import broadcast, nmea_serial, nmea_tcp, nmea_udp
from tinyekf_py.outputs.address import address_text
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.frame import Frame, encode
from tinyekf_py.outputs.nmea_serial import SerialLine
from tinyekf_py.outputs.settings import switched_on
from tinyekf_py.view_state import Navigation, ViewState

DEADLINE_S = 20.0
NAVIGATION = Navigation(1.8e9, 5.0, 121.5, 12.34, 1, 9, 0.93, 3.21, -0.04, -8.0, 2.0)
STATE = ViewState(Estimate(0, 90.0, 0.5, 1.0, 35.0, 126.0, "ok", "gps"), navigation=NAVIGATION)


class Boat:
    """The live program's end of the link: a new estimate every 20 ms, as long as it sails."""

    def __init__(self, state: ViewState) -> None:
        self.ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours.setblocking(False)
        self.feed = Feed(theirs)
        self.state = state
        self.sails = True

    async def run(self) -> None:
        t_us, made_at_s = 0, 0.0
        while True:
            if self.sails:
                t_us, made_at_s = t_us + 100_000, time.monotonic()
            assert self.state.estimate is not None
            estimate = self.state.estimate._replace(t_us=t_us, heading_deg=t_us / 1e6 % 360.0)
            now_s = time.monotonic()
            state = self.state._replace(estimate=estimate, estimate_age_s=now_s - made_at_s, elapsed_s=now_s)
            with contextlib.suppress(BlockingIOError):
                self.ours.send(encode(Frame(time.monotonic(), state)))
            await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def sailing(output: ModuleType, state: ViewState = STATE, **settings: Any) -> AsyncIterator[Boat]:
    name = output.__name__.rpartition(".")[2]
    nmea = settings.pop("nmea", {})
    flat = {f"outputs.nmea.{key}": value for key, value in nmea.items()}
    flat |= {f"outputs.{key}": value for key, value in settings.pop("outputs", {}).items()}
    flat |= {f"outputs.{name}.{key}": value for key, value in {"enabled": True, **settings}.items()}
    table: Mapping[str, Any] = switched_on(apply_flat(Config(), flat, "the test").outputs)[name]
    boat = Boat(state)
    tasks = [asyncio.create_task(work) for work in (boat.feed.run(), boat.run(), output.serve(boat.feed, table))]
    try:
        yield boat
    finally:
        for task in tasks:
            task.cancel()
        for ended in await asyncio.gather(*tasks, return_exceptions=True):
            assert ended is None or isinstance(ended, asyncio.CancelledError), ended
        boat.ours.close()


@pytest.mark.parametrize(
    ("host", "address"),
    [
        ("127.0.0.1", "tcp://127.0.0.1:10110"),
        ("boat.local", "tcp://boat.local:10110"),
        ("::1", "tcp://[::1]:10110"),
        ("0.0.0.0", "tcp://127.0.0.1:10110 and all other addresses of this machine"),
    ],
)
def test_an_address_is_one_that_can_be_typed(host: str, address: str) -> None:
    assert address_text("tcp", {"host": host, "port": 10110}) == address


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


class Listener:
    """A TCP client that reads lines."""

    async def connect(self, port: int) -> Listener:
        end = time.monotonic() + DEADLINE_S
        while True:
            try:
                self._reader, self._writer = await asyncio.open_connection("127.0.0.1", port)
                return self
            except ConnectionRefusedError:
                assert time.monotonic() < end
                await asyncio.sleep(0.01)

    async def line(self, wanted: str = "") -> str:
        """The next sentence of a formatter, or of any."""
        while True:
            line = (await asyncio.wait_for(self._reader.readline(), DEADLINE_S)).decode()
            assert line.endswith("\r\n"), line
            if line[3:6] == wanted or not wanted:
                return line


def test_who_connects_is_sent_every_sentence() -> None:
    async def scenario() -> None:
        port = free_port()
        async with sailing(nmea_tcp, port=port):
            listeners = [await Listener().connect(port) for _ in range(3)]
            for listener in listeners:
                for formatter in ("HDT", "THS", "HDG", "HDM", "ROT", "XDR", "GGA", "RMC"):
                    assert (await listener.line(formatter)).startswith(f"$GP{formatter},")

    asyncio.run(scenario())


def test_no_heading_is_sent_twice_and_a_stale_one_is_void() -> None:
    async def scenario() -> None:
        port = free_port()
        async with sailing(nmea_tcp, port=port) as boat:
            listener = await Listener().connect(port)
            seen = [await listener.line("HDT") for _ in range(5)]
            boat.sails = False
            while not (line := await listener.line()).startswith("$GPTHS,,V"):
                if line.startswith("$GPHDT"):
                    seen.append(line)
            assert len(seen) == len(set(seen))
            for _ in range(3):
                after = [(await listener.line())[3:6] for _ in range(4)]
                assert "HDT" not in after
            boat.sails = True
            assert (await listener.line("HDT")) not in seen

    asyncio.run(scenario())


def test_another_machine_is_sent_of_a_simulation_only_what_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(broadcast, "is_loopback", lambda _address: False)

    async def scenario(*, allow_simulated: bool) -> set[str]:
        port = free_port()
        outputs = {"allow_simulated": allow_simulated}
        async with sailing(nmea_tcp, STATE._replace(simulated=True), port=port, outputs=outputs):
            listener = await Listener().connect(port)
            return {(await listener.line())[3:6] for _ in range(40)}

    assert asyncio.run(scenario(allow_simulated=False)) == {"THS", "GGA", "RMC"}
    assert asyncio.run(scenario(allow_simulated=True)) >= {"HDT", "HDG", "HDM", "ROT", "XDR", "THS", "GGA", "RMC"}


def test_an_alarm_is_sent_while_it_is_raised() -> None:
    async def scenario() -> None:
        port = free_port()
        async with sailing(nmea_tcp, port=port) as boat:
            listener = await Listener().connect(port)
            await listener.line("HDT")
            boat.sails = False
            assert ",001,A,V,no heading" in await listener.line("ALR")
            boat.sails = True
            while ",001,V,V," not in await listener.line("ALR"):
                pass

    asyncio.run(scenario())


def test_rate_talker_and_sentences_are_as_configured() -> None:
    async def scenario() -> None:
        port = free_port()
        nmea = {"rate_hz": 2.0, "sentences": ["HDT"], "talker": "HE"}
        async with sailing(nmea_tcp, port=port, nmea=nmea):
            listener = await Listener().connect(port)
            lines = [await listener.line() for _ in range(4)]
        assert all(line.startswith("$HEHDT,") for line in lines)
        headings = [float(line.split(",")[1]) for line in lines]
        # 50 estimates a second, 0.1 degrees apart: 25 between two sentences, on a slow machine fewer.
        assert all(after - before >= 1.0 for before, after in pairwise(headings)), headings

    asyncio.run(scenario())


def test_a_datagram_holds_the_sentences_of_a_moment() -> None:
    async def scenario() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
            listener.bind(("127.0.0.1", 0))
            listener.setblocking(False)
            async with sailing(nmea_udp, port=listener.getsockname()[1]):
                received = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(listener, 4096), DEADLINE_S)
        assert re.findall(rb"\$GP([A-Z]{3})", received) == [
            *(b"HDT", b"THS", b"HDG", b"HDM", b"ROT", b"XDR", b"GGA", b"RMC"),
        ]
        assert len(received) < 1400

    asyncio.run(scenario())


class Plotter:
    """The far end of a pty."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(slave))
        os.close(slave)
        self.received = b""

    async def until(self, pattern: bytes) -> re.Match[bytes]:
        """Read until the pattern has come."""
        end = time.monotonic() + DEADLINE_S
        while not (found := re.search(pattern, self.received)):
            assert time.monotonic() < end, self.received[-500:]
            try:
                self.received += os.read(self.master, 4096)
            except OSError:  # nothing there, or nobody has opened the other end
                await asyncio.sleep(0.01)
        return found

    def unplug(self) -> None:
        os.close(self.master)
        self.link.unlink()


def test_a_line_that_vanishes_is_used_again_when_it_comes_back(tmp_path: Path) -> None:
    async def scenario() -> None:
        link = tmp_path / "plotter"
        async with sailing(nmea_serial, port=str(link)):
            for _ in range(2):
                plotter = Plotter(link)
                await plotter.until(rb"\$GPHDT,\d+\.\d\d,T\*..\r\n")
                plotter.unplug()

    asyncio.run(scenario())


def test_a_pty_is_on_this_machine_and_gets_simulated_sentences(tmp_path: Path) -> None:
    async def scenario() -> None:
        plotter = Plotter(tmp_path / "plotter")
        async with sailing(nmea_serial, STATE._replace(simulated=True), port=str(plotter.link)):
            await plotter.until(rb"\$GPHDT,")
            await plotter.until(rb"\$GPTHS,\d+\.\d\d,S\*")
            await plotter.until(rb"\$GPRMC,[^\n]*,V,[^\n]*,S\*")

    asyncio.run(scenario())


def test_a_pty_that_nobody_reads_keeps_little_that_is_old_and_no_halves(tmp_path: Path) -> None:
    plotter = Plotter(tmp_path / "plotter")
    line = SerialLine(str(plotter.link), 38400)
    chunk = b"$GPHDT,%03d.00,T*00\r\n"
    number = 0
    for now_s in range(3000):  # ten a second; the pty holds 13 kB
        number = now_s % 1000
        line.send(chunk % number * 10, now_s / 10.0)
    assert line.lost > 0
    received = b""
    with contextlib.suppress(BlockingIOError):
        while True:
            received += os.read(plotter.master, 65536)
    # The kernel's line discipline keeps 4 kB that no flush reaches; beyond them all is of the last ten seconds.
    headings = [int(found) for found in re.findall(rb"\r\n\$GPHDT,(\d{3})\.00,T\*00(?=\r\n)", received[4096:])]
    assert headings
    assert all((number - heading) % 1000 <= 100 for heading in headings), headings
    cut = [text for text in received.split(b"\r\n") if not re.fullmatch(rb"(\$GPHDT,\d{3}\.00,T\*00)?", text)]
    assert all(text.count(b"$") <= 1 for text in cut), cut  # none runs into the next
    assert len(cut) <= 10
    line.close()
    plotter.unplug()


@pytest.mark.parametrize(
    ("key", "value", "why"),
    [
        ("nmea.talker", "GPS", "two capital letters"),
        ("nmea.talker", "g1", "two capital letters"),
        ("nmea.rate_hz", 20, "from 1 to 10"),
        ("nmea.sentences", ["HDT", "HTD"], "did you mean"),
        ("nmea_serial.port", "socket://boat:10110", "nmea_tcp"),
        ("nmea_tcp.port", 0, "from 1 to 65535"),
    ],
)
def test_a_wrong_setting_is_refused_in_a_line(key: str, value: object, why: str) -> None:
    with pytest.raises(ConfigError, match=why) as refused:
        apply_flat(Config(), {f"outputs.{key}": value}, "tinyekf.toml")
    assert f"outputs.{key}" in str(refused.value)
    assert "\n" not in str(refused.value)
