"""A short run of every fuzzer from its seeds; docs/fuzzing.md says how to run them for longer."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

CORPUS = Path(__file__).resolve().parent / "corpus"
SECONDS = 2


def lacking(what: str) -> None:
    if os.environ.get("CI"):
        pytest.fail(f"{what} is not installed")
    pytest.skip(f"{what} is not installed")


def fuzz(tmp_path: Path, command: list[str], target: str) -> None:
    """Run a fuzzer for a moment; what it finds is a failure that shows the input."""
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    options = [f"-max_total_time={SECONDS}", "-max_len=2000", f"-artifact_prefix={tmp_path}/", str(corpus)]
    done = subprocess.run([*command, *options, str(CORPUS / target)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]


@pytest.mark.parametrize("target", ["gps", "compass", "imu", "imu-hex", "recording"])
def test_no_bytes_break_a_decoder_or_the_reader(tmp_path: Path, target: str) -> None:
    if find_spec("atheris") is None:
        lacking("atheris")
    fuzz(tmp_path, [sys.executable, str(Path(__file__).with_name("fuzz_decoders.py")), target], target)


def test_no_samples_break_the_core(tmp_path: Path) -> None:
    if shutil.which("clang") is None:
        lacking("clang")
    program = tmp_path / "fusion"
    subprocess.run(["sh", Path(__file__).with_name("build_fuzz_fusion.sh"), program], check=True, timeout=300)
    fuzz(tmp_path, [str(program)], "core")
