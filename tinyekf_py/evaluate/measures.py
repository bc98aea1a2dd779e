"""How good a heading was, in numbers: errors against the truth, and what the method said of its own uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tinyekf_py.evaluate.outcome import Outcome
from tinyekf_py.evaluate.truth import Floats, Truth, wrap_deg

#: One error in so many rows is kept for the quantiles of pooled runs: errors are correlated for longer than that.
_KEPT_EVERY = 10


@dataclass(frozen=True, slots=True)
class Measures:
    """Errors of one method on one recording, or on several pooled. NaN where a thing cannot be said.

    Judged are the rows at which the truth is known, after the skipped beginning.
    """

    rows: int  #: judged rows with a heading
    rmse_deg: float
    p95_deg: float  #: 95 % of the absolute errors are below
    max_deg: float
    bias_deg: float  #: mean error; positive: heading too large
    availability: float  #: share of the rows since the first fix that have a heading
    within_2_sigma: float  #: share of the errors below two of the method's own standard deviations
    nees: float  #: mean of (error / sigma) squared: 1 when sigma is honest
    nis: float  #: mean normalised innovation squared of the heading, per degree of freedom
    correlation_s: float  #: lag at which the errors' autocorrelation has fallen to 1/e
    step_deg: float  #: greatest change of the heading between two rows that the boat did not make
    seconds: float  #: the time it took
    worst_rmse_deg: float  #: of the pooled runs
    kept_errors_deg: NDArray[np.float32]  #: errors once a second


def errors_of(outcome: Outcome, truth: Truth) -> Floats:
    """Heading minus truth at every row, degrees (-180, 180]; NaN where either is unknown."""
    return wrap_deg(outcome.heading_deg - truth.heading_at(outcome.t_s))


def measure(outcome: Outcome, truth: Truth, *, skip_s: float = 0.0, first_fix_s: float = np.nan) -> Measures:
    """Judge `outcome`, but for the first `skip_s` seconds of the recording; availability counts from the first fix."""
    true_deg = truth.heading_at(outcome.t_s)
    judged = np.isfinite(true_deg) & (outcome.t_s >= skip_s)
    errors = errors_of(outcome, truth)
    errors[~judged] = np.nan
    found = errors[np.isfinite(errors)]
    due = judged & (outcome.t_s > (first_fix_s if np.isfinite(first_fix_s) else -np.inf))
    ratio = errors / outcome.sigma_deg
    ratio = ratio[np.isfinite(ratio)]
    steps = np.abs(wrap_deg(np.diff(errors)))
    rmse = float(np.sqrt(np.mean(found**2))) if len(found) else np.nan
    return Measures(
        rows=len(found),
        rmse_deg=rmse,
        p95_deg=float(np.quantile(np.abs(found), 0.95)) if len(found) else np.nan,
        max_deg=float(np.max(np.abs(found))) if len(found) else np.nan,
        bias_deg=float(np.mean(found)) if len(found) else np.nan,
        availability=float(np.mean(np.isfinite(outcome.heading_deg[due]))) if due.any() else np.nan,
        within_2_sigma=float(np.mean(np.abs(ratio) <= 2.0)) if len(ratio) else np.nan,
        nees=float(np.mean(ratio**2)) if len(ratio) else np.nan,
        nis=outcome.mean_nis,
        correlation_s=correlation_time_s(errors, float(np.median(np.diff(outcome.t_s)))) if len(found) > 2 else np.nan,
        step_deg=float(np.nanmax(steps)) if np.isfinite(steps).any() else np.nan,
        seconds=outcome.seconds,
        worst_rmse_deg=rmse,
        kept_errors_deg=found[::_KEPT_EVERY].astype(np.float32),
    )


def correlation_time_s(errors: Floats, step_s: float) -> float:
    """The first lag, seconds, at which the autocorrelation of `errors` (one every `step_s`, NaN unknown) is below 1/e.

    About their mean; a constant, and errors that stay correlated to the end of half the run, give NaN.
    """
    known = np.isfinite(errors)
    if known.sum() < 3:
        return np.nan
    centred = np.where(known, errors - np.mean(errors[known]), 0.0)
    size = 2 * len(errors)
    products = np.fft.irfft(np.abs(np.fft.rfft(centred, size)) ** 2, size)[: len(errors) // 2]
    pairs = np.round(np.fft.irfft(np.abs(np.fft.rfft(known.astype(float), size)) ** 2, size)[: len(errors) // 2])
    variance = products[0] / pairs[0]
    if not variance > 1e-12:
        return np.nan
    correlation = products / np.maximum(pairs, 1.0) / variance
    below = np.flatnonzero((correlation < np.exp(-1.0)) & (pairs > 0))
    return float(below[0] * step_s) if len(below) else np.nan


def pool(runs: Sequence[Measures]) -> Measures:
    """One `Measures` of several runs: every row counts the same; maxima are the greatest, times the mean."""
    if len(runs) == 1:
        return runs[0]
    counts = np.array([run.rows for run in runs], float)

    def mean(name: str, weights: Floats | None = None) -> float:
        values = np.array([getattr(run, name) for run in runs])
        known = np.isfinite(values) & ((counts if weights is None else weights) > 0)
        if not known.any():
            return np.nan
        return float(np.average(values[known], weights=(counts if weights is None else weights)[known]))

    def greatest(name: str) -> float:
        values = np.array([getattr(run, name) for run in runs])
        return float(np.nanmax(values)) if np.isfinite(values).any() else np.nan

    kept = np.concatenate([run.kept_errors_deg for run in runs])
    mean_square = (
        mean("rmse_deg")
        if not counts.any()
        else float(np.sum([run.rows * run.rmse_deg**2 for run in runs if run.rows]) / counts.sum())
    )
    ones = np.ones(len(runs))
    return replace(
        runs[0],
        rows=int(counts.sum()),
        rmse_deg=float(np.sqrt(mean_square)),
        p95_deg=float(np.quantile(np.abs(kept), 0.95)) if len(kept) else np.nan,
        max_deg=greatest("max_deg"),
        bias_deg=mean("bias_deg"),
        availability=mean("availability", ones),
        within_2_sigma=mean("within_2_sigma"),
        nees=mean("nees"),
        nis=mean("nis"),
        correlation_s=mean("correlation_s"),
        step_deg=greatest("step_deg"),
        seconds=mean("seconds", ones),
        worst_rmse_deg=greatest("worst_rmse_deg"),
        kept_errors_deg=kept,
    )
