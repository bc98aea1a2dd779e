"""A soak in simulated time: a day through the live code path, as fast as it goes.

    python bench/live/soak_simulated.py --hours 24

Real workers, pipes, supervisor, fusion, recording (rotated) and heading CSV; only the clock and the ports are not: each
worker takes the lines of a ten-minute voyage, over and over, as if read at their stamps, and waits for the pipe when it
is full. The parent merges by stamp, for no clock holds the workers together. Prints one JSON object: growth of
resident memory and open files after the first simulated hour, and lines that did not arrive.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from soak_real import open_files, rss_kb

from acquisition import supervisor
from acquisition.child_process import end_with_parent
from acquisition.device import DeviceSettings, DeviceState
from acquisition.message import LINE, OPEN, Message
from acquisition.port_watch import NEVER_US
from acquisition.recording import Line, RecordingReader, read_recording
from acquisition.supervisor import Supervisor
from acquisition.worker import Worker, WorkerSettings
from acquisition.worker_process import WorkerProcess
from tinyekf_py import live
from tinyekf_py.config import Config, apply_flat

CYCLE_S = 600
FLUSH_US = 10_000_000  # so far the disk may be behind: what waits for it is memory too
HOUR_US = 3_600_000_000
BATCH = 400
PIPE_BYTES = 1 << 16  # more than a real one, for fewer turns of the processes
AHEAD = 500  # messages of a device that may wait here for those of another

Burst = tuple[int, bytes]


class Cassette:
    """In place of the port watch: a voyage's reads, over and over, and the clock that they tell."""

    state = OPEN
    due_us = NEVER_US
    opens = 1

    def __init__(self, bursts: list[Burst], cycles: int) -> None:
        self._reads = self._play(bursts, cycles)
        self._next: Burst | None = next(self._reads)
        self.now_us = 0
        self.held: Callable[[], bool] = lambda: False  # whether the worker still has something to tell
        self._fd = os.open("/dev/zero", os.O_RDONLY)  # readable whenever asked

    @staticmethod
    def _play(bursts: list[Burst], cycles: int) -> Iterator[Burst]:
        for cycle in range(cycles):
            for t_us, chunk in bursts:
                yield t_us + cycle * CYCLE_S * 1_000_000, chunk

    @property
    def fd(self) -> int:
        return -1 if self._next is None or self.held() else self._fd

    def start(self, now_us: int) -> None: ...

    def down_us(self, now_us: int) -> int:
        return 0

    def read(self, now_us: int, size: int) -> bytes:
        if self._next is None:
            return b""
        self.now_us, chunk = self._next
        self._next = next(self._reads, None)
        return chunk


class SimulatedWorker(Worker):
    """A worker on a cassette: its clock is that of the cassette, which waits while the pipe is full."""

    def __init__(self, settings: WorkerSettings, out_fd: int, control_fd: int, cassette: Cassette) -> None:
        self._cassette = cassette
        super().__init__(settings, out_fd, control_fd)
        self._watch = cassette  # type: ignore[assignment]
        cassette.held = lambda: self._outbox.waiting

    def _now_us(self) -> int:
        return self._cassette.now_us


def work(out_fd: int, control_fd: int, settings: WorkerSettings) -> None:
    """The child."""
    end_with_parent(settings.parent_pid)
    recording, cycles = os.environ["SOAK_RECORDING"], int(os.environ["SOAK_CYCLES"])
    bursts: list[Burst] = []
    for entry in read_recording(recording):
        if isinstance(entry, Line) and entry.source == settings.name:
            same = bursts and bursts[-1][0] == entry.t_us
            before = bursts.pop()[1] if same else b""
            bursts.append((entry.t_us, before + entry.line + b"\r\n"))
    SimulatedWorker(settings, out_fd, control_fd, Cassette(bursts, cycles)).run()


class SimulatedProcess(WorkerProcess):
    """A worker process that runs `work`."""

    def _start(
        self, settings: DeviceSettings, start_us: int, polling: bool, out_fd: int, control_fd: int
    ) -> subprocess.Popen[bytes]:
        fcntl.fcntl(out_fd, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        told = WorkerSettings(
            settings.name, settings.port, settings.driver, settings.baud, dict(settings.options), polling, start_us,
            os.getpid(),
        )  # fmt: skip
        command = [sys.executable, __file__, "--work", str(out_fd), str(control_fd), json.dumps(told._asdict())]
        return subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=(out_fd, control_fd), process_group=0)


class Soak:
    """The run, and what was seen of it each simulated hour."""

    def __init__(self, config: Config, hours: float) -> None:
        self.run = live.LiveRun(config, start_us=time.monotonic_ns() // 1000)
        self.waiting: dict[str, deque[Message]] = {name: deque() for name in config.sources}
        self.lines: Counter[str] = Counter()
        self._end_us = hours * 3.6e9
        self._now_us = 0
        self._next_flush_us = self._next_look_us = 0
        self._looks: list[dict[str, Any]] = []
        self._dropped: dict[str, Any] = {}
        self._began = time.monotonic()

    def passed(self, states: dict[str, DeviceState], t_us: int) -> None:
        """So far has the run come: let the disk follow, look at the processes, end."""
        self._now_us = t_us
        if t_us >= self._next_flush_us:
            self._next_flush_us += FLUSH_US
            for file in (self.run._recording, self.run._csv):
                assert file is not None
                file.flush()
        if t_us >= self._next_look_us:
            self._next_look_us += HOUR_US
            pids = {"fusion": os.getpid()} | {name: state.pid for name, state in states.items()}
            self._looks.append(
                {
                    "hours": round(t_us / HOUR_US, 2),
                    "rss_kb": {name: rss_kb(pid) for name, pid in pids.items()},
                    "fds": {name: open_files(pid) for name, pid in pids.items()},
                }
            )
            print(json.dumps(self._looks[-1]), file=sys.stderr)
        if t_us >= self._end_us:
            self._dropped = {name: state.dropped for name, state in states.items()}
            self.run.stop()

    def result(self, cycle: RecordingReader) -> dict[str, Any]:
        """The figures; lines that did not arrive are counted against the cycle."""
        warm, last = self._looks[min(1, len(self._looks) - 1)], self._looks[-1]
        stamps: dict[str, list[int]] = {name: [] for name in self.waiting}
        for entry in cycle:
            if isinstance(entry, Line):
                stamps[entry.source].append(entry.t_us)
        cycles, rest_us = divmod(self._now_us, CYCLE_S * 1_000_000)
        sent = {name: cycles * len(all_) + sum(t_us <= rest_us for t_us in all_) for name, all_ in stamps.items()}
        assert self.run._recording is not None
        return {
            "hours": round(self._now_us / HOUR_US, 2),
            "real_minutes": round((time.monotonic() - self._began) / 60.0, 1),
            "rss_warm_kb": warm["rss_kb"],
            "rss_growth_kb": {name: last["rss_kb"][name] - kb for name, kb in warm["rss_kb"].items()},
            "fd_growth": {name: last["fds"][name] - n for name, n in warm["fds"].items()},
            "lines": dict(self.lines),
            "missing_lines": {name: n - self.lines[name] for name, n in sent.items()},
            "dropped": self._dropped,
            "not_recorded": self.run._recording.lost,
            "verdicts": self.run._fusion.verdicts,
        }


class Merging(Supervisor):
    """A supervisor that hands on what is earliest, once it has heard of all devices."""

    soak: Soak

    def poll(self, timeout: float) -> list[tuple[str, Message]]:
        """The next few messages, by stamp."""
        soak = self.soak
        messages: list[tuple[str, Message]] = []
        while len(messages) < BATCH:
            while not all(soak.waiting.values()):
                self._hear(1, 1.0)
            name = min(soak.waiting, key=lambda name: soak.waiting[name][0].t_us)
            message = soak.waiting[name].popleft()
            soak.lines[name] += message.kind == LINE
            messages.append((name, message))
        self._hear(AHEAD, 0.0)
        soak.passed(self.states, messages[-1][1].t_us)
        return messages

    def _hear(self, ahead: int, timeout_s: float) -> None:
        """Read from those with fewer than `ahead` messages waiting; the pipe of another fills, and he waits."""
        watched = [w for w in self._watched.values() if len(self.soak.waiting[w.name]) < ahead]
        pipes = {w.process: w for w in watched if w.process is not None}
        for pipe in select.select(list(pipes), [], [], timeout_s)[0]:
            one = pipes[pipe]
            self.soak.waiting[one.name].extend(message for _, message in self._receive(one))


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--work", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work(int(options.work[0]), int(options.work[1]), WorkerSettings(**json.loads(options.work[2])))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        cycle = Path(folder) / "cycle.rec"
        simulate = [sys.executable, "-m", "tinyekf_py.cli", "simulate", str(cycle), f"{folder}/truth.csv"]
        subprocess.run([*simulate, "--duration", str(CYCLE_S)], check=True, stdout=subprocess.DEVNULL)
        os.environ |= {"SOAK_RECORDING": str(cycle), "SOAK_CYCLES": str(int(options.hours * 3600 / CYCLE_S) + 1)}
        os.environ["XDG_RUNTIME_DIR"] = folder
        reader = read_recording(cycle)
        flat: dict[str, object] = {"outputs.recording": f"{folder}/r.rec", "outputs.csv": f"{folder}/r.csv"}
        flat |= {"recording.max_mb": 20.0, "recording.keep": 3}
        config = apply_flat(apply_flat(Config(), reader.config, "the cycle"), flat, "the soak")
        soak = Soak(config, options.hours)
        Merging.soak = soak
        vars(live)["Supervisor"] = Merging
        vars(supervisor)["WorkerProcess"] = SimulatedProcess
        soak.run.run()
        print(json.dumps(soak.result(reader), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
