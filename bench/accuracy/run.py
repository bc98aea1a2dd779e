"""Accuracy over the named scenarios, settled and cold, with the targets beside. README.md says how to read it."""

from __future__ import annotations

import argparse
import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import Scenario, scenario_named, settled
from tinyekf_py.config import METHODS
from tinyekf_py.evaluate.command import TRAJECTORY, seeds_of
from tinyekf_py.evaluate.job import Evaluation, Job, Simulated
from tinyekf_py.evaluate.measures import Measures, pool
from tinyekf_py.evaluate.methods import all_methods
from tinyekf_py.evaluate.spread import progress, run_jobs
from tinyekf_py.evaluate.table import markdown, markdown_table, pooled_rows, rows_of, write_csv

#: Targets of the root mean square error, degrees, at the typical grade.
SETTLED_TARGETS = {
    "straight": 0.5,
    "north": 0.5,
    "faulty-gps": 0.5,
    "lost-compass": 0.5,
    "straight-blackout": 0.6,
    "magnetic": 0.8,
    "harbour": 1.0,
    "lost-imu": 1.0,
    "current": 1.5,
}
COLD_TARGETS = {
    "straight": 0.8,
    "straight-blackout": 1.0,
    "current": 2.5,
    "dock": 1.0,  # beyond the compass' own error at the one heading
    "lost-imu": 1.5,
    "harbour": 1.2,
    "boreas": 1.2,
}
#: The poor grade may err so many times as much.
POOR_FACTOR = 2.0
#: What no method may be worse than by more than 20 % or 0.3 degrees.
REFERENCES = ("compass", "course", "cnw3", "ekf-ci")

REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Verdict:
    """One scenario against its targets, the runs of all seeds pooled."""

    scenario: str
    target_deg: float
    judged: Measures
    best: str  #: of the references
    best_deg: float

    @property
    def limit_deg(self) -> float:
        return self.best_deg + max(0.2 * self.best_deg, 0.3)

    @property
    def met(self) -> bool:
        return self.judged.rmse_deg <= min(self.target_deg, self.limit_deg) and self.judged.availability > 0.9999


def trajectory_file() -> Path | None:
    """Boreas' poses among the real recordings, if they are here."""
    folder = Path(os.environ.get("TINYEKF_DATA") or REPOSITORY / "../shared/data")
    return next(iter(sorted((folder / "boreas").glob("*.csv"))), None)


def jobs_of(start: str, names: list[str], seeds: tuple[int, ...], grade: str, methods: tuple[str, ...]) -> list[Job]:
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


def verdicts_of(
    evaluations: list[Evaluation], targets: dict[str, float], judged: str, factor: float, start: str
) -> list[Verdict]:
    """A verdict for each scenario of `targets` that was run."""
    verdicts = []
    for name, target_deg in targets.items():
        runs = [e.measures for e in evaluations if e.group == f"{start} {name}"]
        if not runs:
            continue
        pooled = {method: pool([run[method] for run in runs]) for method in runs[0]}
        limit_deg = target_deg * factor
        if name == "dock":
            limit_deg += float(np.sqrt(np.mean([run["compass"].bias_deg ** 2 for run in runs])))
        best = min((m for m in REFERENCES if math.isfinite(pooled[m].rmse_deg)), key=lambda m: pooled[m].rmse_deg)
        verdicts.append(Verdict(name, limit_deg, pooled[judged], best, pooled[best].rmse_deg))
    return verdicts


def verdict_table(verdicts: list[Verdict], judged: str) -> str:
    """The verdicts as Markdown."""
    titles = ["scenario", "verdict", f"{judged} °", "target °", "worst run °", "best other", "its °", "limit °"]
    titles += ["in 2 sigma %", "avail. %", "step °"]
    lines = [
        [
            v.scenario,
            "met" if v.met else "missed",
            *(f"{x:.2f}" for x in (v.judged.rmse_deg, v.target_deg, v.judged.worst_rmse_deg)),
            v.best,
            *(f"{x:.2f}" for x in (v.best_deg, v.limit_deg)),
            *(f"{100.0 * x:.1f}" for x in (v.judged.within_2_sigma, v.judged.availability)),
            f"{v.judged.step_deg:.1f}",
        ]
        for v in verdicts
    ]
    return markdown_table(titles, lines)


def main() -> int:
    """Run the benchmark; 0 whether targets are met or not: all are reported."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="1-5", help="default: 1-5")
    parser.add_argument("--grade", choices=tuple(GRADES), default="typical")
    parser.add_argument("--scenario", default="", help="some of them, with commas (default: all that have a target)")
    parser.add_argument("--start", choices=("settled", "cold", "both"), default="both")
    parser.add_argument("--judge", default="adaptive" if "adaptive" in METHODS else "cnw3", help="method to be judged")
    parser.add_argument("--method", default="", help="the others, with commas (default: all there are)")
    parser.add_argument("--jobs", type=int, help="runs at a time (default: one per processor)")
    parser.add_argument(
        "--out", type=Path, default=REPOSITORY / "build" / "bench-accuracy", help="for CSV and Markdown"
    )
    options = parser.parse_args()

    wanted = options.method.split(",") if options.method else [m for m in all_methods() if not m.startswith("gps")]
    methods = tuple(dict.fromkeys([options.judge, *REFERENCES, *wanted]))
    seeds = seeds_of(options.seeds)
    factor = POOR_FACTOR if options.grade == "poor" else 1.0
    report = [f"Grade {options.grade}, seeds {options.seeds}, the first 20 s of each run left out.\n"]
    evaluations: list[Evaluation] = []
    for start, targets in (("settled", SETTLED_TARGETS), ("cold", COLD_TARGETS)):
        if options.start not in (start, "both"):
            continue
        names = [name for name in targets if not options.scenario or name in options.scenario.split(",")]
        with progress(start) as told:
            jobs = jobs_of(start, names, seeds, options.grade, methods)
            results = run_jobs(jobs, processes=options.jobs, told=told)
        for failure in results.failures:
            print(f"{failure.name}: {failure.reason}", file=sys.stderr)
        evaluations += results.evaluations
        verdicts = verdicts_of(results.evaluations, targets, options.judge, factor, start)
        if verdicts:
            met = sum(verdict.met for verdict in verdicts)
            report.append(f"## {start.capitalize()}: {met} of {len(verdicts)} targets met\n")
            report.append(verdict_table(verdicts, options.judge))
    if not evaluations:
        print("nothing was run", file=sys.stderr)
        return 1
    report += ["## All methods\n", markdown(pooled_rows(evaluations))]
    text = "\n".join(report)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "accuracy.md").write_text(text, "utf-8")
    write_csv(options.out / "accuracy.csv", rows_of(evaluations))
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
