"""The worker: one small process per device, from the port to samples.

``python -m acquisition.worker OUT_FD CONTROL_FD SETTINGS`` is started by `acquisition.supervisor`, which inherits it
two pipes: messages go out of OUT_FD, commands come in at CONTROL_FD (one word a line: start, stop, retry, reset,
quit). SETTINGS is a JSON object with the fields of `WorkerSettings`.

    port ──> framing ──> outbox ──> decoder ──> message ──> pipe
             lines       what is too much is dropped here, before it was decoded

The worker never outlives its parent (end of the control pipe, PR_SET_PDEATHSIG), never blocks on it, and wakes only
when bytes come, a second has passed or the parent speaks. It imports little: five of them run on a 512 MB board.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import time
from collections import Counter
from typing import NamedTuple

from acquisition.child_process import end_with_parent
from acquisition.decoder import Decoder, make_decoder
from acquisition.message import COUNTS, ERROR, HELLO, LINE, LOG, PORT, pack_line, pack_text
from acquisition.outbox import Outbox
from acquisition.port_error import READ_SIZE
from acquisition.port_watch import NEVER_US, SECOND_US, PortWatch

HEARTBEAT_US = SECOND_US
LOG_PERIOD_US = 10 * SECOND_US  # a noisy device gets one line of log in this time
FLOOD_BYTES_S = 32_768  # no device of ours sends more; one set to a higher baud rate may use twice its rate
FLOOD_REST_US = 100_000  # a device that sends more is not listened to for this long
FLOOD_DRAIN_BYTES = 65_536  # what a kernel keeps of a port that nobody reads


class WorkerSettings(NamedTuple):
    """What a worker is told at its start."""

    name: str  #: the source
    port: str
    driver: str
    baud: int
    options: dict[str, object]  #: of the decoder, and `period_ms`
    polling: bool  #: open the port at once
    start_us: int  #: of the recording, on the monotonic clock; stamps count from here
    parent_pid: int


class Worker:
    """The loop of one device's process."""

    def __init__(self, settings: WorkerSettings, out_fd: int, control_fd: int) -> None:
        self._settings = settings
        self._out_fd = out_fd
        self._control_fd = control_fd
        self._start_us = settings.start_us
        self._decoder_options = settings.options.copy()
        period = self._decoder_options.pop("period_ms", 0)
        self._decoder = self._fresh_decoder()
        self._framing = self._decoder.framing()
        self._framed_opens = 0  # the opening of the port that the framing has seen from its start
        self._past_counts: Counter[str] = Counter()  # of decoders and framings that were replaced
        self._counts = Counter({"bytes": 0, "wakeups": 0})
        self._outbox = Outbox(out_fd, self._encode)
        period_us = round(1000 * period) if isinstance(period, (int, float)) else 0
        self._watch = PortWatch(settings.port, settings.baud, period_us, self._report_port)
        self._flood_limit = max(FLOOD_BYTES_S, settings.baud // 5)  # bytes per second
        self._allowance = float(self._flood_limit)  # bytes that may be read now
        self._allowed_at_us = self._now_us()
        self._listen_at_us = 0  # after a flood: not before
        self._logged_drops = 0
        self._log_at_us = 0
        self._poll = select.poll()
        self._polled_fd = -1
        self._polled_out = False

    def run(self) -> None:
        """Serve until the parent says quit or is gone; BrokenPipeError when it closed the out-pipe."""
        now_us = self._now_us()
        beat_at_us = now_us + HEARTBEAT_US
        self._poll.register(self._control_fd, select.POLLIN)
        self._poll.register(self._out_fd, 0)  # POLLERR comes unasked
        self._outbox.add(now_us, HELLO, b"")
        if self._settings.polling:
            self._watch.start(now_us)
        while True:
            if now_us >= self._watch.due_us:
                self._watch.tick(now_us)
            if now_us >= beat_at_us:
                beat_at_us = now_us + HEARTBEAT_US
                self._beat(now_us)
            if 0 < self._listen_at_us <= now_us:
                self._end_flood(now_us)
            self._outbox.flush(now_us)
            self._arrange_poll()
            wait_us = min(beat_at_us, self._watch.due_us, self._listen_at_us or NEVER_US) - now_us
            ready = self._poll.poll(max(0, -(-wait_us // 1000)))
            self._counts["wakeups"] += 1
            for fd, event in ready:
                if fd == self._polled_fd:
                    self._take()
                elif fd == self._control_fd:
                    if not self._obey():
                        return
                elif event & (select.POLLERR | select.POLLHUP):
                    return
            now_us = self._now_us()

    def _now_us(self) -> int:
        return time.monotonic_ns() // 1000 - self._start_us

    def _arrange_poll(self) -> None:
        """Poll the port while it is open and listened to, the out-pipe while something waits for it."""
        fd = -1 if self._listen_at_us else self._watch.fd
        if fd != self._polled_fd:
            if self._polled_fd >= 0:
                self._poll.unregister(self._polled_fd)
            if fd >= 0:
                self._poll.register(fd, select.POLLIN)
            self._polled_fd = fd
        if self._watch.opens != self._framed_opens:
            self._framed_opens = self._watch.opens
            self._framing_anew()
        waiting = self._outbox.waiting
        if waiting != self._polled_out:
            self._poll.modify(self._out_fd, select.POLLOUT if waiting else 0)
            self._polled_out = waiting

    def _take(self) -> None:
        """Read once, stamp, and put the lines that are complete into the outbox."""
        chunk = self._watch.read(self._now_us(), READ_SIZE)
        t_us = self._now_us()
        size = len(chunk)
        self._counts["bytes"] += size
        allowance = self._allowance + (t_us - self._allowed_at_us) * self._flood_limit / SECOND_US
        self._allowance = min(allowance, self._flood_limit) - size
        self._allowed_at_us = t_us
        if self._allowance < 0:
            self._allowance += size
            self._counts["flood-bytes"] += size
            self._listen_at_us = t_us + FLOOD_REST_US
            return
        add = self._outbox.add
        for line in self._framing.feed(chunk):
            add(t_us, LINE, line)

    def _end_flood(self, now_us: int) -> None:
        """Listen again, to what comes from now on: what the kernel kept meanwhile is old."""
        self._listen_at_us = 0
        drained = 0
        while drained < FLOOD_DRAIN_BYTES and (chunk := self._watch.read(now_us, READ_SIZE)):
            drained += len(chunk)
        self._counts["bytes"] += drained
        self._counts["flood-bytes"] += drained
        self._framing_anew()

    def _fresh_decoder(self) -> Decoder:
        return make_decoder(self._settings.name, self._settings.driver, self._decoder_options)

    def _framing_anew(self) -> None:
        """Forget a half line: its other half will not come."""
        self._past_counts.update(self._framing.dropped)
        self._framing = self._decoder.framing()

    def _obey(self) -> bool:
        """Do what the parent says; False at quit or when it is gone."""
        commands = os.read(self._control_fd, 4096)
        now_us = self._now_us()
        for command in commands.split():
            if command == b"start":
                self._watch.start(now_us)
            elif command == b"stop":
                self._watch.stop(now_us)
            elif command == b"retry":
                self._watch.retry(now_us)
            elif command == b"reset":
                self._outbox.add(now_us, HELLO, b"")
            elif command == b"quit":
                return False
        return bool(commands)

    def _encode(self, t_us: int, kind: int, payload: bytes) -> bytes:
        """The message of an entry of the outbox, made when it is sent."""
        if kind == LINE:
            return pack_line(t_us, payload, self._decoder.decode(t_us, payload))
        if kind == HELLO:
            self._past_counts.update(self._decoder.counts)
            self._decoder = self._fresh_decoder()
            payload = json.dumps({"pid": os.getpid(), "driver": self._settings.driver}).encode()
        elif kind == COUNTS:
            payload = json.dumps(self._all_counts(t_us)).encode()
        return pack_text(t_us, kind, payload)

    def _report_port(self, now_us: int, state: str, text: str) -> None:
        self._outbox.add(now_us, PORT, f"{state} {text}".encode())

    def _beat(self, now_us: int) -> None:
        """Once a second: counters, and a word about what had to be dropped."""
        if os.getppid() != self._settings.parent_pid:
            raise BrokenPipeError("the parent is gone")  # someone else still holds its end of the pipes
        if not self._outbox.holds(COUNTS):
            self._outbox.add(now_us, COUNTS, b"")
        if now_us < self._log_at_us:
            return
        counts = self._all_counts(now_us)
        dropped = {reason: n for reason, n in counts.items() if reason not in _NO_DROPS and n}
        total = sum(dropped.values())
        if total != self._logged_drops:
            self._logged_drops = total
            self._log_at_us = now_us + LOG_PERIOD_US
            reasons = ", ".join(f"{reason} {n}" for reason, n in sorted(dropped.items()))
            text = f"dropped so far: {reasons}"
            if self._decoder.last_error:
                text += f"; last: {self._decoder.last_error}"
            self._outbox.add(now_us, LOG, text.encode())

    def _all_counts(self, now_us: int) -> Counter[str]:
        """Everything that was counted since this process started."""
        counts = self._past_counts.copy()
        for more in (self._counts, self._decoder.counts, self._framing.dropped, self._outbox.dropped):
            counts.update(more)
        counts["opens"] = self._watch.opens
        counts["down_ms"] = self._watch.down_us(now_us) // 1000
        return counts


_NO_DROPS = frozenset({"lines", "samples", "bytes", "wakeups", "opens", "down_ms"})


def _report_failure(out_fd: int, start_us: int) -> None:
    """Tell the parent why this process ends, in the second that it may take."""
    import traceback

    t_us = time.monotonic_ns() // 1000 - start_us
    waiting = select.poll()
    waiting.register(out_fd, select.POLLOUT)
    waiting.poll(1000)
    try:
        os.write(out_fd, pack_text(t_us, ERROR, traceback.format_exc().encode()))
    except OSError:
        traceback.print_exc()  # nobody reads the pipe


def main(arguments: list[str]) -> int:
    """Run the worker of `arguments` (out-pipe, control pipe, settings); the exit status."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's to judge
    out_fd, control_fd = int(arguments[0]), int(arguments[1])
    settings = WorkerSettings(**json.loads(arguments[2]))
    end_with_parent(settings.parent_pid)
    try:
        Worker(settings, out_fd, control_fd).run()
    except BrokenPipeError:
        return 0  # the parent is gone
    except Exception:
        _report_failure(out_fd, settings.start_us)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
