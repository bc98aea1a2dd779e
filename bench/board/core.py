"""What the C core costs on the board: instructions of each call, in both precisions, and the load of a Cortex-A8.

    python bench/board/core.py [SECONDS]

Counts instructions of the x86-64 core under callgrind and of the armhf core under qemu-arm with count_insns.c, on the
same simulated recording (five devices at full rates), and estimates the load of a 1 GHz Cortex-A8 from the latter.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
CSRC = HERE.parents[1] / "csrc"
BUILD = HERE.parents[1] / "build" / "board"
sys.path.insert(0, str(HERE.parent))

from replay import decoded  # noqa: E402  # the benchmark beside this folder

METHODS = {"cnw-ekf": 0, "cnw3": 1, "ekf-ci": 2, "adaptive": 3}  # fusion_method_t
KINDS = ("imu_tick", "gps_epoch", "compass_reading", "grid_row")
PER_SECOND = (100.0, 30.0, 10.0, 10.0)  # calls of each kind at full rates
VARIATION_DEG = "-8"
TOOLS = {
    "gcc": "gcc",
    "arm-linux-gnueabihf-gcc": "gcc-arm-linux-gnueabihf libc6-dev-armhf-cross",
    "qemu-arm": "qemu-user",
    "valgrind": "valgrind",
}
ARM = ("arm-linux-gnueabihf-gcc", "-mcpu=cortex-a8", "-mfpu=neon", "-mfloat-abi=hard", "-static")
#: Clock of the BeagleBone Black, and the instructions a cycle that are not floating point: an assumption (README.md).
CLOCK_HZ, IPC = 1e9, 0.25
TRANSFER_CYCLES = 20  # from the floating-point unit to the core
SINGLE_NEON_CYCLES = 1  # single precision in the NEON pipeline (RunFast mode), independent operations


class Cost(NamedTuple):
    """The calls of one kind: their number, the instructions of the dearest, and the sums of counters.h."""

    calls: int
    most: int
    sums: tuple[int, ...]


def main() -> int:
    for tool, packages in TOOLS.items():
        if shutil.which(tool) is None:
            print(f"core.py: {tool} is missing; install it with: apt-get install {packages}", file=sys.stderr)
            return 1
    BUILD.mkdir(parents=True, exist_ok=True)
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 300.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.log"
        command = [sys.executable, "-m", "acquisition.simulator", path, path.with_suffix(".truth.csv")]
        subprocess.run([*command, "--duration", str(duration_s)], check=True)
        samples = Path(folder) / "samples"
        samples.write_bytes(decoded(path)[0])
        counter = build_counter()
        print("| method | precision | machine | " + " | ".join(KINDS) + " | most in one tick |")
        print("|---|---|---|" + "---:|" * (len(KINDS) + 1))
        loads = []
        for method in METHODS:
            for real in ("double", "float"):
                native = callgrind(build(("gcc", "-g"), real, "x86"), method, samples)
                print(f"| `{method}` | {real} | x86-64 | " + " | ".join(f"{n:,.0f}" for n in native) + " | |")
                costs = emulated(build(ARM, real, "arm"), method, samples, counter, Path(folder))
                means = " | ".join(f"{cost.sums[0] / cost.calls:,.0f}" for cost in costs)
                print(f"| `{method}` | {real} | armhf | {means} | {costs[0].most:,} |", flush=True)
                loads.append(load_row(method, real, costs))
    print("\n| method | precision | instructions/s | VFP operations/s | load % | with NEON single % |")
    print("|---|---|---:|---:|---:|---:|")
    print("\n".join(loads))
    return 0


def build(compiler: Sequence[str], real: str, machine: str) -> Path:
    program = BUILD / f"core_load_{machine}_{real}"
    flags = ["-std=gnu11", "-O2", "-ffp-contract=off", "-fno-ipa-icf", f"-DEKF_REAL={real}", "-I", CSRC]
    subprocess.run([*compiler, *flags, HERE / "core_load.c", *CSRC.glob("*.c"), "-lm", "-o", program], check=True)
    return program


def build_counter() -> Path:
    """The plugin that counts."""
    library = BUILD / "libcount.so"
    flags = ["-std=gnu11", "-O2", "-Wall", "-Wextra", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, HERE / "count_insns.c", "-o", library], check=True)
    return library


def callgrind(program: Path, method: str, samples: Path) -> list[float]:
    """Mean instructions of a call of each kind."""
    out = samples.with_name("callgrind.out")
    command = [program, str(METHODS[method]), VARIATION_DEG, samples]
    done = subprocess.run(
        ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", *command],
        check=True,
        capture_output=True,
        text=True,
    )
    calls = {line.split()[0]: int(line.split()[1]) for line in done.stdout.splitlines()}
    annotate = ["callgrind_annotate", "--inclusive=yes", "--threshold=100", out]
    report = subprocess.run(annotate, check=True, capture_output=True, text=True).stdout
    means = []
    for kind in KINDS:
        found = re.search(rf"^\s*([\d,]+) .*:{kind} ", report, re.MULTILINE)
        means.append(int(found[1].replace(",", "")) / calls[kind] if found else float("nan"))
    return means


def emulated(program: Path, method: str, samples: Path, counter: Path, folder: Path) -> list[Cost]:
    """The cost of each kind of call, as counted by the emulator."""
    command = ["qemu-arm", "-plugin", f"{counter},counts={folder}", program]
    done = subprocess.run(
        [*command, str(METHODS[method]), VARIATION_DEG, samples, folder], check=True, capture_output=True, text=True
    )
    rows = {name: [int(n) for n in numbers] for name, *numbers in (line.split() for line in done.stdout.splitlines())}
    return [Cost(rows[kind][0], rows[kind][1], tuple(rows[kind][2:])) for kind in KINDS]


def load_row(method: str, real: str, costs: Sequence[Cost]) -> str:
    """One row of the table of loads: least and most, with VFPLite's times of both precisions, and with NEON's."""
    a_second = [
        sum(rate * cost.sums[i] / cost.calls for rate, cost in zip(PER_SECOND, costs, strict=True))
        for i in range(len(costs[0].sums))
    ]
    everything, doubles, doubles_least, doubles_most, singles, singles_least, singles_most, transfers, _ = a_second
    core = (everything - doubles - singles - transfers) / IPC + transfers * TRANSFER_CYCLES
    percent = [100 * cycles / CLOCK_HZ for cycles in (core + doubles_least + singles_least, core + doubles_most)]
    percent[1] += 100 * singles_most / CLOCK_HZ
    neon = 100 * (core + doubles_most + singles * SINGLE_NEON_CYCLES) / CLOCK_HZ
    spread = f"{percent[0]:.2f} to {percent[1]:.2f}"
    return f"| `{method}` | {real} | {everything:,.0f} | {doubles + singles:,.0f} | {spread} | {neon:.2f} |"


if __name__ == "__main__":
    sys.exit(main())
