"""The deviation card: as a sailor has it beside the compass, printed and drawn."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np

from tinyekf_py.calibrate.deviation_fit import NAMES, DeviationFit, card_deg, deviation_sigma_deg, was_sailed
from tinyekf_py.calibrate.track import CalibrationError

STEP_DEG = 15.0


def card_text(fit: DeviationFit) -> str:
    """Coefficients with their standard errors, the current, and the deviation every 15 degrees of compass heading.

    Where the boat never pointed, the deviation is what the coefficients make of it, and is marked.
    """
    lines = [f"Deviation by {fit.seconds:.0f} s of sailing; {fit.residual_deg:.1f} degrees RMS from second to second"]
    if fit.current is not None:
        current = fit.current
        by = [f"{current.swings} circle(s)"] * (current.swings > 0) + [f"{current.pairs} pair(s) of legs"] * (
            current.pairs > 0
        )
        lines.append(
            f"Current: {current.drift_mps:.2f} m/s setting {current.set_deg:03.0f} true, give or take "
            f"{current.sigma_mps:.2f} m/s, by {' and '.join(by)} at {current.water_speed_mps:.1f} m/s"
        )
    lines.append("")
    for name, value, sigma in zip(NAMES, fit.coefficients_deg, fit.sigma_deg, strict=True):
        lines.append(f"  {name}  {value:+z6.2f} ± {sigma:.2f}" if math.isfinite(sigma) else f"  {name}  not fitted")
    lines += ["", "  compass   deviation   magnetic  (degrees, east positive)"]
    for compass in np.arange(0.0, 360.0, STEP_DEG):
        deviation = float(card_deg(fit, compass))
        sigma = float(deviation_sigma_deg(fit, compass))
        row = f"    {compass:03.0f}   {deviation:+z6.1f} ± {sigma:.1f}   {round(compass + deviation) % 360:03d}"
        lines.append(row if was_sailed(fit, compass) else f"{row}   not sailed")
    return "\n".join(lines) + "\n"


def draw_card(fit: DeviationFit, path: Path) -> None:
    """The deviation curve with its standard error over what was observed, as a picture; needs matplotlib."""
    try:
        figures: Any = importlib.import_module("matplotlib.figure")
    except ImportError as error:
        raise CalibrationError("a drawn card needs matplotlib: install the extra [plots]") from error
    figure = figures.Figure(figsize=(9.0, 5.0), layout="constrained")
    axis = figure.subplots()
    axis.plot(fit.compass_deg, fit.observed_deg, ".", markersize=2.0, color="0.6", label="seen each second")
    headings = np.arange(0.0, 361.0)
    deviation, sigma = card_deg(fit, headings), deviation_sigma_deg(fit, headings)
    axis.fill_between(headings, deviation - 2.0 * sigma, deviation + 2.0 * sigma, color="C0", alpha=0.3)
    axis.plot(headings, deviation, color="C0", label="deviation, ±2 standard errors")
    axis.set_xlim(0.0, 360.0)
    axis.set_xticks(np.arange(0.0, 361.0, 30.0))
    reach = float(np.quantile(np.abs(fit.observed_deg), 0.98)) * 1.3
    axis.set_ylim(-reach, reach)
    axis.axhline(0.0, color="black", linewidth=0.5)
    axis.set_xlabel("compass heading °")
    axis.set_ylabel("deviation ° (east positive)")
    axis.set_title("Deviation: compass + deviation = magnetic")
    axis.legend()
    figure.savefig(path, dpi=110)
