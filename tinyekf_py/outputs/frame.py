"""The packets between the live program and its output process: one datagram of JSON each.

Down go frames, the whole `ViewState` ten times a second; up come the clients' requests, one at a time, and lines for
the log; the answers to requests go down between the frames.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from tinyekf_py.estimate import Estimate
from tinyekf_py.view_state import Navigation, SensorRow, TaskRow, ViewState

MAX_PACKET = 1 << 16  # bytes


class Frame(NamedTuple):
    """A view state, and when it was made."""

    made_at_s: float  #: on the monotonic clock
    state: ViewState


class Request(NamedTuple):
    """What a client wants: status, start TASK, stop TASK."""

    number: int  #: the answer's will be the same
    words: tuple[str, ...]


class Answer(NamedTuple):
    """What the live program says to a request."""

    number: int
    answer: Mapping[str, Any]


class LogLine(NamedTuple):
    """A line for the program's log."""

    level: int  #: as in `logging`
    text: str


Packet = Frame | Request | Answer | LogLine
_KINDS: dict[str, type[Frame] | type[Request] | type[Answer] | type[LogLine]] = {
    "frame": Frame,
    "request": Request,
    "answer": Answer,
    "log": LogLine,
}
_NAMES = {kind: name for name, kind in _KINDS.items()}


def encode(packet: Packet) -> bytes:
    """The datagram of `packet`. Missing numbers are NaN in it, which JSON proper does not have and Python's reads."""
    return json.dumps((_NAMES[type(packet)], packet), separators=(",", ":")).encode()


def decode(datagram: bytes) -> Packet:
    """The packet of a datagram of our own."""
    name, fields = json.loads(datagram)
    if name == "frame":
        made_at_s, state = fields
        return Frame(made_at_s, _view_state(state))
    if name == "request":
        return Request(fields[0], tuple(fields[1]))
    return Answer(*fields) if name == "answer" else LogLine(*fields)


def _view_state(fields: list[Any]) -> ViewState:
    state = ViewState(*fields)
    estimate = Estimate(*state.estimate) if state.estimate is not None else None
    if estimate is not None:
        estimate = estimate._replace(
            weights=tuple(estimate.weights), faz_deg=tuple(estimate.faz_deg), ekf_deg=tuple(estimate.ekf_deg)
        )
    rows = (SensorRow(*row) for row in state.sensors)
    return state._replace(
        estimate=estimate,
        sensors=tuple(row._replace(dropped=tuple((reason, count) for reason, count in row.dropped)) for row in rows),
        notices=tuple(state.notices),
        tasks=tuple(TaskRow(*row) for row in state.tasks),
        navigation=Navigation(*state.navigation),
    )
