"""Other people's filters on the same samples: what one would take who did not take this project.

`imufusion` is x-io Technologies' AHRS with an external heading; FilterPy's extended Kalman filter gets the model and
the numbers of the 2018 paper, one receiver, as the method `cnw-ekf` has them. Both come with the extra [bench].
"""

from __future__ import annotations

import importlib
import importlib.util
import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from acquisition.simulator.vessel import metres_per_degree
from tinyekf_py.core import forward_azimuth
from tinyekf_py.evaluate.decoded import Decoded, held
from tinyekf_py.evaluate.outcome import Outcome
from tinyekf_py.evaluate.sensor_readers import MAX_AGE_S, course
from tinyekf_py.evaluate.truth import Floats

#: Below this speed (m/s) a course says little of the heading, and the compass is taken.
MIN_COURSE_MPS = 1.0
MAX_STEP_S = 1.0

_PACKAGES = {"imufusion": "imufusion", "imufusion-course": "imufusion", "filterpy": "filterpy"}


def missing_package(method: str) -> str:
    """Name of the package that `method` needs and that is not installed; empty when all is there."""
    package = _PACKAGES.get(method, "")
    return package if package and importlib.util.find_spec(package) is None else ""


def imufusion_compass(decoded: Decoded) -> Outcome:
    """imufusion's AHRS with the compass as the external heading."""
    return _imufusion(decoded, "imufusion", use_course=False)


def imufusion_course(decoded: Decoded) -> Outcome:
    """imufusion's AHRS with the receivers' course as the external heading, below walking pace the compass."""
    return _imufusion(decoded, "imufusion-course", use_course=True)


def _imufusion(decoded: Decoded, method: str, *, use_course: bool) -> Outcome:
    imufusion = importlib.import_module("imufusion")
    t_s, gyro_dps, gravity_g = decoded.imu
    compass_s, _, true_deg = decoded.compass
    heading_deg = held(compass_s, true_deg, t_s, MAX_AGE_S)
    if use_course:
        rows = decoded.rows_s
        over_ground = course(decoded)
        fast = _speed(decoded, rows) >= MIN_COURSE_MPS
        courses = held(rows, np.where(fast, over_ground.heading_deg, np.nan), t_s, MAX_AGE_S)
        heading_deg = np.where(np.isfinite(courses), courses, heading_deg)
    began = time.perf_counter()
    ahrs, bias = imufusion.Ahrs(), imufusion.Bias()
    settings = imufusion.AhrsSettings()
    settings.convention = imufusion.CONVENTION_NED
    ahrs.set_settings(settings)
    steps = np.clip(np.diff(t_s, prepend=t_s[:1] - 0.01), 1e-4, MAX_STEP_S).tolist()
    yaw_deg = np.full(len(t_s), np.nan)
    specific_g = -gravity_g
    usable = np.all(np.isfinite(specific_g), axis=1)
    for i, step_s in enumerate(steps):
        ahrs.set_sample_period(step_s)
        rate = bias.update(gyro_dps[i])
        force = specific_g[i] if usable[i] else np.zeros(3)
        if math.isfinite(heading_deg[i]):
            ahrs.update_external_heading(rate, force, float(heading_deg[i]))
        else:
            ahrs.update_no_magnetometer(rate, force)
        yaw_deg[i] = imufusion.quaternion_to_euler(ahrs.get_quaternion())[2]
    seconds = time.perf_counter() - began
    rows = held(t_s, yaw_deg % 360.0, decoded.rows_s, MAX_AGE_S)
    return Outcome(method, decoded.rows_s, rows, np.full(len(rows), np.nan), seconds)


def _speed(decoded: Decoded, rows_s: Floats) -> Floats:
    """The fastest receiver's speed at every row, m/s; 0 where none knows one."""
    speeds = np.zeros(len(rows_s))
    for number in decoded.gps_numbers:
        samples = decoded.of_gps(number)
        speeds = np.fmax(speeds, held(samples["t_us"] / 1e6, samples["speed_mps"], rows_s, MAX_AGE_S))
    return speeds


def filterpy_ekf(decoded: Decoded) -> Outcome:
    """FilterPy's ExtendedKalmanFilter with the 2018 paper's model, Q and R, fed by GPS 1, compass and IMU."""
    began = time.perf_counter()
    boat = _PaperBoat(importlib.import_module("filterpy.kalman").ExtendedKalmanFilter(dim_x=3, dim_z=3))
    rows = decoded.rows_s
    heading = np.full(len(rows), np.nan)
    sigma = np.full(len(rows), np.nan)
    due = 0
    for t_s, kind, values in _stream(decoded):
        while due < len(rows) and rows[due] < t_s:
            heading[due], sigma[due] = boat.heading()
            due += 1
        if kind == "imu":
            boat.turn(t_s, values[0])
        elif kind == "compass":
            boat.compass_deg = values[0]
        else:
            boat.fix(t_s, values)
    while due < len(rows):
        heading[due], sigma[due] = boat.heading()
        due += 1
    mean_nis = boat.nis / boat.updates if boat.updates else math.nan
    return Outcome("filterpy", rows, heading, sigma, time.perf_counter() - began, mean_nis=mean_nis)


def _stream(decoded: Decoded) -> Iterator[tuple[float, str, tuple[float, ...]]]:
    """What the filter is fed, in order of time: yaw rates (degrees/s), compass headings, fixes of the first GPS."""
    imu_s, gyro_dps, _ = decoded.imu
    compass_s, _, true_deg = decoded.compass
    fixes = decoded.of_gps(decoded.gps_numbers[0]) if decoded.gps_numbers else decoded.samples[:0]
    entries: list[tuple[float, str, tuple[float, ...]]] = []
    entries += [(t, "imu", (z,)) for t, z in zip(imu_s.tolist(), gyro_dps[:, 2].tolist(), strict=True)]
    entries += [(t, "compass", (h,)) for t, h in zip(compass_s.tolist(), true_deg.tolist(), strict=True)]
    columns = [fixes[name].tolist() for name in ("code", "lat_deg", "lon_deg", "speed_mps")]
    entries += [
        (t_us / 1e6, "fix", values)
        for t_us, values in zip(fixes["t_us"].tolist(), zip(*columns, strict=True), strict=True)
    ]
    yield from sorted(entries, key=lambda entry: entry[0])


class _PaperBoat:
    """The papers' three-state model around FilterPy's filter."""

    Q = np.diag([0.01, 0.01, math.radians(1.0) ** 2 * 10.0])
    R = np.diag([0.3, 0.07, math.radians(1.0) ** 2 * 0.03])
    P0 = np.diag([10.0, 10.0, math.radians(1.0) ** 2 * 100.0])

    def __init__(self, ekf: Any) -> None:
        self.ekf = ekf
        self.compass_deg = math.nan
        self.nis = 0.0
        self.updates = 0
        self._t_s = math.nan
        self._rate = 0.0
        self._speed = 0.0
        self._origin: tuple[float, float] | None = None
        self._previous: tuple[float, float] | None = None
        self._started = False

    def heading(self) -> tuple[float, float]:
        """Heading and its standard deviation, degrees; NaN before the start."""
        if not self._started:
            return math.nan, math.nan
        return math.degrees(self.ekf.x[2, 0]) % 360.0, math.degrees(math.sqrt(self.ekf.P[2, 2]))

    def turn(self, t_s: float, rate_dps: float) -> None:
        """A yaw rate came."""
        self._rate = math.radians(rate_dps)
        self._predict(t_s)

    def _predict(self, t_s: float) -> None:
        step_s = t_s - self._t_s if self._started else 0.0
        if step_s > 0.0:
            ekf, u = self.ekf, self._speed
            psi = float(ekf.x[2, 0])
            sin, cos = math.sin(psi), math.cos(psi)
            ekf.F = np.array([[1.0, 0.0, -u * sin * step_s], [0.0, 1.0, u * cos * step_s], [0.0, 0.0, 1.0]])
            ekf.Q = self.Q * step_s
            ahead = ekf.x + step_s * np.array([[u * cos], [u * sin], [self._rate]])
            ekf.predict_x = lambda _u=0: setattr(ekf, "x", ahead)
            ekf.predict()
        self._t_s = t_s

    def fix(self, t_s: float, values: tuple[float, ...]) -> None:
        """An epoch of the receiver came: fix quality, latitude, longitude (degrees), speed (m/s)."""
        quality, lat, lon, speed = values
        self._predict(t_s)
        self._speed = speed if math.isfinite(speed) else 0.0
        azimuth = math.nan
        if quality >= 1 and math.isfinite(lat):
            if self._previous is not None:
                azimuth = forward_azimuth(*self._previous, lat, lon)
            self._previous = (lat, lon)
        else:
            self._previous = None
        heading = azimuth if math.isfinite(azimuth) else self.compass_deg
        if not math.isfinite(heading):
            return
        if self._previous is None:
            if self._started:
                self._update(np.array([self.ekf.x[0, 0], self.ekf.x[1, 0], math.radians(heading)]), blind=True)
            return
        self._origin = self._origin or self._previous
        lat_m, lon_m = metres_per_degree(self._origin[0])
        z = np.array([(lat - self._origin[0]) * lat_m, (lon - self._origin[1]) * lon_m, math.radians(heading)])
        if not self._started:
            self.ekf.x, self.ekf.P, self._started, self._t_s = z.reshape(3, 1), self.P0.copy(), True, t_s
        else:
            self._update(z, blind=False)

    def _update(self, z: Floats, *, blind: bool) -> None:
        noise = self.R.copy()
        if blind:
            noise[0, 0] = noise[1, 1] = 1e9
        ekf = self.ekf
        ekf.update(z.reshape(3, 1), lambda _: np.eye(3), lambda x: x, R=noise, residual=_difference)
        self.nis += float(ekf.y[2, 0] ** 2 / ekf.S[2, 2])
        self.updates += 1


def _difference(a: Floats, b: Floats) -> Floats:
    difference = a - b
    difference[2, 0] = math.remainder(difference[2, 0], math.tau)
    return difference
