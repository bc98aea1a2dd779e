"""The tasks of the papers: what they are called, which of them run, and how they are named on a keyboard.

Polls are named as their sources, then come the stages of the weighing and the filters. Whoever switches one (console,
control socket, configuration) ends in `LiveRun`, which tells supervisor, fusion and recording at one place of the
stream. docs/tasks.md says what stopping each of them means.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import NamedTuple

ALL = "all"
STAGES = ("cnw-s1", "cnw-s2", "cnw-s3")
_GPS_KEYS, _FILTER_KEYS = "12345678", "qwertyuo"
ALL_KEY = "a"


class TaskError(ValueError):
    """A task that does not exist: one line saying which there are."""


class Switch(NamedTuple):
    """A request to start or stop a task, or `ALL` of them."""

    name: str
    running: bool


def task_names(sources: Sequence[str], n_gps: int) -> tuple[str, ...]:
    """The tasks of a boat with these sources and receivers gps1 to gps`n_gps`, in the papers' order."""
    return (*sources, "cnw-s1", "cnw-s2", *(f"ekf{i + 1}" for i in range(n_gps)), "cnw-s3")


def task_key(name: str) -> str:
    """The key that starts and stops the task at the console."""
    if name.startswith("gps"):
        return _GPS_KEYS[int(name[3:]) - 1]
    if name.startswith("ekf"):
        return _FILTER_KEYS[int(name[3:]) - 1]
    return {"compass": "c", "imu": "i", "cnw-s1": "s", "cnw-s2": "d", "cnw-s3": "f"}[name]


class Tasks:
    """Which tasks there are, and which of them run."""

    def __init__(self, names: Iterable[str], stopped: Iterable[str] = ()) -> None:
        """All of `names` run but those `stopped`; TaskError when one of these is no task."""
        self._running = dict.fromkeys(names, True)
        for name in stopped:
            for task in self.named(name):
                self._running[task] = False

    @property
    def running(self) -> dict[str, bool]:
        """Whether each task runs, by name."""
        return dict(self._running)

    @property
    def stopped(self) -> tuple[str, ...]:
        """The tasks that do not run."""
        return tuple(name for name, running in self._running.items() if not running)

    def named(self, name: str) -> tuple[str, ...]:
        """The task `name`, or all of them for `ALL`; TaskError when there is none of that name."""
        if name == ALL:
            return tuple(self._running)
        if name not in self._running:
            close = get_close_matches(name, self._running, 1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(self._running)} and {ALL}"
            raise TaskError(f"no task {name!r}; {hint}")
        return (name,)

    def toggled(self, key: str) -> Switch | None:
        """What the key pressed at the console asks for; None for a key without a meaning."""
        if key == ALL_KEY:
            return Switch(ALL, running=bool(self.stopped))
        return next((Switch(name, not on) for name, on in self._running.items() if task_key(name) == key), None)

    def switch(self, wanted: Switch) -> tuple[str, ...]:
        """Note the switch; the tasks whose state it changes. TaskError when there is no such task."""
        changed = tuple(task for task in self.named(wanted.name) if self._running[task] != wanted.running)
        for task in changed:
            self._running[task] = wanted.running
        return changed
