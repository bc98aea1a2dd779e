"""What the live program costs: CPU of one core and memory (PSS) of each of its processes, at full rates.

    python bench/live_load.py [SECONDS]

Runs `tinyekf run --simulate --record`; with the full-screen console on a pty of its own for the second turn. The
simulator is listed, and left out of the sums.
"""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

WARM_UP_S = 5.0


def family(pid: int) -> list[int]:
    """A process and its children."""
    pids = [pid]
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            except OSError:
                continue
            if parent == pid:
                pids.append(int(entry.name))
    return pids


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pss_mb(pid: int) -> float:
    found = re.search(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE)
    return int(found[1]) / 1024 if found else float("nan")


def name_of(pid: int) -> str:
    command = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    worker = re.search(r'acquisition\.worker .*?"name": "(\w+)"', command)
    return f"worker {worker[1]}" if worker else "simulator" if "acquisition.simulator" in command else "fusion"


def measure(seconds: float, *, screen: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = pty.openpty()
        threading.Thread(target=_drain, args=(ours,), daemon=True).start()
        command = [sys.executable, "-m", "tinyekf_py.run", "--simulate", "--record", f"{folder}/r.log"]
        out = theirs if screen else subprocess.DEVNULL
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL, env=environment)
        time.sleep(WARM_UP_S)
        pids = family(process.pid)
        before, began = {pid: cpu_s(pid) for pid in pids}, time.monotonic()
        time.sleep(seconds)
        elapsed = time.monotonic() - began
        print(f"\n{'full-screen console' if screen else 'plain lines'}, {elapsed:.0f} s")
        total_cpu = total_pss = 0.0
        for pid in pids:
            share, memory, name = 100 * (cpu_s(pid) - before[pid]) / elapsed, pss_mb(pid), name_of(pid)
            print(f"  {name:16} {share:5.2f} % of a core  {memory:6.1f} MB")
            if name != "simulator":
                total_cpu, total_pss = total_cpu + share, total_pss + memory
        print(f"  {'all but simulator':16} {total_cpu:4.2f} % of a core  {total_pss:6.1f} MB")
        process.terminate()
        process.wait()


def _drain(descriptor: int) -> None:
    while os.read(descriptor, 65536):
        pass


if __name__ == "__main__":
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    measure(duration_s, screen=False)
    measure(duration_s, screen=True)
