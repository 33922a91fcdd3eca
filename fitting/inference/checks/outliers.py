"""Single readings far from the fit: points of curves, peaks, and whole experiments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import inverse_priors, prior_sigmas
from fitting.fit.fit import Fit
from fitting.fit.likelihood.descent import most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_with
from fitting.fit.linearisation import Linearisation
from fitting.fit.objective import Objective
from fitting.fit.solution import Solution
from fitting.inference.checks.curve_mistakes import solved_inside
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.inference.solved import Solved
from fitting.measurements.dataset import Dataset
from fitting.measurements.tones import Tones
from fitting.signal.chi_square import tail
from fitting.signal.misfit import IMPROBABLE, NOTICED, far_off, scaled_solution
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.finding import Finding, Kind, warning

#: Height of a model over the data below which no factor is reported.
LEAST = 1e-6
#: Factor on the standard deviation of a row that excludes it.
EXCLUDED = 1e6
#: Experiments that are left out in a fit: those that promise most.
TRIED = 2


# --- single rows ----------------------------------------------------------------------------------


def check_peaks(solved: Solved) -> Iterator[Finding]:
    """Peaks whose studentised residual exceeds the campaign's threshold, if nothing explains it.

    Algorithm 2 counts relative deviations alike, whatever their noise, and misses the exact ones;
    least squares are drawn to what is far off. An outlier is one in both.
    """
    if solved.causes:
        return
    solution, sigma = solved.solution, solved.noise.sigma
    fits = [
        Linearisation(
            rows=point.residuals / sigma,
            matrix=solution.matrix / sigma[:, np.newaxis],
            prior=prior_sigmas(solution.parameters, solution.nu),
        )
        for point in (solution.final, solved.likeliest)
    ]
    yield from outlying_peaks(solved.problem.data, solved.problem.threshold, fits)


def outlying_peaks(
    data: Dataset, threshold: float, fits: Sequence[Linearisation]
) -> Iterator[Finding]:
    """Peaks with |r/(sigma sqrt(1 - h))| beyond a threshold in every fit, h the leverage.

    Where the scatter of all rows is wider than the noise, the threshold is relative to it.

    Args:
        data: all measurements.
        threshold: in standard deviations.
        fits: rows, each over its own standard deviation, without what rows share.
    """
    lines = _lines(data)
    scores = np.array(
        [(fit.rows / np.sqrt(np.maximum(1.0 - fit.leverage, 0.05)))[list(lines)] for fit in fits]
    )
    if scores.shape[1] < 4:
        return
    wide = np.maximum(1.0, np.median(np.abs(scores), axis=1, keepdims=True) / 0.6745)
    relative = np.abs(scores / wide)
    score = scores[np.argmin(relative, axis=0), np.arange(scores.shape[1])]
    reduced = ("huber",) if data.outliers == "huber" else ()
    for k in np.argsort(-np.abs(score)):
        if np.min(relative[:, k]) > threshold:
            label, frequency_hz, is_phase = list(lines.values())[k]
            names = {"phase": ("phase",) if is_phase else (), "reduced": reduced}
            about = {"sigmas": float(score[k]), "frequency_hz": frequency_hz}
            yield warning(Kind.outlier, label, names, **about)


def _lines(data: Dataset) -> dict[int, tuple[str, float, bool]]:
    """Experiment, frequency (Hz) and whether it is a phase, by the number of the row of tones."""
    lines: dict[int, tuple[str, float, bool]] = {}
    for m, rows in zip(data.measurements, data.slices, strict=True):
        if isinstance(m, Tones):
            peaks = [(e.label, float(f)) for e in m.experiments for f in e.read_hz]
            both = [(*peak, is_phase) for is_phase in (False, True) for peak in peaks]
            lines.update(zip(range(rows.start, rows.stop), both, strict=False))
    return lines


def without_outliers(fit: Fit, adequacy: Adequacy) -> Adequacy:
    """The same; where single rows make up what looks like larger noise, these are named instead.

    Args:
        fit: a solved problem.
        adequacy: of its residuals.
    """
    if not adequacy.noise_factor > 1.0:
        return adequacy
    solution, known = fit.solution, fit.problem.data.sigma > 0.0
    try:
        inside = solved_inside(solution, solution.final.parameters)
    except (FmuFailure, NoScale):
        return adequacy
    columns, sigma = np.column_stack([solution.matrix, inside])[known], solution.noise.sigma[known]
    far = far_off(solution.final.residuals[known] / sigma, columns / sigma[:, None])
    if not far:
        return adequacy
    rows = tuple(int(k) for k in np.flatnonzero(known)[list(far)])
    return replace(adequacy, noise_factor=1.0, outliers=rows)


def single_rows(solved: Solved) -> Iterator[Finding]:
    """The rows far off that make up what looks like larger noise, each with its place.

    Args:
        solved: with the numbers of these rows.
    """
    data, residuals = solved.problem.data, solved.solution.final.residuals
    sigma, lines = solved.solution.noise.sigma, _lines(data)
    for k in () if solved.adequacy is None else solved.adequacy.outliers:
        [(m, at)] = [
            (m, at)
            for m, at in zip(data.measurements, data.slices, strict=True)
            if at.start <= k < at.stop
        ]
        numbers = {"sigmas": float(-residuals[k] / sigma[k])}
        curves = m.residual_curves(residuals[at])
        curve = next((c for c in curves if k - at.start in c.rows), None)
        name = "" if curve is None else curve.name
        if curve is not None and curve.axis.size:
            place = float(curve.axis[np.flatnonzero(curve.rows == k - at.start)[0]])
            numbers["time_s" if m.is_trace else "frequency_hz"] = place
        elif k in lines:
            name, numbers["frequency_hz"], _ = lines[k]
        subject = "/".join(filter(None, (m.series, name))) or "measurement"
        yield warning(Kind.outlier, subject, None, **numbers)


# --- whole experiments ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Refit:
    """Chi square of the rows that count, its degrees of freedom, and residuals of all rows (m,)."""

    chi_square: float
    freedom: float
    residuals: FloatArray

    @property
    def fits(self) -> bool:
        """Whether noise explains chi square, or nearly."""
        if self.freedom < 1.0:
            return False
        return (
            tail(self.chi_square, self.freedom) >= IMPROBABLE
            or self.chi_square <= NOTICED * self.freedom
        )

    @property
    def numbers(self) -> dict[str, float]:
        """Chi square and its degrees of freedom, by name."""
        return {"chi_square": self.chi_square, "freedom": self.freedom}


def refitted(solution: Solution, objective: Objective, excluded: IntArray) -> Refit:
    """The most likely point of an objective from a solution, without some rows.

    Args:
        solution: where the fit starts, with the noise of the rows.
        objective: of the same rows.
        excluded: numbers of rows that do not count.
    """
    sigma = solution.noise.sigma.copy()
    sigma[excluded] *= EXCLUDED
    noise = replace(solution.noise, sigma=sigma)
    evaluator = LikelihoodEvaluator(likelihood_with(objective, noise))
    optimum = most_likely(evaluator, [solution.final.x])
    rows = optimum.likelihood.residuals(optimum.expansion.sample.rows[: sigma.size])
    return Refit(optimum.chi_square, optimum.degrees_of_freedom - excluded.size, rows)


def outlying_experiment(solution: Solution) -> Iterator[Finding]:
    """The one experiment without which noise explains the rest.

    Args:
        solution: the end of a fit of three experiments or more.
    """
    groups: dict[str, list[int]] = {}
    for row, (label, _, _) in _lines(solution.objective.data).items():
        groups.setdefault(label, []).append(row)
    if len(groups) < 3:
        return
    rows = {label: np.array(mine, dtype=np.intp) for label, mine in groups.items()}
    promising = sorted(rows, key=lambda label: _promised(solution, rows[label]))[:TRIED]
    refits = {label: refitted(solution, solution.objective, rows[label]) for label in promising}
    good = [label for label, refit in refits.items() if refit.fits]
    if len(good) != 1:
        return
    [label] = good
    left = refits[label].residuals[rows[label]]
    # rows are model/data - 1
    factor = float(np.mean(1.0 / np.maximum(1.0 + left, LEAST)))
    yield warning(Kind.outlier, label, None, **refits[label].numbers, factor=factor)


def _promised(solution: Solution, excluded: IntArray) -> float:
    """Chi square of the linearised problem without some rows."""
    sigma = solution.noise.sigma.copy()
    sigma[excluded] *= EXCLUDED
    prior = inverse_priors(solution.parameters)
    stacked = np.vstack([solution.matrix / sigma[:, None], np.diag(prior)])
    target = np.append(solution.final.residuals / sigma, prior * solution.final.x)
    left = target - stacked @ scaled_solution(stacked, target)
    return float(left @ left)
