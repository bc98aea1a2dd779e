"""The C core's functions and filters, reached by other roads: closed forms, brute force, the textbook's matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acquisition.sample import SAMPLE_SIZE, CompassSample, GpsSample, ImuSample
from tinyekf_py import (
    Ekf,
    HeadingEkf,
    Status,
    cnw_stage1,
    cnw_stage2,
    cnw_stage3,
    covariance_intersection,
    forward_azimuth,
)
from tinyekf_py._core import ffi, lib
from tinyekf_py.sample_array import sample_dtype

bearings = st.floats(0, 360, exclude_max=True)


def apart(a: float, b: float) -> float:
    return abs(math.remainder(a - b, 360.0))


def spd(rng: np.random.Generator, scale: float = 1.0) -> np.ndarray:
    root = rng.normal(size=(3, 3))
    return scale * (root @ root.T + 0.1 * np.eye(3))


# --- layout -------------------------------------------------------------------------------------------------


def test_sample_record_is_laid_out_alike_in_python_c_and_numpy() -> None:
    assert ffi.sizeof("sample_t") == SAMPLE_SIZE == sample_dtype.itemsize
    gps = GpsSample(1, 2, 4, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13)
    compass = CompassSample(1, 8, 1, 2.0, 3.0, 4.0, 5.0, 6.0)
    imu = ImuSample(1, 9, 0, *map(float, range(12)))
    for sample, kind in ((gps, "gps"), (compass, "compass"), (imu, "imu")):
        record = ffi.from_buffer("sample_t *", sample.pack())
        assert (record.t_us, record.source) == (sample.t_us, sample.source)
        reading = getattr(record, kind)
        values = []
        for name, field in ffi.typeof(reading).fields:
            value = getattr(reading, name)
            values += list(value) if field.type.kind == "array" else [value]
        assert values == list(sample[3:])
    row = np.frombuffer(gps.pack(), sample_dtype)[0]
    assert (row["t_us"], row["code"], row["lat_deg"], row["hdop"], row["satellites"]) == (1, 4, 6.0, 11.0, 13)
    assert np.frombuffer(imu.pack(), sample_dtype)[0]["accel_g"].tolist() == [6.0, 7.0, 8.0]


# --- angles and weighing ------------------------------------------------------------------------------------


@given(st.floats(-80, 80), st.floats(-180, 180), bearings, st.floats(0.05, 500.0))
def test_forward_azimuth_is_the_course_that_was_sailed(lat: float, lon: float, course: float, metres: float) -> None:
    radius = 6_371_000.0
    d, c, phi = metres / radius, math.radians(course), math.radians(lat)
    phi2 = math.asin(math.sin(phi) * math.cos(d) + math.cos(phi) * math.sin(d) * math.cos(c))
    lam2 = math.atan2(math.sin(c) * math.sin(d) * math.cos(phi), math.cos(d) - math.sin(phi) * math.sin(phi2))
    azimuth = forward_azimuth(lat, lon, math.degrees(phi2), lon + math.degrees(lam2))
    convergence = math.degrees(lam2) * math.sin(phi)  # the course turns by this much on the way
    resolution = math.degrees(1e-8 / metres)  # of degrees in double precision
    assert apart(azimuth, course + convergence) < 1e-3 + resolution


def test_forward_azimuth_takes_arrays_and_has_no_course_at_rest() -> None:
    azimuths = forward_azimuth(35.0, 126.0, [35.001, 35.0, 34.999, 35.0, 35.0], [126.0, 126.001, 126.0, 125.999, 126.0])
    assert azimuths[:4] == pytest.approx([0, 90, 180, 270], abs=1e-3)
    assert math.isnan(azimuths[4])
    assert forward_azimuth(0.0, 179.9999, 0.0, -179.9999) == pytest.approx(90.0)


@pytest.mark.parametrize(
    ("fix", "hdop", "weight"),
    [
        *((2, h, w) for h, w in ((0.5, 3), (1.0, 3), (2.0, 3), (2.01, 2), (5.0, 2), (5.01, 1), (10.0, 1), (10.01, 0))),
        *((1, h, w) for h, w in ((0.5, 2), (2.0, 2), (2.01, 1), (5.0, 1), (5.01, 0), (99.0, 0))),
        *((fix, 1.0, w) for fix, w in ((0, 0), (3, 3), (4, 3), (5, 3), (6, 0), (7, 0), (8, 0), (-1, 0))),
        *((2, h, 0) for h in (0.0, -1.0, math.nan, math.inf)),
    ],
)
def test_stage_1_follows_the_table(fix: int, hdop: float, weight: int) -> None:
    assert cnw_stage1(fix, hdop) == weight


@given(st.lists(bearings, min_size=1, max_size=8), bearings)
def test_weighing_turns_with_its_headings(headings: list[float], turn: float) -> None:
    weights = [1 + i % 3 for i in range(len(headings))]
    mean = cnw_stage3(headings, weights)
    vector = sum(w * np.exp(1j * math.radians(h)) for w, h in zip(weights, headings, strict=True))
    if abs(vector) < 1e-6:
        return
    assert apart(mean, math.degrees(np.angle(vector))) < 1e-6 / abs(vector)
    assert apart(cnw_stage3([h + turn for h in headings], weights), mean + turn) < 1e-6 / abs(vector)


def test_stage_2_weighs_gps_against_compass_across_north() -> None:
    assert apart(cnw_stage2([359, 1, 0], [3, 3, 3], 90), 0) < 1e-9  # all ideal: no compass at all
    assert apart(cnw_stage2([350, 350, math.nan], [3, 3, 0], 20), 20 - 30 * 6 / 9) < 1e-9
    assert cnw_stage2([10, 10, 10], [0, 0, 0], 77) == pytest.approx(77)
    assert cnw_stage2([10, 20, 30], [0, 0, 0], math.nan) == pytest.approx(20)
    assert cnw_stage2([350, 10, math.nan], [1, 1, 0], math.nan) == pytest.approx(0, abs=1e-9)
    assert math.isnan(cnw_stage2([0, 180], [3, 3], math.nan))
    assert math.isnan(cnw_stage2([math.nan] * 3, [0, 0, 0], math.nan))
    assert cnw_stage2([[0, 0], [90, 90]], [3, 3], [5, 5]).tolist() == pytest.approx([0, 90], abs=1e-9)


def test_weighing_refuses_more_receivers_than_there_can_be() -> None:
    with pytest.raises(ValueError, match="from 1 to 8"):
        cnw_stage3([0.0] * 9, [1.0] * 9)


# --- covariance intersection --------------------------------------------------------------------------------


@pytest.mark.parametrize("minimise", ["det", "trace"])
@pytest.mark.parametrize("seed", range(20))
def test_intersection_finds_the_omega_of_brute_force(minimise: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, A, B = rng.normal(size=3), rng.normal(size=3), spd(rng), spd(rng, 3.0)
    result = covariance_intersection(a, A, b, B, minimise=minimise)  # type: ignore[arg-type]
    omegas = np.linspace(0, 1, 20001)
    information = omegas[:, None, None] * np.linalg.inv(A) + (1 - omegas)[:, None, None] * np.linalg.inv(B)
    C = np.linalg.inv(information)
    cost = np.linalg.slogdet(C)[1] if minimise == "det" else np.trace(C, axis1=1, axis2=2)
    assert result.omega == pytest.approx(omegas[np.argmin(cost)], abs=1e-4)
    w = result.omega
    expected = np.linalg.inv(w * np.linalg.inv(A) + (1 - w) * np.linalg.inv(B))
    assert pytest.approx(expected) == result.C
    assert result.c == pytest.approx(expected @ (w * np.linalg.solve(A, a) + (1 - w) * np.linalg.solve(B, b)))


def test_intersection_of_equals_is_half_way_and_wraps_angles() -> None:
    result = covariance_intersection([0, 0, 3.1], np.eye(3), [2, 2, -3.1], np.eye(3), angles=[2])
    assert result.omega == 0.5
    assert result.c[:2].tolist() == [1, 1]
    assert abs(result.c[2]) == pytest.approx(math.pi)
    with pytest.raises(ValueError, match="positive definite"):
        covariance_intersection([0, 0, 0], -np.eye(3), [0, 0, 0], np.eye(3))


# --- filters ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(20))
def test_update_is_the_textbooks_joint_update(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, z, P, R, H = rng.normal(size=3), rng.normal(size=3), spd(rng), spd(rng), rng.normal(size=(3, 3))
    ekf = Ekf(x, (P + P.T) / 2)
    update = ekf.update(z, H, (R + R.T) / 2)
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    assert update.accepted
    assert update.nis == pytest.approx((z - H @ x) @ np.linalg.solve(S, z - H @ x))
    assert ekf.x == pytest.approx(x + K @ (z - H @ x))
    assert pytest.approx((np.eye(3) - K @ H) @ P) == ekf.P


@pytest.mark.parametrize("seed", range(5))
def test_step_is_predict_and_update_with_the_measurement_at_the_prediction(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, fx, z, F, H = *rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), np.eye(3)
    P, Q, R = (np.diag(rng.uniform(0.1, 2, 3)) for _ in range(3))
    stepped, apart_ = Ekf(x, P), Ekf(x, P)
    assert stepped.step(z, fx, F, Q, H, R) is Status.ACCEPTED
    apart_.predict(fx, F, Q)
    assert pytest.approx(F @ P @ F.T + Q) == apart_.P
    apart_.update(z, H, R, hx=H @ fx)
    assert stepped.x == pytest.approx(apart_.x)
    assert pytest.approx(apart_.P) == stepped.P


def test_absent_rows_are_skipped_not_inflated() -> None:
    ekf = Ekf([0, 0, 0], np.eye(3))
    assert ekf.update([1, math.nan, math.nan], np.eye(3), np.eye(3), mask=[True, False, False]).accepted
    assert ekf.x.tolist() == [0.5, 0, 0]
    assert ekf.P.diagonal().tolist() == [0.5, 1, 1]
    assert ekf.update([1, 1, 1], np.eye(3), np.eye(3), mask=[False] * 3).status is Status.SKIPPED


def test_gated_update_says_by_how_much_and_changes_nothing() -> None:
    ekf = Ekf([0, 0, 0], np.eye(3))
    update = ekf.update([10, 0, 0], np.eye(3), np.eye(3), gate=16.0)
    assert update == (Status.GATED, pytest.approx(50.0))
    assert ekf.x.tolist() == [0, 0, 0]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    ekf = Ekf([1, 2, 3], np.eye(3))
    broken = np.eye(3)
    broken[1, 1] = bad
    calls = [
        ekf.predict([bad, 0, 0], np.eye(3), np.eye(3)),
        ekf.predict([0, 0, 0], broken, np.eye(3)),
        ekf.predict([0, 0, 0], np.eye(3), broken),
        ekf.update([bad, 0, 0], np.eye(3), np.eye(3)).status,
        ekf.update([0, 0, 0], broken, np.eye(3)).status,
        ekf.update([0, 0, 0], np.eye(3), broken).status,
    ]
    assert calls == [Status.REFUSED] * 6
    assert ekf.x.tolist() == [1, 2, 3]
    assert ekf.P.tolist() == np.eye(3).tolist()
    with pytest.raises(ValueError, match="finite"):
        Ekf([bad, 0, 0], np.eye(3))


def test_shapes_are_checked() -> None:
    ekf = Ekf([0, 0, 0], np.eye(3))
    with pytest.raises(ValueError, match=r"F has shape \(2, 2\); give \(3, 3\)"):
        ekf.predict([0, 0, 0], np.eye(2), np.eye(3))
    with pytest.raises(ValueError, match="symmetric"):
        Ekf([0, 0, 0], [[1, 1, 0], [0, 1, 0], [0, 0, 1]])
    with pytest.raises(ValueError, match="diagonal"):
        HeadingEkf([0, 0, 0], np.eye(3), np.ones((3, 3)), [1, 1, 1])


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(-12, 6), st.floats(-12, 6))
def test_covariance_stays_symmetric_and_positive_definite(seed: int, log_p: float, log_r: float) -> None:
    rng = np.random.default_rng(seed)
    ekf = Ekf(np.zeros(3), spd(rng, 10**log_p).round(14) + 1e-13 * np.eye(3))
    for _ in range(50):
        ekf.predict(rng.normal(size=3), np.eye(3) + 0.1 * rng.normal(size=(3, 3)), 1e-6 * np.eye(3))
        ekf.update(rng.normal(size=3), rng.normal(size=(3, 3)), 10**log_r * np.diag(rng.uniform(0.1, 1, 3)))
        assert (ekf.P == ekf.P.T).all()
        np.linalg.cholesky(ekf.P)


def test_heading_filter_sails_a_circle_and_wraps() -> None:
    ekf = HeadingEkf([0, 0, 3.0], np.eye(3) * 1e-6, [1e-9] * 3, [1, 1, 1])
    for _ in range(628):
        assert ekf.predict(1.0, 0.0, 0.1, 0.1) is Status.ACCEPTED
    turned = 3.0 + 62.8 * 0.1
    assert apart(math.degrees(ekf.x[2]), math.degrees(turned)) < 1e-9
    assert np.hypot(*ekf.x[:2]) < 0.1  # back where it began
    assert ekf.update([0, 0, ekf.x[2] + 2 * math.pi], [False, False, True]).nis == pytest.approx(0, abs=1e-12)


def test_positions_survive_the_local_frame() -> None:
    frame, out = ffi.new("local_frame_t *"), ffi.new("double[4]")
    for lat, lon in ((35.9, 126.5), (-54.8, -68.3), (0.0, 179.99), (78.2, 15.6)):
        lib.local_frame_set(frame, math.radians(lat), math.radians(lon))
        lib.local_frame_to_metres(frame, math.radians(lat + 0.01), math.radians(lon + 0.02), out, out + 1)
        lib.local_frame_to_position(frame, out[0], out[1], out + 2, out + 3)
        assert math.degrees(out[2]) == pytest.approx(lat + 0.01, abs=1e-12)
        assert apart(math.degrees(out[3]), lon + 0.02) < 1e-12
    lib.local_frame_set(
        frame, 0.0, 0.0
    )  # WGS-84: a minute of latitude at the equator is 1842.9 m, of longitude 1855.3 m
    assert frame.metres_lat * math.radians(1 / 60) == pytest.approx(1842.9, abs=0.05)
    assert frame.metres_lon * math.radians(1 / 60) == pytest.approx(1855.3, abs=0.05)
