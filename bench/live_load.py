"""What the live program costs: CPU of one core and memory (PSS) of each of its processes, at full rates.

    python bench/live_load.py [SECONDS]

Runs `tinyekf run --simulate --record`: with plain lines, with the full-screen console on a pty of its own, and with the
live page, one browser's stream being read. The simulator is listed, and left out of the sums.
"""

from __future__ import annotations

import asyncio
import json
import os
import pty
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import aiohttp

WARM_UP_S = 10.0


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


def cpu_s(pid: int) -> tuple[float, float]:
    """What a process has used of user and of system time."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) / os.sysconf("SC_CLK_TCK"), int(fields[12]) / os.sysconf("SC_CLK_TCK")


def pss_mb(pid: int) -> float:
    found = re.search(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE)
    return int(found[1]) / 1024 if found else float("nan")


def name_of(pid: int) -> str:
    command = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    worker = re.search(r'acquisition\.worker .*?"name": "(\w+)"', command)
    others = {"acquisition.simulator": "simulator", "tinyekf_py.outputs": "outputs"}
    other = next((name for module, name in others.items() if module in command), "fusion")
    return f"worker {worker[1]}" if worker else other


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def read_stream(port: int) -> None:
    """What a page does: open the stream of states, as soon as it is served, and read on."""
    while True:
        try:
            asyncio.run(_read_stream(port))
            return
        except aiohttp.ClientConnectorError:
            time.sleep(0.5)


async def _read_stream(port: int) -> None:
    async with aiohttp.ClientSession() as session, session.ws_connect(f"http://127.0.0.1:{port}/api/stream") as stream:
        async for _ in stream:
            pass


def measure(seconds: float, title: str, *, screen: bool = False, web: bool = False) -> None:
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = pty.openpty()
        threading.Thread(target=_drain, args=(ours,), daemon=True).start()
        command = [sys.executable, "-m", "tinyekf_py.run", "--simulate", "--record", f"{folder}/r.log"]
        port = free_port()
        if web:
            outputs = {"enabled": True, "port": port, "token_file": f"{folder}/token"}
            lines = [f"{key} = {json.dumps(value)}" for key, value in outputs.items()]
            Path(folder, "web.toml").write_text("[outputs]\nallow_simulated = true\n[outputs.web]\n" + "\n".join(lines))
            command += ["--config", f"{folder}/web.toml"]
        out = theirs if screen else subprocess.DEVNULL
        environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL, env=environment)
        if web:
            threading.Thread(target=read_stream, args=(port,), daemon=True).start()
        time.sleep(WARM_UP_S)
        pids = family(process.pid)
        before, began = {pid: cpu_s(pid) for pid in pids}, time.monotonic()
        time.sleep(seconds)
        elapsed = time.monotonic() - began
        print(f"\n{title}, {elapsed:.0f} s")
        user = system = memory = 0.0
        for pid in pids:
            shares = [100 * (now - then) / elapsed for now, then in zip(cpu_s(pid), before[pid], strict=True)]
            name, pss = name_of(pid), pss_mb(pid)
            print(f"  {name:16} user {shares[0]:5.2f} %  system {shares[1]:5.2f} % of a core  {pss:6.1f} MB")
            if name != "simulator":
                user, system, memory = user + shares[0], system + shares[1], memory + pss
        print(f"  {'all but simulator':16} user {user:4.2f} %  system {system:5.2f} % of a core  {memory:6.1f} MB")
        process.terminate()
        process.wait()


def _drain(descriptor: int) -> None:
    while os.read(descriptor, 65536):
        pass


if __name__ == "__main__":
    duration_s = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    measure(duration_s, "plain lines")
    measure(duration_s, "full-screen console", screen=True)
    measure(duration_s, "live page, one browser", web=True)
