"""A job: one recording, real or simulated, with all the methods to be judged on it. Runs in any process, anywhere."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from acquisition.simulator.grades import GRADES
from acquisition.simulator.recorder import record
from acquisition.simulator.scenarios import Scenario
from acquisition.simulator.trajectory import Trajectory
from acquisition.simulator.voyage import START_UTC, Voyage
from tinyekf_py.config import Config
from tinyekf_py.evaluate.decoded import Decoded, decode
from tinyekf_py.evaluate.measures import Measures, measure
from tinyekf_py.evaluate.methods import run_method
from tinyekf_py.evaluate.outcome import Outcome
from tinyekf_py.evaluate.truth import Truth, read_truth


@dataclass(frozen=True, slots=True)
class Recorded:
    """A recording on the disk, and its truth."""

    recording: Path
    truth: Path
    truth_offset_deg: float = 0.0  #: added to the truth's headings

    def load(self, config: Config | None) -> tuple[Decoded, Truth]:
        """Decode it; RecordingError, TruthError or ConfigError when that cannot be."""
        return decode(self.recording, config), read_truth(self.truth, offset_deg=self.truth_offset_deg)


@dataclass(frozen=True, slots=True)
class Simulated:
    """A voyage, sailed when the job runs; `trajectory` is a file of poses to be followed in place of the plan."""

    scenario: Scenario
    grade: str = "typical"
    seed: int = 1
    start_utc: datetime = START_UTC
    trajectory: Path | None = None

    def load(self, config: Config | None) -> tuple[Decoded, Truth]:
        """Sail it, and decode what was recorded."""
        mover = Trajectory(self.trajectory) if self.trajectory else None
        duration_s = mover.duration_s if mover else self.scenario.duration_s
        voyage = Voyage(self.scenario, GRADES[self.grade], seed=self.seed, start_utc=self.start_utc, mover=mover)
        with tempfile.TemporaryDirectory(prefix="tinyekf-evaluate-") as folder:
            recording, truth = Path(folder, "voyage.rec"), Path(folder, "voyage.truth.csv")
            record(voyage, recording, truth, duration_s)
            return decode(recording, config), read_truth(truth)


@dataclass(frozen=True, slots=True)
class Job:
    """What is to be evaluated."""

    name: str  #: of the recording
    source: Recorded | Simulated
    methods: tuple[str, ...]
    group: str = ""  #: jobs of one group are pooled in the table
    skip_s: float = 20.0  #: not judged at the beginning
    config: Config | None = None  #: in place of the recording's own
    keep_series: bool = False  #: whether the outcomes are wanted, for pictures


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What came out of a job."""

    name: str
    group: str
    measures: dict[str, Measures]  #: by method
    outcomes: tuple[Outcome, ...] = ()
    truth: Truth | None = None


@dataclass(frozen=True, slots=True)
class Failure:
    """A job that could not be done, and why, in one line."""

    name: str
    reason: str


@dataclass(frozen=True, slots=True)
class Results:
    """What came out of many jobs, in their order."""

    evaluations: list[Evaluation] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)


def evaluate(job: Job) -> Evaluation | Failure:
    """Do a job. A recording that cannot be used is a Failure: the others of a fleet are worth having."""
    try:
        decoded, truth = job.source.load(job.config)
    except (ValueError, OSError) as error:  # all errors of recordings, truths, configurations and trajectories
        return Failure(job.name, str(error))
    outcomes = tuple(run_method(decoded, method) for method in job.methods)
    measures = {
        outcome.method: measure(outcome, truth, skip_s=job.skip_s, first_fix_s=decoded.first_fix_s)
        for outcome in outcomes
    }
    if not job.keep_series:
        return Evaluation(job.name, job.group, measures)
    return Evaluation(job.name, job.group, measures, outcomes, truth)
