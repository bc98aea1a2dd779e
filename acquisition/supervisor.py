"""The supervisor: keeps one worker alive per device and gathers their messages.

It lives in the fusion process, which calls `poll` in its loop and gets messages; it blocks on nobody. A worker that
dies is restarted with back-off, one that gives no sign of life is killed and restarted, all are ended in steps.
A RESTART message stands in the stream where a device's decoder began anew, so that a recording can say so and its
replay does the same.
"""

from __future__ import annotations

import logging
import selectors
import time
from collections.abc import Sequence

from acquisition.device import DeviceSettings, DeviceState
from acquisition.message import HELLO, LINE, OPEN, RESTART, Message, MessageError
from acquisition.plug_monitor import PlugMonitor
from acquisition.watched_device import NEVER, WatchedDevice
from acquisition.worker_process import WorkerProcess

HEARTBEAT_LIMIT_S = 4.0  # a worker that was silent longer hangs: it speaks every second
START_LIMIT_S = 15.0  # until its first word; a slow board takes seconds to start five interpreters
STALL_S = 1.0  # a `poll` this late is our own fault: then no worker is called hung
LATE_S = 0.4  # a `poll` this late finds more in the workers than their pipes hold;
CATCH_UP_S = 0.1  # then all that they hand over within this time is put in order

_log = logging.getLogger(__name__)


class Supervisor:
    """The workers of all devices.

    Call it from one thread, and from one that lives as long as the workers shall: the kernel kills a worker when the
    thread that started it ends.
    """

    def __init__(
        self, devices: Sequence[DeviceSettings], start_us: int, plug_monitor: PlugMonitor | None = None
    ) -> None:
        """Start a worker per enabled device; `start_us` is the recording's start on the monotonic clock.

        `plug_monitor` wakes workers that wait for their device; without one they look once a second.
        """
        self._start_us = start_us
        self._selector = selectors.DefaultSelector()
        self._watched = {device.name: WatchedDevice(device) for device in devices}
        self._ended: list[WorkerProcess] = []  # killed, not yet reaped
        self._polled_at = time.monotonic()
        self._plug_monitor = plug_monitor
        if plug_monitor is not None:
            self._selector.register(plug_monitor, selectors.EVENT_READ, None)
        for watched in self._watched.values():
            if watched.state.polling:
                self._spawn(watched)

    @property
    def states(self) -> dict[str, DeviceState]:
        """What is known about each device, by name; kept up to date in place by `poll`."""
        return {name: watched.state for name, watched in self._watched.items()}

    def fileno(self) -> int:
        """A descriptor that is readable when `poll` has something to do: for the caller's own selector."""
        return self._selector.fileno()

    def poll(self, timeout: float) -> list[tuple[str, Message]]:
        """Messages that came within `timeout` seconds, as (device, message), by stamp; returns at the first few.

        Those of one device are in its order. A busy device cannot crowd out another: each gives at most a pipe's
        fill (4096 bytes) at a time. A caller that comes late, after a stall, gets all that waited in one piece.
        """
        now = time.monotonic()
        deadline = now + timeout
        gather_until = now + CATCH_UP_S if now - self._polled_at > LATE_S else now
        messages: list[tuple[str, Message]] = []
        sources: set[str] = set()
        while True:
            until = gather_until if messages else min(deadline, self._due())
            for key, _ in self._selector.select(max(0.0, until - now)):
                if key.data is None:
                    self._look_for_plugged()
                    continue
                received = self._receive(key.data)
                if received:
                    sources.add(key.data.name)
                    messages += received
            now = time.monotonic()
            self._look_after(now)
            if now >= (gather_until if messages else deadline):
                if len(sources) > 1:  # in which order the pipes were read is an accident
                    messages.sort(key=lambda entry: entry[1].t_us)
                return messages

    def set_polling(self, name: str, running: bool) -> None:
        """Start or stop one device: a stopped one has its port closed. KeyError when there is no such device."""
        watched = self._watched[name]
        watched.state.polling = running
        if watched.process is not None:
            watched.process.command("start" if running else "stop")
        elif running and watched.restart_at == NEVER:
            self._spawn(watched)

    def retry(self, name: str) -> None:
        """Look for a missing device at once: it was seen being plugged in."""
        process = self._watched[name].process
        if process is not None:
            process.command("retry")

    def reset_decoder(self, name: str) -> None:
        """Let a device's decoder begin anew; RESTART in its stream says from where."""
        process = self._watched[name].process
        if process is not None:
            process.command("reset")

    def close(self) -> None:
        """End every worker in steps (ask, terminate, kill) within 2 s; harmless when repeated."""
        processes = self._ended + [w.process for w in self._watched.values() if w.process is not None]
        for watched in self._watched.values():
            self._forget(watched)
            watched.restart_at = NEVER
            watched.state.pid = 0
        self._ended = []
        remaining = processes
        for step, patience_s in ((WorkerProcess.ask, 0.8), (WorkerProcess.terminate, 0.4), (WorkerProcess.kill, 0.6)):
            for process in remaining:
                step(process)
            deadline = time.monotonic() + patience_s
            remaining = [process for process in remaining if not process.ended_by(deadline)]
        for process in remaining:
            _log.error("worker %d does not die; its device driver holds it", process.pid)
        for process in processes:
            process.release()
        self._selector.close()
        if self._plug_monitor is not None:
            self._plug_monitor.close()
            self._plug_monitor = None

    def _look_for_plugged(self) -> None:
        """Something was plugged in: whoever waits for a device looks whether it is his."""
        assert self._plug_monitor is not None
        if self._plug_monitor.take():
            for name, watched in self._watched.items():
                if watched.state.port_state != OPEN:
                    self.retry(name)

    def _due(self) -> float:
        """When the next restart, or the next look at the heartbeats, is due (seconds on the monotonic clock)."""
        due = self._polled_at + STALL_S / 2
        return min([due, *(watched.restart_at for watched in self._watched.values())])

    def _receive(self, watched: WatchedDevice) -> list[tuple[str, Message]]:
        """One read of one worker's pipe; its end is the worker's."""
        process = watched.process
        assert process is not None
        try:
            messages = process.receive()
        except MessageError as error:
            self._bury(watched, f"sent nonsense ({error})")
            return []
        if messages is None:
            self._bury(watched, "died")
            return []
        if messages:
            watched.heard_at = time.monotonic()
        received: list[tuple[str, Message]] = []
        for message in messages:
            if message.kind == LINE:
                watched.state.last_line_us = message.t_us
            elif message.kind == HELLO:
                if watched.greeted:
                    received.append((watched.name, Message(message.t_us, RESTART, watched.name.encode())))
                watched.greet()
            else:
                watched.note(message)
            received.append((watched.name, message))
        return received

    def _look_after(self, now: float) -> None:
        """Kill who hangs, start who is due, reap who ended."""
        stalled = now - self._polled_at > STALL_S
        self._polled_at = now
        for watched in self._watched.values():
            if watched.process is not None:
                if stalled:
                    watched.heard_at = max(watched.heard_at, now - STALL_S)
                limit = HEARTBEAT_LIMIT_S if watched.here else START_LIMIT_S
                if now - watched.heard_at > limit:
                    self._bury(watched, f"gave no sign of life for {limit:.0f} s and was killed")
            elif now >= watched.restart_at:
                self._spawn(watched)
        if self._ended:
            self._ended = [process for process in self._ended if not process.ended()]

    def _spawn(self, watched: WatchedDevice) -> None:
        """Start the worker of a device; a machine that cannot is asked again later."""
        watched.restart_at = NEVER
        try:
            process = WorkerProcess(watched.settings, self._start_us, watched.state.polling)
        except OSError as error:
            watched.plan_restart()
            _log.error("%s: its worker cannot be started (%s)", watched.name, error)
            return
        watched.process = process
        watched.here = False
        watched.started_at = watched.heard_at = time.monotonic()
        watched.state.pid = process.pid
        self._selector.register(process, selectors.EVENT_READ, watched)

    def _bury(self, watched: WatchedDevice, what: str) -> None:
        """Kill what is left of a worker and plan its successor."""
        process = watched.process
        assert process is not None
        self._forget(watched)
        process.kill()
        process.release()
        if not process.ended():
            self._ended.append(process)
        wait = watched.plan_restart()
        watched.state.restarts += 1
        watched.lose()
        _log.error("%s: worker %d %s; restart in %.1f s", watched.name, process.pid, what, wait)

    def _forget(self, watched: WatchedDevice) -> None:
        if watched.process is not None:
            self._selector.unregister(watched.process)
            watched.process = None
