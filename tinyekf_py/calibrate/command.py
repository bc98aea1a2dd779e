"""`tinyekf calibrate compass REC...` and `tinyekf calibrate gyro REC`.

Exit status: 0 done, 1 the recording cannot tell, 2 the command line or the configuration is wrong.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from acquisition.recording import RecordingError
from tinyekf_py.calibrate.card import card_text, draw_card
from tinyekf_py.calibrate.config_edit import set_key
from tinyekf_py.calibrate.deviation_fit import fit_deviation
from tinyekf_py.calibrate.gyro_fit import fit_gyro
from tinyekf_py.calibrate.track import CalibrationError, track_of
from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config import Config, ConfigError, load_config
from tinyekf_py.evaluate.decoded import decode


def _parser() -> OneLineParser:
    parser = OneLineParser(prog="tinyekf calibrate", description="What a recording tells of compass and gyro.")
    kinds = parser.add_subparsers(dest="what", required=True, metavar="compass|gyro")
    compass = kinds.add_parser("compass", help="deviation coefficients A to E, and the deviation card")
    compass.add_argument("recordings", nargs="+", type=Path, metavar="REC", help="recordings, best with slow circles")
    compass.add_argument("--card", type=Path, metavar="PNG", help="draw the deviation card there")
    compass.add_argument("--write", type=Path, metavar="CONFIG", help="put the coefficients into this configuration")
    gyro = kinds.add_parser("gyro", help="the gyro's bias")
    gyro.add_argument("recordings", nargs=1, type=Path, metavar="REC", help="a recording")
    for parser_of_kind in (compass, gyro):
        parser_of_kind.add_argument("--config", type=Path, metavar="FILE", help="in place of the recordings' own")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    options = _parser().parse_args(argv)
    try:
        config = load_config(options.config) if options.config else None
        return _compass(options, config) if options.what == "compass" else _gyro(options, config)
    except (RecordingError, ConfigError) as error:
        return complain("calibrate", error)
    except (CalibrationError, OSError) as error:
        print(f"tinyekf calibrate: {error}", file=sys.stderr)
        return 1


def _compass(options: argparse.Namespace, config: Config | None) -> int:
    fit = fit_deviation([track_of(decode(recording, config)) for recording in options.recordings])
    print(card_text(fit), end="")
    for warning in fit.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if options.card is not None:
        draw_card(fit, options.card)
    if options.write is not None:
        rounded = [round(value, 2) + 0.0 for value in fit.coefficients_deg]
        set_key(options.write, "sensors.compass.deviation", rounded)
        print(f"\nwritten to {options.write}: sensors.compass.deviation = {rounded}")
    return 0


def _gyro(options: argparse.Namespace, config: Config | None) -> int:
    fit = fit_gyro(decode(options.recordings[0], config))
    print(f"Gyro bias by {fit.seconds:.0f} s, degrees/s\n")
    for axis, bias, sigma in zip("xyz", fit.bias_dps, fit.sigma_dps, strict=True):
        print(f"  {axis}  {bias:+z7.3f} ± {sigma:.3f}")
    print(f"\nz changed by {fit.drift_dps:+z.3f} from the first third of the recording to the last")
    if not fit.referenced:
        print("warning: no compass in it: right only if the boat did not turn on balance", file=sys.stderr)
    return 0
