"""Pictures of an evaluation, by matplotlib (the extra [plots]).

For each recording: heading and its error over time, a row per method, as Figures 7 and 8 of the 2019 paper; histogram
of the errors; sigma against the error; the weights of stage 1; the map.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

import numpy as np

from tinyekf_py.evaluate.job import Evaluation
from tinyekf_py.evaluate.measures import errors_of
from tinyekf_py.evaluate.outcome import Outcome
from tinyekf_py.evaluate.truth import Floats, Truth

_DPI = 110


class PicturesError(ValueError):
    """No pictures can be drawn: one line saying why."""


def require_matplotlib() -> Any:
    """The module `matplotlib.figure`; PicturesError without matplotlib."""
    try:
        return importlib.import_module("matplotlib.figure")
    except ImportError as error:
        raise PicturesError("pictures need matplotlib: install the extra [plots], or give --no-pictures") from error


def draw(evaluation: Evaluation, folder: Path) -> list[Path]:
    """Draw all pictures of one evaluation that kept its series into `folder`; the files."""
    truth = evaluation.truth
    if truth is None:
        return []
    figures = {
        "heading": _headings(evaluation, truth),
        "errors": _histogram(evaluation, truth),
        "sigma": _sigmas(evaluation, truth),
        "weights": _weights(evaluation),
        "map": _map(evaluation, truth),
    }
    stem = re.sub(r"[^\w.-]+", "-", evaluation.name)
    paths = []
    for what, figure in figures.items():
        if figure is None:
            continue
        path = folder / f"{stem}-{what}.png"
        figure.savefig(path, dpi=_DPI)
        paths.append(path)
    return paths


def _figure(width: float, height: float) -> Any:
    return require_matplotlib().Figure(figsize=(width, height), layout="constrained")


def _gapless(heading_deg: Floats) -> Floats:
    """Headings with a gap where they pass north, lest a line be drawn across the picture."""
    gaps = np.abs(np.diff(heading_deg, prepend=heading_deg[:1])) > 180.0
    return np.where(gaps, np.nan, heading_deg)


def _knows_sigma(outcome: Outcome) -> bool:
    return bool(np.isfinite(outcome.sigma_deg).any())


def _headings(evaluation: Evaluation, truth: Truth) -> Any:
    outcomes = evaluation.outcomes
    figure = _figure(11.0, 1.0 + 1.9 * len(outcomes))
    figure.suptitle(evaluation.name)
    axes = figure.subplots(len(outcomes), 2, squeeze=False, sharex=True)
    for (left, right), outcome in zip(axes, outcomes, strict=True):
        left.plot(outcome.t_s, _gapless(outcome.heading_deg), ".", markersize=1.0, color="C0", label=outcome.method)
        left.plot(truth.t_s, _gapless(truth.heading_deg), color="black", linewidth=0.8, label="truth")
        left.set_ylabel("heading °")
        left.legend(loc="upper right", fontsize="x-small")
        errors = errors_of(outcome, truth)
        right.plot(outcome.t_s, errors, color="C3", linewidth=0.6)
        if _knows_sigma(outcome):
            for sign in (-2.0, 2.0):
                right.plot(outcome.t_s, sign * outcome.sigma_deg, color="0.5", linewidth=0.6)
        largest = np.nanquantile(np.abs(errors), 0.995) if np.isfinite(errors).any() else 1.0
        right.set_ylim(-1.2 * largest - 0.1, 1.2 * largest + 0.1)
        right.axhline(0.0, color="black", linewidth=0.5)
        right.set_ylabel("error °")
        rmse = evaluation.measures[outcome.method].rmse_deg
        band = ", grey ±2 sigma" if _knows_sigma(outcome) else ""
        right.set_title(f"{outcome.method}: RMSE {rmse:.2f}°{band}", fontsize="small")
    for axis in axes[-1]:
        axis.set_xlabel("s")
    return figure


def _histogram(evaluation: Evaluation, truth: Truth) -> Any:
    figure = _figure(8.0, 5.0)
    axis = figure.subplots()
    errors = {outcome.method: errors_of(outcome, truth) for outcome in evaluation.outcomes}
    found = {method: error[np.isfinite(error)] for method, error in errors.items()}
    spreads = [np.quantile(np.abs(error), 0.95) for error in found.values() if len(error)]
    reach = max(0.5, 2.0 * float(np.median(spreads))) if spreads else 1.0
    for method, error in found.items():
        if len(error):
            inside = np.clip(error, -reach, reach)
            axis.hist(inside, bins=120, range=(-reach, reach), histtype="step", density=True, label=method)
    axis.set_xlabel("error ° (those beyond the edges are counted at them)")
    axis.set_ylabel("density")
    axis.set_title(f"{evaluation.name}: errors")
    axis.legend(fontsize="small")
    return figure


def _sigmas(evaluation: Evaluation, truth: Truth) -> Any:
    known = [outcome for outcome in evaluation.outcomes if _knows_sigma(outcome)]
    if not known:
        return None
    figure = _figure(1.0 + 3.4 * len(known), 4.0)
    for axis, outcome in zip(figure.subplots(1, len(known), squeeze=False)[0], known, strict=True):
        error = np.abs(errors_of(outcome, truth))
        axis.plot(outcome.sigma_deg, error, ".", markersize=1.5, alpha=0.4)
        reach = float(np.nanquantile(outcome.sigma_deg, 0.99)) * 1.1
        for factor, style in ((1.0, "-"), (2.0, "--")):
            axis.plot(
                [0.0, reach], [0.0, factor * reach], style, color="black", linewidth=0.8, label=f"{factor:.0f} sigma"
            )
        share = evaluation.measures[outcome.method].within_2_sigma
        axis.set_title(f"{outcome.method}: {100.0 * share:.0f} % within 2 sigma", fontsize="small")
        axis.set_xlabel("sigma °")
        axis.set_ylabel("|error| °")
        axis.set_xlim(0.0, reach)
        axis.legend(fontsize="x-small")
    figure.suptitle(evaluation.name)
    return figure


def _weights(evaluation: Evaluation) -> Any:
    weighed = next((outcome for outcome in evaluation.outcomes if outcome.weights.size), None)
    if weighed is None:
        return None
    figure = _figure(9.0, 1.0 + 1.3 * weighed.weights.shape[1])
    axes = figure.subplots(weighed.weights.shape[1], 1, squeeze=False, sharex=True)[:, 0]
    for number, (axis, weights) in enumerate(zip(axes, weighed.weights.T, strict=True), 1):
        axis.step(weighed.t_s, weights, where="post", linewidth=0.8)
        axis.set_ylim(-0.2, 3.2)
        axis.set_yticks([0, 1, 2, 3])
        axis.set_ylabel(f"w{number}")
    axes[-1].set_xlabel("s")
    figure.suptitle(f"{evaluation.name}: weights of stage 1 (3 ideal, 0 bad)")
    return figure


def _map(evaluation: Evaluation, truth: Truth) -> Any:
    places = [(o.method, o.lat_deg, o.lon_deg) for o in evaluation.outcomes if np.isfinite(o.lat_deg).any()]
    if np.isfinite(truth.lat_deg).any():
        places.append(("truth", truth.lat_deg, truth.lon_deg))
    if not places:
        return None
    figure = _figure(7.0, 7.0)
    axis = figure.subplots()
    for method, lat_deg, lon_deg in places:
        axis.plot(lon_deg, lat_deg, color="black" if method == "truth" else None, linewidth=0.9, label=method)
    axis.set_aspect(1.0 / np.cos(np.radians(_middle(places))))
    axis.ticklabel_format(useOffset=False)
    axis.tick_params(axis="x", rotation=30)
    axis.set_xlabel("longitude °")
    axis.set_ylabel("latitude °")
    axis.set_title(evaluation.name)
    axis.legend(fontsize="small")
    return figure


def _middle(places: list[tuple[str, Floats, Floats]]) -> float:
    return float(np.nanmedian(places[0][1]))
