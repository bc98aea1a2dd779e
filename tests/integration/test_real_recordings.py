"""Recordings of real sensors, by others, through every method: no NaN, no gap while a source is alive, no drama."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tinyekf_py.replay import replay

METHODS = ("cnw-ekf", "cnw3", "ekf-ci")


def wrapped(degrees: np.ndarray) -> np.ndarray:
    return (degrees + 180) % 360 - 180


@pytest.mark.parametrize("method", METHODS)
def test_racing_catamaran_has_a_heading_throughout(recordings: Path, method: str) -> None:
    rows = replay(recordings / "alinghi" / "alinghi.log", method=method)
    assert len(rows) > 11_000
    assert np.allclose(np.diff(rows["t_s"]), 0.1)
    sure = rows[20:]
    assert set(sure["mode"]) == {"degraded"}  # no IMU, one GPS of three
    assert not np.isnan(sure["heading_deg"]).any()
    assert not np.isnan(sure["lat_deg"]).any()


@pytest.mark.parametrize("method", METHODS)
def test_car_has_a_heading_throughout_and_near_the_truth(recordings: Path, method: str) -> None:
    folder = recordings / "comma2k19"
    rows = replay(folder / "comma.log", method=method)
    truth = np.genfromtxt(folder / "comma.truth.csv", delimiter=",", names=True)
    sure = rows[20:]
    assert not np.isnan(sure["heading_deg"]).any()
    assert set(sure["mode"]) == {"degraded"}  # no compass, one GPS of three
    error = wrapped(sure["heading_deg"] - np.interp(sure["t_s"], truth["t_s"], truth["heading_deg"]))
    assert np.sqrt(np.mean(np.square(error))) < 3.0
