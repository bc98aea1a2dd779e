"""The targets, and how runs stand against them: all seeds together, those held out, and groups of five."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tinyekf_py.evaluate.job import Evaluation
from tinyekf_py.evaluate.measures import Measures, pool
from tinyekf_py.evaluate.table import markdown_table

#: Targets of the root mean square error, degrees, at the typical grade, by start and scenario.
TARGETS = {
    "settled": {
        "straight": 0.5,
        "north": 0.5,
        "faulty-gps": 0.5,
        "lost-compass": 0.5,
        "straight-blackout": 0.6,
        "magnetic": 0.8,
        "harbour": 1.0,
        "lost-imu": 1.0,
        "current": 1.5,
    },
    "cold": {
        "straight": 0.8,
        "straight-blackout": 1.0,
        "current": 2.5,
        "dock": 1.0,  # beyond the compass' own error at the one heading
        "lost-imu": 1.5,
        "harbour": 1.2,
        "boreas": 1.2,
    },
}
#: What no method may be worse than by more than 20 % or 0.3 degrees.
REFERENCES = ("compass", "course", "cnw3", "ekf-ci")
#: A target asks for the root mean square over so many seeds.
GROUP = 5


@dataclass(frozen=True, slots=True)
class Verdict:
    """Runs of one scenario, pooled, against their targets."""

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


@dataclass(frozen=True, slots=True)
class Voyage:
    """All runs of one scenario from one start, and what is asked of them."""

    start: str  #: settled or cold
    scenario: str
    target_deg: float  #: `dock`'s is what may be added to the compass' own error
    runs: tuple[Evaluation, ...]

    def over(self, seeds: Iterable[int]) -> Voyage:
        """The same, of those seeds alone."""
        chosen = set(seeds)
        return Voyage(self.start, self.scenario, self.target_deg, tuple(r for r in self.runs if seed_of(r) in chosen))

    def groups(self) -> list[Voyage]:
        """Five consecutive seeds at a time; what is left over is in none."""
        seeds = sorted(map(seed_of, self.runs))
        return [self.over(seeds[i : i + GROUP]) for i in range(0, len(seeds) - GROUP + 1, GROUP)]

    def verdict(self, judged: str) -> Verdict:
        pooled = {method: pool([run.measures[method] for run in self.runs]) for method in (judged, *REFERENCES)}
        best = min((m for m in REFERENCES if math.isfinite(pooled[m].rmse_deg)), key=lambda m: pooled[m].rmse_deg)
        target_deg = self.target_deg
        if self.scenario == "dock":
            target_deg += float(np.sqrt(np.mean([run.measures["compass"].bias_deg ** 2 for run in self.runs])))
        return Verdict(target_deg, pooled[judged], best, pooled[best].rmse_deg)


def seed_of(run: Evaluation) -> int:
    """Its name is start, scenario and seed."""
    return int(run.name.rpartition(" ")[2])


def voyages_of(runs: Sequence[Evaluation], factor: float) -> list[Voyage]:
    """Every voyage that has a target and was run; it may err by `factor` times its target."""
    voyages = [
        Voyage(start, name, factor * target_deg, tuple(run for run in runs if run.group == f"{start} {name}"))
        for start, targets in TARGETS.items()
        for name, target_deg in targets.items()
    ]
    return [voyage for voyage in voyages if voyage.runs]


def verdict_table(voyages: Sequence[Voyage], judged: str) -> str:
    """All seeds pooled against the targets, as Markdown."""
    titles = ["scenario", "verdict", f"{judged} °", "target °", "worst run °", "best other", "its °", "limit °"]
    titles += ["in 2 sigma %", "avail. %", "step °"]
    lines = []
    for voyage in voyages:
        v = voyage.verdict(judged)
        lines.append(
            [
                voyage.scenario,
                "met" if v.met else "missed",
                *_degrees(v.judged.rmse_deg, v.target_deg, v.judged.worst_rmse_deg),
                v.best,
                *_degrees(v.best_deg, v.limit_deg),
                *_honesty(v.judged),
            ]
        )
    return markdown_table(titles, lines)


def seeds_table(voyages: Sequence[Voyage], judged: str, held_out: Sequence[int]) -> str:
    """Root mean square errors of all seeds, of the held-out ones and of the groups of five, as Markdown."""
    titles = ["start, voyage", "target °", "all °", "held out °", "groups missed", "worst group °", "worst run °"]
    lines = []
    for voyage in voyages:
        v, apart = voyage.verdict(judged), voyage.over(held_out)
        groups = [group.verdict(judged) for group in voyage.groups()]
        worst = max((group.judged.rmse_deg for group in groups), default=math.nan)
        lines.append(
            [
                f"{voyage.start} {voyage.scenario}",
                *_degrees(v.target_deg, v.judged.rmse_deg),
                *_degrees(apart.verdict(judged).judged.rmse_deg if apart.runs else math.nan),
                f"{sum(not group.met for group in groups)} of {len(groups)}",
                *_degrees(worst, v.judged.worst_rmse_deg),
            ]
        )
    return markdown_table(titles, lines, left=1)


def honesty_table(voyages: Sequence[Voyage], judged: str, held_out: Sequence[int]) -> str:
    """Share within two sigmas, availability and greatest step, of all voyages together and of the hard ones."""
    choices = {
        "all": voyages,
        "all, held out": [voyage.over(held_out) for voyage in voyages],
        "current": [voyage for voyage in voyages if voyage.scenario == "current"],
        "dock": [voyage for voyage in voyages if voyage.scenario == "dock"],
    }
    lines = []
    for name, chosen in choices.items():
        runs = [run.measures[judged] for voyage in chosen for run in voyage.runs]
        if runs:
            lines.append([name, str(len(runs)), *_honesty(pool(runs))])
    return markdown_table(["voyages", "runs", "in 2 sigma %", "avail. %", "step °"], lines, left=1)


def _degrees(*values: float) -> list[str]:
    return [f"{value:.2f}" if math.isfinite(value) else "" for value in values]


def _honesty(judged: Measures) -> list[str]:
    return [
        *(f"{100.0 * share:.1f}" for share in (judged.within_2_sigma, judged.availability)),
        f"{judged.step_deg:.1f}",
    ]
