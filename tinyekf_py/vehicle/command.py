"""The command line of the land-vehicle part: run, simulate, evaluate, calibrate."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config_key import ConfigError
from tinyekf_py.vehicle.calibrate import calibrate_drive, calibration_text
from tinyekf_py.vehicle.config import VehicleConfig, config_text, load_config
from tinyekf_py.vehicle.drive import Drive, hide_gps, read_drive
from tinyekf_py.vehicle.epoch import METHODS, MODES, Epochs, Estimates, estimate_track
from tinyekf_py.vehicle.evaluate import evaluate_methods, results_text
from tinyekf_py.vehicle.noise import PAPER
from tinyekf_py.vehicle.simulate import SHAPES, Grade, simulate_drive, write_drive
from tinyekf_py.vehicle.table import DriveError
from tinyekf_py.vehicle.track import read_truth, write_track

#: From so many epochs on a run says how far it is.
LONG = 200_000


def run_method(
    epochs: Epochs, method: str, config: VehicleConfig, progress: Callable[[int, int], None] | None = None
) -> Estimates:
    """A method's estimates of a drive under its configuration; the paper's filter takes the paper's variances."""
    start = config.drive.start_azimuth_deg
    lever_forward, lever_starboard = config.gps.lever_m
    return estimate_track(
        epochs,
        method,
        PAPER if method == "kinematic-paper" else config.noise,
        lever_m=(lever_forward, lever_starboard),
        standstill_mps=config.drive.standstill_mps,
        start_azimuth_rad=np.nan if isinstance(start, str) else float(np.radians(start)),
        progress=progress,
    )


def _window(text: str) -> tuple[float, float]:
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"give FROM:TO in seconds since the first epoch, not {text}") from error
    return first, last


def _methods(text: str) -> list[str]:
    methods = list(METHODS) if text == "all" else text.split(",")
    for method in methods:
        if method not in METHODS:
            raise argparse.ArgumentTypeError(f"no method {method!r}; there are {', '.join(METHODS)}, and all")
    return methods


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(prog="tinyekf vehicle", description="Position and azimuth of a land vehicle.")
    parser.add_argument("--print-config", action="store_true", help="write a configuration that documents every key")
    commands = parser.add_subparsers(dest="command", parser_class=OneLineParser)

    def drive_command(name: str, text: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=text, description=text)
        command.add_argument("data", type=Path, metavar="DATA.csv")
        command.add_argument("--config", type=Path, metavar="C.toml", help="columns, units, noise; see --print-config")
        command.add_argument("--calibration", type=Path, metavar="CAL.toml", help="scale, offset, unit, latency_s")
        command.add_argument("--hide-gps", type=_window, metavar="FROM:TO", help="seconds to drive without GPS")
        return command

    run = drive_command("run", "The track of a drive.")
    run.add_argument("--method", choices=list(METHODS), default="kinematic")
    run.add_argument("--output", type=Path, required=True, metavar="TRACK.csv")
    evaluate = drive_command("evaluate", "Methods beside each other: the paper's tables and pictures.")
    evaluate.add_argument("--method", type=_methods, default=["kinematic-paper", "kinematic", "lsa"], metavar="M,...")
    evaluate.add_argument(
        "--truth", type=Path, metavar="T.csv", help="t_s, x_m and y_m (or lat_deg, lon_deg), azimuth_deg"
    )
    evaluate.add_argument(
        "--azimuth-offset", type=float, default=0.0, metavar="DEG", help="taken off the truth's azimuth"
    )
    evaluate.add_argument("--out", type=Path, metavar="DIR", help="where pictures go")
    calibrate = drive_command("calibrate", "Scale, offset and latency of each channel against GPS.")
    calibrate.add_argument("--output", type=Path, required=True, metavar="CAL.toml")
    simulate = commands.add_parser("simulate", help="A drive with all sensors, and its truth.")
    simulate.add_argument("--shape", choices=SHAPES, default="mixed")
    simulate.add_argument("--duration", type=float, default=120.0, metavar="S")
    simulate.add_argument("--gps", type=float, default=1.5, metavar="M", help="GPS standard deviation; RTK: 0.02")
    simulate.add_argument("--seed", type=int, default=1)
    simulate.add_argument("--out", type=Path, required=True, metavar="DIR")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a subcommand; its exit status: 0 done, 1 the run failed, 2 input or command line is wrong."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.print_config:
        print(config_text(), end="")
        return 0
    if arguments.command is None:
        parser.error("give run, simulate, evaluate or calibrate")
    try:
        if arguments.command == "simulate":
            return _simulate(arguments)
        config = load_config(arguments.config, arguments.calibration)
        return {"run": _run, "evaluate": _evaluate, "calibrate": _calibrate}[arguments.command](arguments, config)
    except (ConfigError, DriveError) as error:
        return complain("vehicle", error)
    except OSError as error:
        return complain("vehicle", error, 1)


def _read(arguments: argparse.Namespace, config: VehicleConfig) -> Drive:
    drive = read_drive(arguments.data, config)
    if arguments.hide_gps:
        drive = drive._replace(epochs=hide_gps(drive.epochs, *arguments.hide_gps))
    return drive


def _progress(done: int, of: int) -> None:
    if of >= LONG:
        print(f"\r{done * 100 // of} % of {of} epochs", end="\n" if done == of else "", file=sys.stderr, flush=True)


def _run(arguments: argparse.Namespace, config: VehicleConfig) -> int:
    drive = _read(arguments, config)
    estimates = run_method(drive.epochs, arguments.method, config, _progress)
    write_track(arguments.output, estimates, drive, arguments.method)
    modes = Counter(MODES[int(mode)] for mode in estimates["mode"].tolist())
    told = [f"{count} {name}" for name, count in sorted(drive.counts.items()) if count]
    refused = int((estimates["refused"] > 0).sum())
    print(f"{len(estimates)} epochs: {', '.join(f'{count} {mode}' for mode, count in modes.items())}", file=sys.stderr)
    if refused:
        told.append(f"{refused} epochs with a refused observation")
    if told:
        print(f"counted: {', '.join(told)}", file=sys.stderr)
    if set(modes) == {"waiting"}:
        print("tinyekf vehicle: no start was found: the vehicle never moved far enough for an azimuth", file=sys.stderr)
        return 1
    return 0


def _evaluate(arguments: argparse.Namespace, config: VehicleConfig) -> int:
    drive = _read(arguments, config)
    truth = read_truth(arguments.truth, drive.frame, drive.origin_m) if arguments.truth else None
    if truth:
        truth = truth._replace(azimuth_deg=truth.azimuth_deg - arguments.azimuth_offset)
    tracks = {method: run_method(drive.epochs, method, config, _progress) for method in arguments.method}
    print(results_text(evaluate_methods(drive.epochs, tracks, truth)))
    if arguments.out:
        from tinyekf_py.vehicle.pictures import draw_pictures  # matplotlib is optional

        for path in draw_pictures(arguments.out, drive.epochs, tracks, truth):
            print(path)
    return 0


def _calibrate(arguments: argparse.Namespace, config: VehicleConfig) -> int:
    text = calibration_text(calibrate_drive(arguments.data, config), config)
    arguments.output.write_text(text, encoding="utf-8")
    print(text, end="")
    return 0


def _simulate(arguments: argparse.Namespace) -> int:
    grade = Grade(gps_m=arguments.gps)
    drive = simulate_drive(arguments.shape, duration_s=arguments.duration, seed=arguments.seed, grade=grade)
    write_drive(arguments.out, drive, grade)
    print(f"{arguments.out}: drive.csv, truth.csv, config.toml, calibration.toml", file=sys.stderr)
    return 0
