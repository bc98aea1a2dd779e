"""Recordings of real sensors, by others, through every method: no NaN, no gap while a source is alive, no drama."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tinyekf_py.replay import replay

METHODS = ("cnw-ekf", "cnw3", "ekf-ci", "adaptive")


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


def test_adaptive_is_near_the_cars_truth(recordings: Path) -> None:
    folder = recordings / "comma2k19"
    rows = replay(folder / "comma.log", method="adaptive")
    truth = np.genfromtxt(folder / "comma.truth.csv", delimiter=",", names=True)
    judged = rows[(rows["t_s"] > 20.0) & (rows["t_s"] <= truth["t_s"][-1])]
    there = np.interp(judged["t_s"], truth["t_s"], truth["heading_deg"]) + 0.90  # the truth's own mount
    error = wrapped(judged["heading_deg"] - there)
    assert np.sqrt(np.mean(np.square(error))) < 0.35


def test_adaptive_follows_a_catamaran_without_jumps_and_is_less_sure_in_her_tacks(recordings: Path) -> None:
    rows = replay(recordings / "alinghi" / "alinghi.log", method="adaptive")[20:]
    heading, sigma = rows["heading_deg"], rows["heading_sigma_deg"]
    assert np.max(np.abs(wrapped(np.diff(heading)))) < 6.0
    turned = np.abs(wrapped(heading[50:] - heading[:-50])) / 5.0  # degrees a second, over 5 s
    middle = sigma[25:-25]
    assert np.mean(middle[turned > 5.0]) > 1.15 * np.mean(middle[turned < 1.0])
