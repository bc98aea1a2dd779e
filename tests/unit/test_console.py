"""The console view: what it shows, what it must never show, and that it gives the terminal back."""

from __future__ import annotations

import io
import os
import pty
import select
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from tinyekf_py.alarms import HEADING_INVALID, SOURCES_DISAGREE, Alarm
from tinyekf_py.console import ConsoleView, plain_line
from tinyekf_py.estimate import Estimate
from tinyekf_py.tasks import task_key, task_names
from tinyekf_py.view_state import (
    Navigation,
    SensorRow,
    TaskRow,
    ViewState,
    heading_text,
    position_text,
    sensor_words,
    turn_text,
)

NAN = float("nan")
ROOT = Path(__file__).resolve().parents[2]
ESTIMATE = Estimate(12_300_000, 123.44, 0.52, -1.24, 35.960026, 126.519994, "ok", "gps", (3.0, 2.0, 0.0))
SENSORS = (
    SensorRow("gps1", "open", 10.0, 0.08, 2, 1.04, 2.74, heading_deg=119.96, heading_sigma_deg=2.34),
    SensorRow("gps2", "stale", 9.9, 7.5, 1, 2.31, 2.0, 17, "checksum"),
    SensorRow("gps3", "missing", port_text="no such device"),
    SensorRow("compass", "open", 10.0, 0.03, heading_deg=359.97, heading_sigma_deg=1.0),
    SensorRow("imu", "open", 100.2, 0.004),
)
TASKS = tuple(TaskRow(task_key(name), name, name != "ekf2") for name in task_names([row.name for row in SENSORS], 3))
NAVIGATION = Navigation(sog_mps=5.0, cog_deg=131.0, roll_deg=-3.0, pitch_deg=1.5, variation_deg=-8.5)
STATE = ViewState(
    ESTIMATE, 0.05, SENSORS, 3723.0, "cnw3", "/tmp/r.log", True, ("gps3 is missing",), navigation=NAVIGATION
)
ALARMS = (
    Alarm(HEADING_INVALID, "alarm", "no heading: gps3 missing", 1.0),
    Alarm(SOURCES_DISAGREE, "warning", "the headings of gps1 and compass disagree", 1.0),
)


def drawn(
    state: ViewState,
    waited_s: float = 0.0,
    width: int = 80,
    height: int = 24,
    alarms: Sequence[Alarm] = (),
    *,
    ascii_only: bool = False,
) -> str:
    frame = pytest.importorskip("tinyekf_py.console_frame", reason="needs the extra [console]")
    return str(frame.draw(state, waited_s, width, height, alarms, ascii_only=ascii_only).plain)


def test_a_plain_line_says_it_all() -> None:
    assert plain_line(STATE) == (
        "3723.0 s  heading 123.4 deg +- 0.5  turn -1.2 deg/s  position 35.960026 126.519994  ok/gps  "
        "gps1 10.0 Hz, gps2 stale, gps3 missing, compass 10.0 Hz, imu 100.2 Hz"
    )


@pytest.mark.parametrize(("age_s", "waited_s"), [(0.05, 0.96), (1.01, 0.0), (0.05, 60.0), (NAN, 0.0)])
def test_a_stale_estimate_is_shown_as_absent(age_s: float, waited_s: float) -> None:
    state = STATE._replace(estimate_age_s=age_s)
    assert "heading --- deg +- ---  turn --- deg/s  position ---  invalid/invalid" in plain_line(state, waited_s)
    screen = drawn(state, waited_s, height=14)
    assert "NO HEADING" in screen
    assert "123.4" not in screen
    assert "35°" not in screen


@pytest.mark.parametrize(
    "estimate", [None, Estimate(0), ESTIMATE._replace(mode="invalid"), ESTIMATE._replace(heading_deg=NAN)]
)
def test_an_invalid_heading_is_never_a_number(estimate: Estimate | None) -> None:
    assert "heading ---" in plain_line(ViewState(estimate))
    assert "123.4" not in drawn(ViewState(estimate), height=14)


@pytest.mark.parametrize(
    ("heading_deg", "text"), [(0.0, "000.0"), (7.25, "007.2"), (359.94, "359.9"), (359.96, "000.0")]
)
def test_headings_have_three_digits_and_never_360(heading_deg: float, text: str) -> None:
    assert heading_text(ESTIMATE._replace(heading_deg=heading_deg)) == text


def test_positions_are_in_degrees_and_minutes() -> None:
    assert position_text(ESTIMATE) == "35°57.602' N  126°31.200' E"
    assert position_text(ESTIMATE._replace(lat_deg=-0.99999999, lon_deg=-3.5)) == "01°00.000' S  003°30.000' W"


@pytest.mark.parametrize(
    ("rate_dps", "text"), [(1.26, "1.3 °/s to starboard"), (-1.26, "1.3 °/s to port"), (-0.04, "0.0 °/s"), (NAN, "---")]
)
def test_turns_have_a_side(rate_dps: float, text: str) -> None:
    assert turn_text(ESTIMATE._replace(rate_of_turn_dps=rate_dps)) == text


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (60, 14), (20, 5), (1, 1)])
def test_the_frame_fits_its_terminal(width: int, height: int) -> None:
    many = tuple(SensorRow(f"gps{number}", "open", 10.0, 0.1, 2, 1.0, 3.0) for number in range(1, 9)) + SENSORS[3:]
    for state in (STATE, ViewState(ESTIMATE, sensors=many, recording="/a/long/path" * 20, notices=("n" * 300,) * 50)):
        lines = drawn(state, width=width, height=height).split("\n")
        assert len(lines) <= height
        assert max(map(len, lines)) <= width


@pytest.mark.parametrize("width", [80, 120])
def test_every_sensor_has_its_row(width: int) -> None:
    screen = drawn(STATE._replace(notices=()), width=width)
    rows = {line.split()[0]: " ".join(line.split()[1:]) for line in screen.splitlines() if line.strip()}
    wide = width > 100
    assert rows["gps1"] == f"open 10.0 Hz 0.1 s COG 120.0 ±2.3 DGPS 1.0 2.7{' ideal' * wide} 0"
    assert rows["gps2"] == f"stale --- 7.5 s COG --- --- --- --- 17{' checksum' * wide}"
    assert rows["gps3"] == f"missing --- --- COG --- --- --- --- 0{' no such device' * wide}"
    assert rows["compass"] == "open 10.0 Hz 0.0 s HDG 000.0 ±1.0 0"
    assert rows["imu"] == "open 100.2 Hz 0.0 s 0"


def test_a_stopped_sensor_shows_nothing_of_its_past() -> None:
    stopped = SENSORS[0]._replace(port_state="stopped")
    words = sensor_words(stopped, 0.0)
    assert (words.rate, words.fix, words.weight, words.own, words.own_sigma) == ("---", "---", "---", "COG ---", "")


@pytest.mark.parametrize("ascii_only", [False, True])
def test_all_of_the_boat_fits_80_by_24(ascii_only: bool) -> None:
    state = STATE._replace(tasks=TASKS, method="adaptive")
    screen = drawn(state, alarms=ALARMS, ascii_only=ascii_only)
    assert len(screen.splitlines()) <= 24
    for row in SENSORS:
        assert f"\n{row.name} " in screen
    for text in ("ekf2 STOPPED", "f cnw-s3", "gps3 is missing", "COG / HDG"):
        assert text in screen


def test_course_is_never_shown_as_heading() -> None:
    screen = drawn(STATE._replace(estimate=ESTIMATE._replace(mode="invalid", heading_deg=NAN)))
    (course,) = [line for line in screen.splitlines() if "131.0" in line]
    assert course.split() == ["course", "131.0°", "over", "ground,", "9.7", "kn"]
    assert "NO HEADING" in screen
    assert all("COG" in line for line in screen.splitlines() if "120.0" in line)


def test_the_reference_of_the_heading_is_named() -> None:
    screen = drawn(STATE._replace(position_of="the boat's reference point"), height=40)
    assert "true;    magnetic 131.9°, variation 8.5° W" in screen
    assert "COG course over ground: where she goes" in screen
    assert "position: the boat's reference point" in screen
    assert "magnetic ---, variation ---" in drawn(STATE._replace(navigation=Navigation()))


def test_attitude_has_its_sides_in_words() -> None:
    assert "roll 3.0° to port, pitch 1.5° bow up" in drawn(STATE)


def test_what_a_navigator_is_told_disappears_when_it_is_old() -> None:
    screen = drawn(STATE, 1.5)
    assert "131.0" not in screen
    assert "course    --- over ground, ---" in screen
    assert "roll ---, pitch ---" in screen


def test_alarms_are_words_before_they_are_colours() -> None:
    _, first, second, *_ = drawn(STATE, alarms=ALARMS).splitlines()
    assert first == " ALARM: no heading: gps3 missing "
    assert second == " WARNING: the headings of gps1 and compass disagree "
    assert drawn(STATE).splitlines()[1] == ""
    assert plain_line(STATE, 0.0, ALARMS).endswith(
        "  ALARM: no heading: gps3 missing  WARNING: the headings of gps1 and compass disagree"
    )


def test_a_small_terminal_loses_what_is_empty_before_its_sensors() -> None:
    screen = drawn(STATE, height=14)
    assert "imu " in screen
    assert "\n\n" not in screen


def test_simulation_recording_and_notices_are_named() -> None:
    screen = drawn(STATE)
    for text in ("SIMULATED", "recording /tmp/r.log", "1:02:03", "gps3 is missing", "(uncalibrated)", " OK "):
        assert text in screen


def test_a_terminal_without_unicode_gets_ascii() -> None:
    screen = drawn(ViewState(ESTIMATE, recording="/tmp/é.log"), ascii_only=True)
    assert screen.isascii()
    assert "123.4 deg true" in screen
    assert "+- 0.5 deg" in screen


class Lines(io.StringIO):
    """A stream that is no terminal, and tells when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def write(self, text: str) -> int:
        count = super().write(text)
        self.written.set()
        return count


def test_without_a_terminal_there_are_plain_lines() -> None:
    stream = Lines()
    with ConsoleView(stream) as view:
        assert not view.full_screen
        view.show(STATE)
        assert stream.written.wait(10)
    assert stream.getvalue().startswith("3723.")
    assert "heading 123.4" in stream.getvalue()
    assert "\x1b" not in stream.getvalue()


def test_a_stream_that_is_gone_ends_the_view_quietly(caplog: pytest.LogCaptureFixture) -> None:
    class Gone(Lines):
        def flush(self) -> None:
            raise BrokenPipeError

    stream = Gone()
    view = ConsoleView(stream)
    view.start()
    view.show(STATE)
    assert stream.written.wait(10)
    view.stop()
    view.stop()
    assert not caplog.records


def run_on_terminal(program: str, until: bytes, **environment: str) -> bytes:
    """All that `program` writes to a terminal of its own; it is told to go on once `until` has been seen."""
    master, slave = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stdout=slave,
        stderr=slave,
        cwd=ROOT,
        env={**os.environ, "TERM": "xterm", "LC_ALL": "C.UTF-8", "COLUMNS": "80", "LINES": "24", **environment},
    )
    os.close(slave)
    written = b""
    told = False
    assert child.stdin is not None
    while select.select([master], [], [], 20)[0]:
        try:
            written += os.read(master, 65536)
        except OSError:  # the terminal's last user is gone
            break
        if not told and until in written:
            told = True
            child.stdin.write(b"\n")
            child.stdin.flush()
    assert told, written
    child.stdin.close()
    child.wait(20)
    os.close(master)
    return written


PROGRAM = """
import sys
from tests.unit.test_console import STATE
from tinyekf_py.alarms import HEADING_INVALID, SOURCES_DISAGREE, Alarm
from tinyekf_py.console import ConsoleView
view = ConsoleView()
view.start()
view.show(STATE)
sys.stdin.readline()
{end}
"""


@pytest.mark.parametrize("end", ["view.stop()", "raise SystemExit(1)", "raise KeyboardInterrupt"])
def test_the_terminal_is_given_back(end: str) -> None:
    pytest.importorskip("rich", reason="needs the extra [console]")
    written = run_on_terminal(PROGRAM.format(end=end), b"gps3 is missing")
    assert written.count(b"\x1b[?1049h") == written.count(b"\x1b[?1049l") == 1
    assert written.count(b"\x1b[?25l") == written.count(b"\x1b[?25h") == 1
    assert written.rindex(b"\x1b[?1049l") > written.index(b"SENSOR")


def test_no_color_is_obeyed() -> None:
    pytest.importorskip("rich", reason="needs the extra [console]")
    written = run_on_terminal(PROGRAM.format(end="view.stop()"), b"gps3 is missing", NO_COLOR="1")
    assert b"\x1b[1;32m" not in written
    assert b"\x1b[32m" not in written


def test_without_rich_a_terminal_gets_plain_lines_and_a_notice() -> None:
    # Whoever takes the terminal has the log to itself: without rich nobody would see it.
    program = "import sys\nsys.modules['rich'] = None\n" + PROGRAM.format(end="print(view.takes_terminal)\nview.stop()")
    written = run_on_terminal(program, b"heading 123.4")
    assert b"[console]" in written
    assert b"False" in written
    assert b"\x1b" not in written


def test_a_dumb_terminal_gets_plain_lines() -> None:
    assert b"\x1b" not in run_on_terminal(PROGRAM.format(end="view.stop()"), b"heading 123.4", TERM="dumb")
