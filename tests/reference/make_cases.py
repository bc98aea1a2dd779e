"""Writes the inputs of the reference programs as CSV files into a folder.

    python tests/reference/make_cases.py FOLDER [--short]

`cases`, `streams` and `ten_minutes` say what they are. With --short the ten-minute recording is left out.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from boat import Loss
from cases import FUNCTIONS
from streams import STREAMS, Options, Stream
from ten_minutes import VARIATION_DEG, checksum, ten_minutes

from acquisition.sample import COMPASS, IMU, SOURCES, CompassSample, GpsSample, ImuSample, Sample

#: Columns of a table of samples; fusion_run.m counts on this order.
SAMPLE_COLUMNS = (
    *("t_us", "source", "fix_quality", "utc_s", "lat_deg", "lon_deg", "altitude_m", "speed_mps", "course_deg", "hdop"),
    *("variation_deg", "satellites", "reference", "heading_deg", "deviation_deg", "pitch_deg", "roll_deg", "yaw_deg"),
    *("gyro_x_dps", "gyro_y_dps", "gyro_z_dps", "accel_x_g", "accel_y_g", "accel_z_g"),
    *("mag_x_ut", "mag_y_ut", "mag_z_ut"),
)
_COLUMN = {name: column for column, name in enumerate(SAMPLE_COLUMNS)}

#: Numbers of the tasks in a table of switches.
TASKS = {
    **SOURCES,
    **{f"cnw-s{stage}": 10 + stage for stage in (1, 2, 3)},
    **{f"ekf{filter_}": 20 + filter_ for filter_ in range(1, 9)},
}

RECORDING = Stream("ten_minutes", lambda: list(ten_minutes()), Options(variation_deg=VARIATION_DEG), methods=("cnw3",))


def write_csv(path: Path, names: Sequence[str], rows: Iterable[Iterable[float]]) -> None:
    """One header line, then a line a row with 17 significant digits."""
    with path.open("w", encoding="ascii") as file:
        print(",".join(names), file=file)
        for row in rows:
            print(",".join(f"{value:.17g}" for value in row), file=file)


def sample_row(sample: Sample) -> list[float]:
    """A sample as a row of SAMPLE_COLUMNS."""
    row = [math.nan] * len(SAMPLE_COLUMNS)
    for name, value in sample._asdict().items():
        if name != "reserved":
            row[_COLUMN[name]] = value
    return row


def rotation(mount_deg: tuple[float, float, float]) -> np.ndarray:
    """The matrix that turns about x by roll, then y by pitch, then z by yaw (all of the vessel), shape (3, 3)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(math.radians(a)), math.cos(math.radians(a))) for a in mount_deg)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def sources_of(options: Options) -> tuple[str, ...]:
    """Names of the configured sources."""
    names = (*(f"gps{i + 1}" for i in range(options.n_gps)), "compass", "imu")
    return tuple(name for name in names if name not in options.absent)


def options_row(options: Options) -> list[float]:
    """Options as the row that fusion_options.m reads."""
    configured = {SOURCES[name] for name in sources_of(options)}
    return [
        options.n_gps,
        *(float(source in configured) for source in (*range(8), COMPASS, IMU)),
        options.variation_deg,
        *options.deviation,
        *rotation(options.mount_deg).ravel(),
        float(options.specific_force),
        options.max_sigma_deg,
    ]


def write_stream(folder: Path, stream: Stream) -> None:
    """Samples, switches and options of a stream as three files."""
    samples: list[list[float]] = []
    switches: list[tuple[float, float, float, float]] = []
    for item in stream.items():
        if isinstance(item, GpsSample | CompassSample | ImuSample):
            samples.append(sample_row(item))
        elif isinstance(item, Loss):
            switches.append((item.t_us, 30 + SOURCES[item.name], 0.0, len(samples) + 1))
        else:
            switches.append((item.t_us, TASKS[item.name], float(item.running), len(samples) + 1))
    write_csv(folder / f"{stream.name}_samples.csv", SAMPLE_COLUMNS, samples)
    write_csv(folder / f"{stream.name}_tasks.csv", ("t_us", "task", "running", "before"), switches)
    options = options_row(stream.options)
    write_csv(folder / f"{stream.name}_options.csv", [f"option{i + 1}" for i in range(len(options))], [options])


def main(folder: Path, streams: Sequence[Stream]) -> None:
    """Write everything into `folder`, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in FUNCTIONS.items():
        table = make()
        write_csv(folder / f"{name}.csv", table.names, table.rows)
    for stream in streams:
        write_stream(folder, stream)
    lines = [f"{stream.name} {method}\n" for stream in streams for method in stream.methods]
    (folder / "streams.txt").write_text("".join(lines), encoding="ascii")
    if RECORDING in streams:
        (folder / "ten_minutes.sha256").write_text(f"{checksum()}\n", encoding="ascii")


if __name__ == "__main__":
    main(Path(sys.argv[1]), STREAMS if "--short" in sys.argv else (*STREAMS, RECORDING))
