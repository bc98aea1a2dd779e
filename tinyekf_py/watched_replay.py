"""A replay at a pace, as the console and the outputs see it: the boat sails again, but nobody can steer her.

It counts as simulated, whatever was recorded: what it shows is not now.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress

from acquisition.recording import Event
from tinyekf_py.control_socket import Request
from tinyekf_py.estimate import Estimate
from tinyekf_py.instruments import Instruments
from tinyekf_py.replay import Replay
from tinyekf_py.tasks import Switch, TaskError, Tasks, task_key, task_names
from tinyekf_py.view_state import MAX_SENSOR_AGE_S, NAN, SensorRow, TaskRow, ViewState, position_of

_RATE_PERIOD_S = 1.0
_WORK = ("lines", "samples", "unused")


class WatchedReplay:
    """Plays a replay once; `view_state` is how things are at the row that was played last."""

    def __init__(self, replay: Replay) -> None:
        config = replay.config
        self._replay = replay
        self._instruments = Instruments(replay.fusion)
        self._tasks = Tasks(task_names(config.sources, replay.fusion.n_gps), config.tasks.stopped)
        self._newest: Estimate | None = None
        self._newest_at_s = 0.0
        self._rates: dict[str, float] = {}
        self._rated = Counter[str]()
        self._rated_us = 0

    def rows(self, speed: float, wait: Callable[[float], bool]) -> Iterator[Estimate]:
        """The rows, each when it is due, at `speed` times real time; `wait(seconds)` says True to end early."""
        for row in self._replay.paced(speed, wait, self._take, self._obey):
            self._newest, self._newest_at_s = row, time.monotonic()
            self._rate(row.t_us)
            yield row

    def view_state(self) -> ViewState:
        """As the live program's: all of it at the newest row's moment."""
        newest = self._newest
        t_us = newest.t_us if newest is not None else 0
        return ViewState(
            estimate=newest,
            estimate_age_s=time.monotonic() - self._newest_at_s,
            sensors=tuple(self._row(name, t_us) for name in self._replay.config.sources),
            elapsed_s=t_us / 1e6,
            method=self._replay.fusion.method,
            simulated=True,
            tasks=tuple(TaskRow(task_key(name), name, on) for name, on in self._tasks.running.items()),
            navigation=self._instruments.navigation(t_us, newest.t_us if newest is not None else None),
            position_of=position_of(self._replay.fusion.method, self._replay.config.vessel.antennas_m),
        )

    def answer(self, request: Request) -> None:
        """Say to whoever wants to start or stop a task that a replay has none to give; from any thread."""
        if request.words == ("status",):
            mode = self._newest.mode if self._newest is not None else "invalid"
            request.answer.put({"mode": mode, "tasks": self._tasks.running})
        else:
            request.answer.put({"error": "a replay does what was recorded; start and stop tasks in a live run"})

    def _take(self, name: str, records: bytes) -> None:
        self._instruments.take(name, records)

    def _obey(self, event: Event) -> None:
        with suppress(TaskError):  # of a boat with more tasks
            if event.verb in ("start", "stop"):
                self._tasks.switch(Switch(event.name, event.verb == "start"))

    def _row(self, name: str, t_us: int) -> SensorRow:
        row = self._instruments.sensor_row(name, t_us)
        counts = self._replay.counts[name]
        dropped = {reason: count for reason, count in counts.items() if count and reason not in _WORK}
        port_state = "open" if row.age_s <= MAX_SENSOR_AGE_S else "stale" if row.age_s > 0.0 else "no data"
        return row._replace(
            port_state=port_state if self._tasks.running[name] else "stopped",
            rate_hz=self._rates.get(name, NAN),
            lines=counts["lines"],
            samples=counts["samples"],
            errors=sum(dropped.values()),
            dropped=tuple(dropped.items()),
        )

    def _rate(self, t_us: int) -> None:
        elapsed_s = (t_us - self._rated_us) / 1e6
        if elapsed_s >= _RATE_PERIOD_S:
            samples = Counter({name: counts["samples"] for name, counts in self._replay.counts.items()})
            if self._rated:
                self._rates = {name: (samples[name] - self._rated[name]) / elapsed_s for name in samples}
            self._rated, self._rated_us = samples, t_us
