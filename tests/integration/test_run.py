"""The main program as its users start it: real processes, real ptys, real files."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from tinyekf_py.heading_csv import read_heading_csv

RUN = [sys.executable, "-m", "tinyekf_py.run"]


def run(folder: Path, *options: str, timeout: float = 60) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*RUN, *options], cwd=folder, capture_output=True, text=True, timeout=timeout)


@contextmanager
def live(folder: Path, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    with (folder / "stderr.txt").open("wb") as stderr, (folder / "stdout.txt").open("wb") as stdout:
        process = subprocess.Popen([*RUN, "--simulate", *options], cwd=folder, stdout=stdout, stderr=stderr)
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()


def wait_for(what: Callable[[], object], seconds: float = 20.0) -> object:
    deadline = time.monotonic() + seconds
    while not (result := what()):
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)
    return result


def children_of(pid: int) -> dict[int, str]:
    """Command lines of a process' children."""
    children = {}
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and int((entry / "stat").read_text().rpartition(")")[2].split()[1]) == pid:
                children[int(entry.name)] = (entry / "cmdline").read_text().replace("\0", " ")
        except OSError:
            continue  # ended meanwhile
    return children


def said(folder: Path, pattern: str) -> bool:
    return re.search(pattern, (folder / "stderr.txt").read_text()) is not None


def seconds_recorded(path: Path) -> float:
    lines = path.read_text().splitlines() if path.exists() else []
    stamps = [line.split(" ", 1)[0] for line in lines[:-1] if line and line[0] != "#"]
    return float(stamps[-1]) if stamps else 0.0


def test_replay_of_a_live_run_gives_the_same_bytes(tmp_path: Path) -> None:
    done = run(tmp_path, "--simulate", "--duration", "8", "--record", "r.log", "--output", "live.csv")
    assert done.returncode == 0, done.stderr
    assert "heading" in done.stdout
    assert run(tmp_path, "--replay", "r.log", "--output", "replay.csv").returncode == 0
    live_csv = (tmp_path / "live.csv").read_bytes()
    assert live_csv.count(b"\n") > 60
    assert live_csv == (tmp_path / "replay.csv").read_bytes()
    truth = np.genfromtxt(tmp_path / "r.truth.csv", delimiter=",", names=True)
    rows = read_heading_csv(tmp_path / "live.csv")
    headings = dict(zip(np.round(truth["t_s"], 1), truth["heading_deg"], strict=True))
    late = [row for row in rows if row["t_s"] > 3 and round(float(row["t_s"]), 1) in headings]
    errors = [(row["heading_deg"] - headings[round(float(row["t_s"]), 1)] + 180) % 360 - 180 for row in late]
    assert np.sqrt(np.mean(np.square(errors))) < 15  # the paper's method, as it is: see docs/fusion.md


def test_killed_worker_is_told_of_restarted_and_replayed(tmp_path: Path) -> None:
    with live(tmp_path, "--record", "r.log", "--output", "live.csv", "--duration", "14") as process:
        wait_for(lambda: seconds_recorded(tmp_path / "r.log") > 2)
        workers = {pid: line for pid, line in children_of(process.pid).items() if "acquisition.worker" in line}
        assert len(workers) == 5
        victim = next(pid for pid, line in workers.items() if '"gps2"' in line)
        os.kill(victim, signal.SIGKILL)
        wait_for(lambda: said(tmp_path, rf"gps2: worker {victim} died; restart in 0\.5 s"))
        wait_for(lambda: b"restart gps2" in (tmp_path / "r.log").read_bytes())
        assert process.wait(30) == 0
    recording = (tmp_path / "r.log").read_text()
    after = recording.partition("restart gps2")[2]
    assert after.count(" gps2 $") > 50
    rows = read_heading_csv(tmp_path / "live.csv")
    assert not np.isnan(rows["heading_deg"][10:]).any()
    assert set(rows["mode"][-20:]) == {"ok"}
    assert run(tmp_path, "--replay", "r.log", "--output", "replay.csv").returncode == 0
    assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "replay.csv").read_bytes()


def test_stall_of_the_program_replays_as_it_was(tmp_path: Path) -> None:
    with live(tmp_path, "--record", "r.log", "--output", "live.csv") as process:
        wait_for(lambda: seconds_recorded(tmp_path / "r.log") > 2)
        os.kill(process.pid, signal.SIGSTOP)
        goes_on_at = time.monotonic() + 3
        wait_for(lambda: time.monotonic() > goes_on_at)
        os.kill(process.pid, signal.SIGCONT)
        wait_for(lambda: seconds_recorded(tmp_path / "r.log") > 7)
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    assert run(tmp_path, "--replay", "r.log", "--output", "replay.csv").returncode == 0
    assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "replay.csv").read_bytes()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=str)
def test_signal_ends_everything_and_keeps_the_files(tmp_path: Path, number: signal.Signals) -> None:
    with live(tmp_path, "--record", "r.log", "--output", "live.csv") as process:
        wait_for(lambda: seconds_recorded(tmp_path / "r.log") > 1)
        children = children_of(process.pid)
        assert len(children) == 6  # five workers and the simulator
        process.send_signal(number)
        assert process.wait(10) == 0
    for pid in children:
        assert not Path(f"/proc/{pid}").exists()
    assert (tmp_path / "r.log").read_bytes().endswith(b"\n")
    assert run(tmp_path, "--replay", "r.log", "--output", "replay.csv").returncode == 0
    assert (tmp_path / "live.csv").read_bytes() == (tmp_path / "replay.csv").read_bytes()


def test_absent_devices_are_told_of_and_the_rest_goes_on(tmp_path: Path) -> None:
    simulator = subprocess.Popen(
        [sys.executable, "-m", "acquisition.simulator", "--ptys", "--links", "."],
        cwd=tmp_path, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert simulator.stdout is not None
    assert simulator.stdout.readline()
    try:
        (tmp_path / "boat.toml").write_text(
            "vessel.variation_deg = -8.0\n"
            f'sensors.gps1.port = "{tmp_path}/fjGPS1"\n'
            f'sensors.gps2.port = "{tmp_path}/nothing"\n'
            f'sensors.gps3.port = "{tmp_path}/fjGPS3"\n'
            f'sensors.compass.port = "{tmp_path}/fjEC"\n'
            f'sensors.imu.port = "{tmp_path}/fjIMU"\n'
        )
        done = run(tmp_path, "--config", "boat.toml", "--duration", "5", "--output", "live.csv")
    finally:
        simulator.terminate()
        simulator.wait()
    assert done.returncode == 0, done.stderr
    assert re.search(r"gps2: absent: .*nothing", done.stderr)
    rows = read_heading_csv(tmp_path / "live.csv")
    assert set(rows["mode"][-10:]) == {"degraded"}
    assert not np.isnan(rows["heading_deg"][-10:]).any()


def test_chosen_pace_is_kept_and_gives_the_same_rows(tmp_path: Path) -> None:
    simulate = [sys.executable, "-m", "acquisition.simulator", "rec.log", "truth.csv", "--duration", "10"]
    subprocess.run(simulate, cwd=tmp_path, check=True)
    began = time.monotonic()
    assert run(tmp_path, "--replay", "rec.log", "--speed", "5", "--output", "paced.csv").returncode == 0
    assert time.monotonic() - began > 1.9
    assert run(tmp_path, "--replay", "rec.log", "--output", "fast.csv").returncode == 0
    assert (tmp_path / "paced.csv").read_bytes() == (tmp_path / "fast.csv").read_bytes()


def test_compressed_recording_replays_as_it_is(tmp_path: Path) -> None:
    simulate = [sys.executable, "-m", "acquisition.simulator", "rec.log", "truth.csv", "--duration", "10"]
    subprocess.run(simulate, cwd=tmp_path, check=True)
    subprocess.run(["gzip", "-k", "rec.log"], cwd=tmp_path, check=True)
    for name in ("rec.log", "rec.log.gz"):
        assert run(tmp_path, "--replay", name, "--output", f"{name}.csv").returncode == 0
    assert (tmp_path / "rec.log.csv").read_bytes() == (tmp_path / "rec.log.gz.csv").read_bytes()


@pytest.mark.parametrize("pace", [[], ["--speed", "1000"]])
def test_switch_of_an_unknown_task_is_damage_like_any_other(tmp_path: Path, pace: list[str]) -> None:
    heading = "$HCHDT,1.0,T*28"
    (tmp_path / "r.log").write_text(
        f"#tinyekf-recording 1\n0.000000 compass {heading}\n#event 0.5 stop ekf99\n1.000000 compass {heading}\n"
    )
    done = run(tmp_path, "--replay", "r.log", *pace, "--output", "x.csv")
    assert done.returncode == 0, done.stderr
    assert "dropped 1 unknown task" in done.stderr
    assert len(read_heading_csv(tmp_path / "x.csv")) == 10


def test_printed_configuration_is_a_configuration(tmp_path: Path) -> None:
    printed = run(tmp_path, "--print-config")
    assert printed.returncode == 0
    (tmp_path / "tinyekf.toml").write_text(printed.stdout)
    again = run(tmp_path, "--config", "tinyekf.toml", "--print-config")
    assert again.stdout == printed.stdout


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--config", "none.toml"], "cannot read configuration none.toml: No such file or directory"),
        (["--config", "typo.toml"], r"typo.toml: .*fusion.metod.*fusion.method"),
        (["--config", "broken.toml"], "broken.toml is not TOML"),
        (["--simulate", "--method", "cnw4"], "cnw4.*(cnw3|cnw-ekf)"),
        (["--simulate", "--scenario", "nowhere"], "nowhere"),
        (["--replay", "none.log", "--output", "x.csv"], "none.log: No such file or directory"),
        (["--replay", "typo.toml", "--output", "x.csv"], "typo.toml is not a recording"),
        (["--replay", "typo.toml"], "--output"),
        (["--replay", "none.log"], "cannot read recording none.log: No such file or directory"),
        (["--replay", "good.log", "--output", "no/folder.csv"], "no/folder.csv: No such file"),
        (["--simulate", "--replay", "good.log"], "--replay goes with neither"),
        (["--duration", "-3", "--simulate"], "seconds above 0"),
        (["--sumulate"], "--sumulate"),
        (["--replay", "good.log", "--speed", "1e-300"], "at least 0.001"),
        (["--simulate", "--record", "no/folder.log"], "no/folder.log: No such file"),
        (["--simulate", "--record", "/"], "cannot record to /: Is a directory"),
        (["--replay", "good.log", "--output", "./good.log"], "good.log would overwrite the recording"),
        (["--simulate", "--record", "x.log", "--output", "x.log"], "cannot be one file, x.log"),
        (["--replay", "good.log", "--output", "x.csv", "--duration", "3"], "--duration goes with"),
        (["--replay", "good.log", "./good.log", "--output", "x.csv"], "good.log is named twice"),
        (["--simulate", "--record", "dear.log"], "would overwrite dear.truth.csv"),
        (["--simulate", "--web", "99999"], "outputs.web.port = 99999 must be a whole number from 1 to 65535"),
        (["--simulate", "--web", "0"], "outputs.web.port = 0 must be a whole number from 1 to 65535"),
        (["--simulate", "--signalk", "0"], "outputs.signalk.port = 0 serves nobody .* from 1 to 65535"),
        (["--simulate", "--signalk", "-1"], "outputs.signalk.port = -1 must be a whole number from 0 to 65535"),
        (["--replay", "good.log", "--speed", "1", "--nmea-tcp", "0"], "outputs.nmea_tcp.port = 0"),
        (["--replay", "good.log", "--output", "x.csv", "--signalk"], "--signalk go with a live run"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_mistakes_get_one_line_and_status_2(tmp_path: Path, options: list[str], complaint: str) -> None:
    (tmp_path / "typo.toml").write_text('[fusion]\nmetod = "cnw3"\n')
    (tmp_path / "broken.toml").write_text("[fusion\n")
    (tmp_path / "dear.truth.csv").write_text("t_s,heading_deg\n")
    (tmp_path / "good.log").write_text("#tinyekf-recording 1\n0.000000 compass $HCHDT,1.0,T*2A\n")
    done = run(tmp_path, *options)
    assert done.returncode == 2
    lines = [line for line in done.stderr.splitlines() if " INFO " not in line]
    assert len(lines) == 1, done.stderr
    assert re.search(complaint, lines[0]), lines[0]
    assert (tmp_path / "good.log").read_text().startswith("#tinyekf-recording")


def test_console_script_names_the_nearest_command(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-m", "tinyekf_py.cli", "rnu"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == "tinyekf: no command 'rnu'; did you mean run?\n"
