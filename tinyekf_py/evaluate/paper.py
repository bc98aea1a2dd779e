"""The experiment of the 2019 paper, repeated: a boat on a straight line at 18.01 degrees, twice, two days apart.

The paper's recordings were not published; simulated devices of the usual quality stand in for them, in a sea that does
not yaw the boat, so that the reference is 18.01 degrees at every moment as it was in the paper. Each data set is taken
complete (the paper's Table 1 and Figure 8) and with black-outs of all three GPS (Table 2 and Figure 7). Table 3 is the
processing time of one data set, here the C core's own.
"""

from __future__ import annotations

import time
from dataclasses import replace
from datetime import timedelta

from acquisition.recording import Event
from acquisition.simulator.scenarios import SCENARIOS
from acquisition.simulator.voyage import START_UTC
from tinyekf_py.config import METHODS, apply_flat
from tinyekf_py.evaluate.decoded import Decoded
from tinyekf_py.evaluate.job import Job, Simulated
from tinyekf_py.evaluate.table import markdown_table
from tinyekf_py.fusion import fusion_of

REFERENCE_DEG = 18.01
_SEEDS = {"data set 1": (1, 0), "data set 2": (2, 2)}  # seed, days after the first
_REPEATS = 3


def paper_source(scenario_name: str, data_set: str) -> Simulated:
    """One of the paper's data sets: `scenario_name` is straight or straight-blackout."""
    scenario = SCENARIOS[scenario_name]
    waters = replace(scenario.waters, sea=replace(scenario.waters.sea, yaw_deg=0.0))
    seed, days = _SEEDS[data_set]
    return Simulated(replace(scenario, waters=waters), seed=seed, start_utc=START_UTC + timedelta(days=days))


def paper_jobs(methods: tuple[str, ...], *, keep_series: bool = False) -> list[Job]:
    """The four runs: two data sets, complete and with black-outs."""
    return [
        Job(f"{data_set}, {what}", paper_source(scenario, data_set), methods, skip_s=20.0, keep_series=keep_series)
        for what, scenario in (("complete", "straight"), ("black-outs", "straight-blackout"))
        for data_set in _SEEDS
    ]


def processing_times(decoded: Decoded, methods: tuple[str, ...]) -> dict[str, float]:
    """Seconds that the C core takes for all of a recording's samples, the best of three, by method."""
    times = {}
    for method in methods:
        config = apply_flat(decoded.config, {"fusion.method": method}, "--method")
        best = float("inf")
        for _ in range(_REPEATS):
            fusion = fusion_of(config)
            began = time.perf_counter()
            for part in decoded.parts:
                if isinstance(part, Event):
                    fusion.obey(part)
                else:
                    fusion.consume(part)
            best = min(best, time.perf_counter() - began)
        times[method] = best
    return times


def print_processing_times() -> None:
    """The paper's Table 3 for data set 1, complete."""
    decoded, _ = paper_source("straight", "data set 1").load(None)
    times = processing_times(decoded, METHODS)
    samples, minutes = len(decoded.samples), len(decoded.rows_s) / 600.0
    lines = [
        [method, f"{seconds * 1e3:.1f}", f"{seconds / samples * 1e9:.0f}", f"{seconds / times['cnw3']:.2f}"]
        for method, seconds in times.items()
    ]
    print(f"\nProcessing time of {samples} samples ({minutes:.0f} minutes), decoded, in the C core\n")
    print(markdown_table(["method", "ms", "ns a sample", "against cnw3"], lines, left=1), end="")
