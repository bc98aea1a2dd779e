"""`tinyekf evaluate`: recordings with truth, times methods, gives a table and pictures.

Exit status: 0 done, 1 a recording could not be evaluated (the others are shown), 2 the command line is wrong.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from acquisition.recording_writer import truth_beside
from acquisition.simulator.grades import GRADES
from acquisition.simulator.scenarios import Scenario, ScenarioError, scenario_named, settled
from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config import Config, ConfigError, load_config
from tinyekf_py.evaluate.job import Job, Recorded, Results, Simulated
from tinyekf_py.evaluate.methods import MethodError, all_methods, check_methods, default_methods, method_names
from tinyekf_py.evaluate.paper import paper_jobs, print_processing_times
from tinyekf_py.evaluate.pictures import PicturesError, draw, require_matplotlib
from tinyekf_py.evaluate.spread import ClusterError, progress, run_jobs
from tinyekf_py.evaluate.table import markdown, pooled_rows, print_table, rows_of, write_csv

#: The scenario of devices that follow a trajectory: nothing of it but the devices is used.
TRAJECTORY = Scenario("trajectory", "simulated devices on a real trajectory", (), 0.0, 0.0)


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="tinyekf evaluate",
        description="Judge methods on recordings with truth, or on simulated voyages: a table, and pictures.",
    )
    parser.add_argument("recordings", nargs="*", type=Path, metavar="REC", help="recordings")
    parser.add_argument("--truth", nargs="+", type=Path, metavar="T", help="their truths (default: REC's .truth.csv)")
    parser.add_argument("--truth-offset", type=float, default=0.0, metavar="DEG", help="added to the truths' headings")
    parser.add_argument("--scenario", metavar="S,...", help="simulated voyages in place of recordings (or all)")
    parser.add_argument("--trajectory", type=Path, metavar="CSV", help="simulated devices on poses, such as Boreas'")
    parser.add_argument("--seeds", default="1", metavar="N-M", help="of the simulated voyages (default: 1)")
    parser.add_argument("--grade", choices=tuple(GRADES), default="typical", help="of the simulated devices")
    parser.add_argument("--settled", action="store_true", help="simulated voyages begin with a full circle")
    parser.add_argument("--paper", action="store_true", help="repeat the experiment of the 2019 paper")
    parser.add_argument("--method", metavar="M,...", help=f"of {', '.join(method_names())}; or all")
    parser.add_argument("--config", type=Path, metavar="FILE", help="configuration in place of the recordings' own")
    parser.add_argument("--skip", type=float, default=20.0, metavar="S", help="not judged at the start (default: 20)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="write the table (CSV, Markdown) and pictures there")
    parser.add_argument("--no-pictures", action="store_true", help="with --out: the table alone")
    parser.add_argument("--jobs", type=int, metavar="N", help="recordings at a time (default: one per processor)")
    parser.add_argument(
        "--cluster", default="", metavar="ADDRESS", help="run on this Dask scheduler, as tcp://host:8786"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    parser = _parser()
    options = parser.parse_args(argv)
    try:
        _check(parser, options)
        config = load_config(options.config) if options.config else None
        jobs = _jobs(options, _methods(options), config)
        pictures = options.out is not None and not options.no_pictures
        if pictures:
            require_matplotlib()
        with progress("evaluating") as told:
            results = run_jobs(jobs, processes=options.jobs, cluster=options.cluster, told=told)
        return _show(results, options, pictures=pictures)
    except (ConfigError, MethodError, ScenarioError, ClusterError, PicturesError) as error:
        return complain("evaluate", error)
    except OSError as error:
        return complain("evaluate", error, 1)
    except KeyboardInterrupt:
        return 1


def _check(parser: OneLineParser, options: argparse.Namespace) -> None:
    kinds = [bool(options.recordings), bool(options.scenario), bool(options.trajectory), options.paper]
    if sum(kinds) != 1:
        parser.error("name recordings, or give one of --scenario, --trajectory and --paper")
    if options.truth and len(options.truth) != len(options.recordings):
        parser.error(f"{len(options.recordings)} recordings but {len(options.truth)} truths")
    if options.jobs is not None and options.jobs < 1:
        parser.error(f"--jobs {options.jobs}: give 1 or more")
    missing = next((path for path in (*options.recordings, *(options.truth or ())) if not path.exists()), None)
    if missing is not None:
        parser.error(f"{missing}: no such file")
    try:
        options.seed_numbers = seeds_of(options.seeds)
    except ValueError as error:
        parser.error(f"--seeds {options.seeds}: {error}")


def seeds_of(text: str) -> tuple[int, ...]:
    """Numbers of "1-3,7": 1, 2, 3 and 7."""
    seeds: list[int] = []
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.isdigit() or (dash and not last.isdigit()):
            raise ValueError("give numbers such as 3, 1-5 or 1-3,7")
        seeds += range(int(first), int(last if dash else first) + 1)
    if not seeds:
        raise ValueError("no number in it")
    return tuple(seeds)


def _methods(options: argparse.Namespace) -> tuple[str, ...]:
    if options.method == "all":
        return all_methods()
    return check_methods(options.method.split(",") if options.method else default_methods())


def _jobs(options: argparse.Namespace, methods: tuple[str, ...], config: Config | None) -> list[Job]:
    keep = options.out is not None and not options.no_pictures
    if options.paper:
        return paper_jobs(methods, keep_series=keep)
    if options.recordings:
        truths = options.truth or [truth_beside(recording) for recording in options.recordings]
        return [
            Job(
                recording.stem,
                Recorded(recording, truth, options.truth_offset),
                methods,
                "",
                options.skip,
                config,
                keep,
            )
            for recording, truth in zip(options.recordings, truths, strict=True)
        ]
    if options.trajectory:
        scenarios = [TRAJECTORY]
    else:
        names = options.scenario.split(",")
        scenarios = [scenario_named(name) for name in names]
    if options.settled:
        scenarios = [settled(scenario) for scenario in scenarios]
    return [
        Job(
            f"{scenario.name} {seed}" if len(options.seed_numbers) > 1 else scenario.name,
            Simulated(scenario, options.grade, seed, trajectory=options.trajectory),
            methods,
            scenario.name,
            options.skip,
            config,
            keep,
        )
        for scenario in scenarios
        for seed in options.seed_numbers
    ]


def _show(results: Results, options: argparse.Namespace, *, pictures: bool) -> int:
    rows = rows_of(results.evaluations)
    pooled = pooled_rows(results.evaluations)
    if pooled:
        print_table(pooled, "Heading against the truth")
    if options.paper:
        print_processing_times()
    if options.out is not None and rows:
        options.out.mkdir(parents=True, exist_ok=True)
        write_csv(options.out / "table.csv", rows)
        (options.out / "table.md").write_text(markdown(pooled), "utf-8")
        if pictures:
            with progress("drawing") as told:
                for number, evaluation in enumerate(results.evaluations, 1):
                    draw(evaluation, options.out)
                    told(number, len(results.evaluations), evaluation.name)
    for failure in results.failures:
        print(f"tinyekf evaluate: {failure.name}: {failure.reason}", file=sys.stderr)
    return 1 if results.failures else 0
