"""The C core's functions and filters in Python: angles, weighing, covariance intersection, extended Kalman filters.

Degrees here, radians in C (`HeadingEkf` alone keeps C's units). Scalars give a float, arrays an array of the
broadcast shape. Whatever has the wrong shape is a ValueError; what is not finite is refused with a status, as in C.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import IntEnum
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tinyekf_py._core import ffi, lib

Floats = NDArray[np.float64]

_DEGREE = np.pi / 180.0


class Status(IntEnum):
    """What a prediction or an update did. Everything but ACCEPTED left the filter as it was."""

    ACCEPTED = 0
    GATED = 1  #: normalised innovation squared above the gate
    SKIPPED = 2  #: nothing measured
    FAILED = 3  #: the result would not be positive definite
    REFUSED = 4  #: NaN or infinity among the arguments


_status: Callable[[int], Status] = tuple(Status).__getitem__  # by number: faster than calling the enumeration


class Update(NamedTuple):
    """What an update did."""

    status: Status
    nis: float  #: normalised innovation squared of the rows used; NaN when none was judged

    @property
    def accepted(self) -> bool:
        return self.status is Status.ACCEPTED


class Intersection(NamedTuple):
    """Result of `covariance_intersection`."""

    c: Floats  #: shape (3,)
    C: Floats  #: shape (3, 3)
    omega: float  #: weight of the first estimate, 0 to 1


def _elementwise(function: Callable[..., float], *arguments: ArrayLike) -> Any:
    arrays = np.broadcast_arrays(*(np.asarray(argument, float) for argument in arguments))
    if arrays[0].ndim == 0:
        return function(*(float(array) for array in arrays))
    columns = [array.ravel().tolist() for array in arrays]
    return np.array([function(*values) for values in zip(*columns, strict=True)]).reshape(arrays[0].shape)


def forward_azimuth(lat_prev: ArrayLike, lon_prev: ArrayLike, lat_curr: ArrayLike, lon_curr: ArrayLike) -> Any:
    """Course of the track at the current position, degrees true in [0, 360): the 2018 paper's (1), on the sphere.

    Positions in degrees, scalars or arrays that broadcast. NaN for equal positions.
    """

    def one(lat0: float, lon0: float, lat1: float, lon1: float) -> float:
        return float(lib.angle_to_bearing_deg(lib.angle_forward_azimuth(lat0, lon0, lat1, lon1)))

    return _elementwise(one, lat_prev, lon_prev, lat_curr, lon_curr)


def cnw_stage1(fix: ArrayLike, hdop: ArrayLike) -> Any:
    """Weight 0 (BAD) to 3 (IDEAL) of a receiver from GGA fix quality and HDOP: the 2019 paper's Code 3.

    Scalars give an int, arrays an integer array of the broadcast shape. HDOP that is NaN or not positive weighs 0.
    """

    def one(quality: float, dilution: float) -> float:
        return float(lib.cnw_stage1(int(quality) if np.isfinite(quality) else -1, dilution))

    weights = _elementwise(one, fix, hdop)
    return weights.astype(int) if isinstance(weights, np.ndarray) else int(weights)


def cnw_stage2(headings_deg: ArrayLike, weights: ArrayLike, compass_deg: ArrayLike) -> Any:
    """GPSEC_yaw, degrees true in [0, 360): equation (2) of both papers, made safe across north.

    `headings_deg` and `weights` have shape (..., n), n GPS configured (an absent one: NaN, weight 0), `compass_deg`
    shape (...), NaN without a compass. NaN when nothing is left or the headings cancel.
    """
    return _weigh(lambda h, w, n, c: lib.cnw_stage2(h, w, n, c * _DEGREE), headings_deg, weights, compass_deg)


def cnw_stage3(headings_deg: ArrayLike, weights: ArrayLike) -> Any:
    """Weighted circular mean of n filters' headings, degrees in [0, 360): equation (13) of the 2019 paper.

    Both of shape (..., n). All weights zero: their plain mean. NaN when nothing is left or the headings cancel.
    """
    return _weigh(lambda h, w, n, _: lib.cnw_stage3(h, w, n), headings_deg, weights, np.nan)


def _weigh(
    stage: Callable[[Any, Any, int, float], float], headings_deg: ArrayLike, weights: ArrayLike, compass: ArrayLike
) -> Any:
    headings, weighing = np.broadcast_arrays(np.asarray(headings_deg, float), np.asarray(weights, float))
    if headings.ndim == 0 or headings.shape[-1] > lib.SAMPLE_MAX_GPS:
        raise ValueError(f"headings have shape {headings.shape}; give (..., n) with n from 1 to {lib.SAMPLE_MAX_GPS}")
    compasses = np.broadcast_to(np.asarray(compass, float), headings.shape[:-1])
    n = headings.shape[-1]
    result = np.empty(headings.shape[:-1])
    for index in np.ndindex(result.shape):
        radians = (headings[index] * _DEGREE).tolist()
        result[index] = lib.angle_to_bearing_deg(stage(radians, weighing[index].tolist(), n, float(compasses[index])))
    return result if result.ndim else float(result)


def covariance_intersection(
    a: ArrayLike,
    A: ArrayLike,
    b: ArrayLike,
    B: ArrayLike,
    *,
    minimise: Literal["det", "trace"] = "det",
    angles: Iterable[int] = (),
) -> Intersection:
    """Fuse two estimates of unknown correlation: C^-1 = w A^-1 + (1-w) B^-1 with w minimising log det C or trace C.

    `a`, `b`: shape (3,); `A`, `B`: shape (3, 3), symmetric and positive definite (else ValueError). `angles` lists the
    states that are angles in rad: b's are first moved next to a's. The 2015 predecessor's step (EKF-CI).
    """
    if minimise not in ("det", "trace"):
        raise ValueError(f"minimise is {minimise!r}; there are 'det' and 'trace'")
    mask = _mask(angles)
    first, second = _filter(a, A, mask, "a, A"), _filter(b, B, mask, "b, B")
    omega = ffi.new("double *")
    objective = lib.CI_MINIMISE_TRACE if minimise == "trace" else lib.CI_MINIMISE_DET
    if lib.covariance_intersection(first, second, objective, first, omega) != lib.EKF_ACCEPTED:
        raise ValueError("A or B is too close to singular to be intersected")
    return Intersection(_vector_of(first), _matrix_of(first), omega[0])


def _mask(rows: Iterable[int]) -> int:
    mask = 0
    for row in rows:
        if not 0 <= row < 3:
            raise ValueError(f"angle row {row}; there are 0, 1 and 2")
        mask |= 1 << row
    return mask


def _shaped(name: str, values: ArrayLike, shape: tuple[int, ...]) -> list[Any]:
    array = np.asarray(values, float)
    if array.shape != shape:
        raise ValueError(f"{name} has shape {array.shape}; give {shape}")
    rows: list[Any] = array.tolist()
    return rows


def _filter(x: ArrayLike, P: ArrayLike, angle_states: int, name: str) -> Any:
    ekf = ffi.new("ekf_t *")
    if lib.ekf_init(ekf, _shaped(name, x, (3,)), _shaped(name, P, (3, 3)), angle_states) != lib.EKF_ACCEPTED:
        raise ValueError(f"{name}: the covariance must be symmetric and positive definite, and all numbers finite")
    return ekf


def _vector_of(ekf: Any) -> Floats:
    return np.array(list(ekf.x))


def _matrix_of(ekf: Any) -> Floats:
    return np.array([list(row) for row in ekf.P])


class _Filter:
    """What both filters have: the C struct, and copies of what is in it."""

    _ekf: Any

    @property
    def x(self) -> Floats:
        """The state estimate, shape (3,)."""
        return _vector_of(self._ekf)

    @property
    def P(self) -> Floats:
        """Its covariance, shape (3, 3)."""
        return _matrix_of(self._ekf)


class Ekf(_Filter):
    """Extended Kalman filter of 3 states and 3 measurements; you bring the model.

    `x` (shape (3,)) and `P` (shape (3, 3)) are copies of the estimate and its covariance, in your units.
    """

    def __init__(self, x0: ArrayLike, P0: ArrayLike) -> None:
        """State `x0`, shape (3,), and covariance `P0`, shape (3, 3), symmetric and positive definite (ValueError)."""
        self._ekf = _filter(x0, P0, 0, "x0, P0")
        self._measurement = ffi.new("ekf_measurement_t *")
        self._nis = ffi.new("ekf_real *")

    def predict(self, fx: ArrayLike, F: ArrayLike, Q: ArrayLike) -> Status:
        """x = fx, P = F P F' + Q: the 2018 paper's (4). Shapes (3,), (3, 3), (3, 3)."""
        F_, Q_ = _shaped("F", F, (3, 3)), _shaped("Q", Q, (3, 3))
        return _status(lib.ekf_predict(self._ekf, _shaped("fx", fx, (3,)), F_, Q_))

    def update(
        self,
        z: ArrayLike,
        H: ArrayLike,
        R: ArrayLike,
        *,
        hx: ArrayLike | None = None,
        angles: Iterable[int] = (),
        mask: Sequence[bool] | None = None,
        gate: float = 0.0,
    ) -> Update:
        """Take a measurement: the 2018 paper's (6), (7) and state update.

        `z`, shape (3,); its Jacobian `H` and noise covariance `R`, shape (3, 3); `hx`, the predicted measurement,
        H x by default; `angles`, the rows that are angles in rad; `mask`, which rows were measured (all by default);
        `gate`, the largest normalised innovation squared accepted (0: no gate).
        """
        m = self._measurement
        H_array = np.asarray(H, float)
        m.H = _shaped("H", H_array, (3, 3))
        m.z = _shaped("z", z, (3,))
        m.R = _shaped("R", R, (3, 3))
        m.hx = _shaped("hx", H_array @ self.x if hx is None else hx, (3,))
        m.rows = 7 if mask is None else _mask(row for row, measured in enumerate(mask) if measured)
        m.angle_rows = _mask(angles)
        m.gate = gate
        status = lib.ekf_update(self._ekf, m, self._nis)
        return Update(_status(status), self._nis[0])

    def step(self, z: ArrayLike, fx: ArrayLike, F: ArrayLike, Q: ArrayLike, H: ArrayLike, R: ArrayLike) -> Status:
        """One TinyEKF step: predict, then update with hx = H fx (the 2018 paper's mend of §3.3). Shapes as above."""
        return _status(
            lib.ekf_step(
                self._ekf,
                _shaped("z", z, (3,)),
                _shaped("fx", fx, (3,)),
                *(_shaped(name, matrix, (3, 3)) for name, matrix in (("F", F), ("Q", Q), ("H", H), ("R", R))),
            )
        )


class HeadingEkf(_Filter):
    """The papers' filter: state [north_m, east_m, heading_rad], the 2018 paper's (8) to (10). Radians throughout.

    `x` (shape (3,)) and `P` (shape (3, 3), m^2, m rad, rad^2) are copies.
    """

    def __init__(self, x0: ArrayLike, P0: ArrayLike, Q: ArrayLike, R: ArrayLike) -> None:
        """`x0` shape (3,), `P0` shape (3, 3); `Q` (noise per second) and `R`, diagonals of shape (3,) or (3, 3)."""
        self._ekf = _filter(x0, P0, 1 << lib.HEADING_PSI, "x0, P0")
        self._q = ffi.new("double[3]", _diagonal("Q", Q))
        self._r = ffi.new("double[3]", _diagonal("R", R))
        self._z = ffi.new("double[3]")
        self._nis = ffi.new("ekf_real *")

    def predict(self, u: float, v: float, r: float, dt: float) -> Status:
        """Move on by `dt` s with surge `u`, sway `v` (m/s) and yaw rate `r` (rad/s), by one Euler step."""
        return _status(lib.heading_model_predict(self._ekf, u, v, r, dt, self._q))

    def update(self, z: Sequence[float], mask: Sequence[bool] | None = None, *, gate: float = 0.0) -> Update:
        """Measure `z` = [north m, east m, heading rad], shape (3,); `mask` says which of them were measured."""
        rows = 7
        if mask is not None:
            m0, m1, m2 = mask
            rows = bool(m0) | bool(m1) << 1 | bool(m2) << 2
        measured = self._z
        measured[0], measured[1], measured[2] = z
        status = lib.heading_model_update(self._ekf, measured, rows, self._r, gate, self._nis)
        return Update(_status(status), self._nis[0])


def _diagonal(name: str, values: ArrayLike) -> list[float]:
    array = np.asarray(values, float)
    if array.shape == (3, 3):
        if np.any(array != np.diag(np.diag(array))):
            raise ValueError(f"{name} must be diagonal")
        array = np.diag(array)
    if array.shape != (3,):
        raise ValueError(f"{name} has shape {array.shape}; give its diagonal, (3,), or (3, 3)")
    diagonal: list[float] = array.tolist()
    return diagonal
