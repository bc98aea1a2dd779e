"""The heading CSV: ten rows a second of what fusion found, the same live and replayed, byte for byte.

The live program writes it with `HeadingCsvWriter`, which never makes fusion wait; a replay with `write_heading_csv`.
Both render a row with `format_row`, a pure function of the estimate. `read_heading_csv` gives the columns to analysis.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable
from functools import partial
from itertools import chain, islice
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from acquisition.background_file import BackgroundFile
from tinyekf_py.estimate import MIN_GPS_COLUMNS, MODES, POSITION_MODES, Estimate, heading_columns

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_BATCH = 1000


class HeadingCsvError(ValueError):
    """A heading CSV that cannot be read or written: one line saying which, where and why."""


def format_header(n_gps: int) -> str:
    """The first line of a heading CSV with `n_gps` receivers configured, without its line end."""
    return ",".join(heading_columns(n_gps))


def format_row(estimate: Estimate, n_gps: int) -> str:
    """One row of a heading CSV, without its line end.

    Seconds have one decimal, angles four (never 360.0000), latitude and longitude nine; what is not known is empty.
    """
    t_us, heading, sigma, rate, lat, lon, mode, pos_mode, weights, faz, gpsec, ekf = estimate
    tenths = (t_us + 50_000) // 100_000
    fields = [
        f"{tenths // 10}.{tenths % 10}",
        _angle(heading),
        f"{sigma:z.4f}" if isfinite(sigma) else "",
        f"{rate:z.4f}" if isfinite(rate) else "",
        f"{lat:z.9f}" if isfinite(lat) else "",
        f"{lon:z.9f}" if isfinite(lon) else "",
        mode,
        pos_mode,
    ]
    width = n_gps if n_gps > MIN_GPS_COLUMNS else MIN_GPS_COLUMNS
    fields += _padded([f"{weight:zg}" if isfinite(weight) else "" for weight in weights], width)
    fields += _padded([_angle(angle) for angle in faz], width)
    fields.append(_angle(gpsec))
    fields += _padded([_angle(angle) for angle in ekf], width)
    return ",".join(fields)


def _angle(degrees: float) -> str:
    if not isfinite(degrees):
        return ""
    text = f"{degrees:z.4f}"
    return "0.0000" if text == "360.0000" else text


def _padded(texts: list[str], width: int) -> list[str]:
    return texts if len(texts) == width else (texts + [""] * width)[:width]


class HeadingCsvWriter:
    """Writes a heading CSV behind its caller's back (`acquisition.background_file` says how). Replaces an old file."""

    def __init__(self, path: str | Path, n_gps: int) -> None:
        try:
            self._file: BackgroundFile[Estimate] = BackgroundFile(
                path, f"{format_header(n_gps)}\n".encode(), partial(_render, n_gps=n_gps)
            )
        except OSError as error:
            raise _cannot_write(path, error) from error

    @property
    def failure(self) -> str:
        """Why writing has stopped, one line; empty while it goes on."""
        return self._file.failure

    def row(self, estimate: Estimate) -> None:
        """Append the row of `estimate`; costs the caller a list append."""
        self._file.put(estimate)

    def flush(self) -> None:
        """Wait until all rows are on the disk (or writing has failed)."""
        self._file.flush()

    def close(self) -> None:
        """Write the rest and end; harmless when repeated. UnfinishedFileError when the CSV lacks its end."""
        self._file.close()


def _render(estimates: list[Estimate], n_gps: int) -> bytes:
    return "".join(f"{format_row(estimate, n_gps)}\n" for estimate in estimates).encode()


def write_heading_csv(path: str | Path, estimates: Iterable[Estimate], n_gps: int) -> int:
    """Write all `estimates`, as they come, and return their number; HeadingCsvError when the file cannot be written."""
    count = 0
    remaining = iter(estimates)
    try:
        with open(path, "wb") as file:
            file.write(f"{format_header(n_gps)}\n".encode())
            while batch := list(islice(remaining, _BATCH)):
                file.write(_render(batch, n_gps))
                count += len(batch)
    except OSError as error:
        raise _cannot_write(path, error) from error
    return count


def _cannot_write(path: str | Path, error: OSError) -> HeadingCsvError:
    return HeadingCsvError(f"cannot write heading CSV {path}: {error.strerror or error}")


def read_heading_csv(path: str | Path) -> NDArray[np.void]:
    """The rows of a heading CSV as an array of shape (rows,) with its columns as fields (`estimate_dtype`).

    Empty fields are NaN. A last row that a power cut left without its line end is dropped; any other damage is a
    HeadingCsvError naming the line.
    """
    import numpy as np  # for analysis alone: what writes a heading CSV needs none

    from tinyekf_py.estimate_array import estimate_dtype

    try:
        text = Path(path).read_text("utf-8")
    except OSError as error:
        raise HeadingCsvError(f"cannot read heading CSV {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise HeadingCsvError(f"{path} is not a heading CSV: it is not text") from error
    lines = text[: text.rfind("\n") + 1].splitlines()
    columns = tuple(lines[0].split(",")) if lines else ()
    n_gps = sum(name.startswith("faz") for name in columns)
    if columns != heading_columns(n_gps):
        raise HeadingCsvError(f"{path} is not a heading CSV: its first line is not {format_header(MIN_GPS_COLUMNS)}")
    rows = []
    for number, fields in enumerate(csv.reader(lines[1:]), 2):
        try:
            rows.append(_parse_row(fields, len(columns)))
        except ValueError as error:
            raise HeadingCsvError(f"{path}, line {number}: {error}") from error
    return np.array(rows, dtype=estimate_dtype(n_gps))


def _parse_row(fields: list[str], width: int) -> tuple[float | str, ...]:
    if len(fields) != width:
        raise ValueError(f"{len(fields)} fields where the first line has {width}")
    mode, pos_mode = fields[6:8]
    if mode not in MODES or pos_mode not in POSITION_MODES:
        raise ValueError(f"no such mode: {mode}, {pos_mode}")
    numbers = (float(field) if field else float("nan") for field in chain(fields[:6], fields[8:]))
    front = tuple(islice(numbers, 6))
    return (*front, mode, pos_mode, *numbers)
