"""How good each sensor is believed to be: the noise settings of the vehicle's methods, as keys of its configuration.

An observation's standard deviation is `sqrt(white^2 + walk^2 dt + (relative z)^2)` over the dt seconds since the epoch
before: `white` does not care how long the epoch is (the steps of a counter), `walk` with its root (a gyro's noise),
`relative` with what was measured (a scale). The preset `paper` is the third paper's section 3.1.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from tinyekf_py.config_key import choice, key, number, numbers

_RADIAN = math.pi / 180.0
_turn = numbers(("white", "walk", "relative"), 0, 360)
_way = numbers(("white", "walk", "relative"), 0, 1000)


def _turn_key(values: tuple[float, float, float], sensor: str) -> Any:
    return key(
        values, f"Noise of the {sensor}'s rotation, as [white, walk, relative].", _turn, unit="deg, deg/sqrt(s), 1"
    )


def _way_key(values: tuple[float, float, float], sensor: str) -> Any:
    return key(values, f"Noise of the {sensor}'s distance, as [white, walk, relative].", _way, unit="m, m/sqrt(s), 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """The keys of [noise]. The defaults suit automotive MEMS gyros, wheel pulses and a single-frequency receiver."""

    preset: str = key(
        "ours",
        "Where the values come from: ours, with the keys below, or paper, the third paper's variances.",
        choice("ours", "paper"),
    )
    gps_m: float = key(
        1.5, "Standard deviation of each GPS coordinate, where no column tells it.", number(1e-4, 1e4), unit="m"
    )
    turn_odo: tuple[float, float, float] = _turn_key((0.5, 0.0, 0.01), "odometer")
    turn_xsens: tuple[float, float, float] = _turn_key((0.0, 0.05, 0.0), "XSENS")
    turn_silicon: tuple[float, float, float] = _turn_key((0.0, 0.05, 0.0), "Silicon sensor")
    turn_bosch: tuple[float, float, float] = _turn_key((0.0, 0.05, 0.0), "Bosch sensor")
    way_odo: tuple[float, float, float] = _way_key((0.006, 0.01, 0.0), "odometer")
    way_xsens: tuple[float, float, float] = _way_key((0.003, 0.0, 0.0), "XSENS")
    way_bosch: tuple[float, float, float] = _way_key((0.003, 0.0, 0.0), "Bosch sensor")
    way_oss: tuple[float, float, float] = _way_key((0.003, 0.01, 0.0), "optical sensor")
    accel_xsens_mps2: float = key(
        0.3, "Standard deviation of XSENS's mean acceleration.", number(1e-3, 100), unit="m/s^2"
    )
    accel_bosch_mps2: float = key(
        0.3, "Standard deviation of Bosch's mean acceleration.", number(1e-3, 100), unit="m/s^2"
    )
    along: float = key(
        0.6,
        "Acceleration along the way where none is measured, as a density.",
        number(1e-3, 100),
        unit="m/s^2/sqrt(Hz)",
    )
    lateral: float = key(
        1.6,
        "Acceleration across the way (it turns the velocity), as a density.",
        number(1e-3, 100),
        unit="m/s^2/sqrt(Hz)",
    )
    position_walk: float = key(
        0.01,
        "What the model leaves out: slip, sideslip, as a random walk of the position.",
        number(1e-4, 10),
        unit="m/sqrt(s)",
    )
    gate_gps: float = key(
        13.8,
        "Largest normalised innovation squared of a GPS position (2 degrees of freedom); 0 takes all.",
        number(0, 1e9),
    )
    gate_row: float = key(
        10.8, "Largest normalised innovation squared of another observation; 0 takes all.", number(0, 1e9)
    )
    reaccept_s: float = key(
        3.0, "GPS positions refused for so long are taken all the same: then it is the track that is lost.",
        number(0, 3600), unit="s",
    )  # fmt: skip
    start_sigma_deg: float = key(
        3.0, "Azimuth known well enough to start from the first metres.", number(0.01, 45), unit="degrees"
    )
    turn_threshold_rad: float = key(
        0.01, "Rotation between two epochs above which the adjustment takes the circle (lsa).", number(0, 3), unit="rad"
    )
    turn_hysteresis: float = key(
        0.5, "Share of the threshold below which it goes back to the straight line.", number(0, 1)
    )

    def fill(self, options: Any) -> None:
        """Write everything into the core's `vehicle_options_t`."""
        rows = PAPER_ROWS if self.preset == "paper" else self._rows()
        for row, (white, walk, relative) in enumerate(rows):
            options.white[row], options.walk[row], options.relative[row] = white, walk, relative
        options.accel_sigma_mps2 = (self.accel_xsens_mps2, self.accel_bosch_mps2)
        options.q_ww = 1.0  # "Assume: Q_ww = 1"
        options.along_density = self.along
        options.lateral_density = self.lateral
        options.position_walk = self.position_walk
        options.gate_gps = self.gate_gps
        options.gate_row = self.gate_row
        options.reaccept_s = self.reaccept_s
        options.start_sigma_rad = self.start_sigma_deg * _RADIAN
        options.turn_threshold_rad = self.turn_threshold_rad
        options.turn_hysteresis = self.turn_hysteresis

    def _rows(self) -> list[tuple[float, float, float]]:
        turns = (self.turn_odo, self.turn_xsens, self.turn_silicon, self.turn_bosch)
        ways = (self.way_odo, self.way_xsens, self.way_bosch, self.way_oss)
        gps = [(self.gps_m, 0.0, 0.0)] * 2
        return gps + [(white * _RADIAN, walk * _RADIAN, relative) for white, walk, relative in turns] + list(ways)


#: Section 3.1 of the third paper: variances of X, Y (m^2), of the rotations of odometer, XSENS, Silicon and Bosch
#: (rad^2), of the distances of odometer, XSENS, Bosch and optical sensor (m^2), whatever the epoch's length.
PAPER_VARIANCES = (1e-5, 1e-5, 0.01, 0.1, 0.1, 1e-4, 1e-5, 0.01, 0.01, 0.01)
PAPER_ROWS = [(math.sqrt(variance), 0.0, 0.0) for variance in PAPER_VARIANCES]

#: What `kinematic-paper` takes unless told otherwise.
PAPER = dataclasses.replace(Noise(), preset="paper")
