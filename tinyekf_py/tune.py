"""`tinyekf tune REC...`: the noise Q and R of the papers' filter by maximum likelihood, judged on held-out data.

The 2018 paper sets Q and R "depending on the measured values". Here they are those under which the filter's own
innovations are likeliest: each epoch's innovation is Gaussian with the covariance that the filter expects, so their
likelihood over a recording is a function of Q and R, and its maximum is searched. Positions share one noise for north
and east. The last third of each recording (or the recordings of `--held-out`) is kept for the comparison.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from acquisition.recording import RecordingError
from acquisition.simulator.vessel import metres_per_degree
from tinyekf_py.calibrate.config_edit import set_key
from tinyekf_py.command_line import OneLineParser, complain
from tinyekf_py.config import PAPER_Q, PAPER_R, ConfigError, load_config
from tinyekf_py.core import HeadingEkf, forward_azimuth
from tinyekf_py.evaluate.decoded import Decoded, decode, held
from tinyekf_py.evaluate.table import markdown_table

Floats = NDArray[np.float64]

TRAINING_SHARE = 2.0 / 3.0
MIN_EPOCHS = 300
MAX_STEP_S = 2.0
_MAX_ROUNDS = 160
_SIGMA_OF_START_DEG = 10.0
_DEG2 = math.radians(1.0) ** 2
#: Epochs that are looked at during the search: more make it slower, hardly better.
_MAX_EPOCHS = 4000


class TuningError(ValueError):
    """Recordings that cannot be tuned to: one line saying why."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Diagonals of Q (per second) and R: [north m^2, east m^2, heading degrees^2]."""

    q: tuple[float, ...] = PAPER_Q
    r: tuple[float, ...] = PAPER_R


@dataclass(frozen=True, slots=True)
class Likelihood:
    """How well the innovations agree with what the filter expects, per epoch."""

    log_likelihood: float  #: mean, natural logarithm
    nis: float  #: mean normalised innovation squared per degree of freedom: 1 when Q and R are right
    heading_nis: float  #: the same of the heading alone


def epochs_of(decoded: Decoded, number: int) -> Floats:
    """What the filter of a receiver is fed: rows of step s, speed m/s, rate rad/s, north m, east m, azimuth rad.

    An epoch without its predecessor (a gap of more than 2 s, no fix) has a step of 0: the filter starts anew there.
    """
    fixes = decoded.of_gps(number)
    fixes = fixes[(fixes["code"] >= 1) & np.isfinite(fixes["lat_deg"]) & np.isfinite(fixes["lon_deg"])]
    if len(fixes) < 2:
        return np.empty((0, 6))
    t_s, lat, lon = fixes["t_us"] / 1e6, fixes["lat_deg"], fixes["lon_deg"]
    lat_m, lon_m = metres_per_degree(float(lat[0]))
    imu_s, gyro_dps, _ = decoded.imu
    turned = np.concatenate([[0.0], np.cumsum(np.diff(imu_s) * gyro_dps[1:, 2])]) if len(imu_s) else np.zeros(1)
    angle = np.radians(np.interp(t_s, imu_s, turned)) if len(imu_s) else np.zeros(len(t_s))
    step = np.diff(t_s)
    speed = np.nan_to_num(held(t_s, fixes["speed_mps"], t_s, MAX_STEP_S))[:-1]
    azimuth = np.radians(forward_azimuth(lat[:-1], lon[:-1], lat[1:], lon[1:]))
    north, east = (lat - lat[0]) * lat_m, (lon - lon[0]) * lon_m
    step_or_none = np.where((step > 0.0) & (step <= MAX_STEP_S), step, 0.0)
    rate = np.diff(angle) / np.maximum(step, 1e-3)
    rows: Floats = np.stack([step_or_none, speed, rate, north[1:], east[1:], azimuth], axis=1)
    return rows


def likelihood(sequences: Sequence[Floats], noise: Noise) -> Likelihood:
    """Run the papers' filter over the epochs of `sequences` under `noise`."""
    q = (noise.q[0], noise.q[1], noise.q[2] * _DEG2)
    r = (noise.r[0], noise.r[1], noise.r[2] * _DEG2)
    start = np.diag([10.0, 10.0, _SIGMA_OF_START_DEG**2 * _DEG2])
    total = squares = heading_squares = 0.0
    count = 0
    for rows in sequences:
        ekf: HeadingEkf | None = None
        for step, speed, rate, north, east, azimuth in rows.tolist():
            if ekf is None or step == 0.0:
                if math.isfinite(azimuth):
                    ekf = HeadingEkf([north, east, azimuth], start, q, r)
                continue
            ekf.predict(speed, 0.0, rate, step)
            if not math.isfinite(azimuth):
                continue
            (a, b, c), (_, d, e), (_, _, f) = ekf.P.tolist()
            psi = float(ekf.x[2])
            a, d, f = a + r[0], d + r[1], f + r[2]
            determinant = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
            update = ekf.update((north, east, azimuth))
            if not update.accepted or determinant <= 0.0:
                continue
            total -= 0.5 * (update.nis + math.log(determinant) + 3.0 * math.log(math.tau))
            squares += update.nis
            heading_squares += math.remainder(azimuth - psi, math.tau) ** 2 / f
            count += 1
    if not count:
        return Likelihood(-math.inf, math.nan, math.nan)
    return Likelihood(total / count, squares / count / 3.0, heading_squares / count)


def tuned(sequences: Sequence[Floats], told: Callable[[int], None] = lambda _: None) -> Noise:
    """The noise under which the innovations of `sequences` are likeliest."""
    share = max(1, round(sum(map(len, sequences)) / _MAX_EPOCHS))
    searched = [rows[: max(MIN_EPOCHS, len(rows) // share)] for rows in sequences]
    rounds = 0

    def cost(logs: Floats) -> float:
        nonlocal rounds
        rounds += 1
        told(rounds)
        return -likelihood(searched, _noise_of(logs)).log_likelihood

    return _noise_of(_downhill(cost, np.log([PAPER_Q[0], PAPER_Q[2], PAPER_R[0], PAPER_R[2]])))


def _noise_of(logs: Floats) -> Noise:
    q_place, q_heading, r_place, r_heading = (float(value) for value in np.exp(np.clip(logs, -16.0, 16.0)))
    return Noise((q_place, q_place, q_heading), (r_place, r_place, r_heading))


def _downhill(cost: Callable[[Floats], float], start: Floats) -> Floats:
    """The minimum of `cost` by Nelder and Mead's simplex, first edges 2 (a factor of 7 in what is searched here)."""
    simplex = np.vstack([start, start + 2.0 * np.eye(len(start))])
    costs = np.array([cost(point) for point in simplex])
    for _ in range(_MAX_ROUNDS):
        order = np.argsort(costs)
        simplex, costs = simplex[order], costs[order]
        if np.ptp(simplex, axis=0).max() < 0.02:
            break
        centre = simplex[:-1].mean(axis=0)
        mirrored = centre + (centre - simplex[-1])
        its_cost = cost(mirrored)
        if its_cost < costs[0]:
            farther = centre + 2.0 * (centre - simplex[-1])
            farther_cost = cost(farther)
            better = farther_cost < its_cost
            simplex[-1], costs[-1] = (farther, farther_cost) if better else (mirrored, its_cost)
        elif its_cost < costs[-2]:
            simplex[-1], costs[-1] = mirrored, its_cost
        else:
            nearer = centre + 0.5 * ((mirrored if its_cost < costs[-1] else simplex[-1]) - centre)
            nearer_cost = cost(nearer)
            if nearer_cost < min(its_cost, costs[-1]):
                simplex[-1], costs[-1] = nearer, nearer_cost
            else:
                simplex[1:] = simplex[0] + 0.5 * (simplex[1:] - simplex[0])
                costs[1:] = [cost(point) for point in simplex[1:]]
    best: Floats = simplex[int(np.argmin(costs))]
    return best


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command: 0 done, 1 the recordings cannot tell, 2 the command line or configuration is wrong."""
    parser = OneLineParser(prog="tinyekf tune", description="Q and R of the papers' filters, from recordings.")
    parser.add_argument("recordings", nargs="+", type=Path, metavar="REC")
    parser.add_argument("--held-out", nargs="+", type=Path, default=[], metavar="REC", help="recordings to judge on")
    parser.add_argument("--config", type=Path, metavar="FILE", help="in place of the recordings' own")
    parser.add_argument(
        "--write", type=Path, metavar="CONFIG", help="put fusion.q and fusion.r into this configuration"
    )
    options = parser.parse_args(argv)
    try:
        return _tune(options)
    except (RecordingError, ConfigError) as error:
        return complain("tune", error)
    except (TuningError, OSError) as error:
        return complain("tune", error, 1)


def _tune(options: argparse.Namespace) -> int:
    config = load_config(options.config) if options.config else None

    def sequences(paths: Sequence[Path]) -> list[Floats]:
        recordings = [decode(path, config) for path in paths]
        rows = [epochs_of(decoded, number) for decoded in recordings for number in decoded.gps_numbers]
        return [row for row in rows if len(row) >= MIN_EPOCHS]

    everything = sequences(options.recordings)
    if not everything:
        raise TuningError(f"fewer than {MIN_EPOCHS} GPS epochs with a fix in it; record for longer")
    training = [rows if options.held_out else rows[: int(TRAINING_SHARE * len(rows))] for rows in everything]
    judged = (
        sequences(options.held_out)
        if options.held_out
        else [rows[int(TRAINING_SHARE * len(rows)) :] for rows in everything]
    )
    if not judged:
        raise TuningError(f"fewer than {MIN_EPOCHS} GPS epochs with a fix in the recordings held out")

    def told(rounds: int) -> None:
        if sys.stderr.isatty():
            print(f"\r{rounds} tried", end="", file=sys.stderr, flush=True)

    noise = tuned(training, told)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    lines = []
    for name, candidate in (("before (the papers')", Noise()), ("after", noise)):
        result = likelihood(judged, candidate)
        q, r = (" ".join(f"{value:.3g}" for value in values) for values in (candidate.q, candidate.r))
        numbers = (f"{value:.2f}" for value in (result.log_likelihood, result.nis, result.heading_nis))
        lines.append([name, q, r, *numbers])
    print("On held-out data; Q per second and R are [north m^2, east m^2, heading degrees^2]\n")
    print(markdown_table(["", "Q", "R", "log likelihood", "NIS", "heading NIS"], lines, left=3), end="")
    if options.write is not None:
        for key, values in (("fusion.q", noise.q), ("fusion.r", noise.r)):
            set_key(options.write, key, [float(f"{value:.3g}") for value in values])
        print(f"\nwritten to {options.write}: fusion.q and fusion.r")
    return 0


if __name__ == "__main__":
    sys.exit(main())
