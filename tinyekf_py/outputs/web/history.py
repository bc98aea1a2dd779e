"""The last five minutes, for a page that is opened late: twice a second, each point encoded once."""

from __future__ import annotations

from collections import deque
from typing import Any

from tinyekf_py.outputs.feed import Feed
from tinyekf_py.outputs.web.wire import number, to_json
from tinyekf_py.view_state import MAX_ESTIMATE_AGE_S, ViewState

LENGTH_S = 300.0
PERIOD_S = 0.5
#: What a point is made of. Sensors are in the order of `History.sensors`.
COLUMNS = (
    *("t_s", "heading_deg", "heading_sigma_deg", "mode", "lat_deg", "lon_deg"),
    *("sensor_heading_deg", "sensor_weight", "sensor_errors"),
)


class History:
    """Points of a run; a run that begins anew begins an empty history."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, str]] = deque()  # the time of each, and its JSON
        self._sensors: tuple[str, ...] = ()
        self._last_s = float("-inf")

    def add(self, feed: Feed) -> None:
        """Take a point of what `feed` says now, unless the last one is too near."""
        state = feed.state
        if state is None:
            return
        stale = not feed.age_s <= MAX_ESTIMATE_AGE_S
        t_s = state.elapsed_s + (feed.age_s if stale else 0.0)
        sensors = tuple(row.name for row in state.sensors)
        if sensors != self._sensors or t_s < self._last_s:
            self._points.clear()
            self._sensors, self._last_s = sensors, float("-inf")
        if t_s - self._last_s < PERIOD_S * 0.9:
            return
        self._last_s = t_s
        estimate = feed.estimate
        point = (
            round(t_s, 1),
            number(estimate.heading_deg, 1),
            number(estimate.heading_sigma_deg, 1),
            estimate.mode,
            number(estimate.lat_deg, 6),
            number(estimate.lon_deg, 6),
            *_of_sensors(state, stale),
        )
        self._points.append((t_s, to_json(point)))
        while self._points[0][0] < t_s - LENGTH_S:
            self._points.popleft()

    def json(self) -> str:
        """All points, as one object."""
        head = to_json({"columns": COLUMNS, "sensors": self._sensors, "length_s": LENGTH_S, "period_s": PERIOD_S})
        return f'{head[:-1]},"points":[{",".join(text for _, text in self._points)}]}}'


def _of_sensors(state: ViewState, stale: bool) -> tuple[list[Any], list[Any], list[Any]]:
    rows = state.sensors
    if stale:
        return [None] * len(rows), [None] * len(rows), [row.errors for row in rows]
    return (
        [number(row.heading_deg, 1) for row in rows],
        [number(row.weight, 1) for row in rows],
        [row.errors for row in rows],
    )
