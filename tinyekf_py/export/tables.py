"""The tables of an export: one for each sensor with its samples, and `heading` with the estimates.

A row is a tuple with one value for each column of its table: numbers, words, or None for what is missing. Times are
microseconds since the recording's start.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isfinite
from typing import NamedTuple, Protocol

from acquisition.sample import (
    COMPASS,
    IMU,
    REFERENCE_TRUE,
    SAMPLE_SIZE,
    SOURCE_NAMES,
    CompassSample,
    GpsSample,
    ImuSample,
    Sample,
    unpack,
)
from tinyekf_py.estimate import Estimate, heading_columns
from tinyekf_py.estimate_array import estimates_to_array

HEADING = "heading"

Value = float | int | str | None
Row = tuple[Value, ...]


class ExportError(ValueError):
    """An export that cannot be made: one line saying what is missing or in the way."""


class Column(NamedTuple):
    """One column; its name ends with its unit."""

    name: str
    kind: type[float] | type[int] | type[str]


class Table(NamedTuple):
    """One table; the time of its rows stands apart."""

    name: str  #: a source, or `HEADING`
    kind: str  #: gps, compass, imu or heading
    columns: tuple[Column, ...]


class Timed(NamedTuple):
    """A row and its time."""

    t_us: int  #: since the recording's start
    row: Row


class Sink(Protocol):
    """Where rows go, oldest first in each table."""

    def samples(self, table: Table, rows: list[Timed]) -> None:
        """Take rows of a sensor."""
        ...

    def estimates(self, estimates: list[Estimate]) -> None:
        """Take estimates."""
        ...


def sample_table(source: int) -> Table:
    """The table of a source's samples: the sample's fields without its number and what is reserved."""
    if source == COMPASS:
        sample, skipped = CompassSample._field_defaults, 0
        kind = "compass"
    elif source == IMU:
        sample, skipped = ImuSample._field_defaults, 1
        kind = "imu"
    else:
        sample, skipped = GpsSample._field_defaults, 0
        kind = "gps"
    columns = [Column(name, int if isinstance(value, int) else float) for name, value in sample.items()][skipped:]
    if source == COMPASS:
        columns[0] = Column("reference", str)
    return Table(SOURCE_NAMES[source], kind, tuple(columns))


def heading_table(n_gps: int) -> Table:
    """The table of the estimates: the heading CSV's columns without the time."""
    words = ("mode", "pos_mode")
    columns = heading_columns(n_gps)[1:]
    return Table(HEADING, HEADING, tuple(Column(name, str if name in words else float) for name in columns))


def samples_by_source(records: bytes) -> dict[int, list[Timed]]:
    """Packed samples as rows of their sources' tables."""
    rows: dict[int, list[Timed]] = {}
    for begin in range(0, len(records), SAMPLE_SIZE):
        sample = unpack(records[begin : begin + SAMPLE_SIZE])
        rows.setdefault(sample.source, []).append(Timed(sample.t_us, _sample_row(sample)))
    return rows


def estimate_rows(estimates: list[Estimate], n_gps: int) -> list[Timed]:
    """Estimates as rows of the heading's table."""
    values = estimates_to_array(estimates, n_gps).tolist()
    return [Timed(estimate.t_us, _known(row[1:])) for estimate, row in zip(estimates, values, strict=True)]


def _sample_row(sample: Sample) -> Row:
    if isinstance(sample, GpsSample):
        fix, *middle, satellites = sample[2:]
        return (_count(int(fix)), *_known(middle), _count(int(satellites)))
    if isinstance(sample, CompassSample):
        return ("true" if sample.reference == REFERENCE_TRUE else "compass", *_known(sample[3:]))
    return _known(sample[3:])


def _count(number: int) -> int | None:
    return number if number >= 0 else None


def _known(values: Iterable[float | str]) -> Row:
    return tuple(value if isinstance(value, str) or isfinite(value) else None for value in values)


def named(table: Table, row: Row) -> Iterator[tuple[str, Value]]:
    """The known values of a row with their columns' names."""
    return ((column.name, value) for column, value in zip(table.columns, row, strict=True) if value is not None)
