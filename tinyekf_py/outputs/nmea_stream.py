"""What NMEA listeners are sent, and when: the same stream for TCP, UDP and serial lines.

Each new estimate makes sentences, at most `rate_hz` times a second, and none twice: when the estimates stop, there is
silence, and after a second of it the sentences that say "invalid", once a second.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any, NamedTuple

from tinyekf_py.alarms import Alarm
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.nmea import FORMATTERS, MARKED, alarm_sentence, report_of, sentences
from tinyekf_py.view_state import ViewState

ALARM_PERIOD_S = 1.0
INVALID_PERIOD_S = 1.0
#: So often it is said that an alarm has gone.
GONE_TIMES = 3
_EARLY_S = 0.05  # estimates come every 0.1 s, more or less
_LONGEST_WAIT_S = 0.25


class Chunk(NamedTuple):
    """Whole sentences of one moment."""

    everywhere: bytes
    here: bytes  #: for listeners on this machine alone: simulated, and nothing in them says so


async def chunks(feed: Feed, settings: Mapping[str, Any]) -> AsyncIterator[Chunk]:
    """The stream as [outputs.nmea] wants it, until the program ends."""
    talker, wanted = settings["talker"], settings["sentences"]
    formatters = [formatter for formatter in wanted if formatter in FORMATTERS]
    alarms = AlarmStream(talker) if "ALR" in wanted else None
    clock = asyncio.get_running_loop().time
    due = alarms_due = 0.0
    sent_us = None
    async for _ in feed.frames(_LONGEST_WAIT_S):
        state, now = feed.state, clock()
        if state is None:
            continue
        lines: list[tuple[str, bytes]] = []
        report = report_of(state, feed.age_s, send_deviation=settings["send_deviation"])
        is_new = state.estimate is not None and state.estimate.t_us != sent_us
        if (is_new or report.estimate.mode == "invalid") and now >= due - _EARLY_S:
            period_s = 1.0 / settings["rate_hz"] if is_new else INVALID_PERIOD_S
            due = max(due + period_s, now + period_s - _EARLY_S)
            sent_us = state.estimate.t_us if state.estimate is not None else None
            lines = sentences(talker, formatters, report)
        if alarms is not None and now >= alarms_due:
            alarms_due = now + ALARM_PERIOD_S
            lines += [("ALR", line) for line in alarms.sentences(feed.alarms, state, feed.age_s)]
        if lines:
            yield split(lines, unmarked_stay=state.simulated and not settings["allow_simulated"])


def split(lines: Sequence[tuple[str, bytes]], *, unmarked_stay: bool) -> Chunk:
    """The lines as a chunk; `unmarked_stay`: those that do not say that they are simulated stay on this machine."""
    stay = [unmarked_stay and formatter not in MARKED for formatter, _ in lines]
    return Chunk(
        b"".join(line for (_, line), stays in zip(lines, stay, strict=True) if not stays),
        b"".join(line for (_, line), stays in zip(lines, stay, strict=True) if stays),
    )


class AlarmStream:
    """ALR sentences: every alarm while it is raised, and some times that it has gone."""

    def __init__(self, talker: str) -> None:
        self._talker = talker
        self._told: dict[str, Alarm] = {}
        self._times: dict[str, int] = {}

    def sentences(self, raised: Sequence[Alarm], state: ViewState, waited_s: float) -> list[bytes]:
        """What is to be said now, `waited_s` seconds after `state` was made."""
        utc_s, now_s = state.navigation.utc_s + waited_s, state.elapsed_s + waited_s
        lines = []
        for alarm in raised:
            self._told[alarm.id], self._times[alarm.id] = alarm, GONE_TIMES
            since_utc_s = utc_s - (now_s - alarm.since_s)
            lines.append(alarm_sentence(self._talker, alarm.id, alarm.text, since_utc_s, raised=True))
        for name in self._told.keys() - {alarm.id for alarm in raised}:
            lines.append(alarm_sentence(self._talker, name, self._told[name].text, utc_s, raised=False))
            self._times[name] -= 1
            if not self._times[name]:
                del self._told[name]
        return lines
