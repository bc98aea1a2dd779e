"""Channels of a drive: columns of CSV files as time series in SI units, with what was wrong with them counted.

Here raw voltages and impulse counts become units, time stamps lose their sensor's latency, and mistakes that show are
told: a voltage that no A/D converter gives, a speed that no car reaches.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tinyekf_py.vehicle.config import CHANNELS, UNITS, ChannelConfig, VehicleConfig
from tinyekf_py.vehicle.table import DriveError, Floats, Table, read_table

#: Largest voltage of an A/D converter that is believed.
LARGEST_V = 12.0
#: Quantity -> largest magnitude that is believed, SI.
LARGEST = {"speed": 100.0, "rotation rate": 10.0, "acceleration": 100.0, "angle": 360.0, "distance": 1e8}
#: From this share of implausible values on it is the unit that is wrong, not the value.
UNIT_MISTAKE = 0.01

_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


class Series(NamedTuple):
    """One channel: values at increasing times."""

    t_s: Floats  #: shape (n,), latency taken off
    values: Floats  #: shape (n,), SI (latitudes and longitudes in degrees); NaN is missing
    cumulative: bool  #: a counter's distance, not a rate


class Channels(NamedTuple):
    """What a drive recorded."""

    series: Mapping[str, Series]
    fresh_gps: np.ndarray  #: shape (rows of the GPS file,), whether a row brings a new position
    counts: Counter[str]  #: what was left out, and why


def read_channels(path: Path, config: VehicleConfig) -> Channels:
    """Read DATA.csv and what the configuration names beside it."""
    counts: Counter[str] = Counter()
    tables: dict[Path, Table] = {}

    def table_of(file: str) -> Table:
        found = path.parent / file if file else path
        if found not in tables:
            tables[found] = read_table(found)
            counts["malformed fields"] += tables[found].malformed
        return tables[found]

    series: dict[str, Series] = {}
    times: dict[tuple[Path, str], tuple[Floats, np.ndarray]] = {}
    fresh = np.zeros(0, bool)
    for name, channel in config.channels.items():
        table = table_of(channel.file)
        if config.is_default and channel.column[0] not in table.names:
            continue
        time_column = channel.time_column or config.time.column
        if (table.path, time_column) not in times:
            times[table.path, time_column] = _times(table, time_column, _TIME_UNITS[config.time.unit], counts)
        t_s, kept = times[table.path, time_column]
        latency = config.gps.latency_s if name.startswith("gps_") else 0.0
        values, cumulative = _values(name, channel, table, kept, counts)
        series[name] = Series(t_s - channel.latency_s - latency, values, cumulative)
        if name in ("gps_lat", "gps_x"):
            fresh = _fresh(table, kept, config, values)
    _check_gps(path, series)
    return Channels(series, fresh, counts)


def _check_gps(path: Path, series: Mapping[str, Series]) -> None:
    for one, other in (("gps_lat", "gps_lon"), ("gps_x", "gps_y")):
        if (one in series) != (other in series):
            raise DriveError(f"{path}: {one} and {other} belong together; one of them is missing")
    if "gps_lat" not in series and "gps_x" not in series:
        raise DriveError(f"{path}: no GPS position: name channels gps_lat and gps_lon, or gps_x and gps_y")


def _times(table: Table, name: str, unit_s: float, counts: Counter[str]) -> tuple[Floats, np.ndarray]:
    """Time stamps in seconds that increase, and which rows have them."""
    t = table.column(name, "the time stamps") * unit_s
    finite = np.isfinite(t)
    latest = np.maximum.accumulate(np.where(finite, t, -np.inf))
    kept = finite.copy()
    kept[1:] &= t[1:] > latest[:-1]
    dropped = int(len(t) - kept.sum())
    if dropped * 2 > len(t):
        raise DriveError(
            f"{table.path}: {dropped} of {len(t)} time stamps in {name!r} do not increase; is it the time?"
        )
    counts["rows with missing times"] += int((~finite).sum())
    counts["rows out of order or repeated"] += dropped - int((~finite).sum())
    return t[kept], kept


def _values(
    name: str, channel: ChannelConfig, table: Table, kept: np.ndarray, counts: Counter[str]
) -> tuple[Floats, bool]:
    raw = np.zeros(int(kept.sum()))
    for column, weight in zip(channel.column, channel.axis, strict=True):
        one = table.column(column, f"channel {name}")[kept]
        if channel.raw == "V":
            one = _believed(one, LARGEST_V, f"{table.path}: channel {name}", "V", counts)
        raw = raw + weight * one
    unit = channel.unit or CHANNELS[name][1]
    quantity, size = UNITS[unit]
    values = (channel.scale * raw + channel.offset) * size
    values = _believed(values, LARGEST[quantity], f"{table.path}: channel {name}", f"as {quantity} in SI units", counts)
    return values, quantity == "distance" and not name.startswith("gps_")


def _believed(values: Floats, largest: float, where: str, what: str, counts: Counter[str]) -> Floats:
    """The values, those beyond `largest` missing; DriveError when they are so many that the unit must be wrong."""
    beyond = np.abs(values) > largest
    n = int(beyond.sum())
    if n > UNIT_MISTAKE * len(values):
        example = values[beyond][0]
        raise DriveError(
            f"{where} has {example:g} {what}, where {largest:g} is the most; are raw, scale and unit right?"
        )
    counts["implausible values"] += n
    return np.where(beyond, np.nan, values)


def _fresh(table: Table, kept: np.ndarray, config: VehicleConfig, values: Floats) -> np.ndarray:
    """Rows that bring a new position, where a slower receiver's last one is repeated."""
    fresh = np.isfinite(values)
    if config.gps.change_column:
        watched = table.column(config.gps.change_column, "gps.change_column")[kept]
        changed = np.ones(len(watched), bool)
        changed[1:] = watched[1:] != watched[:-1]
        return fresh & changed
    return fresh
