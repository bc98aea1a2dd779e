"""Random errors that remember: the difference between a real sensor and a table of dice throws."""

from __future__ import annotations

import math
import random


class GaussMarkov:
    """An error of standard deviation `sigma` whose memory fades with `time_s`, drawn every `step_s`."""

    def __init__(self, sigma: float, time_s: float, step_s: float, rng: random.Random) -> None:
        self._keep = math.exp(-step_s / time_s)
        self._kick = sigma * math.sqrt(1.0 - self._keep**2)
        self._gauss = rng.gauss
        self.value = rng.gauss(0.0, sigma)

    def step(self) -> float:
        """The next value."""
        self.value = self._keep * self.value + self._gauss(0.0, self._kick)
        return self.value


class SmoothGaussMarkov:
    """As `GaussMarkov`, but with a continuous rate, as the errors of positions have that a receiver has filtered."""

    def __init__(self, sigma: float, time_s: float, step_s: float, rng: random.Random) -> None:
        # A first-order error behind a lag of the same time constant; the lag halves the variance.
        self._source = GaussMarkov(sigma * math.sqrt(2.0), time_s, step_s, rng)
        self._follow = step_s / time_s
        self.value = 0.5 * self._source.value + rng.gauss(0.0, sigma / math.sqrt(2.0))

    def step(self) -> float:
        """The next value."""
        self.value += self._follow * (self._source.step() - self.value)
        return self.value
