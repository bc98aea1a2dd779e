"""The console: the live program's face in a terminal, or a plain line a second where there is none.

The live program calls `show` with a `ViewState` as often as it likes, which only stores it; a thread of this file
draws twice a second. It also notices when no state comes any more: an old heading then disappears instead of staying
on the screen as if it were true. Colours and full-screen drawing come from rich (the extra `[console]`); without rich,
without a terminal, or on a dumb one, there are plain lines.
"""

from __future__ import annotations

import atexit
import importlib.util
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from math import isfinite
from types import TracebackType
from typing import Self, TextIO

from tinyekf_py.alarms import Alarm, Alarms
from tinyekf_py.view_state import ViewState, current_estimate, heading_text, sensor_words

FRAME_PERIOD_S = 0.5
LINE_PERIOD_S = 1.0

_Draw = Callable[[ViewState, float, Sequence[Alarm]], None]

_log = logging.getLogger(__name__)


def plain_line(state: ViewState, waited_s: float = 0.0, alarms: Sequence[Alarm] = ()) -> str:
    """One ASCII line that says it all, `waited_s` seconds after `state` was made; "---" for what is not known."""
    estimate = current_estimate(state, waited_s)
    heading = heading_text(estimate)
    sigma = rate = "---"
    if estimate.mode != "invalid":
        sigma = f"{estimate.heading_sigma_deg:.1f}" if isfinite(estimate.heading_sigma_deg) else "---"
        rate = f"{estimate.rate_of_turn_dps:+z.1f}" if isfinite(estimate.rate_of_turn_dps) else "---"
    position = "---"
    if estimate.pos_mode != "invalid" and isfinite(estimate.lat_deg) and isfinite(estimate.lon_deg):
        position = f"{estimate.lat_deg:.6f} {estimate.lon_deg:.6f}"
    sensors = []
    for row in state.sensors:
        words = sensor_words(row, waited_s)
        sensors.append(f"{words.name} {words.rate if row.port_state == 'open' else row.port_state}")
    stopped = [row.name for row in state.tasks if not row.running]
    return (
        f"{state.elapsed_s + waited_s:.1f} s  heading {heading} deg +- {sigma}  turn {rate} deg/s  "
        f"position {position}  {estimate.mode}/{estimate.pos_mode}  {', '.join(sensors)}"
        f"{'  stopped: ' + ' '.join(stopped) if stopped else ''}"
        f"{''.join(f'  {alarm.severity.upper()}: {alarm.text}' for alarm in alarms)}"
    ).rstrip()


class ConsoleView:
    """Shows the latest `ViewState` on `stream` (standard output) until stopped; also a context manager.

    `stop` restores the terminal, and is called at the interpreter's exit if nobody did.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stdout
        self._latest: tuple[ViewState, float] | None = None
        self._alarms = Alarms()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._screen: _Screen | None = None

    @property
    def full_screen(self) -> bool:
        """Whether the whole terminal is drawn (from `start` to `stop`); else there are plain lines."""
        return self._screen is not None

    @property
    def takes_terminal(self) -> bool:
        """Whether `start` will draw on the whole terminal."""
        return _is_screen(self._stream) and importlib.util.find_spec("rich") is not None

    def start(self) -> None:
        """Take the terminal, and begin."""
        self._screen = _open_screen(self._stream)
        atexit.register(self.stop)
        draw, period_s = (self._screen.draw, FRAME_PERIOD_S) if self._screen else (self._print_line, LINE_PERIOD_S)
        self._thread = threading.Thread(target=self._run, args=(draw, period_s), name="console", daemon=True)
        self._thread.start()

    def show(self, state: ViewState) -> None:
        """Show `state` from the next frame on; costs nothing, never fails."""
        self._latest = (state, time.monotonic())

    def stop(self) -> None:
        """Draw no more and give the terminal back; harmless when repeated."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join(2.0)
            self._thread = None
        if self._screen is not None:
            screen, self._screen = self._screen, None
            screen.close()
        atexit.unregister(self.stop)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def _run(self, draw: _Draw, period_s: float) -> None:
        try:
            self._draw_until_stopped(draw, period_s)
        except OSError:  # the terminal is gone: nobody is watching any more
            return
        except Exception:
            # The outermost frame of this thread: a fault of the view must not end the program that it shows.
            _log.exception("the console view has ended")

    def _draw_until_stopped(self, draw: _Draw, period_s: float) -> None:
        while not self._ended.is_set() and not self._stream.closed:
            if self._latest is None:  # the first state is shown soon after it is there
                self._ended.wait(0.05)
                continue
            started_s = time.monotonic()
            state, shown_s = self._latest
            waited_s = started_s - shown_s
            draw(state, waited_s, self._alarms.update(state, waited_s))
            self._ended.wait(started_s + period_s - time.monotonic())

    def _print_line(self, state: ViewState, waited_s: float, alarms: Sequence[Alarm]) -> None:
        self._stream.write(plain_line(state, waited_s, alarms) + "\n")
        self._stream.flush()


class _Screen:
    """The terminal while the view has it: the alternate screen, without a cursor."""

    def __init__(self, stream: TextIO) -> None:
        from rich.console import Console
        from rich.live import Live

        from tinyekf_py.console_frame import draw

        self._draw = draw
        self._console = Console(file=stream, highlight=False, markup=False, emoji=False)
        self._live = Live(console=self._console, screen=True, auto_refresh=False, vertical_overflow="crop")

    def open(self) -> None:
        self._live.start()

    def draw(self, state: ViewState, waited_s: float, alarms: Sequence[Alarm]) -> None:
        width, height = self._console.size
        ascii_only = not self._console.encoding.startswith("utf")
        frame = self._draw(state, waited_s, width, height, alarms, ascii_only=ascii_only)
        self._live.update(frame, refresh=True)

    def close(self) -> None:
        try:
            self._live.stop()
        except (OSError, ValueError) as error:  # nobody is left to see it
            _log.debug("the terminal could not be restored: %s", error)


def _is_screen(stream: TextIO) -> bool:
    return stream.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")


def _open_screen(stream: TextIO) -> _Screen | None:
    """The screen, or None where plain lines must do."""
    if not _is_screen(stream):
        return None
    try:
        screen = _Screen(stream)
    except ImportError:
        _log.warning("plain lines only: rich is not installed; the extra [console] gives the full view")
        return None
    screen.open()
    return screen
