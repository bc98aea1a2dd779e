"""An export as CSV: a folder with a file for each sensor, and heading.csv, which is the heading CSV itself."""

from __future__ import annotations

import csv
from contextlib import ExitStack
from pathlib import Path
from typing import TextIO

from acquisition.recording import format_seconds
from tinyekf_py.estimate import Estimate, decimals_of
from tinyekf_py.export.part_files import PartFiles
from tinyekf_py.export.tables import HEADING, Table, Timed, Value
from tinyekf_py.heading_csv import format_header, format_row


class CsvTables:
    """Writes `FOLDER/TABLE.csv`; missing values are empty fields, times seconds since the recording's start."""

    def __init__(self, folder: Path, files: PartFiles, stack: ExitStack, n_gps: int) -> None:
        """`stack` closes the files, before `files` moves them into place."""
        self._folder, self._files, self._stack, self._n_gps = folder, files, stack, n_gps
        self._open: dict[str, TextIO] = {}
        self._heading = self._file(HEADING, format_header(n_gps))

    def samples(self, table: Table, rows: list[Timed]) -> None:
        """Append rows of a sensor."""
        file = self._open.get(table.name)
        if file is None:
            file = self._file(table.name, ",".join(["t_s", *(column.name for column in table.columns)]))
        writer = csv.writer(file, lineterminator="\n")
        decimals = [decimals_of(column.name) for column in table.columns]
        writer.writerows((format_seconds(t_us), *map(_rounded, row, decimals)) for t_us, row in rows)

    def estimates(self, estimates: list[Estimate]) -> None:
        """Append rows of the heading CSV."""
        self._heading.writelines(f"{format_row(estimate, self._n_gps)}\n" for estimate in estimates)

    def _file(self, name: str, header: str) -> TextIO:
        path = self._files.path_for(self._folder / f"{name}.csv")
        file = self._stack.enter_context(open(path, "w", encoding="utf-8", newline=""))  # noqa: SIM115
        file.write(f"{header}\n")
        self._open[name] = file
        return file


def _rounded(value: Value, decimals: int) -> Value:
    return round(value, decimals) + 0.0 if isinstance(value, float) else value  # + 0.0: never -0.0
