"""Accuracy over the named scenarios, settled and cold, with the targets beside. README.md says how to read it."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from journal import Journal
from verdicts import REFERENCES, TARGETS, honesty_table, seeds_table, verdict_table, voyages_of

from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import Scenario, scenario_named, settled
from tinyekf_py.config import METHODS
from tinyekf_py.evaluate.command import TRAJECTORY, seeds_of
from tinyekf_py.evaluate.job import Evaluation, Job, Simulated
from tinyekf_py.evaluate.methods import all_methods, check_methods
from tinyekf_py.evaluate.spread import progress, run_jobs
from tinyekf_py.evaluate.table import markdown, pooled_rows, rows_of, write_csv

#: The poor grade may err so many times as much.
POOR_FACTOR = 2.0

REPOSITORY = Path(__file__).resolve().parents[2]


def trajectory_file() -> Path | None:
    """Boreas' poses among the real recordings, if they are here."""
    folder = Path(os.environ.get("TINYEKF_DATA") or REPOSITORY / "../shared/data")
    return next(iter(sorted((folder / "boreas").glob("*.csv"))), None)


def jobs_of(start: str, names: Sequence[str], seeds: Sequence[int], grade: str, methods: tuple[str, ...]) -> list[Job]:
    """A job for each scenario and seed; `start` is settled or cold."""
    jobs = []
    for name in names:
        poses = trajectory_file() if name == "boreas" else None
        if name == "boreas" and poses is None:
            print("boreas is left out: its poses are not here (set TINYEKF_DATA)", file=sys.stderr)
            continue
        scenario: Scenario = TRAJECTORY if name == "boreas" else scenario_named(name)
        if start == "settled":
            scenario = settled(scenario)
        jobs += [
            Job(
                f"{start} {name} {seed}", Simulated(scenario, grade, seed, trajectory=poses), methods, f"{start} {name}"
            )
            for seed in seeds
        ]
    return jobs


def report(runs: Sequence[Evaluation], options: argparse.Namespace) -> str:
    """All tables, as Markdown."""
    voyages = voyages_of(runs, POOR_FACTOR if options.grade == "poor" else 1.0)
    parts = [f"Grade {options.grade}, seeds {options.seeds}, the first 20 s of each run left out.\n"]
    for start in TARGETS:
        chosen = [voyage for voyage in voyages if voyage.start == start]
        if chosen:
            met = sum(voyage.verdict(options.judge).met for voyage in chosen)
            parts.append(f"## {start.capitalize()}: {met} of {len(chosen)} targets met\n")
            parts.append(verdict_table(chosen, options.judge))
    held_out = seeds_of(options.held_out) if options.held_out else ()
    parts += [f"## Seeds; held out: {options.held_out or 'none'}\n", seeds_table(voyages, options.judge, held_out)]
    parts += ["## Honesty\n", honesty_table(voyages, options.judge, held_out)]
    parts += ["## All methods\n", markdown(pooled_rows(runs))]
    return "\n".join(parts)


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1-5", help="default: 1-5")
    parser.add_argument("--held-out", default="", metavar="N-M", help="seeds to be shown apart, such as 11-50")
    parser.add_argument("--grade", choices=tuple(GRADES), default="typical")
    parser.add_argument("--scenario", default="", help="some of them, with commas (default: all that have a target)")
    parser.add_argument("--start", choices=(*TARGETS, "both"), default="both")
    parser.add_argument("--judge", default="adaptive" if "adaptive" in METHODS else "cnw3", help="method to be judged")
    parser.add_argument("--method", default="", help="the others, with commas (default: all there are)")
    parser.add_argument("--jobs", type=int, help="runs at a time (default: one per processor)")
    parser.add_argument("--resume", action="store_true", help="take what an interrupted command of this grade has done")
    parser.add_argument(
        "--out", type=Path, default=REPOSITORY / "build" / "bench-accuracy", help="for all that is kept"
    )
    return parser.parse_args()


def main() -> int:
    """Run the benchmark; 0 whether targets are met or not: all are reported."""
    options = arguments()
    wanted = options.method.split(",") if options.method else [m for m in all_methods() if not m.startswith("gps")]
    methods = check_methods(dict.fromkeys([options.judge, *REFERENCES, *wanted]))
    jobs = []
    for start, targets in TARGETS.items():
        if options.start in (start, "both"):
            names = [name for name in targets if not options.scenario or name in options.scenario.split(",")]
            jobs += jobs_of(start, names, seeds_of(options.seeds), options.grade, methods)
    options.out.mkdir(parents=True, exist_ok=True)
    journal = Journal(options.out / f"runs-{options.grade}.pickle", resume=options.resume)
    left = [job for job in jobs if not journal.done(job.name, methods)]
    with progress("accuracy") as told:
        results = run_jobs(left, processes=options.jobs, told=told, found=journal.note)
    for failure in results.failures:
        print(f"{failure.name}: {failure.reason}", file=sys.stderr)
    done = {run.name: run for run in journal.runs}
    runs = [done[job.name] for job in jobs if job.name in done]
    if not runs:
        print("nothing was run", file=sys.stderr)
        return 1
    text = report(runs, options)
    (options.out / "accuracy.md").write_text(text, "utf-8")
    write_csv(options.out / "accuracy.csv", rows_of(runs))
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
