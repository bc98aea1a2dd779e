"""A soak in real time: the live program on five simulated devices, its memory, file descriptors and lost lines.

python bench/live/soak_real.py --minutes 60
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from acquisition.recording import Line, read_recording
from tinyekf_py.control_socket import ControlError, call

WARM_UP_S = 120.0
PERIOD_S = 10.0


def rss_kb(pid: int) -> int:
    """Resident memory of a process, kB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1])
    raise ProcessLookupError(pid)


def open_files(pid: int) -> int:
    """File descriptors of a process."""
    return len(os.listdir(f"/proc/{pid}/fd"))


def processor_s(pid: int) -> float:
    """Processor time of a process, seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def soak(minutes: float, folder: Path) -> dict[str, Any]:
    """Run it; the figures."""
    recording = folder / "soak.rec"
    command = [sys.executable, "-m", "tinyekf_py.run", "--simulate"]
    command += ["--record", str(recording), "--output", str(folder / "soak.csv")]
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
    socket = folder / "tinyekf" / "ctl.sock"
    with (folder / "soak.log").open("wb") as log:
        program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log, env=environment)
    began = time.monotonic()
    samples: list[dict[str, Any]] = []
    status: dict[str, Any] = {}
    while time.monotonic() - began < minutes * 60.0:
        time.sleep(PERIOD_S)
        try:
            status = call(socket, "status")
        except ControlError as error:
            print(error, file=sys.stderr)
            continue
        pids = {"fusion": program.pid} | {name: sensor["pid"] for name, sensor in status["sensors"].items()}
        samples.append(
            {
                "t_s": status["t_s"],
                "mode": status["mode"],
                "rss_kb": {name: rss_kb(pid) for name, pid in pids.items()},
                "fds": {name: open_files(pid) for name, pid in pids.items()},
                "cpu_s": {name: processor_s(pid) for name, pid in pids.items()},
            }
        )
        (folder / "samples.json").write_text(json.dumps(samples))
    program.send_signal(signal.SIGTERM)
    program.wait()
    warm = next(sample for sample in samples if sample["t_s"] >= min(WARM_UP_S, samples[-1]["t_s"]))
    last = samples[-1]
    lines = Counter(entry.source for entry in read_recording(recording) if isinstance(entry, Line))
    return {
        "minutes": round(last["t_s"] / 60.0, 1),
        "rss_warm_kb": warm["rss_kb"],
        "rss_growth_kb": {name: last["rss_kb"][name] - kb for name, kb in warm["rss_kb"].items()},
        "fd_growth": {name: last["fds"][name] - n for name, n in warm["fds"].items()},
        "cpu_percent": {name: round(100.0 * s / last["t_s"], 1) for name, s in last["cpu_s"].items()},
        "not_ok": sum(sample["mode"] != "ok" for sample in samples),
        "lines": {name: sensor["lines"] for name, sensor in status["sensors"].items()},
        "recorded_lines": dict(lines),
        "dropped": {name: sensor["dropped"] for name, sensor in status["sensors"].items()},
        "restarts": {name: sensor["restarts"] for name, sensor in status["sensors"].items()},
        "exit_status": program.returncode,
    }


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(soak(options.minutes, Path(folder)), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
