"""One frame of the console view as rich text: the heading large, what is known beside it, a row per sensor.

Drawn line by line in fixed columns, since rich's tables and layouts cost many times as much a frame. Every colour
repeats a word that stands beside it, so that nothing is lost without colours (NO_COLOR) or to colour-blind eyes.
Needs the extra `[console]`; imported by `console` when there is a terminal to draw on.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

from rich.text import Text

from tinyekf_py.alarms import Alarm
from tinyekf_py.config import PAPER_METHODS
from tinyekf_py.estimate import Estimate
from tinyekf_py.view_state import (
    NAN,
    Navigation,
    SensorRow,
    TaskRow,
    ViewState,
    bearing_text,
    current_estimate,
    current_navigation,
    elapsed_text,
    heading_text,
    position_text,
    sensor_words,
    sided_text,
    speed_text,
    turn_text,
)


class _Symbols(NamedTuple):
    degree: str
    plus_minus: str
    between: str  #: between the degrees and the minutes of a position


_SYMBOLS = _Symbols("°", "±", "°")
_ASCII = _Symbols(" deg", "+-", " ")

_MODE_WORDS = {
    "ok": ("OK", "bold green"),
    "degraded": ("DEGRADED", "bold yellow"),
    "dead-reckoning": ("DEAD RECKONING", "bold magenta"),
    "invalid": ("NO HEADING", "bold white on red"),
}
_POSITION_WORDS = {"gps": "GPS", "dead-reckoning": "dead reckoning", "invalid": "no position"}

_GLYPHS = {
    "0": ("█▀▀█", "█  █", "█  █", "█▄▄█"),
    "1": (" ▄█ ", "  █ ", "  █ ", " ▄█▄"),
    "2": ("▀▀▀█", "▄▄▄█", "█   ", "█▄▄▄"),
    "3": ("▀▀▀█", " ▄▄█", "   █", "▄▄▄█"),
    "4": ("█  █", "█▄▄█", "   █", "   █"),
    "5": ("█▀▀▀", "█▄▄▄", "   █", "▄▄▄█"),
    "6": ("█▀▀▀", "█▄▄▄", "█  █", "█▄▄█"),
    "7": ("▀▀▀█", "  ▄▀", "  █ ", "  █ "),
    "8": ("█▀▀█", "█▄▄█", "█  █", "█▄▄█"),
    "9": ("█▀▀█", "█▄▄█", "   █", "▄▄▄█"),
    ".": (" ", " ", " ", "▄"),
    "-": ("    ", "▄▄▄▄", "    ", "    "),
    "°": ("▄▀▄", "▀▄▀", "   ", "   "),
}
_GLYPH_ROWS = 4
#: A terminal of fewer lines gets its heading in one line.
_MIN_LINES_FOR_LARGE = 22
#: So many lines are left to notices before the reference is shown.
_NOTICE_LINES = 5

_ALARM_STYLES = {"alarm": "bold white on red", "warning": "bold black on yellow"}


class _Columns(NamedTuple):
    """A row of a sensor: how it is laid out."""

    row: str
    names: tuple[str, ...]
    weight_width: int
    state: slice  #: where the port's state stands


_NARROW = _Columns(
    "{:<7} {:<13} {:>8} {:>7} {:<15} {:<9} {:>4} {:>4} {:>5}",
    ("SENSOR", "PORT", "RATE", "AGE", "COG / HDG", "FIX", "HDOP", "WT", "ERR"), 4, slice(8, 21),
)  # fmt: skip
_WIDE = _Columns(
    "{:<8} {:<14} {:>8} {:>8}   {:<16} {:<10} {:>5}   {:<14} {:>6}",
    ("SENSOR", "PORT", "RATE", "AGE", "COG / HDG", "FIX", "HDOP", "WEIGHT", "ERRORS"), 14, slice(9, 23),
)  # fmt: skip
_MIN_WIDTH_FOR_WIDE = 97


def draw(
    state: ViewState,
    waited_s: float,
    width: int,
    height: int,
    alarms: Sequence[Alarm] = (),
    *,
    ascii_only: bool = False,
) -> Text:
    """The screen of `width` columns and `height` lines, `waited_s` seconds after `state` was made."""
    estimate = current_estimate(state, waited_s)
    navigation = current_navigation(state, waited_s)
    symbols = _ASCII if ascii_only else _SYMBOLS
    columns = _WIDE if width >= _MIN_WIDTH_FOR_WIDE else _NARROW
    beside = _beside(estimate, state.method, navigation, symbols)
    below = [Text(), *_navigation(estimate, navigation, symbols), Text()]
    below.append(Text(columns.row.format(*columns.names), style="bold underline"))
    below += [_sensor(row, waited_s, width, columns, symbols) for row in state.sensors]
    if state.tasks:
        below += [Text(), *_tasks(state.tasks, width)]
    lines = [_title(state, waited_s, width), *([_alarm_line(alarm) for alarm in alarms] or [Text()])]
    if height >= max(_MIN_LINES_FOR_LARGE, len(lines) + _GLYPH_ROWS + len(below)) and not ascii_only:
        lines += _large_heading(estimate, beside)
    else:
        lines += _small_heading(estimate, beside, symbols)
    lines += below
    if len(lines) > height:  # what is empty goes first
        lines = [line for line in lines if line]
    legend = _legend(state, symbols)
    if height - len(lines) >= len(legend) + _NOTICE_LINES + 1:
        lines += legend
    room = height - len(lines) - 1
    if state.notices and room > 0:
        lines += [Text(), *(Text(notice) for notice in state.notices[-room:])]
    if ascii_only:
        lines = [_in_ascii(line) for line in lines]
    return Text("\n", no_wrap=True, overflow="crop", end="").join(_cut(line, width) for line in lines[:height])


def _legend(state: ViewState, symbols: _Symbols) -> list[Text]:
    """What the words stand for, and what the heading and the position refer to."""
    texts = [
        "HDG heading, true: where she points; COG course over ground: where she goes",
        f"{symbols.plus_minus} one standard deviation; weight 0 bad, 1 good, 2 excellent, 3 ideal",
    ]
    if state.position_of:
        texts.append(f"position: {state.position_of}")
    return [Text(), *(Text(text, style="dim") for text in texts)]


def _alarm_line(alarm: Alarm) -> Text:
    """What is wrong, in words before colours."""
    style = _ALARM_STYLES.get(alarm.severity, "bold")
    return Text.assemble((f" {alarm.severity.upper()}: {alarm.text} ", style))


def _tasks(tasks: tuple[TaskRow, ...], width: int) -> list[Text]:
    """The tasks with their keys, as many a line as fit."""
    lines = [Text("Key starts or stops, a all:")]
    for row in tasks:
        word = f"{row.key} {row.name}" + ("" if row.running else " STOPPED")
        if len(lines[-1]) + len(word) + 2 > width:
            lines.append(Text(" "))
        lines[-1].append("  ")
        lines[-1].append(word, style="" if row.running else "bold red")
    return lines


def _cut(line: Text, width: int) -> Text:
    if len(line) > width:
        line.truncate(width)
    return line


def _in_ascii(line: Text) -> Text:
    # What comes from outside, such as a path: one character for one, so that the styled spans keep their places.
    return Text(line.plain.encode("ascii", "replace").decode(), style=line.style, spans=line.spans)


def _title(state: ViewState, waited_s: float, width: int) -> Text:
    left = f" tinyekf  {state.method}" + ("  SIMULATED" if state.simulated else "")
    right = f"recording {state.recording}  " if state.recording else "not recording  "
    right += elapsed_text(state.elapsed_s + waited_s) + " "
    space = width - len(left) - len(right)
    if space < 2:  # a long path keeps its end, where the file's name is
        right = "..." + right[3 - space + 2 :]
        space = 2
    return Text(left + " " * space + right, style="reverse")


def _beside(estimate: Estimate, method: str, navigation: Navigation, symbols: _Symbols) -> list[Text]:
    word, style = _MODE_WORDS.get(estimate.mode, (estimate.mode, "bold"))
    sigma = "---"
    if estimate.mode != "invalid" and isfinite(estimate.heading_sigma_deg):
        sigma = f"{symbols.plus_minus} {estimate.heading_sigma_deg:.1f}{symbols.degree}"
        sigma += "  (uncalibrated)" if method in PAPER_METHODS else ""
    magnetic = bearing_text(estimate.heading_deg - navigation.variation_deg if estimate.mode != "invalid" else NAN)
    variation = sided_text(navigation.variation_deg, "E", "W", symbols.degree)
    return [
        Text.assemble("heading  ", (f" {word} ", style)),
        Text(f"sigma    {sigma}"),
        Text(f"turning  {turn_text(estimate, f'{symbols.degree}/s'.strip())}"),
        Text(f"true;    magnetic {_with_degree(magnetic, symbols)}, variation {variation}"),
    ]


def _with_degree(bearing: str, symbols: _Symbols) -> str:
    return bearing if bearing == "---" else f"{bearing}{symbols.degree}"


def _large_heading(estimate: Estimate, beside: list[Text]) -> list[Text]:
    text = heading_text(estimate)
    glyphs = [_GLYPHS[character] for character in (text if text == "---" else f"{text}°")]
    rows = ["   " + "  ".join(glyph[row] for glyph in glyphs) for row in range(_GLYPH_ROWS)]
    style = "bold" if estimate.mode != "invalid" else "bold red"
    return [Text.assemble((row.ljust(36), style), note) for row, note in zip(rows, beside, strict=True)]


def _small_heading(estimate: Estimate, beside: list[Text], symbols: _Symbols) -> list[Text]:
    text = heading_text(estimate)
    shown = text if text == "---" else f"{text}{symbols.degree} true"
    first, *rest = beside
    return [Text.assemble("   ", (shown.ljust(18), "bold"), first), *(Text(" " * 21 + note.plain) for note in rest)]


def _navigation(estimate: Estimate, navigation: Navigation, symbols: _Symbols) -> list[Text]:
    """Where she is, where she goes (which is not where she points), and how she lies."""
    word = _POSITION_WORDS.get(estimate.pos_mode, estimate.pos_mode)
    course = _with_degree(bearing_text(navigation.cog_deg), symbols)
    roll = sided_text(navigation.roll_deg, "to starboard", "to port", symbols.degree)
    pitch = sided_text(navigation.pitch_deg, "bow up", "bow down", symbols.degree)
    return [
        Text(f"   position  {position_text(estimate, symbols.between)}   ({word})"),
        Text(f"   course    {course} over ground, {speed_text(navigation.sog_mps)}"),
        Text(f"   attitude  roll {roll}, pitch {pitch}"),
    ]


def _sensor(row: SensorRow, waited_s: float, width: int, columns: _Columns, symbols: _Symbols) -> Text:
    words = sensor_words(row, waited_s)
    own = words.own + (f"{symbols.plus_minus:>2}{words.own_sigma}" if words.own_sigma else "")
    weight = words.weight if len(words.weight) <= columns.weight_width else words.weight.partition(" ")[0]
    line = columns.row.format(
        words.name,
        words.port_state[: columns.state.stop - columns.state.start],
        *(words.rate, words.age, own, words.fix, words.hdop, weight, words.errors),
    )
    text = Text(line)
    text.stylize("green" if row.port_state == "open" else "bold red", columns.state.start, columns.state.stop)
    why = row.last_error if row.port_state in ("open", "stopped") else row.port_text or row.last_error
    if why and width - len(line) > 12:
        text.append(f"  {why}")
    return text
