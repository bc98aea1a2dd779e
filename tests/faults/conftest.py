"""The fault matrix: a live program on a boat whose cables and workers a row breaks, and the table of what happened.

With $TINYEKF_FAULT_TABLE set, the rows are written there as the table of docs/faults.md.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_boat import DEADLINE_S, SENSORS, Boat, Program, is_whole

from tinyekf_py.heading_csv import read_heading_csv

HEADER = (
    "| fault | what the output did | noticed after, s | whole again after, s | lines lost |\n|---|---|---|---|---|\n"
)


@dataclass
class Row:
    """What a fault did."""

    fault: str
    output: str = ""
    noticed_s: float | None = None
    whole_s: float | None = None
    lost: str = "none"

    def text(self) -> str:
        """The row of the table."""
        noticed, whole = ("-" if s is None else f"{s:.1f}" for s in (self.noticed_s, self.whole_s))
        return f"| {self.fault} | {self.output} | {noticed} | {whole} | {self.lost} |\n"


@dataclass
class Life:
    """A boat, its program, and what the rows found."""

    boat: Boat
    live: Program
    rows: list[Row] = field(default_factory=list)

    def now_s(self) -> float:
        """The program's clock."""
        return float(self.live.ask("status")["t_s"])

    def sent(self) -> dict[str, int]:
        """Lines that each sensor has sent."""
        return {name: cable.sent for name, cable in self.boat.cables.items()}

    def recorded(self, until_s: float) -> dict[str, int]:
        """Lines of each sensor in the recording up to a time, once it has got past that."""
        end = time.monotonic() + DEADLINE_S
        while True:
            lines = [line for line in self.live.recording.read_bytes().split(b"\n")[:-1] if line[:1] != b"#"]
            stamped = [line.split(b" ", 2)[:2] for line in lines]
            if stamped and float(stamped[-1][0]) > until_s:
                sources = [source.decode() for stamp, source in stamped if float(stamp) <= until_s]
                return {name: sources.count(name) for name in SENSORS}
            assert time.monotonic() < end, "the recording does not go on"
            select.select([], [], [], 0.1)

    def modes(self, from_s: float, to_s: float) -> list[str]:
        """The heading's modes in the CSV between two times."""
        end = time.monotonic() + DEADLINE_S
        while True:
            rows = read_heading_csv(self.live.csv)
            if len(rows) and rows["t_s"][-1] > to_s:
                return [str(mode) for mode in rows["mode"][(rows["t_s"] >= from_s) & (rows["t_s"] <= to_s)]]
            assert time.monotonic() < end, "the heading CSV does not go on"
            select.select([], [], [], 0.1)

    def row(
        self,
        fault: str,
        breaking: Callable[[], object],
        noticed: Callable[[dict[str, Any]], object],
        repairing: Callable[[], object] = lambda: None,
        *,
        whole: Callable[[dict[str, Any]], object] = is_whole,
        broken: tuple[str, ...] = (),
        limit_s: float = DEADLINE_S,
    ) -> Row:
        """Break something, wait until it is noticed, repair it, wait until all is whole; the row for the table.

        Sensors that are not `broken` must lose nothing. `limit_s`: until it must have been noticed.
        """
        self.live.until_whole()
        counting = time.monotonic()
        before_s, sent_before = self.now_s(), self.sent()
        began = time.monotonic()
        breaking()
        self.live.until(noticed, f"{fault}: noticed", limit_s)
        noticed_s = time.monotonic() - began
        repaired = time.monotonic()
        repairing()
        self.live.until(whole, f"{fault}: whole again")
        whole_s = time.monotonic() - repaired
        counting_again = time.monotonic()
        after_s, sent_after = self.now_s(), self.sent()
        counted = time.monotonic()
        sent = {name: sent_after[name] - sent_before[name] for name in SENSORS}
        before, after = self.recorded(before_s), self.recorded(after_s)
        lost = {name: sent[name] - (after[name] - before[name]) for name in SENSORS}
        # What may have been sent while the counts were taken, for which a loaded machine takes its time.
        share = (began - counting + counted - counting_again) / (counted - counting)
        in_flight = {name: 5 + share * sent[name] for name in SENSORS}
        for name in SENSORS:
            assert name in broken or lost[name] <= in_flight[name], f"{fault}: {name} lost {lost[name]} lines"
        modes = self.modes(before_s, after_s)
        kinds = list(dict.fromkeys(modes))
        row = Row(fault, " → ".join(kinds), noticed_s, whole_s)
        if lost_lines := {name: n for name, n in lost.items() if name in broken and n > in_flight[name]}:
            row.lost = ", ".join(f"{name} {n} of {sent[name]}" for name, n in lost_lines.items())
        self.rows.append(row)
        return row


def check_outputs(live: Program) -> None:
    """What no fault may do: a NaN in the output, or a recording whose replay is another run."""
    assert b"nan" not in live.csv.read_bytes().lower()
    rows = read_heading_csv(live.csv)
    assert np.isfinite(rows["heading_deg"][rows["mode"] != "invalid"]).all()
    assert live.replayed() == live.csv.read_bytes()


_table: list[Row] = []


@pytest.fixture(scope="session")
def table() -> Iterator[list[Row]]:
    """Where rows are gathered."""
    yield _table
    path = os.environ.get("TINYEKF_FAULT_TABLE")
    if path:
        Path(path).write_text(HEADER + "".join(row.text() for row in _table), "utf-8")


@pytest.fixture(scope="module")
def life(tmp_path_factory: pytest.TempPathFactory, table: list[Row]) -> Iterator[Life]:
    """One program that lives through all rows of a module."""
    folder = tmp_path_factory.mktemp("life")
    boat = Boat(folder)
    live = Program(folder, boat)
    try:
        yield Life(boat, live, table)
        assert live.end() == 0
        check_outputs(live)
    finally:
        live.kill()
        boat.close()


@pytest.fixture
def own_life(tmp_path: Path, table: list[Row]) -> Iterator[Callable[..., Life]]:
    """A program of a row's own: makes it, with the program's options."""
    lives: list[Life] = []

    def make(*options: str, **more: Any) -> Life:
        boat = Boat(tmp_path)
        lives.append(Life(boat, Program(tmp_path, boat, *options, **more), table))
        return lives[-1]

    yield make
    for life in lives:
        life.live.kill()
        life.boat.close()


@pytest.fixture
def row_of() -> Callable[..., Row]:
    """Puts a row measured otherwise into the table."""

    def add(life: Life, fault: str, output: str, noticed_s: float | None, whole_s: float | None) -> Row:
        life.rows.append(Row(fault, output, noticed_s, whole_s))
        return life.rows[-1]

    return add
