"""CSV tables of numbers, read fast: an hour at 100 Hz is 3.6 million fields.

The first line names the columns. A field that is empty or no number is missing (NaN) and counted when it is not empty.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class DriveError(ValueError):
    """A drive that cannot be processed: what, where, what to do, in one line."""


class Table(NamedTuple):
    """A CSV file's numbers."""

    path: Path
    names: tuple[str, ...]
    rows: Floats  #: shape (n, number of names)
    malformed: int  #: fields that are no numbers, and rows of another length, which are left out

    def column(self, name: str, of: str) -> Floats:
        """The column `name`, shape (n,); `of` says in an error what wanted it."""
        if name not in self.names:
            raise DriveError(f"{self.path}: no column {name!r} (for {of}); there are {', '.join(self.names)}")
        return self.rows[:, self.names.index(name)]


def read_table(path: Path) -> Table:
    """Read a CSV file of numbers."""
    try:
        content = path.read_bytes().replace(b"\r\n", b"\n")
    except OSError as error:
        raise DriveError(f"{path}: {error.strerror or error}") from error
    header, _, body = content.partition(b"\n")
    names = tuple(name.strip() for name in header.decode("utf-8", "replace").lstrip("\ufeff").split(","))
    if len(set(names)) != len(names) or not all(names):
        raise DriveError(f"{path}: the first line must name the columns, each once: {header[:80]!r}")
    if not body.strip():
        raise DriveError(f"{path}: no rows below the first line")
    rows = _read_fast(body, len(names))
    if rows is not None:
        return Table(path, names, rows, 0)
    return Table(path, names, *_read_careful(body, len(names)))


def _read_fast(body: bytes, width: int) -> Floats | None:
    """All fields in one go; None where the body is not a full table of numbers."""
    while b",," in body:
        body = body.replace(b",,", b",nan,")
    body = body.replace(b",\n", b",nan\n").replace(b"\n,", b"\nnan,")
    body = (b"nan" if body.startswith(b",") else b"") + body.rstrip(b"\n")
    if body.endswith(b","):
        body += b"nan"
    lines = body.count(b"\n") + 1
    if body.count(b",") != lines * (width - 1):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how NumPy says that it met something else than a number
        try:
            numbers = np.fromstring(body.replace(b"\n", b",").decode("ascii", "replace"), sep=",")
        except (DeprecationWarning, ValueError):
            return None
    return numbers.reshape(lines, width) if numbers.size == lines * width else None


def _read_careful(body: bytes, width: int) -> tuple[Floats, int]:
    malformed = 0
    rows: list[list[float]] = []
    for line in body.decode("utf-8", "replace").splitlines():
        fields = line.split(",")
        if len(fields) != width:
            malformed += bool(line.strip())
            continue
        row = []
        for field in fields:
            try:
                row.append(float(field))
            except ValueError:
                malformed += bool(field.strip())
                row.append(math.nan)
        rows.append(row)
    return np.array(rows, float).reshape(-1, width), malformed


def write_table(path: Path, names: Iterable[str], formats: Iterable[str], rows: Iterable[Iterable[object]]) -> None:
    """Write a CSV file: a %-format a column; NaN becomes an empty field."""
    line = ",".join(formats) + "\n"
    with path.open("w", encoding="ascii") as file:
        file.write(",".join(names) + "\n")
        file.write("".join([line % tuple(row) for row in rows]).replace("nan", ""))
