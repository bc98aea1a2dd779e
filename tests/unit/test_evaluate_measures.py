"""Measures against closed forms, and the truth they are taken against."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tinyekf_py.evaluate.measures import Measures, correlation_time_s, measure, pool
from tinyekf_py.evaluate.outcome import Outcome
from tinyekf_py.evaluate.truth import Floats, Truth, TruthError, read_truth, wrap_deg

ROWS_S = np.arange(0, 6000) * 0.1


def truth_of(heading_deg: Floats, t_s: Floats = ROWS_S) -> Truth:
    return Truth(t_s, heading_deg % 360.0, np.full(len(t_s), np.nan), np.full(len(t_s), np.nan))


def outcome_of(heading_deg: Floats, sigma_deg: float = np.nan) -> Outcome:
    return Outcome("some", ROWS_S[: len(heading_deg)], heading_deg % 360.0, np.full(len(heading_deg), sigma_deg), 0.5)


def test_errors_across_north_are_small() -> None:
    heading = 359.9 + 0.001 * np.arange(6000)
    measures = measure(outcome_of(heading + 0.3), truth_of(heading))
    assert measures.rmse_deg == pytest.approx(0.3)
    assert measures.bias_deg == pytest.approx(0.3)
    assert measures.max_deg == pytest.approx(0.3)
    assert measures.step_deg == pytest.approx(0.0, abs=1e-9)


def test_an_honest_sigma_is_found_honest() -> None:
    errors = np.random.default_rng(1).normal(0.0, 2.0, 6000)
    measures = measure(outcome_of(90.0 + errors, 2.0), truth_of(np.full(6000, 90.0)))
    assert measures.within_2_sigma == pytest.approx(0.9545, abs=0.01)
    assert measures.nees == pytest.approx(1.0, abs=0.05)
    assert measures.p95_deg == pytest.approx(2.0 * 1.96, abs=0.1)


def test_availability_counts_from_the_first_fix_and_errors_from_the_end_of_the_skipped_time() -> None:
    heading = np.full(6000, 50.0)
    heading[:200] = np.nan  # before the fix at 20 s
    heading[200:300] = 60.0  # skipped
    heading[600:1176] = np.nan
    measures = measure(outcome_of(heading), truth_of(np.full(6000, 50.0)), skip_s=30.0, first_fix_s=20.0)
    assert measures.rmse_deg == 0.0
    assert measures.availability == pytest.approx(1.0 - 576 / 5700)
    late = measure(outcome_of(heading), truth_of(np.full(6000, 50.0)), skip_s=0.0, first_fix_s=19.95)
    assert late.availability == pytest.approx(1.0 - 576 / 5800)


def test_a_step_that_the_boat_made_is_none() -> None:
    heading = np.where(np.arange(6000) < 3000, 10.0, 40.0)
    assert measure(outcome_of(heading), truth_of(heading)).step_deg == 0.0
    assert measure(outcome_of(heading), truth_of(np.full(6000, 10.0))).step_deg == pytest.approx(30.0)


def test_a_method_without_headings_has_no_errors() -> None:
    measures = measure(outcome_of(np.full(6000, np.nan)), truth_of(np.full(6000, 10.0)))
    assert measures.rows == 0
    assert np.isnan(measures.rmse_deg)
    assert measures.availability == 0.0


@pytest.mark.parametrize("time_s", [1.0, 5.0, 20.0])
def test_correlation_time_of_a_gauss_markov_error(time_s: float) -> None:
    rng = np.random.default_rng(3)
    keep = np.exp(-0.1 / time_s)
    errors = np.zeros(200_000)
    kicks = rng.normal(0.0, np.sqrt(1.0 - keep**2), len(errors))
    for i in range(1, len(errors)):
        errors[i] = keep * errors[i - 1] + kicks[i]
    errors[1000:3000] = np.nan
    assert correlation_time_s(errors, 0.1) == pytest.approx(time_s, rel=0.2)


def test_a_constant_error_has_no_correlation_time() -> None:
    assert np.isnan(correlation_time_s(np.full(1000, 0.3), 0.1))


@given(st.lists(st.integers(30, 400), min_size=2, max_size=4), st.integers(0, 2**32 - 1))
def test_pooled_runs_are_as_one_long_run(lengths: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    errors = [rng.normal(rng.normal(), 2.0, 10 * length) for length in lengths]

    def judged(run: Floats) -> Measures:
        return measure(outcome_of(10.0 + run, 2.0), truth_of(np.full(len(run), 10.0), ROWS_S[: len(run)]))

    pooled = pool([judged(run) for run in errors])
    everything = np.concatenate(errors)
    assert pooled.rmse_deg == pytest.approx(np.sqrt(np.mean(everything**2)))
    assert pooled.bias_deg == pytest.approx(np.mean(everything))
    assert pooled.max_deg == pytest.approx(np.max(np.abs(everything)))
    assert pooled.within_2_sigma == pytest.approx(np.mean(np.abs(everything) <= 4.0))
    assert pooled.worst_rmse_deg == pytest.approx(max(np.sqrt(np.mean(run**2)) for run in errors))


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_deg(np.array([angle]))[0])
    assert -180.0 < wrapped <= 180.0
    assert np.isclose(np.cos(np.radians(wrapped - angle)), 1.0)


def test_truth_is_interpolated_across_north_and_not_across_gaps(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("t_s,heading_deg\n0.0,359.0\n0.5,1.0\n3.0,5.0\n3.1,6.0\n")
    headings = read_truth(path, offset_deg=10.0).heading_at(np.array([-0.1, 0.25, 1.0, 3.05, 3.2]))
    assert headings[[1, 3]] == pytest.approx([10.0, 15.5])
    assert np.isnan(headings[[0, 2, 4]]).all()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("heading,t\n", "first line"),
        ("t_s,heading_deg\n0.0,1.0\n0.1,x\n", "line 3"),
        ("t_s,heading_deg\n0.0,1.0,2.0\n", "line 2"),
        ("t_s,heading_deg\n1.0,1.0\n0.5,2.0\n", "rise"),
    ],
)
def test_a_bad_truth_is_named(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(TruthError, match=said):
        read_truth(path)
