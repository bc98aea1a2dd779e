"""The compass' firmware on a simulated Arduino Uno with a simulated CMPS11, heard by the program's own decoder."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from acquisition.compass import CompassDecoder
from acquisition.sample import CompassSample

SCRIPT = Path(__file__).resolve().parents[2] / "toolchain" / "compass-firmware" / "build.sh"
PERIOD_S = 0.1

pytestmark = pytest.mark.skipif(
    shutil.which("avr-g++") is None and os.environ.get("CI") != "true",
    reason="needs gcc-avr avr-libc arduino-core-avr libsimavr-dev libelf-dev",
)


class Heard(NamedTuple):
    """What came over the serial line, and what the decoder makes of it."""

    lines: list[tuple[float, bytes]]
    samples: list[CompassSample]
    refused: int


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("firmware")
    subprocess.run([SCRIPT, "--output", folder, "--simulator"], check=True)
    return folder


def run(board: Path, scenario: Sequence[str]) -> Heard:
    """Plays the events of `scenario` (see simulated_board.c) to the firmware."""
    command = [board / "simulated-board", board / "compass.elf"]
    done = subprocess.run(command, input="\n".join(scenario) + "\n", capture_output=True, text=True, check=True)
    decoder = CompassDecoder()
    lines, samples = [], []
    for row in done.stdout.splitlines():
        if not row.startswith("#"):
            stamp, _, line = row.split(" ", 2)
            lines.append((float(stamp), line.encode()))
            samples += decoder.decode(round(float(stamp) * 1e6), line.encode())
    return Heard(lines, samples, sum(decoder.counts[reason] for reason in ("checksum", "malformed", "foreign")))


def test_every_bearing_pitch_and_roll_arrives_as_the_compass_has_it(board: Path) -> None:
    bearings = [*range(0, 3600, 37), 9, 10, 99, 100, 255, 256, 999, 1000, 2559, 2560, 3599]
    attitudes = [(k * 7 % 181 - 90, k * 11 % 181 - 90) for k in range(len(bearings))]
    scenario = [
        f"{max(0.0, PERIOD_S * (k - 0.5)):.3f} ok {bearing} {pitch} {roll}"
        for k, (bearing, (pitch, roll)) in enumerate(zip(bearings, attitudes, strict=True))
    ]
    heard = run(board, [*scenario, f"{PERIOD_S * (len(bearings) - 0.5):.3f} end"])
    assert heard.refused == 0
    assert [sample.heading_deg for sample in heard.samples] == [bearing / 10 for bearing in bearings]
    with_next_heading = [(sample.pitch_deg, sample.roll_deg) for sample in heard.samples[1:]]
    assert with_next_heading == attitudes[:-1]


def test_a_heading_comes_ten_times_a_second_within_twenty_milliseconds_of_its_reading(board: Path) -> None:
    heard = run(board, ["0 ok 3599 -90 -90", "10.05 end"])
    assert len(heard.samples) == 101
    for k, sample in enumerate(heard.samples):
        assert sample.t_us == pytest.approx(100_000 * k + 22_000, abs=2_000)  # of which 20 ms are the sentence


@pytest.mark.parametrize("loss", ["unplugged", "floating"])
def test_a_lost_compass_says_no_heading_and_comes_back(board: Path, loss: str) -> None:
    heard = run(board, ["0 ok 1234 -5 17", f"1.05 {loss}", "3.05 ok 2345 6 -7", "4.05 end"])
    assert heard.refused == 0
    headings = [sample.heading_deg for sample in heard.samples]
    assert len(headings) == 41
    assert headings[:11] == [123.4] * 11
    assert all(math.isnan(heading) for heading in headings[11:31])
    assert headings[31:] == [234.5] * 10
    assert not any(b"XDR" in line for t_s, line in heard.lines if 1.15 < t_s < 3.05)


def test_a_compass_that_holds_the_bus_is_clocked_free(board: Path) -> None:
    heard = run(board, ["0 ok 1234 -5 17", "1.05 stuck 2345 6 -7", "2.05 end"])
    headings = [sample.heading_deg for sample in heard.samples]
    assert headings[:11] == [123.4] * 11
    assert math.isnan(headings[11])
    assert headings[12:] == [234.5] * 9


def test_the_watchdog_restarts_a_hung_program(board: Path) -> None:
    heard = run(board, ["0 ok 1234 -5 17", "1.05 hang 2345 6 -7", "4.05 end"])
    silent = [t_s for t_s, line in heard.lines if 1.1 < t_s < 1.9]
    assert silent == []
    after = [sample for sample in heard.samples if sample.t_us > 1_900_000]
    assert after[0].t_us < 2_300_000
    assert {sample.heading_deg for sample in after} == {234.5}


@pytest.mark.parametrize(
    ("arguments", "path", "status", "says"),
    [
        (["--nonsense"], None, 2, "unknown argument --nonsense"),
        (["--output"], None, 2, "--output needs a value"),
        (["--flash", "/dev/no-such-port"], None, 1, "no port /dev/no-such-port"),
        (["--output", "/dev/null/build"], None, 1, "cannot make the folder /dev/null/build"),
        ([], "/bin-without-avr", 1, "avr-g++ is missing; install it with: apt-get install gcc-avr"),
    ],
)
def test_the_build_refuses_in_one_line(arguments: list[str], path: str | None, status: int, says: str) -> None:
    bash = shutil.which("bash")
    assert bash is not None
    environment = {**os.environ, **({"PATH": path} if path else {})}
    done = subprocess.run([bash, SCRIPT, *arguments], capture_output=True, text=True, env=environment)
    assert done.returncode == status
    assert says in done.stderr
    assert done.stderr.count("\n") == 1


def test_the_build_has_help() -> None:
    done = subprocess.run([SCRIPT, "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("Usage: build.sh")
