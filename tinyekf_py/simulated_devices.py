"""Five simulated devices in a process of their own, for `run --simulate`: real ptys, real protocols, real rates."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from tinyekf_py.config import Config, apply_flat


class SimulationError(RuntimeError):
    """The simulator did not start: one line saying why."""


class SimulatedDevices:
    """The simulator's process; a context manager that ends it."""

    def __init__(self, options: Sequence[str] = (), *, truth: Path | None = None, start_us: int = 0) -> None:
        """`options` are those of `tinyekf simulate --ptys`; `truth` gets the truth CSV, its zero at `start_us`."""
        command = [sys.executable, "-m", "acquisition.simulator", "--ptys", *options]
        if truth is not None:
            command += ["--truth", str(truth), "--start-us", str(start_us)]
        # A session of its own: Ctrl-C in the terminal ends the program, which ends the simulator last.
        with tempfile.TemporaryFile("w+") as complaints:  # a pipe that nobody empties would stop it one day
            self._process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=complaints, text=True, start_new_session=True
            )
            assert self._process.stdout is not None
            announcement = self._process.stdout.readline()
            if not announcement:
                self._process.wait()
                complaints.seek(0)
                complaint = complaints.read().strip().removeprefix("tinyekf simulate: ")
                raise SimulationError(complaint or "the simulator ended before it began")
        self._announced = json.loads(announcement)

    def configure(self, config: Config) -> Config:
        """`config` with the simulated ports, variation and antennas, without the devices that the scenario lacks."""
        flat: dict[str, object] = {f"vessel.{key}": self._announced[key] for key in ("variation_deg", "antennas_m")}
        for name in config.sources:
            if name in self._announced["ports"]:
                flat[f"sensors.{name}.port"] = self._announced["ports"][name]
            else:
                flat[f"sensors.{name}.enabled"] = False
        return apply_flat(config, flat, "the simulator")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
