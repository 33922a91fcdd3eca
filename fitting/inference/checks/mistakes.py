"""Mistakes of a measurement: single readings far off, exchanged labels, drift or phases.

What one mistake explains of a misfit is named as its cause: single rows first; then a number that
mends curves (`fitting.inference.checks.curve_mistakes`); of a model that is refused also a drift
the other way round, one experiment, and a factor on all peaks, the first that explains it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import inverse_priors, prior_sigmas
from fitting.fit.fit import Fit
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.fit.optimum import most_likely
from fitting.fit.solution import Solution
from fitting.inference.checks.curve_mistakes import MOST_LEFT, curve_mistake, solved_inside
from fitting.inference.joint import share_apart
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.inference.solved import Solved
from fitting.measurements.complex.tones import ComplexTones
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import DivisibleResponse
from fitting.measurements.tones import Tones
from fitting.signal.chi_square import tail
from fitting.signal.misfit import IMPROBABLE, NOTICED, excess_share, far_off, scaled_solution
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.finding import Finding, Kind, warning

#: Height of a model over the data below which no factor is reported.
LEAST = 1e-6
#: Factor on the standard deviation of a row that excludes it.
EXCLUDED = 1e6
#: Experiments that are left out in a fit: those that promise most.
TRIED = 2
#: Chi square of two peaks from which they may be exchanged, and what is left if they are.
SWAPPED_BEYOND, SWAPPED_SHARE = 50.0, 0.1
#: Share of the misfit that the drift the other way round may leave.
MOST_LEFT_REVERSED = 0.1
#: Factors on phases that a mistake makes, and what their numbers are then.
READINGS = {-1.0: "reversed", 180.0 / math.pi: "radian", math.pi / 180.0: "degree"}
#: Residuals, in their noise or as a share where that is unknown, from which phases are suspected.
DOUBTFUL, DOUBTFUL_SHARE = 3.0, 0.1
#: Share of chi square that a reading may leave to be named.
MOST_LEFT_READ = 0.1


# --- single rows ----------------------------------------------------------------------------------


def check_peaks(solved: Solved) -> Iterator[Finding]:
    """Peaks whose studentised residual exceeds the campaign's threshold, if nothing explains it.

    Values of its own for each campaign explain it where they leave little: they contradict then.
    Algorithm 2 counts relative deviations alike, whatever their noise, and misses the exact ones;
    least squares are drawn to what is far off. An outlier is one in both.
    """
    if solved.causes or share_apart(solved.joint) <= MOST_LEFT:
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

    What is next to each other on a curve is no single row: a part of the data is off then, which
    the model does not describe.

    Args:
        fit: a solved problem.
        adequacy: of its residuals.
    """
    if not adequacy.noise_factor > 1.0:
        return adequacy
    solution, known = fit.solution, fit.problem.data.sigma > 0.0
    try:
        inside = solved_inside(solution, solution.final)
    except (FmuFailure, NoScale):
        return adequacy
    columns, sigma = np.column_stack([solution.matrix, inside])[known], solution.noise.sigma[known]
    white = solution.final.residuals[known] / sigma
    readings = _readings(fit.problem.data, solution.final.residuals)[known]
    far = far_off(white, columns / sigma[:, None], readings)
    if not far:
        return adequacy
    if np.any(np.diff(np.unique(readings[list(far)])) == 1):
        return replace(adequacy, noise_factor=1.0, describes=False, is_uneven=True)
    rows = tuple(int(k) for k in np.flatnonzero(known)[list(far)])
    return replace(adequacy, noise_factor=1.0, outliers=rows)


def _readings(data: Dataset, residuals: FloatArray) -> IntArray:
    """Number of the reading that each row is of, (m,); next numbers are next on a curve."""
    readings, free = 2 * np.arange(residuals.size), 2 * residuals.size
    first: dict[str, int] = {}
    for row, (label, _, _) in _lines(data).items():  # one mistake puts all peaks of one too high
        readings[row] = first.setdefault(label, int(readings[row]))
    for m, at in zip(data.measurements, data.slices, strict=True):
        for curve in m.residual_curves(residuals[at]):
            if curve.axis.size:
                places, order = np.unique(curve.axis, return_inverse=True)
                readings[at.start + curve.rows] = free + order
                free += places.size + 1
    return readings


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
        subject = "/".join(filter(None, (m.series, name))) or "measurement"
        if curve is not None and curve.axis.size:
            place = float(curve.axis[np.flatnonzero(curve.rows == k - at.start)[0]])
            numbers["time_s" if m.is_trace else "frequency_hz"] = place
        elif k in lines:
            subject, numbers["frequency_hz"], _ = lines[k]  # its series is in the label
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


def refit_of(solution: Solution, objective: Objective, excluded: IntArray) -> Refit:
    """The most likely point of an objective from a solution, without some rows.

    Args:
        solution: where the fit starts, with the noise of the rows.
        objective: of the same rows.
        excluded: numbers of rows that do not count.
    """
    sigma = solution.noise.sigma.copy()
    sigma[excluded] *= EXCLUDED
    noise = replace(solution.noise, sigma=sigma)
    evaluator = LikelihoodEvaluator(likelihood_of(objective, noise))
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

    def left_by(label: str) -> float:
        """Chi square of the linearised problem without an experiment."""
        sigma, prior = solution.noise.sigma.copy(), inverse_priors(solution.parameters)
        sigma[rows[label]] *= EXCLUDED
        stacked = np.vstack([solution.matrix / sigma[:, None], np.diag(prior)])
        target = np.append(solution.final.residuals / sigma, prior * solution.final.x)
        remaining = target - stacked @ scaled_solution(stacked, target)
        return float(remaining @ remaining)

    promising = sorted(rows, key=left_by)[:TRIED]
    refits = {label: refit_of(solution, solution.objective, rows[label]) for label in promising}
    good = [label for label, refit in refits.items() if refit.fits]
    if len(good) != 1:
        return
    [label] = good
    left = refits[label].residuals[rows[label]]
    # rows are model/data - 1
    factor = float(np.mean(1.0 / np.maximum(1.0 + left, LEAST)))
    yield warning(Kind.outlier, label, None, **refits[label].numbers, factor=factor)


# --- exchanges ------------------------------------------------------------------------------------


def check_exchanged_peaks(solved: Solved) -> Iterator[Finding]:
    """Experiments whose peaks fit far better with two of them exchanged."""
    if solved.causes or share_apart(solved.joint) <= MOST_LEFT:
        return
    sigmas = solved.problem.data.peaks_of_rows(solved.noise.sigma)
    peaks = solved.problem.data.peaks(solved.solution.final.scaled)
    rows = iter(zip(peaks, sigmas, strict=True))
    for e in solved.problem.experiments:
        mine = np.array([next(rows) for _ in e.read_hz])
        for i, k in itertools.combinations(range(len(e.read_hz)), 2):
            model, sigma = mine[[i, k]].T
            as_is, swapped = (
                float(np.sum(((model - measured) / (measured * sigma)) ** 2))
                for measured in (e.peaks_v[[i, k]], e.peaks_v[[k, i]])
            )
            if as_is > SWAPPED_BEYOND and swapped < SWAPPED_SHARE * as_is:
                one_hz, other_hz = float(e.read_hz[i]), float(e.read_hz[k])
                yield warning(Kind.peaks_exchanged, e.label, one_hz=one_hz, other_hz=other_hz)


def exchanged_drift(solved: Solved) -> Iterator[Finding]:
    """That the values of a drift before and after its series are exchanged.

    Args:
        solved: with experiments under a drift.
    """
    solution, objective = solved.solution, solved.solution.objective
    response, everything = objective.response, np.empty(0, dtype=np.intp)
    if not isinstance(response, DivisibleResponse):
        return
    for name, bound in solved.problem.campaigns.items():
        ends = bound.drift.ends
        if not any(before != after for before, after in ends.values()):
            continue
        reversed_tones = tuple(
            replace(
                m,
                experiments=tuple(
                    replace(
                        e,
                        settings={
                            key: sum(ends[key]) - float(value) if key in ends else value
                            for key, value in e.settings.items()
                        },
                    )
                    for e in m.experiments
                ),
            )
            if isinstance(m, Tones) and m.series == name
            else m
            for m in objective.data.measurements
        )
        other = replace(
            objective,
            response=response.answering(reversed_tones),
            data=replace(objective.data, measurements=reversed_tones),
        )
        refit = refit_of(solution, other, everything)
        before = refit_of(solution, objective, everything)
        left = excess_share(refit.chi_square, before.chi_square, refit.freedom)
        if refit.fits or left < MOST_LEFT_REVERSED:  # a drift that bends leaves some
            yield warning(Kind.drift_exchanged, name or "drift", None, **refit.numbers)
            return


def check_phases(solved: Solved) -> Iterator[Finding]:
    """Phases that fit far better with another sign or unit: each reading is fitted."""
    solution, data = solved.solution, solved.data

    def chi_square(k: int, read: ComplexTones) -> float:
        measurements = (*data.measurements[:k], read, *data.measurements[k + 1 :])
        other = replace(solution.objective, data=replace(data, measurements=measurements))
        likelihood = likelihood_of(other, RowNoise(solved.noise.sigma, solved.noise.common))
        starts = [solution.final.x, solution.initial.x]
        return most_likely(LikelihoodEvaluator(likelihood), starts).chi_square

    for k, m in enumerate(data.measurements):
        if not isinstance(m, ComplexTones):
            continue
        limit = np.where(m.sigma > 0.0, DOUBTFUL * m.sigma, DOUBTFUL_SHARE)
        if float(np.mean((solution.final.residuals[data.slices[k]] / limit) ** 2)) < 1.0:
            continue
        as_is = chi_square(k, m)
        for factor, reading in READINGS.items():
            other = chi_square(k, m.read_as(factor))
            if other < MOST_LEFT_READ * as_is:
                names = {"reading": (reading,)}
                yield warning(Kind.phases_misread, m.series, names, improvement=as_is / other)


# --- causes of a misfit ---------------------------------------------------------------------------


def causes_of(solved: Solved) -> tuple[Finding, ...]:
    """The mistakes that explain a misfit; none where the residuals are what they should be.

    Single rows first; then a number that mends curves; of a model that is refused also a drift the
    other way round, one experiment, and a factor on all peaks, the first that explains it.

    Args:
        solved: with what is known of the residuals.
    """
    adequacy = solved.adequacy
    if adequacy is None or adequacy.rival is not None or adequacy.no_line:
        return ()
    causes = [*single_rows(solved)]
    if adequacy.describes and not adequacy.is_correlated:
        return tuple(causes)
    solution, apart = solved.solution, share_apart(solved.joint)
    try:
        causes += curve_mistake(solution, tones=False, apart=apart)
        if not causes and not adequacy.describes and solved.problem.data.tones:
            causes += [*exchanged_drift(solved)] or [*outlying_experiment(solution)]
        if not causes and not adequacy.describes:
            causes += curve_mistake(solution, tones=True, apart=apart)
    except (FmuFailure, NoScale, np.linalg.LinAlgError):  # where the model fails nothing is known
        pass
    return tuple(causes)
