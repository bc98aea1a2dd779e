"""The live program: workers' messages into the fusion, lines and rows into the writers, the state to the console.

    supervisor ──messages──> fusion ──rows──> heading CSV
         (one process per device)  └──lines──> recording        in the order in which they were processed

One thread does all of it and waits for nobody: files are written, and the console drawn, behind its back.
"""

from __future__ import annotations

import logging
import time
from collections import deque
from contextlib import ExitStack
from datetime import UTC, datetime

from acquisition.device import DeviceSettings, DeviceState
from acquisition.message import LINE, RESTART, SILENT
from acquisition.recording import RecordingWriter
from acquisition.sample import SAMPLE_SIZE, GpsSample, unpack
from acquisition.supervisor import Supervisor
from tinyekf_py.config import Config, result_config
from tinyekf_py.console import ConsoleView
from tinyekf_py.estimate import Estimate
from tinyekf_py.fusion import fusion_of
from tinyekf_py.heading_csv import HeadingCsvWriter
from tinyekf_py.view_state import SensorRow, ViewState

WAIT_S = 0.25  # longest wait for messages: how soon a stop is noticed when no device speaks
VIEW_PERIOD_S = 0.25
_NOTICES = 5

_log = logging.getLogger(__name__)


class LiveRun:
    """One run over the configured devices, from its start to its end."""

    def __init__(self, config: Config, *, start_us: int, simulated: bool = False) -> None:
        """Devices are opened and files begun by `run`; `start_us` is the zero of all stamps, monotonic."""
        self._config = config
        self._start_us = start_us
        self._start_utc = datetime.now(UTC)
        self._simulated = simulated
        self._fusion = fusion_of(config)
        self._ending = False
        self._newest: Estimate | None = None
        self._newest_at = 0.0
        self._last_records: dict[str, bytes] = {}
        self._notices: deque[str] = deque(maxlen=_NOTICES)

    @property
    def notices(self) -> deque[str]:
        """The latest one-line messages, as the console shows them: whoever logs may append to it."""
        return self._notices

    def stop(self) -> None:
        """End `run` soon; may be called from a signal handler."""
        self._ending = True

    def run(self, duration_s: float | None = None, view: ConsoleView | None = None) -> None:
        """Run until `stop`, or for `duration_s`. RecordingError or HeadingCsvError when a file cannot be begun."""
        outputs = self._config.outputs
        with ExitStack() as stack:
            recording = csv = None
            if outputs.recording:
                recording = RecordingWriter(outputs.recording, self._start_utc, result_config(self._config))
                stack.callback(recording.close)
            if outputs.csv:
                csv = HeadingCsvWriter(outputs.csv, self._fusion.n_gps)
                stack.callback(csv.close)
            supervisor = Supervisor(device_settings(self._config), self._start_us)
            stack.callback(supervisor.close)
            if view is not None:
                stack.enter_context(view)
            self._loop(supervisor, recording, csv, duration_s, view)

    def _loop(
        self,
        supervisor: Supervisor,
        recording: RecordingWriter | None,
        csv: HeadingCsvWriter | None,
        duration_s: float | None,
        view: ConsoleView | None,
    ) -> None:
        end = float("inf") if duration_s is None else self._start_us / 1e6 + duration_s
        next_view = 0.0
        while not self._ending and (now := time.monotonic()) < end:
            for name, message in supervisor.poll(min(WAIT_S, end - now)):
                if message.kind == LINE:
                    if recording is not None:
                        recording.line(message.t_us, name, message.line)
                    if message.samples:
                        self._take(name, message.samples, csv)
                elif message.kind == RESTART and recording is not None:
                    recording.event(message.t_us, "restart", name)
            if view is not None and now >= next_view:
                next_view = now + VIEW_PERIOD_S
                view.show(self._view_state(supervisor.states))

    def _take(self, name: str, records: bytes, csv: HeadingCsvWriter | None) -> None:
        rows = self._fusion.feed_records(records)
        self._last_records[name] = records[-SAMPLE_SIZE:]
        if rows:
            self._newest = rows[-1]
            self._newest_at = time.monotonic()
            if csv is not None:
                for row in rows:
                    csv.row(row)
            for notice in self._fusion.take_notices():
                _log.warning("%s", notice)

    def _view_state(self, states: dict[str, DeviceState]) -> ViewState:
        elapsed_s = (time.monotonic_ns() // 1000 - self._start_us) / 1e6
        return ViewState(
            estimate=self._newest,
            estimate_age_s=time.monotonic() - self._newest_at,
            sensors=tuple(self._sensor_row(state, elapsed_s) for state in states.values()),
            elapsed_s=elapsed_s,
            method=self._fusion.method,
            recording=self._config.outputs.recording,
            simulated=self._simulated,
            notices=tuple(self._notices),
        )

    def _sensor_row(self, state: DeviceState, elapsed_s: float) -> SensorRow:
        record = self._last_records.get(state.name)
        sample = unpack(record) if record else None
        gps = sample if isinstance(sample, GpsSample) else None
        weight = float("nan")
        if gps is not None and self._newest is not None:
            weight = self._newest.weights[gps.source]
        return SensorRow(
            name=state.name,
            port_state="stale" if state.port_state == SILENT else state.port_state,
            rate_hz=state.rate_hz,
            age_s=elapsed_s - sample.t_us / 1e6 if sample else float("nan"),
            fix_quality=gps.fix_quality if gps else -1,
            hdop=gps.hdop if gps else float("nan"),
            weight=weight,
            errors=state.errors,
            last_error=state.last_error,
        )


def device_settings(config: Config) -> list[DeviceSettings]:
    """The devices that a configuration has aboard, as the supervisor takes them."""
    return [
        DeviceSettings(
            name=name,
            port=config.sensors[name].port,
            driver=config.sensors[name].driver,
            baud=config.sensors[name].baud,
            options=config.decoder_options(name),
        )
        for name in config.sources
    ]
