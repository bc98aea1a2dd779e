"""Compares two heading CSVs: byte-identical, or the largest difference of each column.

    python compare_headings.py HERE.csv THERE.csv

Exit status 1 when they differ.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path


def main() -> int:
    here, there = (Path(name) for name in sys.argv[1:])
    if here.read_bytes() == there.read_bytes():
        print(f"byte-identical, {here.stat().st_size} bytes")
        return 0
    ours, theirs = (list(csv.DictReader(path.open(encoding="utf-8"))) for path in (here, there))
    largest: dict[str, tuple[float, str]] = {}
    rows = sum(a != b for a, b in zip(ours, theirs, strict=False))
    for a, b in zip(ours, theirs, strict=False):
        for column, value in a.items():
            if value != b[column]:
                difference = distance(value, b[column], angle=column.endswith("_deg") and not column.startswith("lat"))
                largest[column] = max(largest.get(column, (0.0, "")), (difference, a["t_s"]))
    print(f"{len(ours)} and {len(theirs)} rows, {rows} differ")
    for column, (difference, t_s) in largest.items():
        print(f"  {column}: up to {difference:g} at t = {t_s} s")
    return 1


def distance(a: str, b: str, *, angle: bool) -> float:
    """How far two cells are apart; infinite where one is a word or empty."""
    try:
        apart = abs(float(a) - float(b))
    except ValueError:
        return float("inf")
    return min(apart, 360.0 - apart) if angle else apart


if __name__ == "__main__":
    sys.exit(main())
