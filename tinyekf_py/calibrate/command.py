"""`tinyekf calibrate compass REC...`, `tinyekf calibrate gyro REC` and `tinyekf calibrate latency REC`.

Exit status: 0 done, 1 the recording cannot tell, 2 the command line or the configuration is wrong.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from acquisition.recording import RecordingError
from tinyekf_py.calibrate.card import card_text, draw_card
from tinyekf_py.calibrate.config_edit import set_key
from tinyekf_py.calibrate.deviation_fit import fit_deviation
from tinyekf_py.calibrate.gyro_fit import fit_gyro
from tinyekf_py.calibrate.latency_fit import SIGMA_S, fit_latency, worth_writing
from tinyekf_py.calibrate.track import CalibrationError, track_of
from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config import Config, ConfigError, load_config
from tinyekf_py.evaluate.decoded import decode
from tinyekf_py.fusion import rotation
from tinyekf_py.sensor_config import ImuConfig

#: A card is not believed to be better than this, degrees: leeway, and what changes from day to day.
_LEAST_SIGMA_DEG = 0.3


def _parser() -> OneLineParser:
    parser = OneLineParser(
        prog="tinyekf calibrate", description="What a recording tells of compass, gyro and receivers."
    )
    kinds = parser.add_subparsers(dest="what", required=True, metavar="compass|gyro|latency")
    compass = kinds.add_parser("compass", help="deviation coefficients A to E, and the deviation card")
    compass.add_argument("recordings", nargs="+", type=Path, metavar="REC", help="recordings, best with slow circles")
    compass.add_argument("--card", type=Path, metavar="PNG", help="draw the deviation card there")
    compass.add_argument("--write", type=Path, metavar="CONFIG", help="put the coefficients into this configuration")
    compass.add_argument(
        "--reciprocal-legs", action="store_true", help="legs on opposite headings were sailed at the same water speed"
    )
    gyro = kinds.add_parser("gyro", help="the gyro's bias")
    latency = kinds.add_parser("latency", help="how late the receivers' lines come")
    for parser_of_kind, what in ((gyro, "the bias"), (latency, "what is well known")):
        parser_of_kind.add_argument("recordings", nargs=1, type=Path, metavar="REC", help="a recording")
        parser_of_kind.add_argument("--write", type=Path, metavar="CONFIG", help=f"put {what} into this configuration")
    for parser_of_kind in (compass, gyro, latency):
        parser_of_kind.add_argument("--config", type=Path, metavar="FILE", help="in place of the recordings' own")
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; the exit status."""
    options = _parser().parse_args(argv)
    try:
        config = load_config(options.config) if options.config else None
        return {"compass": _compass, "gyro": _gyro, "latency": _latency}[options.what](options, config)
    except (RecordingError, ConfigError) as error:
        return complain("calibrate", error)
    except (CalibrationError, OSError) as error:
        return complain("calibrate", error, 1)


def _compass(options: argparse.Namespace, config: Config | None) -> int:
    fit = fit_deviation(
        [track_of(decode(recording, config)) for recording in options.recordings],
        reciprocal_legs=options.reciprocal_legs,
    )
    print(card_text(fit), end="")
    for warning in fit.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if options.card is not None:
        draw_card(fit, options.card)
    if options.write is not None:
        rounded = [round(value, 2) + 0.0 for value in fit.coefficients_deg]
        set_key(options.write, "sensors.compass.deviation", rounded)
        print(f"\nwritten to {options.write}: sensors.compass.deviation = {rounded}")
        if all(math.isfinite(sigma) for sigma in fit.sigma_deg):
            doubt = [round(max(sigma, _LEAST_SIGMA_DEG), 2) for sigma in fit.sigma_deg]
            set_key(options.write, "fusion.adaptive.deviation_sigma_deg", doubt)
            print(f"written to {options.write}: fusion.adaptive.deviation_sigma_deg = {doubt}")
    return 0


def _gyro(options: argparse.Namespace, config: Config | None) -> int:
    decoded = decode(options.recordings[0], config)
    fit = fit_gyro(decoded)
    print(f"Gyro bias by {fit.seconds:.0f} s, degrees/s\n")
    for axis, bias, sigma in zip("xyz", fit.bias_dps, fit.sigma_dps, strict=True):
        print(f"  {axis}  {bias:+z7.3f} ± {sigma:.3f}")
    print(f"\nz changed by {fit.drift_dps:+z.3f} from the first third of the recording to the last")
    if not fit.referenced:
        print("warning: no compass in it: right only if the boat did not turn on balance", file=sys.stderr)
    if options.write is not None:
        imu = decoded.config.sensors.get("imu")
        before, mount_deg = (imu.gyro_bias_dps, imu.mount) if isinstance(imu, ImuConfig) else ((0.0,) * 3, (0.0,) * 3)
        own_axes = np.array(rotation(mount_deg)).T @ fit.bias_dps
        bias_dps = [round(float(old + new), 3) + 0.0 for old, new in zip(before, own_axes, strict=True)]
        set_key(options.write, "sensors.imu.gyro_bias_dps", bias_dps)
        print(f"\nwritten to {options.write}: sensors.imu.gyro_bias_dps = {bias_dps}")
    return 0


def _latency(options: argparse.Namespace, config: Config | None) -> int:
    found = fit_latency(decode(options.recordings[0], config))
    print("Latency of the receivers' lines against the gyro's, milliseconds\n")
    for latency in found:
        print(f"  {latency.source}  {1e3 * latency.seconds:4.0f} ± {1e3 * latency.sigma_s:.0f}")
    known = worth_writing(found)
    if len(known) < len(found):
        print(f"warning: beforehand ± {1e3 * SIGMA_S:.0f} ms; sail more turns, at several speeds", file=sys.stderr)
    if options.write is not None:
        for latency in known:
            set_key(options.write, f"sensors.{latency.source}.latency_ms", round(1e3 * latency.seconds))
        print(f"\nwritten to {options.write}: {', '.join(latency.source for latency in known) or 'nothing'}")
    return 0
