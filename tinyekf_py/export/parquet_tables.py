"""An export as Parquet: a folder with a file for each sensor, and heading.parquet. Needs the extra `[parquet]`."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tinyekf_py.estimate import Estimate
from tinyekf_py.export.part_files import PartFiles
from tinyekf_py.export.tables import Table, Timed, estimate_rows, heading_table

_ROWS = 50_000  # of a row group
_TYPES = {float: pa.float64(), int: pa.int32(), str: pa.string()}


class ParquetTables:
    """Writes `FOLDER/TABLE.parquet`; missing values are null.

    `t_s` are seconds since the recording's start; `utc`, where the recording tells its start, is a timestamp.
    """

    def __init__(
        self, folder: Path, files: PartFiles, stack: ExitStack, n_gps: int, start_utc: datetime | None
    ) -> None:
        """`stack` writes the rest and closes the files, before `files` moves them into place."""
        self._folder, self._files, self._stack = folder, files, stack
        self._start_us = round(start_utc.timestamp() * 1e6) if start_utc is not None else None
        self._n_gps = n_gps
        self._heading = heading_table(n_gps)
        self._waiting: dict[str, list[Timed]] = {}
        self._writers: dict[str, pq.ParquetWriter] = {}
        self._begin(self._heading)

    def samples(self, table: Table, rows: list[Timed]) -> None:
        """Append rows of a sensor."""
        if table.name not in self._writers:
            self._begin(table)
        waiting = self._waiting[table.name]
        waiting += rows
        if len(waiting) >= _ROWS:
            self._flush(table)

    def estimates(self, estimates: list[Estimate]) -> None:
        """Append rows of the heading."""
        self.samples(self._heading, estimate_rows(estimates, self._n_gps))

    def _begin(self, table: Table) -> None:
        fields: list[Any] = [pa.field("t_s", pa.float64())]
        if self._start_us is not None:
            fields.append(pa.field("utc", pa.timestamp("us", tz="UTC")))
        fields += [pa.field(column.name, _TYPES[column.kind]) for column in table.columns]
        path = self._files.path_for(self._folder / f"{table.name}.parquet")
        self._writers[table.name] = self._stack.enter_context(pq.ParquetWriter(path, pa.schema(fields)))
        self._waiting[table.name] = []
        self._stack.callback(self._flush, table)

    def _flush(self, table: Table) -> None:
        rows, writer = self._waiting[table.name], self._writers[table.name]
        if not rows:
            return
        columns: list[Any] = [[t_us / 1e6 for t_us, _ in rows]]
        if self._start_us is not None:
            columns.append([self._start_us + t_us for t_us, _ in rows])
        columns += zip(*(row for _, row in rows), strict=True)
        arrays = [pa.array(column, field.type) for column, field in zip(columns, writer.schema, strict=True)]
        writer.write_table(pa.Table.from_arrays(arrays, schema=writer.schema))
        rows.clear()
