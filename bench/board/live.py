"""What the live program costs the board: ARM instructions of each of its processes over a minute at full rates.

    python bench/board/live.py ROOT [--seconds N] [--screen] [--web] [--source DIR]

ROOT is the emulated board's root (toolchain/emulated-board.sh), or any armhf Debian with the program's packages;
DIR holds `acquisition` and `tinyekf_py` with the armhf core (default: those installed in ROOT). The simulator runs on
this machine and is not counted; the program and its workers run under qemu-arm with count_insns.c, whose counters
are read at the beginning and the end of the minute. Kernel time is not in them: README.md says how it is added.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from core import CLOCK_HZ, IPC, TRANSFER_CYCLES, VARIATION_DEG, build_counter
from live_load import free_port, read_stream  # core.py has made the folder above known

COUNTERS = 9  # of counters.h
START_LIMIT_S = 180.0  # an emulated start is slow
WARM_UP_S = 10.0
LINKS = {"gps1": "fjGPS1", "gps2": "fjGPS2", "gps3": "fjGPS3", "compass": "fjEC", "imu": "fjIMU"}
#: Shows the root what it needs of this machine, for this process alone, and goes there: ROOT FOLDER SOURCE COMMAND...
ENTER = """
root=$1 folder=$2 source=$3; shift 3
for path in /proc /sys /dev /dev/pts /lib64 /lib/x86_64-linux-gnu /usr/lib/x86_64-linux-gnu "$folder" "$source"; do
    mkdir -p "$root$path"
    mount --bind "$path" "$root$path"
done
touch "$root/usr/bin/qemu-arm"
mount --bind /usr/bin/qemu-arm "$root/usr/bin/qemu-arm"
exec chroot "$root" "$@"
"""
#: Starts the program with workers that go through the same emulator.
START = "import sys; sys.executable = {wrapper!r}; sys.argv[1:] = {arguments!r}; import tinyekf_py.cli as c; c.main()"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--screen", action="store_true", help="with the full-screen console instead of plain lines")
    parser.add_argument("--source", type=Path, help="folder with the program and its armhf core")
    parser.add_argument("--web", action="store_true", help="with the live page, one browser's stream being read")
    options = parser.parse_args()
    if shutil.which("qemu-arm") is None:
        print("live.py: qemu-arm is missing; install it with: apt-get install qemu-user", file=sys.stderr)
        return 1
    python = options.root.resolve() / "usr/bin/python3.11"
    if not python.exists():
        print(f"live.py: {options.root} has no usr/bin/python3.11; give the root of an armhf Debian", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as name:
        measure(options, Path(name))
    return 0


def measure(options: argparse.Namespace, folder: Path) -> None:
    counts = folder / "counts"
    counts.mkdir()
    library = build_counter()
    wrapper = folder / "python"  # runs inside the root; the emulator itself is this machine's
    emulator = f"qemu-arm -0 /usr/bin/python3.11 -plugin {folder}/{library.name},counts={counts} /usr/bin/python3.11"
    wrapper.write_text(f'#!/bin/sh\nexec {emulator} "$@"\n')
    wrapper.chmod(0o755)
    shutil.copy(library, folder)
    config = folder / "tinyekf.toml"
    ports = "".join(f'[sensors.{source}]\nport = "{folder}/{link}"\n' for source, link in LINKS.items())
    port = free_port()
    web = f'[outputs.web]\nenabled = true\nport = {port}\ntoken_file = "{folder}/token"\n' if options.web else ""
    config.write_text(f"[vessel]\nvariation_deg = {VARIATION_DEG}\n{ports}{web}")
    simulator = subprocess.Popen(
        [sys.executable, "-m", "acquisition.simulator", "--ptys", "--links", folder], stdout=subprocess.PIPE, text=True
    )
    assert simulator.stdout is not None
    json.loads(simulator.stdout.readline())
    arguments = ["run", "--config", str(config), "--record", str(folder / "r.log")]
    start = START.format(wrapper=str(wrapper), arguments=arguments)
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
    if options.source is not None:
        environment["PYTHONPATH"] = str(options.source.resolve())
    ours, theirs = pty.openpty()
    threading.Thread(target=_drain, args=(ours,), daemon=True).start()
    with (folder / "log").open("w+") as log:
        out = theirs if options.screen else subprocess.DEVNULL
        enter = ["unshare", "--mount", "--", "sh", "-euc", ENTER, "sh", str(options.root.resolve()), str(folder)]
        enter += [str(options.source.resolve() if options.source else folder), str(wrapper), "-P", "-c", start]
        program = subprocess.Popen(enter, stdout=out, stderr=log, env=environment)
        try:
            wait_until_all_speak(program, folder / "r.log")
            if options.web:
                threading.Thread(target=read_stream, args=(port,), daemon=True).start()
            time.sleep(WARM_UP_S)
            before, began = read_all(counts), time.monotonic()
            switches = {pid: switches_of(pid) for pid in before}
            samples = lines_of(folder / "r.log")
            time.sleep(options.seconds)
            after, elapsed_s = read_all(counts), time.monotonic() - began
            names = {pid: name_of(pid) for pid in after}
            wakes = {pid: (switches_of(pid) - then) / elapsed_s for pid, then in switches.items()}
            lines = lines_of(folder / "r.log") - samples
        finally:
            program.terminate()
            program.wait()
            simulator.terminate()
            simulator.wait()
            log.seek(0)
            print(log.read(), file=sys.stderr, end="")
    print(f"{elapsed_s:.0f} s, {lines / elapsed_s:.0f} lines/s recorded (full rates: 210)")
    print("| process | wake-ups/s | instructions/s | VFP operations/s | load of a 1 GHz Cortex-A8, user |")
    print("|---|---:|---:|---:|---:|")
    total = [0.0] * COUNTERS
    for pid, counters in sorted(after.items()):
        if pid not in before:
            continue
        rates = [(now - then) / elapsed_s for now, then in zip(counters, before[pid], strict=True)]
        total = [a + b for a, b in zip(total, rates, strict=True)]
        print(row(names[pid], wakes[pid], rates))
    print(row("all", sum(wakes.values()), total))


def row(name: str, wakes: float, rates: list[float]) -> str:
    everything, doubles, _, doubles_most, singles, _, singles_most, transfers, _ = rates
    cycles = (everything - doubles - singles - transfers) / IPC + transfers * TRANSFER_CYCLES
    load = 100 * (cycles + doubles_most + singles_most) / CLOCK_HZ
    return f"| {name} | {wakes:.0f} | {everything / 1e6:.2f} M | {(doubles + singles) / 1e3:.0f} k | {load:.1f} % |"


def wait_until_all_speak(program: subprocess.Popen[bytes], recording: Path) -> None:
    """Until every source stands in the recording."""
    limit = time.monotonic() + START_LIMIT_S
    while not (recording.exists() and all(f" {name} ".encode() in recording.read_bytes() for name in LINKS)):
        if program.poll() is not None or time.monotonic() > limit:
            raise SystemExit("live.py: the program has ended, or not every device was heard")
        time.sleep(0.5)


def read_all(folder: Path) -> dict[int, tuple[int, ...]]:
    """The counters of every process that still lives."""
    return {
        int(path.name): struct.unpack(f"={COUNTERS}Q", path.read_bytes())
        for path in folder.iterdir()
        if Path(f"/proc/{path.name}").exists()
    }


def switches_of(pid: int) -> int:
    """How often the threads of a process have gone to sleep of their own will."""
    statuses = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/status")]
    return sum(int(re.findall(r"^voluntary_ctxt_switches:\s+(\d+)", text, re.MULTILINE)[0]) for text in statuses)


def lines_of(path: Path) -> int:
    with path.open("rb") as file:
        return sum(not line.startswith(b"#") for line in file)


def name_of(pid: int) -> str:
    command = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    worker = re.search(r'acquisition\.worker .*?"name": "(\w+)"', command)
    return f"worker {worker[1]}" if worker else "outputs" if "tinyekf_py.outputs" in command else "fusion"


def _drain(descriptor: int) -> None:
    while os.read(descriptor, 65536):
        pass


if __name__ == "__main__":
    sys.exit(main())
