"""One frame of the console view as rich text: the heading large, what is known beside it, a row per sensor.

Drawn line by line in fixed columns, since rich's tables and layouts cost many times as much a frame. Every colour
repeats a word that stands beside it, so that nothing is lost without colours (NO_COLOR) or to colour-blind eyes.
Needs the extra `[console]`; imported by `console` when there is a terminal to draw on.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from rich.text import Text

from tinyekf_py.config import PAPER_METHODS
from tinyekf_py.estimate import Estimate
from tinyekf_py.view_state import (
    SensorRow,
    TaskRow,
    ViewState,
    current_estimate,
    elapsed_text,
    heading_text,
    position_text,
    sensor_words,
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
_MIN_LINES_FOR_LARGE = 18

_COLUMNS = "{:<8} {:<13} {:>8} {:>8}  {:<10} {:>5}  {:<12} {:>7}"
_COLUMN_NAMES = ("SENSOR", "PORT", "RATE", "AGE", "FIX", "HDOP", "WEIGHT", "ERRORS")


def draw(state: ViewState, waited_s: float, width: int, height: int, *, ascii_only: bool = False) -> Text:
    """The screen of `width` columns and `height` lines, `waited_s` seconds after `state` was made."""
    estimate = current_estimate(state, waited_s)
    symbols = _ASCII if ascii_only else _SYMBOLS
    beside = _beside(estimate, state.method, symbols)
    lines = [_title(state, waited_s, width), Text()]
    if height >= _MIN_LINES_FOR_LARGE and not ascii_only:
        lines += _large_heading(estimate, beside)
    else:
        lines += _small_heading(estimate, beside, symbols)
    lines += [Text(), _position(estimate, symbols), Text()]
    lines.append(Text(_COLUMNS.format(*_COLUMN_NAMES), style="bold underline"))
    lines += [_sensor(row, waited_s, width) for row in state.sensors]
    if state.tasks:
        lines += [Text(), *_tasks(state.tasks, width)]
    room = height - len(lines) - 1
    if state.notices and room > 0:
        lines += [Text(), *(Text(notice) for notice in state.notices[-room:])]
    if ascii_only:
        lines = [_in_ascii(line) for line in lines]
    return Text("\n", no_wrap=True, overflow="crop", end="").join(_cut(line, width) for line in lines[:height])


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


def _beside(estimate: Estimate, method: str, symbols: _Symbols) -> list[Text]:
    word, style = _MODE_WORDS.get(estimate.mode, (estimate.mode, "bold"))
    sigma = "---"
    if estimate.mode != "invalid" and isfinite(estimate.heading_sigma_deg):
        sigma = f"{symbols.plus_minus} {estimate.heading_sigma_deg:.1f}{symbols.degree}"
        sigma += "  (uncalibrated)" if method in PAPER_METHODS else ""
    return [
        Text.assemble("heading  ", (f" {word} ", style)),
        Text(f"sigma    {sigma}"),
        Text(f"turning  {turn_text(estimate, f'{symbols.degree}/s'.strip())}"),
    ]


def _large_heading(estimate: Estimate, beside: list[Text]) -> list[Text]:
    text = heading_text(estimate)
    glyphs = [_GLYPHS[character] for character in (text if text == "---" else f"{text}°")]
    rows = ["   " + "  ".join(glyph[row] for glyph in glyphs) for row in range(_GLYPH_ROWS)]
    style = "bold" if estimate.mode != "invalid" else "bold red"
    return [
        Text.assemble((row.ljust(36), style), note) for row, note in zip(rows, [*beside, Text("true")], strict=True)
    ]


def _small_heading(estimate: Estimate, beside: list[Text], symbols: _Symbols) -> list[Text]:
    text = heading_text(estimate)
    shown = text if text == "---" else f"{text}{symbols.degree} true"
    first, *rest = beside
    return [Text.assemble("   ", (shown.ljust(18), "bold"), first), *(Text(" " * 21 + note.plain) for note in rest)]


def _position(estimate: Estimate, symbols: _Symbols) -> Text:
    word = _POSITION_WORDS.get(estimate.pos_mode, estimate.pos_mode)
    return Text(f"   position  {position_text(estimate, symbols.between)}   ({word})")


def _sensor(row: SensorRow, waited_s: float, width: int) -> Text:
    words = sensor_words(row, waited_s)
    line = _COLUMNS.format(
        words.name,
        words.port_state[:13],
        *(words.rate, words.age, words.fix, words.hdop, words.weight, words.errors),
    )
    text = Text(line)
    text.stylize("green" if row.port_state == "open" else "bold red", 9, 22)
    if row.last_error and width - len(line) > 12:
        text.append(f"  {row.last_error}")
    return text
