"""Inputs of the single functions: random ones and the edges, as arrays with named columns.

Pure NumPy from fixed seeds; nothing here knows the C core. `FUNCTIONS` maps a function's name to its maker.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

NAN = float("nan")
MAX_HEADINGS = 8


class Table(NamedTuple):
    """A table of numbers."""

    names: tuple[str, ...]
    rows: NDArray[np.float64]  #: shape (number of cases, number of names)


def numbered(name: str, count: int) -> tuple[str, ...]:
    """Names with numbers from 1, as the columns of a vector or of a matrix row by row."""
    return tuple(f"{name}{i + 1}" for i in range(count))


def _generator(seed: int) -> np.random.RandomState:
    return np.random.RandomState(seed)  # the legacy generator: its stream is frozen for good


def forward_azimuth() -> Table:
    """Steps of 1 cm to 10,000 km anywhere, across the date line and the poles, and no step at all."""
    chance = _generator(1)
    rows: list[tuple[float, float, float, float]] = []
    for step_deg in (1e-7, 1e-6, 1e-5, 1e-4, 1e-2, 1.0, 40.0):
        for _ in range(60):
            lat = float(np.round(chance.uniform(-80, 80), 8))
            lon = float(np.round(chance.uniform(-180, 180), 8))
            d_lat, d_lon = chance.normal(0, step_deg, 2)
            new_lat = float(np.clip(np.round(lat + d_lat, 9), -89, 89))
            rows.append((lat, lon, new_lat, float(np.round((lon + d_lon + 180) % 360 - 180, 9))))
    for lat, step in itertools.product((-45.0, 0.0, 35.96, 71.2), (1e-6, 1e-3)):
        for d_lat, d_lon in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1), (0, 0)):
            rows.append((lat, 126.5, lat + step * d_lat, 126.5 + step * d_lon))
            rows.append((lat, 180.0 - step / 3, lat + step * d_lat, -180.0 + step / 3 * d_lon))
    rows += [(10.0, 180.0, 10.0, -180.0), (89.9999, 10.0, 89.9999, -170.0), (0.0, 0.0, 0.0, 180.0)]
    rows += [(NAN, 1.0, 2.0, 3.0), (1.0, NAN, 2.0, 3.0), (1.0, 2.0, NAN, 3.0), (1.0, 2.0, 3.0, NAN)]
    return Table(("lat_prev", "lon_prev", "lat_curr", "lon_curr"), np.array(rows))


def cnw_stage1() -> Table:
    """Every fix quality with every HDOP class, its borders and their neighbours."""
    borders = [b for x in (1.0, 2.0, 5.0, 10.0, 20.0) for b in (np.nextafter(x, 0), x, np.nextafter(x, 99))]
    hdops = [*borders, 0.0, -0.0, -1.0, 5e-324, 0.5, 1.5, 3.0, 7.0, 99.99, NAN, float("inf"), float("-inf")]
    return Table(("fix", "hdop"), np.array([(fix, hdop) for fix in range(-1, 10) for hdop in hdops]))


def _headings(chance: np.random.RandomState) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Headings and stage-1 weights of 1 to 8 receivers, NaN-padded; some missing, often about north."""
    n = int(chance.randint(1, MAX_HEADINGS + 1))
    headings = np.full(MAX_HEADINGS, NAN)
    weights = np.full(MAX_HEADINGS, NAN)
    spread = float(chance.choice([1.0, 10.0, 90.0, 360.0]))
    centre = float(chance.choice([0.0, chance.uniform(0, 360)]))
    headings[:n] = np.round((centre + spread * chance.uniform(-0.5, 0.5, n)) % 360, int(chance.choice([0, 2, 9])))
    headings[:n][chance.uniform(size=n) < 0.15] = NAN
    weights[:n] = chance.randint(0, 4, n) * (chance.uniform() < 0.9)
    return headings, weights, n


def _edge_headings() -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    return [
        ((359.0, 1.0, 0.0), (3, 3, 3)),
        ((0.0, 180.0), (2, 2)),  # cancelled
        ((90.0, 270.0), (1, 1)),
        ((90.0, 270.0), (0, 0)),
        ((0.0, 120.0, 240.0), (1, 1, 1)),
        ((0.0, 180.0), (3, 2)),
        ((10.0, 190.0, NAN), (2, 2, 3)),
        ((NAN, NAN, NAN), (3, 3, 3)),
        ((NAN,), (0,)),
        ((360.0,), (1,)),
        ((180.0, 180.0, 180.0), (3, 2, 1)),
        ((1e-13, 359.9999999999999), (1, 1)),
        ((45.0, NAN, 46.0), (0, 3, 0)),
    ]


def _padded(values: tuple[float, ...]) -> NDArray[np.float64]:
    return np.array(values + (NAN,) * (MAX_HEADINGS - len(values)))


def _weighing(seed: int, compasses: tuple[float, ...]) -> Table:
    chance = _generator(seed)
    rows = []
    for _ in range(300):
        headings, weights, n = _headings(chance)
        compass = NAN if chance.uniform() < 0.25 else float(np.round(chance.uniform(0, 360), 1)) % 360
        rows.append(np.concatenate([[n, compass], headings, weights]))
    for (headings_, weights_), compass in itertools.product(_edge_headings(), compasses):
        rows.append(np.concatenate([[len(headings_), compass], _padded(headings_), _padded(weights_)]))
    return Table(("n", "compass", *numbered("h", MAX_HEADINGS), *numbered("w", MAX_HEADINGS)), np.array(rows))


def cnw_stage2() -> Table:
    """Receivers about north and anywhere, with and without a compass, cancelled and without weight."""
    return _weighing(2, (NAN, 1.5, 359.9, 191.0, 200.0))  # never exactly opposite: there rounding decides the side


def cnw_stage3() -> Table:
    """As stage 2, without a compass."""
    return _weighing(3, (NAN,))


def _covariance(chance: np.random.RandomState, scales: NDArray[np.float64], correlation: float) -> NDArray[np.float64]:
    """A random 3 x 3 covariance with the standard deviations `scales` and correlations up to `correlation`."""
    root = chance.normal(size=(3, 5))
    matrix = root @ root.T
    deviation = np.sqrt(np.diag(matrix))
    matrix = correlation * matrix / np.outer(deviation, deviation)
    np.fill_diagonal(matrix, 1.0)
    matrix = matrix * np.outer(scales, scales)
    return (matrix + matrix.T) / 2


def covariance_intersection() -> Table:
    """Alike, nearly alike, nested, crossing and badly scaled covariances; headings across north."""
    chance = _generator(4)
    rows = []
    for k in range(320):
        kind = k % 8
        scale = np.array([1.0, 1.0, 0.1]) * 10 ** chance.uniform(-1, 1, 3)
        a_matrix = _covariance(chance, scale, float(chance.uniform(0, 0.9)))
        b_matrix = _covariance(chance, scale * 10 ** chance.uniform(-0.5, 0.5, 3), float(chance.uniform(0, 0.9)))
        if kind == 1:
            b_matrix = a_matrix.copy()  # alike
        elif kind == 2:
            b_matrix = a_matrix * (1 + 1e-12)  # alike but for rounding
        elif kind == 3:
            b_matrix = a_matrix * 4.0  # nested: the end of the interval
        elif kind == 4:
            b_matrix = a_matrix * np.outer(nearly := 1 + chance.uniform(-0.02, 0.02, 3), nearly)
        elif kind == 5:  # metres against tiny angles
            scale = np.array([30.0, 10.0, 1e-3])
            a_matrix = _covariance(chance, scale, 0.7)
            b_matrix = _covariance(chance, scale * 10 ** chance.uniform(-1, 1, 3), 0.7)
        elif kind == 6:
            a_matrix, b_matrix = np.diag(scale**2), np.diag(scale[::-1] ** 2)
        elif kind == 7:
            a_matrix, b_matrix = b_matrix, b_matrix / 9.0
        a, b = chance.normal(0, 10, 3), chance.normal(0, 10, 3)
        a[2] = chance.uniform(-np.pi, np.pi)
        b[2] = a[2] + chance.normal(0, 0.3)
        b[2] = np.arctan2(np.sin(b[2]), np.cos(b[2]))
        by_trace, with_angle = float(chance.uniform() < 0.5), float(chance.uniform() < 0.7)
        rows.append(np.concatenate([[by_trace, with_angle], a, a_matrix.ravel(), b, b_matrix.ravel()]))
    names = (*numbered("a", 3), *numbered("A", 9), *numbered("b", 3), *numbered("B", 9))
    return Table(("trace", "angle", *names), np.array(rows))


def ekf() -> Table:
    """Predictions and updates with random matrices; with `angle` the third measured row and state are a heading."""
    chance = _generator(5)
    rows = []
    for k in range(300):
        with_angle = float(k % 2)
        scale = np.array([3.0, 3.0, 0.3]) * 10 ** chance.uniform(-1, 1, 3)
        p = _covariance(chance, scale, 0.8)
        q = _covariance(chance, 0.3 * scale, 0.5)
        r = _covariance(chance, scale * 10 ** chance.uniform(-1, 1, 3), 0.5)
        f = np.eye(3) + 0.2 * chance.normal(size=(3, 3))
        h = np.eye(3) if with_angle else chance.normal(size=(3, 3))
        fx = chance.normal(0, 3, 3)
        fx[2] = chance.uniform(-np.pi, np.pi)
        hx = h @ fx + 0.1 * chance.normal(size=3) * (k % 4 < 2)
        z = hx + chance.normal(size=3) * scale
        if with_angle:
            z[2] = np.arctan2(np.sin(z[2]), np.cos(z[2]))
        rows.append(np.concatenate([[with_angle], p.ravel(), fx, f.ravel(), q.ravel(), z, h.ravel(), r.ravel(), hx]))
    matrices = (*numbered("P", 9), *numbered("fx", 3), *numbered("F", 9), *numbered("Q", 9))
    return Table(
        ("angle", *matrices, *numbered("z", 3), *numbered("H", 9), *numbered("R", 9), *numbered("hx", 3)),
        np.array(rows),
    )


def heading_ekf() -> Table:
    """One vessel filter over 500 steps of changing length, each with none, some or all of its rows measured."""
    chance = _generator(6)
    rows = []
    north, east, psi = 0.0, 0.0, 3.0
    for _ in range(500):
        dt = float(chance.choice([0.01, 0.1, 1.0]))
        u, v, r = chance.uniform(0, 8), chance.normal(0, 0.2), chance.normal(0, 0.3)
        north += dt * (u * np.cos(psi) - v * np.sin(psi))
        east += dt * (u * np.sin(psi) + v * np.cos(psi))
        psi += dt * r
        mask = chance.randint(0, 2, 3) * (chance.uniform() < 0.7)
        noisy = psi + chance.normal(0, 0.05)
        z = (north + chance.normal(), east + chance.normal(), np.arctan2(np.sin(noisy), np.cos(noisy)))
        rows.append((u, v, r, dt, *mask, *z))
    return Table(("u", "v", "r", "dt", "mask1", "mask2", "mask3", "z1", "z2", "z3"), np.array(rows, dtype=float))


FUNCTIONS: dict[str, Callable[[], Table]] = {
    "forward_azimuth": forward_azimuth,
    "cnw_stage1": cnw_stage1,
    "cnw_stage2": cnw_stage2,
    "cnw_stage3": cnw_stage3,
    "covariance_intersection": covariance_intersection,
    "ekf": ekf,
    "heading_ekf": heading_ekf,
}
