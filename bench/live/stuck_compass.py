"""What a compass costs that sticks at one value while three good receivers and the IMU go on.

    python bench/live/stuck_compass.py

A simulated tour of 400 s in which the boat turns by 40 to 80 degrees and once all round; the compass sticks from 60 to
360 s. For every method, with the IMU (then the gyro tells that it sticks) and without (then the courses tell, some
seconds later): the error of the heading against the truth in that time, RMS and largest, beside that of the sound
compass.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from acquisition.recording import read_recording
from tinyekf_py.config import Config, apply_flat
from tinyekf_py.evaluate.truth import Truth, read_truth, wrap_deg
from tinyekf_py.fusion import METHODS
from tinyekf_py.replay import replay

STICKS_S = (60.0, 360.0)
DURATION_S = 400


def stick(sound: Path, stuck: Path) -> None:
    """Copy a recording, its compass repeating within `STICKS_S` what it said first."""
    held: dict[bytes, bytes] = {}
    lines = []
    for line in sound.read_bytes().splitlines():
        stamp, _, rest = line.partition(b" ")
        if rest.startswith(b"compass ") and STICKS_S[0] <= float(stamp) < STICKS_S[1]:
            line = stamp + b" " + held.setdefault(rest[:14], rest)
        lines.append(line + b"\n")
    stuck.write_bytes(b"".join(lines))


def figures(recording: Path, truth: Truth, method: str, *, imu: bool) -> str:
    """RMS and largest error (degrees) while it sticks, and the share of those rows that is called ok."""
    config = apply_flat(Config(), read_recording(recording).config, "the recording")
    rows = replay(recording, method, apply_flat(config, {"sensors.imu.enabled": imu}, "here"))
    rows = rows[(rows["t_s"] >= STICKS_S[0]) & (rows["t_s"] < STICKS_S[1])]
    error = wrap_deg(rows["heading_deg"] - truth.heading_at(rows["t_s"]))
    rms, most = np.sqrt(np.mean(error**2)), np.max(np.abs(error))
    return f"{rms:5.1f} {most:5.1f} {np.mean(rows['mode'] == 'ok'):5.0%}"


def main() -> int:
    """The table."""
    with tempfile.TemporaryDirectory() as folder:
        sound, stuck, truth_csv = (Path(folder) / name for name in ("sound.rec", "stuck.rec", "truth.csv"))
        command = [sys.executable, "-m", "tinyekf_py.cli", "simulate", str(sound), str(truth_csv)]
        subprocess.run([*command, "--scenario", "tour", "--duration", str(DURATION_S)], check=True)
        stick(sound, stuck)
        truth = read_truth(truth_csv)
        print(f"{'error, deg: RMS, largest, rows ok':34}{'sound compass':>19}{'stuck compass':>19}")
        for imu in (True, False):
            for method in METHODS:
                columns = [figures(recording, truth, method, imu=imu) for recording in (sound, stuck)]
                print(
                    f"{method:10}{'with' if imu else 'without':>8} IMU {'':11}" + "".join(f"{c:>19}" for c in columns)
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
