"""The C core against the papers' post-processing in the MATLAB language: golden outputs, to 1e-9 (see `agreement`).

Remake the goldens with `tests/reference/make_goldens.sh`. Where Octave is installed this is done here too, into a
temporary folder, and compared with what is committed.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from agreement import GOLDEN, RUNS, function_differences, golden, golden_name, stream_differences
from cases import FUNCTIONS
from streams import Stream
from ten_minutes import checksum

TOLERANCE = 1e-9

#: Omega is where the derivative of log det C (or of tr C) vanishes, and between covariances that are nearly alike this
#: derivative is nearly flat: rounding of 1e-16 moves its zero by 1e-16 / slope. What is fused does not feel it.
TOLERANCES = {"covariance_intersection omega": 1e-6}

#: The reference on another machine: sin, cos and BLAS differ in the last digit, and steps of 1e-7 degrees magnify that.
REMADE_TOLERANCE = 1e-10


@pytest.mark.parametrize("name", FUNCTIONS)
def test_core_agrees_with_the_reference(name: str) -> None:
    differences = function_differences(name)
    assert {what: value for what, value in differences.items() if value > TOLERANCES.get(what, TOLERANCE)} == {}


@pytest.mark.parametrize(("stream", "method"), RUNS, ids=[f"{stream.name}-{method}" for stream, method in RUNS])
def test_fusion_agrees_with_the_reference(stream: Stream, method: str) -> None:
    differences = stream_differences(stream, method)
    assert {column: value for column, value in differences.items() if value > TOLERANCE} == {}


def test_ten_minutes_are_those_of_the_golden() -> None:
    committed = (GOLDEN / "ten_minutes.sha256").read_text(encoding="ascii").strip()
    assert checksum() == committed, "the simulator or a decoder has changed: run tests/reference/make_goldens.sh"


def test_goldens_are_what_octave_makes(tmp_path: Path) -> None:
    if shutil.which("octave-cli") is None:
        why = "octave-cli is not installed (Debian: apt install octave)"
        if os.environ.get("CI"):
            pytest.fail(why)
        pytest.skip(why)
    script = Path(__file__).resolve().parent / "make_goldens.sh"
    environment = {**os.environ, "PYTHON": sys.executable}
    done = subprocess.run([script, tmp_path], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    names = {*FUNCTIONS, *(golden_name(stream, method) for stream, method in RUNS)}
    assert {path.name for path in GOLDEN.glob("*.gz")} == {f"{name}.csv.gz" for name in names}
    for name in sorted(names):
        remade, committed = golden(name, tmp_path), golden(name)
        assert remade.names == committed.names, name
        np.testing.assert_allclose(
            remade.rows, committed.rows, rtol=REMADE_TOLERANCE, atol=REMADE_TOLERANCE, err_msg=name
        )
