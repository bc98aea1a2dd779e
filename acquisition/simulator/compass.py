"""The simulated compass: a CMPS11 behind an Arduino that prints HDM and XDR ten times a second.

It shows the compass heading: what is left of the magnetic heading when the iron aboard has deviated it. It follows the
boat with a lag, and rolls leave a trace in it.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence

from acquisition.simulator.faults import Disturbance, Fault
from acquisition.simulator.grades import CompassGrade
from acquisition.simulator.nmea import sentence
from acquisition.simulator.noise import GaussMarkov
from acquisition.simulator.vessel import Motion

PERIOD_S = 0.1
_XDR_DELAY_US = 3_000


def deviation_at(coefficients: Sequence[float], compass_deg: float) -> float:
    """Deviation in degrees, east positive, on a compass heading: A + B sin + C cos + D sin 2x + E cos 2x."""
    a, b, c, d, e = coefficients
    zeta = math.radians(compass_deg)
    return a + b * math.sin(zeta) + c * math.cos(zeta) + d * math.sin(2.0 * zeta) + e * math.cos(2.0 * zeta)


class Compass:
    """The compass of one boat; `deviation_deg` are its coefficients A to E as the seed drew them."""

    def __init__(self, grade: CompassGrade, variation_deg: float, faults: Sequence[Fault], seed: object) -> None:
        rng = random.Random(f"compass {seed}")
        self._rng = rng
        self._grade = grade
        self._variation_deg = variation_deg
        self._disturbances = [fault for fault in faults if isinstance(fault, Disturbance)]
        self.deviation_deg = tuple(
            size * rng.uniform(0.6, 1.4) * rng.choice((-1.0, 1.0)) for size in grade.deviation_deg
        )
        self._tilt = grade.tilt_deg * rng.choice((-1.0, 1.0))
        self._slow = GaussMarkov(grade.slow_deg, grade.slow_time_s, PERIOD_S, rng)
        self._follow = 1.0 - math.exp(-PERIOD_S / grade.lag_s)
        self._shown_deg: float | None = None

    def reading(self, motion: Motion) -> list[tuple[int, bytes]]:
        """HDM and XDR of this moment, each with the microseconds until it arrives."""
        gauss, grade = self._rng.gauss, self._grade
        true_deg = math.degrees(motion.heading_rad)
        if self._shown_deg is None:
            self._shown_deg = true_deg
        self._shown_deg += self._follow * (true_deg - self._shown_deg)
        disturbance = sum(fault.offset_at(motion.t_s) for fault in self._disturbances)
        magnetic_deg = self._shown_deg - self._variation_deg + disturbance
        compass_deg = magnetic_deg
        for _ in range(4):  # deviation depends on the compass heading itself; each round gains an order of magnitude
            compass_deg = magnetic_deg - deviation_at(self.deviation_deg, compass_deg)
        roll_deg, pitch_deg = math.degrees(motion.roll_rad), math.degrees(motion.pitch_rad)
        compass_deg += self._tilt * roll_deg + self._slow.step() + gauss(0.0, grade.white_deg)
        tenths = round(compass_deg * 10.0) % 3600
        delay_us = round((grade.latency_s + abs(gauss(0.0, grade.jitter_s))) * 1e6)
        pitch, roll = round(pitch_deg + gauss(0.0, 0.3)), round(roll_deg + gauss(0.0, 0.3))  # whole degrees in a CMPS11
        return [
            (delay_us, sentence(f"HCHDM,{tenths // 10}.{tenths % 10},M")),
            (delay_us + _XDR_DELAY_US, sentence(f"HCXDR,A,{pitch},D,PITCH,A,{roll},D,ROLL")),
        ]
