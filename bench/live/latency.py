"""From the last byte of a line at a sensor's pty to the estimate that knows it, and to the row at the output.

    python bench/live/latency.py --seconds 120
    python bench/live/latency.py --seconds 120 --clients 10    # as many pages and chart plotters watch meanwhile

A child process sails five simulated devices at full rates on ptys, noting the time before each line is written. The
live program runs here, with its workers, recording and heading CSV, and notes the time when it has dealt with a line:

- `estimate`: from the line that completes a GPS epoch until fusion has been fed it and gives the estimate of then;
- `read`: the part of it until the worker's read has returned. On a loaded machine this is the kernel: what comes in
  at a tty passes through one of its threads, which waits its turn whatever the priority of our processes;
- `program`: the rest, which is ours: framing, decoding, pipe, recording, fusion;
- `row`: from the line, of whatever sensor, whose sample completes a row of the 100 ms grid until that row is on its
  way to the CSV and the outputs. (An epoch shows in the row of the next grid point, by design up to 100 ms later.)
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import aiohttp
import numpy as np

from acquisition.message import LINE, Message
from acquisition.simulator.grades import GRADES
from acquisition.simulator.ptys import LINK_NAMES, Pty
from acquisition.simulator.scenarios import SCENARIOS
from acquisition.simulator.vessel import STEP_US
from acquisition.simulator.voyage import Voyage
from acquisition.supervisor import Supervisor
from tinyekf_py import live
from tinyekf_py.config import Config, apply_flat
from tinyekf_py.estimate import Estimate
from tinyekf_py.live import LiveRun

WARM_UP_S = 3.0  # from the first line of a device on, not counted
SETTLING_S = 5.0  # from the start until all clients are served, and before the end
PORTS = {"web": 28431, "nmea_tcp": 28432}
HANDSHAKE = (
    "GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
ALIGNED = 30  # lines that must agree to know which line sent is the first received


def sail(log: Path) -> None:
    """The child: print the ports, sail until SIGTERM, then write the lines with their times."""
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: ended.append(number))
    ptys = {name: Pty() for name in LINK_NAMES}
    print(json.dumps({name: port.path for name, port in ptys.items()}), flush=True)
    voyage = Voyage(SCENARIOS["tour"], GRADES["typical"])
    sent: list[tuple[str, int, str]] = []
    due = time.monotonic()
    while not ended:
        due += STEP_US / 1e6
        time.sleep(max(0.0, due - time.monotonic()))
        for _, name, line in voyage.advance():
            began_ns = time.monotonic_ns()
            ptys[name].send([line])
            sent.append((name, began_ns, line.decode("latin-1")))
    log.write_text(json.dumps(sent))


async def watch(web: int, nmea: int, clients: int, seconds: int) -> None:
    """Another child: read the page's stream and NMEA 0183 by TCP, each over `clients` connections; one of each more
    never reads. Prints how often each heard the heading, and the output process' load, when standard input ends."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))  # they stand for other machines: not to be in our way
    heard = [0] * (2 * clients)

    async def page(number: int, session: aiohttp.ClientSession) -> None:
        async with session.ws_connect(f"http://127.0.0.1:{web}/api/stream") as stream:
            async for message in stream:
                heard[number] += message.data.startswith('{"state":')

    async def plotter(number: int) -> None:
        reader, _ = await asyncio.open_connection("127.0.0.1", nmea)
        while line := await reader.readline():
            heard[number] += line[3:6] == b"HDT"

    for port in (web, nmea):
        await listening(port)
    never_read = [socket.create_connection(("127.0.0.1", port)) for port in (web, nmea)]
    never_read[0].sendall(HANDSHAKE.format(port=web).encode())
    async with aiohttp.ClientSession() as session:
        tasks = [asyncio.create_task(page(number, session)) for number in range(clients)]
        tasks += [asyncio.create_task(plotter(clients + number)) for number in range(clients)]
        await asyncio.sleep(SETTLING_S)
        pid, began_s = output_process(), time.monotonic()
        before_s = cpu_s_of(pid)
        await asyncio.sleep(max(seconds - 3 * SETTLING_S, 1.0))
        share = 100.0 * (cpu_s_of(pid) - before_s) / (time.monotonic() - began_s)
        smaps = Path(f"/proc/{pid}/smaps_rollup").read_text()
        pss_kb = next(int(line.split()[1]) for line in smaps.splitlines() if line.startswith("Pss:"))
        await asyncio.to_thread(sys.stdin.read)
        print(json.dumps({"heard": heard, "share": share, "pss_mb": pss_kb / 1024}), flush=True)
        for task in tasks:
            task.cancel()


def output_process() -> int:
    """The process number of our parent's output process."""
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended
            ours = int(stat_of(int(entry.name))[1]) == os.getppid()
            if ours and b"outputs.process" in (entry / "cmdline").read_bytes():
                return int(entry.name)
    raise SystemExit("there is no output process")


def cpu_s_of(pid: int) -> float:
    """Processor time a process has taken."""
    fields = stat_of(pid)
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def stat_of(pid: int) -> list[str]:
    """Fields of /proc/PID/stat from the third, the state, on."""
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


async def listening(port: int) -> None:
    """Wait until something listens at a port."""
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
            return
        except ConnectionRefusedError:
            await asyncio.sleep(0.1)


class Dealt(NamedTuple):
    """A line that the program has dealt with."""

    line: str
    read_us: int  #: its stamp
    done_ns: int = 0  #: monotonic
    made_sample: bool = False
    made_row: bool = False


class TimedRun(LiveRun):
    """A live run that notes, per line, when it was dealt with."""

    def __init__(self, config: Config, start_us: int) -> None:
        super().__init__(config, start_us=start_us)
        self.dealt: dict[str, list[Dealt]] = {name: [] for name in LINK_NAMES}
        self._made_row = False

    def _take(self, name: str, records: bytes) -> None:
        self._made_row = False
        super()._take(name, records)
        assert self._fusion.estimate is not None
        done_ns = time.monotonic_ns()
        self.dealt[name][-1] = self.dealt[name][-1]._replace(done_ns=done_ns, made_sample=True, made_row=self._made_row)

    def _put_out(self, rows: list[Estimate]) -> None:
        super()._put_out(rows)
        self._made_row = bool(rows)


def noting(run: TimedRun) -> type[Supervisor]:
    """A supervisor that notes each line as it is taken from its messages."""

    class Noted(list[tuple[str, Message]]):
        def __iter__(self) -> Iterator[tuple[str, Message]]:
            for name, message in super().__iter__():
                if message.kind == LINE:
                    run.dealt[name].append(Dealt(message.line.decode("latin-1"), message.t_us))
                yield name, message

    class Noting(Supervisor):
        def poll(self, timeout: float) -> list[tuple[str, Message]]:
            return Noted(super().poll(timeout))

    return Noting


def measure(seconds: float, folder: Path, clients: int) -> dict[str, list[float]]:
    """Latencies in milliseconds, by what the module says."""
    start_us = time.monotonic_ns() // 1000
    command = [sys.executable, __file__, "--sail", str(folder / "sent.json")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        assert child.stdout is not None
        ports = json.loads(child.stdout.readline())
        flat: dict[str, object] = {f"sensors.{name}.port": port for name, port in ports.items()}
        flat |= {"outputs.recording": str(folder / "r.rec"), "outputs.csv": str(folder / "r.csv")}
        if clients:
            flat |= {f"outputs.{name}.enabled": True for name in PORTS} | {
                f"outputs.{name}.port": port for name, port in PORTS.items()
            }
            watching = [sys.executable, __file__, "--watch", *map(str, PORTS.values()), str(clients), str(int(seconds))]
            watcher = subprocess.Popen(watching, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        run = TimedRun(apply_flat(Config(), flat, "the benchmark"), start_us)
        os.environ["XDG_RUNTIME_DIR"] = str(folder)
        vars(live)["Supervisor"] = noting(run)
        run.run(seconds)
        child.terminate()
        if clients:
            watched = json.loads(watcher.communicate()[0])
            heard = watched["heard"]
            print(f"{len(heard)} clients heard the heading {min(heard)} to {max(heard)} times in {seconds:.0f} s")
            print(f"the output process took {watched['share']:.2f} % of a core, {watched['pss_mb']:.1f} MB PSS")
    sent: dict[str, list[tuple[int, str]]] = {name: [] for name in LINK_NAMES}
    for name, began_ns, line in json.loads((folder / "sent.json").read_text()):
        sent[name].append((began_ns, line))
    latencies: dict[str, list[float]] = {"estimate": [], "read": [], "program": [], "row": []}
    for name, all_dealt in run.dealt.items():
        beginning = [dealt.line for dealt in all_dealt[:ALIGNED]]
        lines = [line for _, line in sent[name]]
        first = next(n for n in range(len(lines)) if lines[n : n + ALIGNED] == beginning)
        for (began_ns, line), dealt in zip(sent[name][first:], all_dealt, strict=False):
            if line != dealt.line:
                raise SystemExit(f"{name}: a line was lost; measure again on a quieter machine")
            if dealt.read_us < all_dealt[0].read_us + WARM_UP_S * 1e6:
                continue
            whole_ms = (dealt.done_ns - began_ns) / 1e6
            if name.startswith("gps") and dealt.made_sample:
                read_ms = (start_us + dealt.read_us) / 1e3 - began_ns / 1e6
                latencies["estimate"].append(whole_ms)
                latencies["read"].append(read_ms)
                latencies["program"].append(whole_ms - read_ms)
            if dealt.made_row:
                latencies["row"].append(whole_ms)
    return latencies


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--sail", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--clients", type=int, default=0, help="pages, and as many chart plotters")
    parser.add_argument("--watch", type=int, nargs=4, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.sail:
        sail(options.sail)
        return 0
    if options.watch:
        asyncio.run(watch(*options.watch))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        latencies = measure(options.seconds, Path(folder), options.clients)
    for what, ms in latencies.items():
        p50, p99, p999 = np.percentile(ms, [50, 99, 99.9])
        figures = f"p50 {p50:.2f}, p99 {p99:.2f}, p99.9 {p999:.2f}, max {max(ms):.2f} ms"
        print(f"{what:9} {len(ms):6} times: {figures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
