"""The configuration's part on fusion: which method, and what each of them is told beforehand."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.sample import MAX_GPS
from tinyekf_py.config_key import choice, integer, key, number, numbers, table

#: The methods of the papers: their standard deviation is that of their own covariance, and uncalibrated.
PAPER_METHODS = ("cnw-ekf", "cnw3", "ekf-ci")
METHODS = (*PAPER_METHODS, "adaptive")
#: The papers' noise of position (m^2) and heading (degrees^2): process noise per second, and measurement noise.
PAPER_Q, PAPER_R = (0.01, 0.01, 10.0), (0.3, 0.07, 0.03)


@dataclass(frozen=True, slots=True, kw_only=True)
class CnwEkfConfig:
    """Method cnw-ekf."""

    gps: int = key(
        1, "The receiver whose filter gives the heading: 1 for gps1.", integer(1, MAX_GPS), shapes_result=True
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptiveConfig:
    """Method adaptive: what it believes before it has measured anything (docs/adaptive.md)."""

    current_chance: float = key(
        0.1,
        "How likely a current is: 0.5 where tides run, less on a lake.",
        number(0.001, 0.999),
        shapes_result=True,
    )
    current_mps: float = key(
        0.35,
        "Standard deviation of a current, where there is one, along either axis.",
        number(0.05, 5),
        unit="m/s",
        shapes_result=True,
    )
    deviation_sigma_deg: tuple[float, ...] = key(
        (1.2, 2.3, 2.3, 0.9, 0.7),
        "Standard deviation of what is not known of the compass' A to E; tinyekf calibrate compass says it.",
        numbers("ABCDE", 0.05, 60),
        unit="degrees",
        shapes_result=True,
    )
    leeway_deg: float = key(
        0.25,
        "Standard deviation of what nothing aboard can see, as leeway; a part of the heading's own.",
        number(0, 20),
        unit="degrees",
        shapes_result=True,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FusionConfig:
    """How the sensors become one heading."""

    method: str = key(
        "adaptive",
        "adaptive (ours), or the papers' cnw-ekf (one filter), cnw3 (one a receiver, weighed), ekf-ci (intersected).",
        choice(*METHODS),
        shapes_result=True,
    )
    max_sigma_deg: float = key(
        30.0,
        "A heading whose standard deviation is above this is invalid, and not given.",
        number(0.1, 180),
        unit="degrees",
        shapes_result=True,
    )
    q: tuple[float, ...] = key(
        PAPER_Q,
        "Process noise of the papers' filters as [north, east, heading]; tinyekf tune estimates it.",
        numbers(("north", "east", "heading"), 1e-9, 1e9),
        unit="m^2/s, m^2/s, degrees^2/s",
        shapes_result=True,
    )
    r: tuple[float, ...] = key(
        PAPER_R,
        "Measurement noise of the papers' filters as [north, east, heading]; tinyekf tune estimates it.",
        numbers(("north", "east", "heading"), 1e-9, 1e9),
        unit="m^2, m^2, degrees^2",
        shapes_result=True,
    )
    cnw_ekf: CnwEkfConfig = table(CnwEkfConfig(), "cnw-ekf")
    adaptive: AdaptiveConfig = table(AdaptiveConfig(), "adaptive")
