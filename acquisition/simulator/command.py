"""The simulator's command line: a recording and its truth, or five ptys."""

from __future__ import annotations

import argparse
import json
import logging
import math
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from types import FrameType
from typing import NoReturn

from acquisition.recording import RecordingError
from acquisition.simulator.grades import GRADES
from acquisition.simulator.ptys import (
    LinkError,
    Pty,
    claimed,
    make_links,
    next_grid_point,
    remove_links,
    serve,
    utc_tenth,
)
from acquisition.simulator.recorder import record
from acquisition.simulator.scenarios import SCENARIOS, Scenario, ScenarioError, scenario_named, settled
from acquisition.simulator.voyage import START_UTC, Voyage, antennas_m

_MAX_DURATION_S = 7 * 86400.0


class _CommandError(ValueError):
    """A command line that makes no sense."""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise _CommandError(message)


def _seconds(text: str) -> float:
    value = float(text)
    if not (math.isfinite(value) and 0.0 < value <= _MAX_DURATION_S):
        raise argparse.ArgumentTypeError(f"a duration is more than 0 and at most {_MAX_DURATION_S:.0f} s, not {text}")
    return value


def _utc(text: str) -> datetime:
    try:
        value = datetime.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"not a time like 2026-11-24T03:00:00Z: {text!r}") from None
    return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


def _parser() -> _Parser:
    parser = _Parser(
        prog="tinyekf simulate",
        description="Simulate a boat with three GPS, a compass and an IMU: write a recording with its truth, "
        "faster than real time, or serve the devices on ptys.",
    )
    parser.add_argument("recording", nargs="?", type=Path, metavar="REC", help="recording to write")
    parser.add_argument("truth_csv", nargs="?", type=Path, metavar="TRUTH", help="truth CSV to write")
    parser.add_argument("--list", action="store_true", help="list the scenarios and end")
    parser.add_argument("--scenario", metavar="S", help="what is sailed (default: tour)", default="tour")
    parser.add_argument("--settled", action="store_true", help="begin with a full circle at constant water speed")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of all that is random (default: 1)")
    parser.add_argument("--grade", choices=tuple(GRADES), default="typical", help="of the devices (default: typical)")
    parser.add_argument("--duration", type=_seconds, metavar="SECONDS", help="default: the scenario's; ptys: endless")
    parser.add_argument("--start-utc", type=_utc, metavar="TIME", help=f"default: {START_UTC:%Y-%m-%dT%TZ}; ptys: now")
    parser.add_argument("--ptys", action="store_true", help="serve on ptys until SIGTERM, Ctrl-C or the parent's end")
    parser.add_argument("--links", type=Path, metavar="DIR", help="with --ptys: make links fjGPS1 to fjIMU there")
    parser.add_argument("--truth", type=Path, metavar="FILE", help="with --ptys: write the truth there")
    parser.add_argument("--start-us", type=int, metavar="N", help="with --truth: its zero, monotonic µs (default: now)")
    return parser


def main(argv: Sequence[str]) -> int:
    """Run the command; the exit status: 0 done, 1 the run failed, 2 the command line is wrong (one line says why)."""
    logging.getLogger("acquisition").addHandler(logging.NullHandler())  # what fails is raised, too, and told once
    try:
        options = _parser().parse_args(argv)
        if options.list:
            width = max(map(len, SCENARIOS))
            print("\n".join(f"{scenario.name:{width}}  {scenario.summary}" for scenario in SCENARIOS.values()))
            return 0
        _check(options)
        scenario = scenario_named(options.scenario)
        if options.settled:
            scenario = settled(scenario)
        if options.ptys:
            return _serve(scenario, options)
        voyage = Voyage(scenario, GRADES[options.grade], seed=options.seed, start_utc=options.start_utc or START_UTC)
        record(voyage, options.recording, options.truth_csv, options.duration or scenario.duration_s)
    except (_CommandError, ScenarioError, LinkError, RecordingError) as error:
        print(f"tinyekf simulate: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - whoever read it has gone; nothing is left to flush
    except OSError as error:
        print(f"tinyekf simulate: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 1
    return 0


def _check(options: argparse.Namespace) -> None:
    if options.ptys:
        if options.recording:
            raise _CommandError("--ptys writes no recording; --truth FILE takes the truth")
        return
    for option in ("links", "truth", "start_us"):
        if getattr(options, option) is not None:
            raise _CommandError(f"--{option.replace('_', '-')} belongs to --ptys")
    if not options.truth_csv:
        raise _CommandError("name the recording and the truth to write (REC TRUTH), or use --ptys or --list")
    if options.recording.resolve() == options.truth_csv.resolve():
        raise _CommandError(f"recording and truth cannot both be {options.recording}")


def _serve(scenario: Scenario, options: argparse.Namespace) -> int:
    parent = os.getppid()
    signals: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        signals.append(number)

    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, note)
    start_us = time.monotonic_ns() // 1000 if options.start_us is None else options.start_us
    departure_us = next_grid_point(start_us)
    voyage = Voyage(
        scenario,
        GRADES[options.grade],
        seed=options.seed,
        start_utc=options.start_utc or utc_tenth(departure_us),
    )
    end_us = math.inf if options.duration is None else departure_us + options.duration * 1e6

    def ended() -> bool:
        return bool(signals) or os.getppid() != parent or time.monotonic_ns() // 1000 >= end_us

    ptys = {source: Pty() for source in scenario.devices}
    links: dict[str, Path] = {}
    truth = None
    with ExitStack() as stack:
        for pty in ptys.values():
            stack.callback(pty.close)
        if options.links:
            stack.enter_context(claimed(options.links))
        if options.truth:
            try:
                truth = stack.enter_context(options.truth.open("w", encoding="ascii", buffering=1)), start_us
            except OSError as error:
                raise _CommandError(f"cannot write the truth to {options.truth}: {error.strerror}") from error
        if options.links:
            links = make_links(ptys, options.links)
            stack.callback(remove_links, ptys, links)
        _announce(scenario, options, ptys, links)
        serve(voyage, ptys, departure_us, ended, truth)
    return 0


def _announce(scenario: Scenario, options: argparse.Namespace, ptys: dict[str, Pty], links: dict[str, Path]) -> None:
    """One JSON line: where the devices are, and what a navigator would know of the boat."""
    line = {
        "ports": {source: pty.path for source, pty in ptys.items()},
        "links": {source: str(link) for source, link in links.items()},
        "variation_deg": scenario.waters.variation_deg,
        "antennas_m": antennas_m(),
        "scenario": scenario.name,
        "grade": options.grade,
        "seed": options.seed,
    }
    print(json.dumps(line), flush=True)
