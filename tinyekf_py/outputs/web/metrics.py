"""The view state as Prometheus text: what is not known now has no line."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterable, Mapping
from math import isfinite
from pathlib import Path

from tinyekf_py.estimate import MODES, POSITION_MODES
from tinyekf_py.outputs.feed import Feed
from tinyekf_py.view_state import MAX_SENSOR_AGE_S, SensorRow, ViewState

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_PAGE = os.sysconf("SC_PAGE_SIZE")

Labels = Mapping[str, str]
Samples = Iterable[tuple[Labels, float]]


def metrics_text(feed: Feed, served: Mapping[str, Samples]) -> str:
    """All metrics; `served` are this server's own, by a name of `_SERVED`."""
    state = feed.state or ViewState(None)
    estimate = feed.estimate
    none: Labels = {}
    text = [
        _family("tinyekf_up", "gauge", "Whether the program speaks.", [(none, float(feed.age_s < 2.0))]),
        _family("tinyekf_info", "gauge", "The run.", [({"method": state.method}, 1.0)]),
        _family("tinyekf_simulated", "gauge", "Whether the boat is simulated.", [(none, float(state.simulated))]),
        _family("tinyekf_run_seconds", "gauge", "Time since the run's start.", [(none, state.elapsed_s)]),
        _family("tinyekf_heading_degrees", "gauge", "True heading.", [(none, estimate.heading_deg)]),
        _family(
            *("tinyekf_heading_sigma_degrees", "gauge", "Standard deviation of the heading."),
            [(none, estimate.heading_sigma_deg)],
        ),
        _family(
            *("tinyekf_rate_of_turn_degrees_per_second", "gauge", "Rate of turn, positive to starboard."),
            [(none, estimate.rate_of_turn_dps)],
        ),
        _family(
            *("tinyekf_heading_mode", "gauge", "1 for the mode that the heading has."),
            [({"mode": mode}, float(mode == estimate.mode)) for mode in MODES],
        ),
        _family(
            *("tinyekf_position_mode", "gauge", "1 for the mode that the position has."),
            [({"mode": mode}, float(mode == estimate.pos_mode)) for mode in POSITION_MODES],
        ),
        _family("tinyekf_latitude_degrees", "gauge", "North positive.", [(none, estimate.lat_deg)]),
        _family("tinyekf_longitude_degrees", "gauge", "East positive.", [(none, estimate.lon_deg)]),
        *_of_sensors(state.sensors, feed.age_s),
        _family(
            *("tinyekf_task_running", "gauge", "Whether the task runs."),
            [({"task": task.name}, float(task.running)) for task in state.tasks],
        ),
        _family(
            *("tinyekf_recording_lost_total", "counter", "Entries that could not be recorded."),
            [(none, float(state.recording_lost))],
        ),
        *(_family(name, *_SERVED[name], samples) for name, samples in served.items()),
        *_of_process(),
    ]
    return "".join(text)


_SERVED = {
    "tinyekf_web_clients": ("gauge", "WebSocket clients, by stream."),
    "tinyekf_web_frames_total": ("counter", "Frames sent to WebSocket clients."),
    "tinyekf_web_frames_lost_total": ("counter", "Frames that a slow client was spared."),
    "tinyekf_web_refused_total": ("counter", "Requests and connections that were turned away, by reason."),
}


def _of_sensors(rows: Iterable[SensorRow], waited_s: float) -> Iterable[str]:
    rows = tuple(rows)
    fresh = {row.name: row.age_s + waited_s <= MAX_SENSOR_AGE_S for row in rows}
    nan = float("nan")

    def each(name: str, kind: str, doc: str, values: Iterable[float]) -> str:
        return _family(name, kind, doc, [({"sensor": row.name}, v) for row, v in zip(rows, values, strict=True)])

    yield each("tinyekf_sensor_open", "gauge", "Whether its port is open.", (row.port_state == "open" for row in rows))
    yield each("tinyekf_sensor_rate_hertz", "gauge", "Samples a second.", (row.rate_hz for row in rows))
    yield each("tinyekf_sensor_age_seconds", "gauge", "Since the last sample.", (row.age_s + waited_s for row in rows))
    fixes = (float(row.fix_quality) if row.fix_quality >= 0 and fresh[row.name] else nan for row in rows)
    yield each("tinyekf_sensor_fix_quality", "gauge", "GPS: as GGA's.", fixes)
    yield each("tinyekf_sensor_hdop", "gauge", "GPS.", (row.hdop if fresh[row.name] else nan for row in rows))
    weights = (row.weight if fresh[row.name] else nan for row in rows)
    yield each("tinyekf_sensor_weight", "gauge", "GPS: of stage 1, 0 to 3.", weights)
    headings = (row.heading_deg if fresh[row.name] else nan for row in rows)
    yield each("tinyekf_sensor_heading_degrees", "gauge", "Of it alone: a GPS's course, the compass.", headings)
    yield each("tinyekf_sensor_lines_total", "counter", "Lines received.", (row.lines for row in rows))
    yield each("tinyekf_sensor_samples_total", "counter", "Samples made of them.", (row.samples for row in rows))
    yield each("tinyekf_sensor_errors_total", "counter", "Lines dropped.", (row.errors for row in rows))
    yield each("tinyekf_sensor_restarts_total", "counter", "Restarts of its worker.", (row.restarts for row in rows))
    yield each("tinyekf_sensor_down_seconds_total", "counter", "Time without data.", (row.down_s for row in rows))
    dropped = [({"sensor": row.name, "reason": why}, float(n)) for row in rows for why, n in row.dropped]
    yield _family("tinyekf_sensor_dropped_total", "counter", "Lines dropped, by reason.", dropped)


def _of_process() -> Iterable[str]:
    """What Prometheus' own clients say of a process: this is the output process, not the fusion."""
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE
    yield _family(
        "process_cpu_seconds_total", "counter", "CPU time of the output process.", [({}, time.process_time())]
    )
    yield _family("process_resident_memory_bytes", "gauge", "Memory of the output process.", [({}, float(resident))])


def _family(name: str, kind: str, doc: str, samples: Samples) -> str:
    lines = [f"{name}{_labels(labels)} {float(value):.12g}\n" for labels, value in samples if isfinite(value)]
    return "".join((f"# HELP {name} {doc}\n# TYPE {name} {kind}\n", *lines)) if lines else ""


def _labels(labels: Labels) -> str:
    if not labels:
        return ""
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(value: str) -> str:
    return re.sub(r'[\\"\n]', lambda found: {"\\": "\\\\", '"': '\\"', "\n": "\\n"}[found[0]], value)
