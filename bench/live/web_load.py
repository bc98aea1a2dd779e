"""What the output process costs while ten pages and ten chart plotters watch, and how soon the page is painted.

    python bench/live/web_load.py [SECONDS]

Runs `tinyekf run` on five simulated devices at full rates, with the web and NMEA 0183 by TCP on, and measures the
output process twice: without clients, and with ten WebSocket and ten TCP clients at 10 Hz, of which one more of each
never reads. Then Chromium (Playwright) opens the page ten times.
"""

from __future__ import annotations

import os
import re
import select
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WARM_UP_S, CLIENTS = 6.0, 10
CONFIG = """[outputs.web]
enabled = true
port = {web}
[outputs.nmea_tcp]
enabled = true
port = {nmea}
"""
HANDSHAKE = (
    "GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
)
PING, PONG = b"\x89\x00", b"\x8a\x80\0\0\0\0"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def processes_of(pid: int) -> dict[int, str]:
    """The program's processes, by what they are; without the simulator."""
    found = {pid: "fusion"}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
                command = (entry / "cmdline").read_text()
            except OSError:
                continue
            if parent == pid and "acquisition.simulator" not in command:
                found[int(entry.name)] = "outputs" if "outputs.process" in command else "worker"
    return found


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pss_mb(pid: int) -> float:
    found = re.search(r"^Pss:\s+(\d+)", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE)
    return int(found[1]) / 1024 if found else float("nan")


class Clients:
    """Reads all it is sent in a thread, and counts it."""

    def __init__(self, port: int, hello: bytes = b"") -> None:
        self.readers = [socket.create_connection(("127.0.0.1", port)) for _ in range(CLIENTS)]
        self.stuck = socket.create_connection(("127.0.0.1", port))
        for client in (*self.readers, self.stuck):
            client.sendall(hello)
        self.marks = 0
        self.mark = b'{"state":' if hello else b"HDT,"
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while not self._ended.is_set():
            for client in select.select(self.readers, [], [], 0.2)[0]:
                chunk = client.recv(1 << 20)
                self.marks += chunk.count(self.mark)
                if PING in chunk:
                    client.sendall(PONG)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        for client in (*self.readers, self.stuck):
            client.close()


def measure(pid: int, seconds: float) -> None:
    """Print the output process' share of a core, its PSS, and the whole program's PSS."""
    processes = processes_of(pid)
    output = next(process for process, name in processes.items() if name == "outputs")
    before, began = cpu_s(output), time.monotonic()
    time.sleep(seconds)
    share = 100.0 * (cpu_s(output) - before) / (time.monotonic() - began)
    whole = sum(pss_mb(process) for process in processes)
    print(f"  output process {share:5.2f} % of a core, {pss_mb(output):5.1f} MB PSS; program {whole:6.1f} MB PSS")


def paint(port: int) -> None:
    """Print the page's weight and its first paint, median and longest of ten."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        paints_ms, shown_ms, weights = [], [], []
        for _ in range(10):
            page = browser.new_page(viewport={"width": 800, "height": 480})
            weight: list[int] = []
            page.on("response", lambda response, weight=weight: weight.append(len(response.body())))
            began = time.monotonic()
            page.goto(f"http://127.0.0.1:{port}")
            page.wait_for_selector("html[data-link=live]")
            shown_ms.append(1000 * (time.monotonic() - began))
            entries = "performance.getEntriesByName('first-contentful-paint').map((e) => e.startTime)"
            page.wait_for_function(f"{entries}.length > 0")
            paints_ms.append(page.evaluate(entries)[0])
            weights.append(sum(weight))
            page.close()
        browser.close()
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/api/history") as answer:
        history = len(answer.read())
    print(f"page: {max(weights) / 1000:.1f} kB, and {history / 1000:.1f} kB of history")
    print(f"first contentful paint {statistics.median(paints_ms):.0f} ms (longest {max(paints_ms):.0f});", end=" ")
    print(f"the heading is there after {statistics.median(shown_ms):.0f} ms (longest {max(shown_ms):.0f})")


def metrics(port: int) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics") as answer:
        return str(answer.read().decode())


def main(seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        web, nmea = free_port(), free_port()
        (Path(folder) / "tinyekf.toml").write_text(CONFIG.format(web=web, nmea=nmea))
        process = subprocess.Popen(
            [sys.executable, "-m", "tinyekf_py.run", "--simulate", "--config", f"{folder}/tinyekf.toml"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            env={**os.environ, "XDG_RUNTIME_DIR": folder, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        try:
            time.sleep(WARM_UP_S)
            print(f"without clients, {seconds:.0f} s")
            measure(process.pid, seconds)
            pages, plotters = Clients(web, HANDSHAKE.format(port=web).encode()), Clients(nmea)
            time.sleep(2.0)
            print(f"with {CLIENTS} pages and {CLIENTS} plotters, and one of each that never reads, {seconds:.0f} s")
            before, began = (pages.marks, plotters.marks), time.monotonic()
            measure(process.pid, seconds)
            elapsed = time.monotonic() - began
            rates = [
                (now - then) / elapsed / CLIENTS
                for now, then in zip((pages.marks, plotters.marks), before, strict=True)
            ]
            print(f"  each page got {rates[0]:.2f} states a second, each plotter {rates[1]:.2f} HDT")
            lost = re.search(r'^tinyekf_web_frames_lost_total{stream="page"} (.+)', metrics(web), re.MULTILINE)
            print(f"  the page that never reads was spared {lost[1] if lost else 0} states")
            pages.close()
            plotters.close()
            paint(web)
        finally:
            process.terminate()
            process.wait()


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 30.0)
