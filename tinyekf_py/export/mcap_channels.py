"""An export as MCAP with channels of JSON, which opens in Foxglove. Needs the extra `[mcap]`.

One channel for each sensor and one for the heading, with the values of the tables; beside them every position as
Foxglove's own `foxglove.LocationFix`, which its map shows. A missing value is a missing key.
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import Any

from mcap.writer import Writer

from tinyekf_py.estimate import Estimate
from tinyekf_py.export.part_files import PartFiles
from tinyekf_py.export.tables import HEADING, Table, Timed, Value, estimate_rows, heading_table, named

_JSON_TYPES = {float: "number", int: "integer", str: "string"}
_NUMBER = {"type": "number"}
_LOCATION_FIX = {
    "title": "foxglove.LocationFix",
    "type": "object",
    "properties": {
        "timestamp": {
            "type": "object",
            "title": "time",
            "properties": {
                "sec": {"type": "integer", "minimum": 0},
                "nsec": {"type": "integer", "minimum": 0, "maximum": 999_999_999},
            },
        },
        "frame_id": {"type": "string"},
        "latitude": _NUMBER,
        "longitude": _NUMBER,
        "altitude": _NUMBER,
        "position_covariance": {"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
        "position_covariance_type": {
            "title": "foxglove.PositionCovarianceType",
            "oneOf": [
                {"title": title, "const": value}
                for value, title in enumerate(("UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"))
            ],
        },
    },
}


class McapChannels:
    """Writes one file; log times are UTC where the recording tells its start, else since that start."""

    def __init__(self, path: Path, files: PartFiles, stack: ExitStack, n_gps: int, start_utc: datetime | None) -> None:
        """`stack` ends the file, before `files` moves it into place."""
        self._n_gps = n_gps
        self._heading = heading_table(n_gps)
        self._start_us = round(start_utc.timestamp() * 1e6) if start_utc is not None else 0
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._writer = Writer(stack.enter_context(open(files.path_for(path), "wb")))  # noqa: SIM115
        self._writer.start(profile="", library="tinyekf")
        stack.callback(self._writer.finish)

    def samples(self, table: Table, rows: list[Timed]) -> None:
        """Append messages of a sensor, and its positions."""
        topic = f"/{table.name}"
        channel = self._channel(topic, f"tinyekf.{table.kind}", _schema(table))
        location = "/location" if table.name == HEADING else f"{topic}/location"
        for t_us, row in rows:
            values = dict(named(table, row))
            self._message(channel, t_us, {"t_s": t_us / 1e6, **values})
            if "lat_deg" in values and "lon_deg" in values:
                fixes = self._channel(location, "foxglove.LocationFix", _LOCATION_FIX)
                self._message(fixes, t_us, self._location_fix(t_us, table.name, values))

    def estimates(self, estimates: list[Estimate]) -> None:
        """Append messages of the heading, and the fused positions."""
        self.samples(self._heading, estimate_rows(estimates, self._n_gps))

    def _location_fix(self, t_us: int, frame_id: str, values: dict[str, Value]) -> dict[str, Any]:
        seconds, rest_us = divmod(self._start_us + t_us, 1_000_000)
        return {
            "timestamp": {"sec": seconds, "nsec": rest_us * 1000},
            "frame_id": frame_id,
            "latitude": values["lat_deg"],
            "longitude": values["lon_deg"],
            "altitude": values.get("altitude_m") or 0.0,
            "position_covariance": [0.0] * 9,
            "position_covariance_type": 0,
        }

    def _channel(self, topic: str, schema_name: str, schema: dict[str, Any]) -> int:
        if topic not in self._channels:
            if schema_name not in self._schemas:
                self._schemas[schema_name] = self._writer.register_schema(
                    schema_name, "jsonschema", json.dumps(schema).encode()
                )
            self._channels[topic] = self._writer.register_channel(topic, "json", self._schemas[schema_name])
        return self._channels[topic]

    def _message(self, channel: int, t_us: int, message: dict[str, Any]) -> None:
        time_ns = (self._start_us + t_us) * 1000
        data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
        self._writer.add_message(channel, log_time=time_ns, data=data, publish_time=time_ns)


def _schema(table: Table) -> dict[str, Any]:
    properties = {column.name: {"type": _JSON_TYPES[column.kind]} for column in table.columns}
    return {"title": f"tinyekf.{table.kind}", "type": "object", "properties": {"t_s": _NUMBER, **properties}}
