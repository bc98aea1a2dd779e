"""The table of an evaluation: on the terminal, as CSV for programs, as Markdown for reports."""

from __future__ import annotations

import csv
import importlib
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from tinyekf_py.evaluate.job import Evaluation
from tinyekf_py.evaluate.measures import Measures, pool

_CSV_FIELDS = (
    *("rows", "rmse_deg", "p95_deg", "max_deg", "bias_deg", "availability", "within_2_sigma", "nees", "nis"),
    *("correlation_s", "step_deg", "seconds"),
)


class Row(NamedTuple):
    """One line of the table: a method on a recording, or on a group of them pooled."""

    name: str
    method: str
    runs: int
    measures: Measures


class _Column(NamedTuple):
    title: str
    value: Callable[[Row], float]
    digits: int
    scale: float = 1.0


_COLUMNS = (
    _Column("RMSE °", lambda row: row.measures.rmse_deg, 2),
    _Column("95 % °", lambda row: row.measures.p95_deg, 2),
    _Column("max °", lambda row: row.measures.max_deg, 1),
    _Column("bias °", lambda row: row.measures.bias_deg, 2),
    _Column("avail. %", lambda row: row.measures.availability, 1, 100.0),
    _Column("in 2 sigma %", lambda row: row.measures.within_2_sigma, 1, 100.0),
    _Column("NEES", lambda row: row.measures.nees, 2),
    _Column("NIS", lambda row: row.measures.nis, 2),
    _Column("corr. s", lambda row: row.measures.correlation_s, 1),
    _Column("step °", lambda row: row.measures.step_deg, 1),
    _Column("s/run", lambda row: row.measures.seconds, 2),
)
_WORST = _Column("worst run °", lambda row: row.measures.worst_rmse_deg, 2)


def rows_of(evaluations: Iterable[Evaluation]) -> list[Row]:
    """A row for each recording and method, in their order."""
    return [
        Row(evaluation.name, method, 1, measures)
        for evaluation in evaluations
        for method, measures in evaluation.measures.items()
    ]


def pooled_rows(evaluations: Iterable[Evaluation]) -> list[Row]:
    """A row for each group and method; a recording without a group is its own."""
    groups: dict[tuple[str, str], list[Measures]] = {}
    for evaluation in evaluations:
        for method, measures in evaluation.measures.items():
            groups.setdefault((evaluation.group or evaluation.name, method), []).append(measures)
    return [Row(name, method, len(runs), pool(runs)) for (name, method), runs in groups.items()]


def _cells(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    columns = [*_COLUMNS, _WORST] if any(row.runs > 1 for row in rows) else list(_COLUMNS)
    titles = ["recording", "method", *(column.title for column in columns)]
    lines = []
    for row in rows:
        name = f"{row.name} x{row.runs}" if row.runs > 1 else row.name
        lines.append([name, row.method, *(_number(column, row) for column in columns)])
    return titles, lines


def _number(column: _Column, row: Row) -> str:
    value = column.value(row) * column.scale
    if not math.isfinite(value):
        return ""
    return f"{value:z.{column.digits}f}" if abs(value) < 1e5 else f"{value:.1e}"


def markdown(rows: Sequence[Row]) -> str:
    """The table as Markdown, its columns aligned for those who read it as text."""
    return markdown_table(*_cells(rows))


def markdown_table(titles: Sequence[str], lines: Sequence[Sequence[str]], left: int = 2) -> str:
    """A Markdown table; all but the first `left` columns are numbers, and stand to the right."""
    widths = [max(3, *(len(line[i]) for line in (titles, *lines))) for i in range(len(titles))]

    def line_of(cells: Sequence[str]) -> str:
        padded = [
            cell.ljust(w) if i < left else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
        ]
        return f"| {' | '.join(padded)} |"

    rule = [("-" * w if i < left else "-" * (w - 1) + ":") for i, w in enumerate(widths)]
    return "\n".join([line_of(titles), f"| {' | '.join(rule)} |", *(line_of(line) for line in lines)]) + "\n"


def print_table(rows: Sequence[Row], title: str) -> None:
    """The table on the terminal, by rich where that is installed; as Markdown where stdout is no terminal."""
    titles, lines = _cells(rows)
    if sys.stdout.isatty():
        try:
            rich_table, rich_console = importlib.import_module("rich.table"), importlib.import_module("rich.console")
        except ImportError:
            pass
        else:
            table = rich_table.Table(title=title)
            for i, name in enumerate(titles):
                table.add_column(name, justify="left" if i < 2 else "right", no_wrap=i < 2)
            for before, line in zip([[""], *lines], lines, strict=False):
                if before[0] not in ("", line[0]):
                    table.add_section()
                table.add_row(*line)
            rich_console.Console().print(table)
            return
    print(f"{title}\n\n{markdown_table(titles, lines)}", end="")


def write_csv(path: Path, rows: Iterable[Row]) -> None:
    """The rows with all their digits; empty where unknown."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["recording", "method", "runs", *_CSV_FIELDS])
        for row in rows:
            values = [getattr(row.measures, name) for name in _CSV_FIELDS]
            writer.writerow([row.name, row.method, row.runs, *("" if math.isnan(v) else f"{v:.6g}" for v in values)])
