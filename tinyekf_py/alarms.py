"""Alarms: when the heading is gone, is less than it should be, or the sources contradict each other.

Console, page, NMEA `ALR` and Signal K notifications all say what `Alarms.update` gives. An alarm comes once its cause
has lasted, and goes once the cause has been gone for a while, so that none flickers; only a lost heading is told at
once, and only one that was never there goes at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from math import hypot, isfinite
from typing import NamedTuple

from tinyekf_py.view_state import MAX_SENSOR_AGE_S, NAN, SensorRow, ViewState, current_estimate

HEADING_INVALID, HEADING_DEGRADED, SOURCES_DISAGREE = "heading-invalid", "heading-degraded", "sources-disagree"
#: Every alarm there is -> its number where a protocol wants one (`ALR`).
NUMBERS = {HEADING_INVALID: 1, HEADING_DEGRADED: 2, SOURCES_DISAGREE: 3}

#: Two sources disagree from so many standard deviations of their difference on, and agree again below so many.
DISAGREE_SIGMAS, AGREE_SIGMAS = 3.0, 2.0
#: How long a cause lasts before its alarm comes, and how long it has been gone before the alarm goes, seconds.
HOLD_S = {HEADING_INVALID: 0.0, HEADING_DEGRADED: 1.0, SOURCES_DISAGREE: 5.0}
RELEASE_S = {HEADING_INVALID: 1.0, HEADING_DEGRADED: 3.0, SOURCES_DISAGREE: 5.0}


class Alarm(NamedTuple):
    """One alarm that is raised."""

    id: str  #: a key of `NUMBERS`
    severity: str  #: "alarm": act now; "warning": look
    text: str  #: one line for a person
    since_s: float  #: when it was raised, on the clock of `ViewState.elapsed_s`


class _Cause(NamedTuple):
    severity: str
    text: str


class _Watch:
    """One alarm's cause over time."""

    def __init__(self) -> None:
        self.cause = _Cause("warning", "")
        self.since_s = NAN  # when raised; NaN: it is not
        self.seen_s = NAN  # when the cause was last there
        self.began_s = NAN  # since when it is there; NaN: it is not


class Alarms:
    """The alarms of one run, by the view states given to `update`, which wants to be called at least once a second."""

    def __init__(self) -> None:
        self._watches = {name: _Watch() for name in NUMBERS}
        self._had_heading = False

    def update(self, state: ViewState | None, waited_s: float) -> tuple[Alarm, ...]:
        """The alarms raised `waited_s` seconds after `state` was made (None: nothing has come yet), worst first."""
        now_s = state.elapsed_s + waited_s if state is not None and isfinite(waited_s) else 0.0
        causes = {
            HEADING_INVALID: _invalid(state, waited_s),
            HEADING_DEGRADED: _degraded(state, waited_s) if state is not None else None,
            SOURCES_DISAGREE: self._contradiction(state, waited_s) if state is not None else None,
        }
        raised = []
        for name, cause in causes.items():
            watch = self._watches[name]
            _note(watch, cause, now_s, HOLD_S[name], RELEASE_S[name] if self._had_heading else 0.0)
            if isfinite(watch.since_s):
                raised.append(Alarm(name, watch.cause.severity, watch.cause.text, watch.since_s))
        self._had_heading |= causes[HEADING_INVALID] is None
        if any(alarm.id == HEADING_INVALID for alarm in raised):  # which says more than that it is degraded
            raised = [alarm for alarm in raised if alarm.id != HEADING_DEGRADED]
        return tuple(sorted(raised, key=lambda alarm: alarm.severity))

    def _contradiction(self, state: ViewState, waited_s: float) -> _Cause | None:
        rows = [
            row
            for row in state.sensors
            if isfinite(row.heading_deg + row.heading_sigma_deg) and row.age_s + waited_s <= MAX_SENSOR_AGE_S
        ]
        raised = isfinite(self._watches[SOURCES_DISAGREE].since_s)
        sigmas = AGREE_SIGMAS if raised else DISAGREE_SIGMAS
        pairs = [(a, b) for a, b in combinations(rows, 2) if _apart_deg(a, b) > sigmas * _sigma_deg(a, b)]
        return _Cause("warning", _disagreement_text(pairs)) if pairs else None


def _note(watch: _Watch, cause: _Cause | None, now_s: float, hold_s: float, release_s: float) -> None:
    if cause is not None:
        watch.cause, watch.seen_s = cause, now_s
        if not isfinite(watch.began_s):
            watch.began_s = now_s
        if not isfinite(watch.since_s) and now_s - watch.began_s >= hold_s:
            watch.since_s = now_s
    else:
        watch.began_s = NAN
        if isfinite(watch.since_s) and now_s - watch.seen_s >= release_s:
            watch.since_s = NAN


def _invalid(state: ViewState | None, waited_s: float) -> _Cause | None:
    if state is None or state.estimate is None:
        return _Cause("alarm", "no heading yet")
    if current_estimate(state, waited_s).mode != "invalid":
        return None
    return _Cause("alarm", "no heading" + _because(state.sensors))


def _degraded(state: ViewState, waited_s: float) -> _Cause | None:
    mode = current_estimate(state, waited_s).mode
    if mode == "dead-reckoning":
        return _Cause("alarm", "heading by the gyro alone" + _because(state.sensors))
    if mode == "degraded":
        stopped = [task.name for task in state.tasks if not task.running]
        stages = [name for name in stopped if name not in {row.name for row in state.sensors}]
        return _Cause("warning", "heading degraded" + _because(state.sensors, stages))
    return None


def _because(rows: Iterable[SensorRow], stopped: Iterable[str] = ()) -> str:
    faults = [f"{row.name} {row.port_state}" for row in rows if row.port_state != "open"]
    faults += [f"{row.name} without a fix" for row in rows if row.port_state == "open" and row.fix_quality == 0]
    faults += [f"{name} stopped" for name in stopped]
    return f": {', '.join(faults)}" if faults else ""


def _apart_deg(a: SensorRow, b: SensorRow) -> float:
    return abs((a.heading_deg - b.heading_deg + 180.0) % 360.0 - 180.0)


def _sigma_deg(a: SensorRow, b: SensorRow) -> float:
    return hypot(a.heading_sigma_deg, b.heading_sigma_deg)


def _disagreement_text(pairs: list[tuple[SensorRow, SensorRow]]) -> str:
    """Who stands against whom: the source in most of the pairs against those that it contradicts."""
    counts: dict[str, int] = {}
    for pair in pairs:
        for row in pair:
            counts[row.name] = counts.get(row.name, 0) + 1
    odd = max(counts, key=lambda name: counts[name])
    others = [b.name if a.name == odd else a.name for a, b in pairs if odd in (a.name, b.name)]
    return f"the headings of {odd} and {', '.join(others)} disagree"
