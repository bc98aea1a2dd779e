"""What is evaluated: the fusion as a replay runs it, single sensors by their closed form, peers by each other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acquisition.simulator.grades import GRADES, CompassGrade, GpsGrade, Grade, ImuGrade
from acquisition.simulator.recorder import record
from acquisition.simulator.scenarios import SCENARIOS
from acquisition.simulator.voyage import Voyage
from tinyekf_py.config import Config, apply_flat
from tinyekf_py.evaluate.decoded import Decoded, decode
from tinyekf_py.evaluate.measures import errors_of, measure
from tinyekf_py.evaluate.methods import MethodError, check_methods, run_method
from tinyekf_py.evaluate.truth import Truth, read_truth
from tinyekf_py.replay import replay

STEADY_COMPASS = CompassGrade(
    deviation_deg=(2.0, 2.0, 2.0, 1.0, 1.0),
    lag_s=0.001,
    latency_s=0.0,
    jitter_s=0.0,
    white_deg=0.0,
    slow_deg=0.0,
    tilt_deg=0.0,
)

Sail = Callable[..., tuple[Path, Path]]


@pytest.fixture(scope="module")
def sail(tmp_path_factory: pytest.TempPathFactory) -> Sail:
    def run(name: str, duration_s: float, grade: Grade = GRADES["typical"], **changes: object) -> tuple[Path, Path]:
        folder = tmp_path_factory.mktemp("voyage")
        scenario = replace(SCENARIOS[name], **changes)  # type: ignore[arg-type]
        record(Voyage(scenario, grade), folder / "voyage.rec", folder / "voyage.truth.csv", duration_s)
        return folder / "voyage.rec", folder / "voyage.truth.csv"

    return run


@pytest.fixture(scope="module")
def tour(sail: Sail) -> tuple[Path, Decoded, Truth]:
    recording, truth = sail("tour", 120.0)
    return recording, decode(recording), read_truth(truth)


@pytest.mark.parametrize("method", ["cnw3", "ekf-ci"])
def test_the_fusion_is_judged_on_the_rows_of_a_replay(tour: tuple[Path, Decoded, Truth], method: str) -> None:
    recording, decoded, _ = tour
    rows, outcome = replay(recording, method=method), run_method(decoded, method)
    for column, values in (("t_s", outcome.t_s), ("heading_deg", outcome.heading_deg), ("w2", outcome.weights[:, 1])):
        np.testing.assert_array_equal(rows[column], values)
    np.testing.assert_allclose(decoded.rows_s, rows["t_s"], atol=1e-9)


def test_events_of_a_recording_are_obeyed(tour: tuple[Path, Decoded, Truth], tmp_path: Path) -> None:
    lines = tour[0].read_bytes().splitlines(keepends=True)
    at = next(i for i, line in enumerate(lines) if line.startswith(b"60."))
    stopped = tmp_path / "stopped.rec"
    stopped.write_bytes(b"".join([*lines[:at], b"#event 60.000000 stop compass\n", *lines[at:]]))
    outcome = run_method(decode(stopped), "compass")
    assert np.isfinite(outcome.heading_deg[(outcome.t_s > 1.0) & (outcome.t_s < 60.0)]).all()
    assert np.isnan(outcome.heading_deg[outcome.t_s > 61.1]).all()
    fused = run_method(decode(stopped), "cnw3")
    np.testing.assert_array_equal(fused.heading_deg, replay(stopped, method="cnw3")["heading_deg"])


def test_the_compass_alone_has_its_deviation_until_that_is_configured(sail: Sail) -> None:
    scenario = replace(SCENARIOS["tour"], waters=replace(SCENARIOS["tour"].waters, sea=SCENARIOS["dock"].waters.sea))
    recording, truth_path = sail("tour", 150.0, replace(GRADES["good"], compass=STEADY_COMPASS), waters=scenario.waters)
    truth = read_truth(truth_path)
    raw = measure(run_method(decode(recording), "compass"), truth)
    true_terms = Voyage(scenario, replace(GRADES["good"], compass=STEADY_COMPASS)).compass.deviation_deg
    flat = {"vessel.variation_deg": -8.0, "sensors.compass.deviation": list(true_terms)}
    corrected = measure(run_method(decode(recording, apply_flat(Config(), flat, "test")), "compass"), truth)
    assert raw.rmse_deg > 1.0
    assert corrected.rmse_deg < 0.6  # a reading up to 0.1 s old in turns of up to 10 degrees/s


def test_course_readers_agree_with_the_truth_where_there_is_nothing_to_err(sail: Sail) -> None:
    perfect = Grade(
        GpsGrade(shared_m=0.0, own_m=0.0, white_m=0.0, velocity_mps=0.0, latency_s=(0.0, 0.0), jitter_s=0.0),
        CompassGrade(),
        ImuGrade(),
    )
    waters = SCENARIOS["straight"].waters
    still = replace(waters.sea, yaw_deg=0.0, surge_mps=0.0, sway_mps=0.0, roll_deg=0.0, pitch_deg=0.0)
    calm = replace(waters, leeway_deg=0.0, sea=still)
    recording, truth = sail("straight", 40.0, perfect, waters=calm)
    decoded = decode(recording)
    for method in ("course", "gps1-course", "gps3-course"):
        errors = errors_of(run_method(decoded, method), read_truth(truth))
        assert np.nanmax(np.abs(errors)) < 0.02


def test_filterpy_with_the_papers_model_is_as_good_as_the_core(tour: tuple[Path, Decoded, Truth]) -> None:
    _, decoded, truth = tour
    ours = measure(run_method(decoded, "cnw-ekf"), truth, skip_s=20.0)
    theirs = measure(run_method(decoded, "filterpy"), truth, skip_s=20.0)
    assert theirs.rmse_deg == pytest.approx(ours.rmse_deg, rel=0.03)
    assert theirs.nis > 1.0  # the paper's R is far too small: known, and shown


@pytest.mark.parametrize("method", ["imufusion", "imufusion-course"])
def test_imufusion_follows_what_heading_it_is_given(tour: tuple[Path, Decoded, Truth], method: str) -> None:
    _, decoded, truth = tour
    measures = measure(run_method(decoded, method), truth, skip_s=20.0)
    assert measures.rmse_deg < 6.0
    assert measures.availability == 1.0


def test_a_method_that_does_not_exist_is_named_with_the_nearest() -> None:
    with pytest.raises(MethodError, match="did you mean cnw3"):
        check_methods(["cnw4"])
