"""The goldens themselves, judged by roads that share no formula with the reference: vectors, brute force, solvers.

A reference that is wrong in the same way as the core proves nothing; these tests need neither Octave nor the core.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from agreement import golden
from cases import cnw_stage1, cnw_stage2, cnw_stage3, covariance_intersection, ekf, forward_azimuth
from numpy.typing import NDArray


def _unit_vector(lat_deg: np.longdouble, lon_deg: np.longdouble) -> NDArray[np.longdouble]:
    lat, lon = lat_deg * np.longdouble(np.pi) / 180, lon_deg * np.longdouble(np.pi) / 180
    return np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])


def test_forward_azimuth_is_the_direction_of_the_great_circle() -> None:
    """Tangent of the circle through both points, away from the earlier one, split into north and east."""
    for (lat1, lon1, lat2, lon2), (faz,) in zip(forward_azimuth().rows, golden("forward_azimuth").rows, strict=True):
        a = _unit_vector(np.longdouble(lat1), np.longdouble(lon1))
        b = _unit_vector(np.longdouble(lat2), np.longdouble(lon2))
        step = math.hypot(lat2 - lat1, (lon2 - lon1 + 180) % 360 - 180)
        if not step > 0 or (lat1, lon1, lon2) == (0.0, 0.0, 180.0):
            continue  # no direction, or every direction
        tangent = np.dot(a, b) * b - a if step > 1 else (b - a) - np.dot(b - a, b) * b
        north = _unit_vector(np.longdouble(lat2 + 90), np.longdouble(lon2))
        east = _unit_vector(np.longdouble(0), np.longdouble(lon2 + 90))
        expected = math.degrees(math.atan2(np.dot(tangent, east), np.dot(tangent, north)))
        difference = (faz - expected + 180) % 360 - 180
        rounding = 3e-12 if abs(lon2 - lon1) > 180 else 2e-15  # across the date line the difference itself is rounded
        assert abs(difference) < 1e-9 + rounding / step, (lat1, lon1, lat2, lon2)


def test_equal_positions_and_missing_ones_have_no_azimuth() -> None:
    rows = forward_azimuth().rows
    still = (rows[:, 0] == rows[:, 2]) & ((rows[:, 1] - rows[:, 3]) % 360 == 0)
    assert still.sum() >= 8
    expected = still | np.isnan(rows).any(axis=1)
    np.testing.assert_array_equal(np.isnan(golden("forward_azimuth").rows[:, 0]), expected)


def test_stage_1_follows_the_table() -> None:
    table = {"differential": (3, 2, 1), "single": (2, 1, 0), "none": (0, 0, 0)}
    for (fix, hdop), (weight,) in zip(cnw_stage1().rows, golden("cnw_stage1").rows, strict=True):
        kind = "differential" if fix in (2, 3, 4, 5) else "single" if fix == 1 else "none"
        classes = [k for k, (low, high) in enumerate(((0, 2), (2, 5), (5, 10))) if low < hdop <= high]
        assert weight == (table[kind][classes[0]] if classes else 0), (fix, hdop)


@pytest.mark.parametrize("stage", ["cnw_stage2", "cnw_stage3"])
def test_weighing_by_complex_numbers(stage: str) -> None:
    """The mean direction is the argument of a sum of unit complex numbers; stage 2 turns the compass towards it."""
    cases = {"cnw_stage2": cnw_stage2, "cnw_stage3": cnw_stage3}[stage]()
    for row, (result,) in zip(cases.rows, golden(stage).rows, strict=True):
        n, compass = int(row[0]), row[1] if stage == "cnw_stage2" else math.nan
        pairs = [(h, w) for h, w in zip(row[2 : 2 + n], row[10 : 10 + n], strict=True) if not math.isnan(h)]
        total = sum(w for _, w in pairs)
        if total == 0 and math.isnan(compass):
            pairs = [(h, 1.0) for h, _ in pairs]
        resultant = sum(w * np.exp(1j * math.radians(h)) for h, w in pairs)
        defined = abs(resultant) > 1e-9 * max(sum(w for _, w in pairs), 1e-300)
        mean = math.degrees(np.angle(resultant)) if defined else math.nan
        expected = mean
        if not math.isnan(compass):
            lean = total / (3 * n) * ((mean - compass + 180) % 360 - 180)
            expected = compass + (lean if defined and total else 0.0)
        assert math.isnan(expected) == math.isnan(result), row
        if not math.isnan(expected):
            assert 0 <= result < 360
            assert abs((result - expected + 180) % 360 - 180) < 1e-9, row


def test_covariance_intersection_beats_every_omega_of_a_fine_grid() -> None:
    omegas = np.linspace(0, 1, 2001)
    for row, result in zip(covariance_intersection().rows, golden("covariance_intersection").rows, strict=True):
        a, b = np.linalg.inv(row[5:14].reshape(3, 3)), np.linalg.inv(row[17:26].reshape(3, 3))
        candidates = np.linalg.inv(omegas[:, None, None] * a + (1 - omegas)[:, None, None] * b)
        fused = result[3:12].reshape(3, 3)
        if row[0]:
            best, reached = np.trace(candidates, axis1=1, axis2=2).min(), np.trace(fused)
        else:
            best, reached = np.linalg.det(candidates).min(), np.linalg.det(fused)
        assert reached <= best * (1 + 1e-9)


def test_covariance_intersection_solves_its_normal_equations() -> None:
    """With its omega: C^-1 c = omega A^-1 a + (1 - omega) B^-1 b, b's heading on a's side of the circle."""
    for row, result in zip(covariance_intersection().rows, golden("covariance_intersection").rows, strict=True):
        a, b, omega = row[2:5], row[14:17].copy(), result[12]
        if row[1]:
            b[2] -= 2 * np.pi * np.round((b[2] - a[2]) / (2 * np.pi))
        root_a, root_b = (np.linalg.cholesky(row[k : k + 9].reshape(3, 3)) for k in (5, 17))
        stacked = np.vstack([np.sqrt(omega) * np.linalg.inv(root_a), np.sqrt(1 - omega) * np.linalg.inv(root_b)])
        seen = np.concatenate(
            [np.sqrt(omega) * np.linalg.solve(root_a, a), np.sqrt(1 - omega) * np.linalg.solve(root_b, b)]
        )
        deviation = np.sqrt(np.diag(result[3:12].reshape(3, 3)))
        expected = deviation * np.linalg.lstsq(stacked * deviation, seen, rcond=None)[0]
        difference = result[:3] - expected
        if row[1]:
            difference[2] -= 2 * np.pi * np.round(difference[2] / (2 * np.pi))
        assert np.all(np.abs(difference) < 1e-9 * (1 + deviation))


def test_alike_covariances_are_shared_evenly() -> None:
    rows, results = covariance_intersection().rows, golden("covariance_intersection").rows
    alike = np.isclose(rows[:, 5:14], rows[:, 17:26], rtol=1e-10, atol=0).all(axis=1)
    assert alike.sum() >= 80
    assert (results[alike, 12] == 0.5).all()


def test_kalman_update_is_the_least_squares_of_prior_and_measurement() -> None:
    """Whiten prior and measurement, stack them, solve: no gain, no innovation covariance."""
    for row, result in zip(ekf().rows, golden("ekf").rows, strict=True):
        prior, p = result[:3], result[3:12].reshape(3, 3)
        z, h, r, hx = row[31:34], row[34:43].reshape(3, 3), row[43:52].reshape(3, 3), row[52:55]
        innovation = z - hx
        if row[0]:
            innovation[2] -= 2 * np.pi * np.round(innovation[2] / (2 * np.pi))
        root_p, root_r = np.linalg.inv(np.linalg.cholesky(p)), np.linalg.inv(np.linalg.cholesky(r))
        stacked = np.vstack([root_p, root_r @ h])
        change = np.linalg.lstsq(stacked, np.concatenate([np.zeros(3), root_r @ innovation]), rcond=None)[0]
        np.testing.assert_allclose(result[12:15], prior + change, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            result[15:24].reshape(3, 3), np.linalg.inv(stacked.T @ stacked), rtol=1e-7, atol=1e-10 * np.trace(p)
        )
