"""What single precision costs in accuracy: the same recordings replayed with both builds of the C core, and the truth.

    python bench/board/precision.py [SEEDS]

Builds the core with TINYEKF_REAL=double and =float in copies of the sources, runs the filter's lock-up test in both,
and replays simulated recordings of ten minutes (SEEDS of each scenario, 2 unless told otherwise) with every method.
"""

from __future__ import annotations

import csv
import math
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "board"
METHODS = ("cnw-ekf", "cnw3", "ekf-ci", "adaptive")
SCENARIOS = ("straight", "harbour", "current", "lost-imu", "faulty-gps")
FIRST_S = 20.0  # left out, as in bench/accuracy


class Row(NamedTuple):
    """A line of a heading CSV, or of a truth."""

    heading_deg: float
    sigma_deg: float


def main() -> int:
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    with ThreadPoolExecutor(2) as pool:
        copies = dict(zip(("double", "float"), pool.map(build, ("double", "float")), strict=True))
    for real in copies:
        print(f"lock-up test, {real}: {lock_up(real)}")
    errors: dict[tuple[str, str], list[float]] = {(method, real): [] for method in METHODS for real in copies}
    outside: dict[tuple[str, str], int] = dict.fromkeys(errors, 0)
    apart: dict[str, list[float]] = {method: [] for method in METHODS}
    with tempfile.TemporaryDirectory() as folder:
        for scenario in SCENARIOS:
            for seed in range(1, seeds + 1):
                recording, truth = Path(folder) / "r.log", Path(folder) / "t.csv"
                options = ["--scenario", scenario, "--seed", str(seed), "--duration", "600"]
                python(copies["double"], "acquisition.simulator", recording, truth, *options)
                true = rows_of(truth)
                for method in METHODS:
                    found = {real: replayed(copy, recording, method) for real, copy in copies.items()}
                    for real, rows in found.items():
                        judged = [(row, true[t]) for t, row in rows.items() if t in true and float(t) >= FIRST_S]
                        deviations = [wrapped(row.heading_deg - t.heading_deg) for row, t in judged]
                        errors[method, real] += deviations
                        outside[method, real] += sum(
                            abs(e) > 2 * row.sigma_deg for e, (row, _) in zip(deviations, judged, strict=True)
                        )
                    pairs = [(row, found["float"].get(t)) for t, row in found["double"].items()]
                    apart[method] += [abs(wrapped(a.heading_deg - b.heading_deg)) for a, b in pairs if b is not None]
                print(f"{scenario} {seed}", file=sys.stderr)
    print("| method | RMSE double | RMSE float | float - double: RMS | largest | in 2 sigma double | float | rows |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    for method in METHODS:
        both = [errors[method, real] for real in copies]
        inside = [100 * (1 - outside[method, real] / len(e)) for real, e in zip(copies, both, strict=True)]
        print(
            f"| `{method}` | {rms(both[0]):.4f}° | {rms(both[1]):.4f}° | {rms(apart[method]):.5f}° "
            f"| {max(apart[method]):.4f}° | {inside[0]:.2f} % | {inside[1]:.2f} % | {len(both[0])}, {len(both[1])} |"
        )
    return 0


def build(real: str) -> Path:
    """A copy of what is committed, its core in this precision."""
    copy = BUILD / f"precision-{real}"
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir(parents=True)
    archive = [
        "git",
        "archive",
        "HEAD",
        "setup.py",
        "pyproject.toml",
        "README.md",
        "LICENSE",
        "csrc",
        "acquisition",
        "tinyekf_py",
    ]
    sources = subprocess.run(archive, cwd=ROOT, check=True, capture_output=True).stdout
    subprocess.run(["tar", "x"], cwd=copy, input=sources, check=True)
    command = [sys.executable, "setup.py", "-q", "build_ext", "--inplace"]
    subprocess.run(command, cwd=copy, check=True, env={**os.environ, "TINYEKF_REAL": real}, stderr=subprocess.DEVNULL)
    return copy


def lock_up(real: str) -> str:
    """The verdict of the filter's own test, whose larger part is the lock-up courses."""
    program, csrc = BUILD / f"test_ekf_{real}", ROOT / "csrc"
    sources = [ROOT / "tests" / "c" / "test_ekf.c", *(csrc / name for name in ("ekf.c", "heading_model.c", "angle.c"))]
    flags = ["-std=c11", "-O2", "-ffp-contract=off", f"-DEKF_REAL={real}", "-I", csrc]
    subprocess.run(["gcc", *flags, *sources, "-lm", "-o", program], check=True)
    return subprocess.run([program], check=True, capture_output=True, text=True).stdout.strip()


def python(copy: Path, module: str, *arguments: str | Path) -> None:
    subprocess.run([sys.executable, "-m", module, *arguments], check=True, cwd=copy, env=environment_of(copy))


def environment_of(copy: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(copy)}


def replayed(copy: Path, recording: Path, method: str) -> dict[str, Row]:
    out = recording.with_name("h.csv")
    arguments = ["--replay", recording, "--output", out, "--method", method]
    command = [sys.executable, "-m", "tinyekf_py.run", *arguments]
    subprocess.run(command, check=True, cwd=copy, env=environment_of(copy), stderr=subprocess.DEVNULL)
    return rows_of(out)


def rows_of(path: Path) -> dict[str, Row]:
    """The headings of a CSV by their time; rows without one are left out."""
    with path.open(newline="") as file:
        return {
            row["t_s"]: Row(float(row["heading_deg"]), float(row.get("heading_sigma_deg") or "nan"))
            for row in csv.DictReader(file)
            if row["heading_deg"]
        }


def wrapped(angle_deg: float) -> float:
    return (angle_deg + 180.0) % 360.0 - 180.0


def rms(values: list[float]) -> float:
    return math.sqrt(math.fsum(value * value for value in values) / len(values))


if __name__ == "__main__":
    sys.exit(main())
