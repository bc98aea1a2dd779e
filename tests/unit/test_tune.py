"""Tuning finds the noise that was put in."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from acquisition.simulator.command import main as simulate
from tinyekf_py.config import load_config
from tinyekf_py.tune import Floats, Noise, likelihood, main, tuned


def drive(noise: Noise, epochs: int, seed: int) -> Floats:
    """Epochs of the papers' very model under `noise`, 0.1 s apart."""
    rng = np.random.default_rng(seed)
    degree = math.radians(1.0)
    north = east = psi = 0.0
    rows = []
    for k in range(epochs):
        rate = 0.05 * math.sin(k / 40.0)
        north, east = north + 0.3 * math.cos(psi), east + 0.3 * math.sin(psi)
        psi += 0.1 * rate
        north, east, psi = (
            value + rng.normal(0.0, math.sqrt(0.1 * q)) * unit
            for value, q, unit in zip((north, east, psi), noise.q, (1.0, 1.0, degree), strict=True)
        )
        seen = [
            value + rng.normal(0.0, math.sqrt(r)) * unit
            for value, r, unit in zip((north, east, psi), noise.r, (1.0, 1.0, degree), strict=True)
        ]
        rows.append([0.1 if k else 0.0, 3.0, rate, *seen])
    return np.array(rows)


def test_the_noise_of_the_model_itself_is_found() -> None:
    true = Noise((0.02, 0.02, 2.0), (0.01, 0.01, 9.0))
    found = tuned([drive(true, 1500, 1)])
    for name in ("q", "r"):
        for value, wanted in zip(getattr(found, name), getattr(true, name), strict=True):
            assert wanted / 1.7 < value < wanted * 1.7
    judged = likelihood([drive(true, 1500, 2)], found)
    assert judged.nis == pytest.approx(1.0, abs=0.1)
    assert judged.heading_nis == pytest.approx(1.0, abs=0.15)
    assert judged.log_likelihood > likelihood([drive(true, 1500, 2)], Noise()).log_likelihood


def test_held_out_data_is_likelier_after_tuning_and_the_result_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, config = tmp_path / "harbour.rec", tmp_path / "tinyekf.toml"
    arguments = [str(recording), str(tmp_path / "truth.csv"), "--scenario", "harbour", "--duration", "120"]
    assert simulate(arguments) == 0
    assert main([str(recording), "--write", str(config)]) == 0
    before, after = (
        line.split("|") for line in capsys.readouterr().out.splitlines() if "before" in line or "after" in line
    )
    assert float(after[4]) > float(before[4])
    fusion = load_config(config).fusion
    assert fusion.r[2] > 1.0  # forward azimuth over 100 ms is far noisier than the papers' R says


def test_too_short_a_recording_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = tmp_path / "short.rec"
    assert simulate([str(recording), str(tmp_path / "truth.csv"), "--duration", "5"]) == 0
    assert main([str(recording)]) == 1
    assert "fewer than 300" in capsys.readouterr().err
