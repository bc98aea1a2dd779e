"""The live program: workers' messages into the fusion, lines and rows into the writers, the state to the console.

    supervisor ──messages──> fusion ──rows──> heading CSV
         (one process per device)  └──lines──> recording        in the order in which they were processed

One thread does all of it and waits for nobody: files are written, and the console drawn, behind its back.
"""

from __future__ import annotations

import logging
import math
import queue
import time
from collections import deque
from collections.abc import Mapping
from contextlib import ExitStack
from datetime import UTC, datetime

from acquisition.background_file import Rotation
from acquisition.device import DeviceSettings, DeviceState
from acquisition.message import LINE, LOST, PORT, RESTART
from acquisition.plug_monitor import open_plug_monitor
from acquisition.recording_writer import RecordingWriter
from acquisition.supervisor import Supervisor
from tinyekf_py.config import Config, result_config
from tinyekf_py.console import ConsoleView
from tinyekf_py.control_socket import ControlServer, Request, listening_path
from tinyekf_py.estimate import Estimate
from tinyekf_py.fusion import fusion_of
from tinyekf_py.heading_csv import HeadingCsvWriter
from tinyekf_py.instruments import Instruments
from tinyekf_py.outputs.launcher import OutputProcess
from tinyekf_py.outputs.settings import switched_on
from tinyekf_py.service_notify import ServiceNotifier
from tinyekf_py.tasks import ALL, Switch, TaskError, Tasks, task_key, task_names
from tinyekf_py.view_state import TaskRow, ViewState, current_estimate, position_of

WAIT_S = 0.25  # longest wait for messages: how soon a stop is noticed when no device speaks
VIEW_PERIOD_S = 0.25
FRAME_PERIOD_S = 0.5  # longest time between two frames to the outputs when there is nothing new
PAUSE_S = 0.003  # sensors speak in bursts: a new estimate goes to the outputs in the first pause of this length,
PATIENCE_S = 0.03  # or so long after it was made
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
        self._waits_since = math.inf  # when an estimate was made that the outputs have not been given
        self._instruments = Instruments(self._fusion)
        self._notices: deque[str] = deque(maxlen=_NOTICES)
        self._tasks = Tasks(task_names(config.sources, self._fusion.n_gps), config.tasks.stopped)
        self._notifier = ServiceNotifier()
        self._requests: queue.SimpleQueue[Request] = queue.SimpleQueue()
        self._recording: RecordingWriter | None = None
        self._csv: HeadingCsvWriter | None = None
        self._outputs: OutputProcess | None = None

    @property
    def notices(self) -> deque[str]:
        """The latest one-line messages, as the console shows them: whoever logs may append to it."""
        return self._notices

    def stop(self) -> None:
        """End `run` soon; may be called from a signal handler."""
        self._ending = True

    def ask(self, request: Request) -> None:
        """Let the loop answer `request` (status, start TASK, stop TASK) between two messages; from any thread."""
        self._requests.put(request)

    def key_pressed(self, key: str) -> None:
        """Switch the task of that key, from any thread."""
        wanted = self._tasks.toggled(key)
        if wanted is not None:
            self.ask(Request(("start" if wanted.running else "stop", wanted.name), queue.SimpleQueue()))

    def run(self, duration_s: float | None = None, view: ConsoleView | None = None) -> None:
        """Run until `stop`, or for `duration_s`. RecordingError or HeadingCsvError when a file cannot be begun."""
        outputs = self._config.outputs
        with ExitStack() as stack:
            if outputs.recording:
                limits = self._config.recording
                rotation = Rotation(round(limits.max_mb * 1e6), limits.max_hours * 3600.0, limits.keep)
                config = result_config(self._config)
                self._recording = RecordingWriter(outputs.recording, self._start_utc, config, rotation)
                stack.callback(self._recording.close)
            if outputs.csv:
                self._csv = HeadingCsvWriter(outputs.csv, self._fusion.n_gps)
                stack.callback(self._csv.close)
            supervisor = Supervisor(device_settings(self._config), self._start_us, open_plug_monitor())
            stack.callback(supervisor.close)
            for name in self._tasks.stopped:
                self._switch(0, name, running=False)
            stack.enter_context(ControlServer(listening_path(), self.ask))
            served = switched_on(outputs)
            if served:
                self._outputs = stack.enter_context(OutputProcess(served, self.ask))
            if view is not None:
                stack.enter_context(view)
            stack.enter_context(self._notifier)
            self._loop(supervisor, duration_s, view)

    def _loop(self, supervisor: Supervisor, duration_s: float | None, view: ConsoleView | None) -> None:
        recording = self._recording
        end = float("inf") if duration_s is None else self._start_us / 1e6 + duration_s
        next_view = next_frame = 0.0
        while not self._ending and (now := time.monotonic()) < end:
            new = self._outputs is not None and self._waits_since < math.inf
            messages = supervisor.poll(min(PAUSE_S if new else WAIT_S, end - now))
            for name, message in messages:
                if message.kind == LINE:
                    if recording is not None:
                        recording.line(message.t_us, name, message.line)
                    if message.samples:
                        self._take(name, message.samples)
                elif message.kind == RESTART and recording is not None:
                    recording.event(message.t_us, "restart", name)
                elif message.kind == PORT and message.text.startswith(f"{LOST} "):
                    self._lose(message.t_us, name)
            while not self._requests.empty():
                request = self._requests.get()
                request.answer.put(self._answer(request.words, supervisor))
            self._notifier.turned(now, self._newest.mode if self._newest is not None else "waiting for sensors")
            paused = new and not messages
            if self._outputs is not None and (paused or now >= min(next_frame, self._waits_since + PATIENCE_S)):
                self._waits_since, next_frame = math.inf, now + FRAME_PERIOD_S
                self._outputs.offer(self._view_state(supervisor.states))
            if view is not None and now >= next_view:
                next_view = now + VIEW_PERIOD_S
                view.show(self._view_state(supervisor.states))

    def _answer(self, words: tuple[str, ...], supervisor: Supervisor) -> Mapping[str, object]:
        """Obey a request of the control socket or the console, and say how things are then."""
        if len(words) == 2 and words[0] in ("start", "stop"):
            try:
                changed = self._tasks.switch(Switch(words[1], words[0] == "start"))
            except TaskError as error:
                return {"error": str(error)}
            t_us = time.monotonic_ns() // 1000 - self._start_us
            for name in changed:
                self._switch(t_us, name, running=words[0] == "start")
                if name in supervisor.states:
                    supervisor.set_polling(name, words[0] == "start")
                _log.info("%s %s", name, "started" if words[0] == "start" else "stopped")
        elif words != ("status",):
            return {"error": f"{' '.join(words)!r} is no request; say status, start TASK or stop TASK"}
        return self._status(supervisor.states)

    def _lose(self, t_us: int, name: str) -> None:
        """A port hung up: tell the fusion, and say so at the same place of the recording."""
        if self._recording is not None:
            self._recording.event(t_us, LOST, name)
        self._put_out(self._fusion.lose(t_us, name))

    def _switch(self, t_us: int, name: str, *, running: bool) -> None:
        """Start or stop a task in the fusion, and say so at the same place of the recording."""
        if self._recording is not None:
            self._recording.event(t_us, "start" if running else "stop", name)
        self._put_out(self._fusion.set_task(t_us, name, running))

    def _take(self, name: str, records: bytes) -> None:
        rows = self._fusion.feed_records(records)
        self._instruments.take(name, records)
        self._put_out(rows)

    def _put_out(self, rows: list[Estimate]) -> None:
        if rows:
            self._newest = rows[-1]
            self._newest_at = time.monotonic()
            self._waits_since = min(self._waits_since, self._newest_at)
            if self._csv is not None:
                for row in rows:
                    self._csv.row(row)
            for notice in self._fusion.take_notices():
                _log.warning("%s", notice)

    def _view_state(self, states: dict[str, DeviceState]) -> ViewState:
        elapsed_us = time.monotonic_ns() // 1000 - self._start_us
        recording = self._recording
        return ViewState(
            estimate=self._newest,
            estimate_age_s=time.monotonic() - self._newest_at,
            sensors=tuple(self._instruments.device_row(state, elapsed_us) for state in states.values()),
            elapsed_s=elapsed_us / 1e6,
            method=self._fusion.method,
            recording=self._config.outputs.recording,
            simulated=self._simulated,
            notices=tuple(self._notices),
            tasks=tuple(TaskRow(task_key(name), name, on) for name, on in self._tasks.running.items()),
            navigation=self._instruments.navigation(elapsed_us, self._newest.t_us if self._newest else None),
            recording_failure=recording.failure if recording is not None else "",
            recording_lost=recording.lost if recording is not None else 0,
            position_of=position_of(self._fusion.method, self._config.vessel.antennas_m),
        )

    def _status(self, states: dict[str, DeviceState]) -> Mapping[str, object]:
        """Everything a second terminal is told, as JSON takes it: null for what is not known."""
        view = self._view_state(states)
        estimate = current_estimate(view, 0.0)
        sensors = {}
        for row in view.sensors:
            sensors[row.name] = {
                "port_state": row.port_state,
                "port_text": row.port_text,
                "pid": states[row.name].pid,
                "rate_hz": round(row.rate_hz, 2) if math.isfinite(row.rate_hz) else None,
                "age_s": round(row.age_s, 3) if math.isfinite(row.age_s) else None,
                "restarts": row.restarts,
                "stale_s": row.down_s,
                "lines": row.lines,
                "samples": row.samples,
                "dropped": dict(row.dropped),
                "last_error": row.last_error,
            }
        return {
            "t_s": round(view.elapsed_s, 3),
            "method": view.method,
            "mode": estimate.mode,
            "pos_mode": estimate.pos_mode,
            "heading_deg": round(estimate.heading_deg, 4) if math.isfinite(estimate.heading_deg) else None,
            "tasks": self._tasks.running,
            "sensors": sensors,
            "recording": {
                "path": view.recording,
                "failure": view.recording_failure,
                "lost": view.recording_lost,
            },
        }


def device_settings(config: Config) -> list[DeviceSettings]:
    """The devices that a configuration has aboard, as the supervisor takes them."""
    return [
        DeviceSettings(
            name=name,
            port=config.sensors[name].port,
            driver=config.sensors[name].driver,
            baud=config.sensors[name].baud,
            enabled=name not in config.tasks.stopped and ALL not in config.tasks.stopped,
            options=config.decoder_options(name),
        )
        for name in config.sources
    ]
