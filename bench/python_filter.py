"""One prediction and update of `HeadingEkf` from Python against FilterPy's extended Kalman filter with the same model.

    python bench/python_filter.py

FilterPy (extra [bench]) is the filter that most Python users reach for. Both take the same course; the figure is the
shortest of the repeats, taken by turns.
"""

from __future__ import annotations

import math
import timeit
from collections.abc import Callable

import numpy as np

from tinyekf_py import HeadingEkf

Q, R = np.diag([0.01, 0.01, 0.003]), np.diag([0.3, 0.07, 1e-5])
U, RATE, DT = 2.0, 0.01, 0.1
Z = (0.1, 0.2, 0.3)


def ours() -> Callable[[], None]:
    ekf = HeadingEkf(np.zeros(3), np.diag([10.0, 10, 1]), Q, R)

    def step() -> None:
        ekf.predict(U, 0.0, RATE, DT)
        ekf.update(Z)

    return step


def filterpy() -> Callable[[], None]:
    from filterpy.kalman import ExtendedKalmanFilter

    class Boat(ExtendedKalmanFilter):  # type: ignore[misc]
        def predict_x(self, u: float = 0) -> None:
            psi = self.x[2]
            north, east = DT * U * math.cos(psi), DT * U * math.sin(psi)
            self.F[0, 2], self.F[1, 2] = -east, north
            self.x = self.x + np.array([north, east, DT * RATE])

    ekf = Boat(3, 3)
    ekf.P, ekf.Q, ekf.R = np.diag([10.0, 10, 1]), Q * DT, R
    ekf.x, ekf.F = np.zeros(3), np.eye(3)
    identity = np.eye(3)
    z = np.array(Z)

    def residual(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        difference = a - b
        difference[2] = math.remainder(difference[2], 2 * math.pi)
        return difference

    def step() -> None:
        ekf.predict()
        ekf.update(z, lambda _: identity, lambda x: x, residual=residual)

    return step


def main() -> None:
    contenders = {"HeadingEkf": ours(), "FilterPy EKF": filterpy()}
    shortest = dict.fromkeys(contenders, math.inf)
    for _ in range(15):
        for name, step in contenders.items():
            count = 20_000 if name == "HeadingEkf" else 2_000
            shortest[name] = min(shortest[name], timeit.timeit(step, number=count) / count)
    for name, seconds in shortest.items():
        print(f"{name:14} {seconds * 1e6:7.2f} us  ratio {seconds / shortest['HeadingEkf']:6.1f}")


if __name__ == "__main__":
    main()
