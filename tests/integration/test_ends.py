"""How the commands end when the disk is full, when Ctrl-C comes early, and when nobody reads what they print."""

from __future__ import annotations

import os
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

TINYEKF = [sys.executable, "-m", "tinyekf_py.cli"]


def tinyekf(folder: Path, *options: str, largest_file: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command; no file that it writes gets larger than `largest_file` bytes: a full disk for everybody."""

    def limit() -> None:
        if largest_file is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

    return subprocess.run(
        [*TINYEKF, *options], cwd=folder, capture_output=True, text=True, timeout=60, preexec_fn=limit
    )


@pytest.mark.parametrize(("option", "name", "least"), [("--record", "r.log", 500), ("--output", "h.csv", 30)])
def test_a_run_that_could_not_write_its_file_to_the_end_has_failed(
    tmp_path: Path, option: str, name: str, least: int
) -> None:
    os.mkfifo(tmp_path / name)  # whose reader goes away: it takes no more, as a disk that stays full
    reader = os.open(tmp_path / name, os.O_RDONLY | os.O_NONBLOCK)
    command = [*TINYEKF, "run", "--simulate", "--duration", "5", option, name]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert select.select([reader], [], [], 20)[0]
    os.close(reader)
    _, complaints = process.communicate(timeout=30)
    assert process.returncode == 1
    said = re.findall(rf"^tinyekf run: {name}: (\d+) lines are missing, to the end: Broken pipe$", complaints, re.M)
    assert len(said) == 1, complaints
    assert int(said[0]) >= least


def test_a_simulation_that_finds_no_room_says_so_once(tmp_path: Path) -> None:
    done = tinyekf(tmp_path, "simulate", "r.log", "truth.csv", "--duration", "120", largest_file=100_000)
    assert done.returncode == 1
    assert re.fullmatch(r"tinyekf simulate: r.log: \d+ lines are missing(, to the end: File too large)?\n", done.stderr)
    done = tinyekf(tmp_path, "simulate", "/dev/null", "truth.csv", "--duration", "120", largest_file=30_000)
    assert done.returncode == 1
    assert done.stderr == "tinyekf simulate: cannot write the truth to truth.csv: File too large\n"


def heed_ctrl_c() -> None:
    """A shell lets what it runs in the background ignore Ctrl-C, and so the tests and their children."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.fixture(scope="module")
def python_start_s() -> float:
    """How long Python takes here, now, until it runs our first line, generously."""
    began_s = time.monotonic()
    subprocess.run([*TINYEKF, "--version"], check=True, stdout=subprocess.DEVNULL)
    return 2.0 * (time.monotonic() - began_s)


@pytest.mark.parametrize("after_s", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8])
def test_ctrl_c_at_the_beginning_leaves_nothing_in_the_way(
    tmp_path: Path, python_start_s: float, after_s: float
) -> None:
    options = ("run", "--simulate", "--record", "r.log", "--output", "h.csv")
    process = subprocess.Popen(
        [*TINYEKF, *options],
        cwd=tmp_path,
        env={**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=heed_ctrl_c,
    )
    try:
        time.sleep(after_s)  # the moment is what is tested
        os.killpg(process.pid, signal.SIGINT)
        _, complaints = process.communicate(timeout=20)
    finally:
        process.kill()
    lines = [line for line in complaints.decode().splitlines() if " INFO " not in line]
    if process.returncode not in (0, 130):  # Python itself was not yet there
        assert after_s < python_start_s
        assert process.returncode in (1, -signal.SIGINT)
    else:
        assert lines == []
    again = tinyekf(tmp_path, *options, "--duration", "1")
    assert again.returncode == 0, again.stderr


@pytest.mark.parametrize(
    "words",
    ["--help", "run --print-config", "run --help", "simulate --list", "devices check", "devices list", "--version"],
)
def test_a_reader_that_has_had_enough_is_no_fault(tmp_path: Path, words: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([*TINYEKF, *words.split()], cwd=tmp_path, stdout=writing, stderr=subprocess.PIPE, timeout=30)
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, b"")


def test_output_that_cannot_be_had_at_all_is_no_fault(tmp_path: Path) -> None:
    assert shutil.which("sh")
    command = f'exec "{sys.executable}" -m tinyekf_py.cli simulate --list >&-'
    done = subprocess.run(["sh", "-c", command], cwd=tmp_path, stderr=subprocess.PIPE, timeout=30)
    assert (done.returncode, done.stderr) == (0, b"")


def test_the_version_is_that_of_the_package(tmp_path: Path) -> None:
    done = tinyekf(tmp_path, "--version")
    assert re.fullmatch(r"tinyekf \d+\.\d+\.\d+\n", done.stdout)
