"""Writes a voyage as a recording with its truth, faster than real time."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import IO

from acquisition.background_file import UnfinishedFileError
from acquisition.recording import RecordingError
from acquisition.recording_writer import RecordingWriter
from acquisition.simulator.scenarios import DEVICES, Scenario
from acquisition.simulator.vessel import STEP_US, Motion
from acquisition.simulator.voyage import Voyage, antennas_m

TRUTH_HEADER = "t_s,heading_deg,lat_deg,lon_deg\n"
TRUTH_PERIOD_STEPS = 10

_FLUSH_STEPS = 6000


def truth_row(t_s: float, motion: Motion) -> str:
    """The line of the truth CSV at `t_s`, ten times a second."""
    heading_deg = round(motion.heading_deg, 4) % 360.0
    return f"{t_s:.1f},{heading_deg:.4f},{motion.lat_deg:.9f},{motion.lon_deg:.9f}\n"


def recording_config(scenario: Scenario) -> dict[str, object]:
    """The `#config` keys that a recording of `scenario` carries: what a navigator would know of his boat."""
    config: dict[str, object] = {
        "vessel.variation_deg": scenario.waters.variation_deg,
        "vessel.antennas_m": antennas_m(),
    }
    config.update({f"sensors.{name}.enabled": False for name in DEVICES if name not in scenario.devices})
    return config


def record(voyage: Voyage, recording: Path, truth: Path, duration_s: float) -> None:
    """Sail `voyage` for `duration_s` seconds into the files `recording` and `truth`; existing ones are replaced.

    RecordingError says which file cannot be created, OSError why writing ended before the voyage did.
    """
    try:
        truth_file = truth.open("w", encoding="ascii")
    except OSError as error:
        raise RecordingError(f"cannot write the truth to {truth}: {error.strerror}") from error
    config = recording_config(voyage.scenario)
    try:
        with truth_file, closing(RecordingWriter(recording, voyage.start_utc, config)) as writer:
            truth_file.write(TRUTH_HEADER)
            _sail(voyage, writer, truth_file, round(duration_s * 1e6) // STEP_US)
    except UnfinishedFileError:
        raise
    except OSError as error:
        raise OSError(f"cannot write the truth to {truth}: {error.strerror}") from error
    if writer.lost:
        raise OSError(f"{recording}: {writer.lost} lines are missing")


def _sail(voyage: Voyage, writer: RecordingWriter, truth_file: IO[str], steps: int) -> None:
    truth_file.write(truth_row(0.0, voyage.motion))
    for step in range(1, steps + 1):
        for t_us, source, line in voyage.advance():
            writer.line(t_us, source, line)
        if step % TRUTH_PERIOD_STEPS == 0:
            truth_file.write(truth_row(voyage.motion.t_s, voyage.motion))
        if step % _FLUSH_STEPS == 0:
            writer.flush()  # this voyage runs ahead of any disk
            if writer.failure or writer.lost:
                return
