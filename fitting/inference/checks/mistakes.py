"""Mistakes of a measurement, and what they explain of a misfit.

What one mistake explains is named as its cause: single rows first; then a number that mends curves;
of a model that is refused also a drift the other way round, one experiment, and a factor on all
peaks, the first that explains it.

A mistake of one kind that one number a curve corrects is a gain, an offset, a shift, a noise level:

    min_(x, c) |r(x, c)|^2        c: a gain, an offset, a shift of the axis, a level of noise

r are the whitened rows of all measurements, the mistake corrected in one curve, or in every curve
by a number of its own: curves share parameters, so that a mistake in one shows in others. A cause
is named where it removes most of the chi square beyond its degrees of freedom, no other kind, nor
values of its own for each campaign, removes nearly as much, and what it leaves is noise by the rule
of `fitting.signal.misfit`. A shift may be many line widths: its search starts at the best one of a
scan. Shifts that differ between curves are tried only for curves with the same settings: a wrong
law of the settings shifts curves, too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter

import numpy as np
from scipy.linalg import block_diag
from scipy.special import lambertw

from fitting.campaign.parameters import inverse_priors, prior_sigmas, search_bounds
from fitting.fit.fit import Fit, Solution
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, Point, evaluate_many, jacobian
from fitting.fit.optimum import most_likely
from fitting.inference.agreement import share_apart
from fitting.inference.checks.solutions import Solved
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.dataset import Dataset, own_scale
from fitting.measurements.measurement import DivisibleResponse, Measurement
from fitting.measurements.residuals import ResidualCurve
from fitting.measurements.tones import ComplexTones, Tones
from fitting.signal.misfit import (
    IMPROBABLE,
    NOTICED,
    Misfit,
    correlation,
    excess_share,
    far_off,
    misfit_of,
    scaled_solution,
)
from fitting.signal.residual_tests import innovations
from fitting.signal.student import tail
from fitting.text.arrays import FloatArray, IntArray, Scalar
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.finding import Finding, Kind, warning

#: Share of the misfit that a cause may leave, and how many times as much every other kind leaves.
MOST_LEFT, CLEARLY = 0.3, 2.0
#: Share that a linear step may leave where a fit with the mistake follows; of how many kinds, of
#: how many parameters at most, steps of all and of its sizes alone, and halvings of a step.
WORTH_A_FIT, CANDIDATES, MOST_FITTED, STEPS, SIZE_STEPS, HALVINGS = 0.8, 2, 12, 6, 6, 4
#: Shifts that are tried, over the whole length of a curve.
SCANNED = 81
#: Curves of which each may have a mistake of its own, and from how many on not all are named.
MOST_CURVES, NAMED = 12, 4


@dataclass(frozen=True)
class _Curve:
    """A curve of a measurement, the `order`-th, with the numbers of its rows among all."""

    measurement: Measurement
    rows_of: slice
    order: int
    curve: ResidualCurve

    @property
    def rows(self) -> IntArray:
        return np.asarray(self.rows_of.start + self.curve.rows)

    @property
    def name(self) -> str:
        what = "experiments" if isinstance(self.measurement, Tones) else self.curve.name
        return "/".join(filter(None, (self.measurement.series, what))) or "measurement"

    @property
    def settings(self) -> dict[str, Scalar]:
        places = self.measurement.places
        return dict(places[self.order][1]) if self.order < len(places) else {}

    def at(self, residuals: FloatArray) -> ResidualCurve:
        """The curve for other residuals of all rows (m,)."""
        return self.measurement.residual_curves(residuals[self.rows_of])[self.order]


@dataclass(frozen=True)
class Trial:
    """A mistake of one kind in some curves, its sizes, and parameters x (n,): what is left.

    `rows` (m,) are whitened and corrected, `slopes` (m, k) theirs by the sizes, then by what
    measurements are solved for inside.
    """

    kind: Kind
    curves: tuple[_Curve, ...]
    sizes: FloatArray
    x: FloatArray
    chi_square: float = math.nan
    rows: FloatArray = field(default_factory=lambda: np.empty(0))
    slopes: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


#: What is left of the misfit, of a trial.
LEFT = attrgetter("chi_square")


def curve_mistake(solution: Solution, *, tones: bool, apart: float) -> Iterator[Finding]:
    """The mistake that mends curves, if it is of one kind alone.

    Args:
        solution: the end of a fit.
        tones: of peaks of experiments, else of all other curves.
        apart: share of the misfit that campaigns with values of their own leave.
    """
    data, residuals, x = solution.objective.data, solution.final.residuals, solution.final.x
    curves = [
        _Curve(m, at, order, curve)
        for m, at in zip(data.measurements, data.slices, strict=True)
        for order, curve in enumerate(m.residual_curves(residuals[at]))
        if curve.columns and isinstance(m, Tones) is tones
    ]
    # by kind: a mistake of each curve alone; last one of all curves, each of its own size
    by_kind: dict[Kind, list[Trial]] = {}
    for kind in dict.fromkeys(kind for each in curves for kind in each.curve.columns):
        mine = tuple(each for each in curves if kind in each.curve.columns)
        groups: list[tuple[_Curve, ...]] = [(each,) for each in mine]
        alike = kind is not Kind.shift or all(c.settings == mine[0].settings for c in mine)
        if 1 < len(mine) <= MOST_CURVES and alike:
            groups.append(mine)
        by_kind[kind] = [Trial(kind, group, np.zeros(len(group)), x) for group in groups]
    if not by_kind:
        return
    search, count = Search(solution, curves), residuals.size
    none = Trial(Kind.gain, (), np.empty(0), x)
    before = search.linear(none).chi_square
    tried = sorted(map(search.promising, by_kind.values()), key=LEFT)
    if excess_share(tried[0].chi_square, before, count) > WORTH_A_FIT:
        return
    if len(solution.parameters) <= MOST_FITTED:
        before = search.fitted(none).chi_square
        fits = [search.corrected_fit(by_kind[t.kind], before) for t in tried[:CANDIDATES]]
        tried = sorted([*fits, *tried[CANDIDATES:]], key=LEFT)
    best, *others = (excess_share(trial.chi_square, before, count) for trial in tried)
    is_clear = best <= MOST_LEFT and min([*others, apart]) >= CLEARLY * best
    if not (is_clear and search.leaves_noise(tried[0])):
        return
    trial, names = tried[0], [curve.name for curve in tried[0].curves]
    size = float(trial.sizes[np.argmax(np.abs(trial.sizes))])
    if trial.kind is Kind.noise_level:
        # the factor q on a density whose deviance 2 (q - 1 - ln q) has this signed root
        branch = -1 if size > 0.0 else 0
        size = float(-lambertw(-np.exp(-1.0 - 0.5 * size**2), branch).real) - 1.0
    numbers = {"size": size, "removed": 1.0 - best, "curves": float(len(names))}
    if trial.kind is Kind.shift:
        is_trace = trial.curves[0].measurement.is_trace
        numbers["time_s" if is_trace else "frequency_hz"] = size
    subject = ", ".join(names) if len(names) < NAMED else f"{names[0]} to {names[-1]}"
    yield warning(trial.kind, subject, None, **numbers)


class Search:
    """Fits with a mistake corrected, from the end of a fit."""

    def __init__(self, solution: Solution, curves: Sequence[_Curve]) -> None:
        self.solution, self.curves = solution, curves
        self.bounds = search_bounds(solution.parameters)
        self.inside = solved_inside(solution, solution.final)
        self.known = solution.objective.data.sigma > 0.0
        self.sigma = solution.noise.sigma.copy()
        for rows in (each.rows for each in curves):
            if not np.all(self.known[rows]):  # innovations estimate a noise that is not stated
                _, news = innovations(solution.final.residuals[rows])
                self.sigma[rows] = float(np.sqrt(np.mean(news**2))) or 1.0

    # --- one step of the linearised problem ---

    def promising(self, candidates: Sequence[Trial]) -> Trial:
        """The candidate of which a linear step leaves least, from no mistake or the best shift."""
        starts = [*candidates]
        for trial in candidates:
            if trial.kind is Kind.shift:
                sizes = np.array([self._scanned(curve) for curve in trial.curves])
                starts.append(replace(trial, sizes=sizes))
        return min(map(self.linear, starts), key=LEFT)

    def linear(self, trial: Trial) -> Trial:
        """One step of all parameters and sizes, of the linearised problem."""
        point = self.solution.final
        here = self._corrected(trial, point.residuals, self.inside)
        step, chi_square = self._step(here, self.solution.matrix)
        return replace(self._moved(here, step, 1.0), chi_square=chi_square)

    def _scanned(self, place: _Curve) -> float:
        """Shift of a curve that leaves least of it, parameters as they are."""
        curve, sigma = place.curve, self.sigma[place.rows]
        rows = self.solution.final.residuals[place.rows] / sigma
        course, columns = curve.course / sigma, (self.inside / self.sigma[:, None])[place.rows]
        columns = columns[:, np.any(columns != 0.0, axis=0)]

        def left(shift: float) -> float:
            moved = rows + curve.moved(course, shift) - course
            solved = curve.moved(columns, shift)
            residuals = moved - solved @ scaled_solution(solved, moved)
            return float(residuals @ residuals)

        half = 0.5 * float(np.ptp(curve.axis))
        return float(min(np.linspace(-half, half, SCANNED), key=left))

    def _step(self, here: Trial, matrix: FloatArray) -> tuple[FloatArray, float]:
        """Step of parameters, sizes and what is solved inside; chi square that it leaves."""
        slopes = _shifted(here, matrix) / self.sigma[:, None]
        prior = inverse_priors(self.solution.parameters)
        priors = np.hstack([np.diag(prior), np.zeros((prior.size, here.slopes.shape[1]))])
        stacked = np.vstack([np.column_stack([slopes, here.slopes]), priors])
        target = np.append(here.rows, prior * here.x)
        step = -scaled_solution(stacked, target)
        left = (target + stacked @ step)[: here.rows.size]
        return step, float(left @ left)

    def _moved(self, here: Trial, step: FloatArray, part: float) -> Trial:
        count = here.x.size
        x = np.clip(here.x + part * step[:count], *self.bounds)
        return replace(here, x=x, sizes=here.sizes + part * step[count : count + here.sizes.size])

    # --- fits ---

    def corrected_fit(self, candidates: Sequence[Trial], before: float) -> Trial:
        """A fit with the mistake of one curve, or of all where that does not explain the misfit."""
        alone = [trial for trial in candidates if len(trial.curves) == 1]
        fit = self.fitted(self.promising(alone))
        share = excess_share(fit.chi_square, before, self.sigma.size)
        if len(candidates) == len(alone) or share <= MOST_LEFT:
            return fit
        return self.fitted(self.promising(candidates[-1:]))

    def fitted(self, trial: Trial) -> Trial:
        """A fit of parameters and sizes, from a trial or from no mistake, whichever is better."""
        nothing = replace(trial, sizes=np.zeros(trial.sizes.size), x=self.solution.final.x)

        def direction(here: Trial) -> Callable[[float], Trial]:
            step, _ = self._step(here, jacobian(self.solution.objective, here.x))
            return lambda part: self.sized(self._moved(here, step, part))

        return _descend(min(map(self.sized, (trial, nothing)), key=LEFT), direction, STEPS)

    def sized(self, trial: Trial) -> Trial:
        """The best sizes, and the best values of what is solved inside, at parameters x."""
        [point] = evaluate_many(self.solution.objective, [trial.x])
        inside, count = solved_inside(self.solution, point), trial.sizes.size

        def at(sizes: FloatArray) -> Trial:
            here = self._corrected(replace(trial, sizes=sizes), point.residuals, inside)
            solved = here.slopes[:, count:]
            rows = here.rows - solved @ scaled_solution(solved, here.rows)
            return replace(here, rows=rows, chi_square=float(rows @ rows))

        def direction(here: Trial) -> Callable[[float], Trial]:
            step = -scaled_solution(here.slopes, here.rows)[:count]
            return lambda part: at(here.sizes + part * step)

        return _descend(at(trial.sizes), direction, SIZE_STEPS if count else 0)

    def _corrected(self, trial: Trial, residuals: FloatArray, inside: FloatArray) -> Trial:
        """The trial with its rows and slopes, for residuals of all rows."""
        rows, slopes = residuals.copy(), np.zeros((residuals.size, len(trial.curves)))
        for k, place in enumerate(trial.curves):
            curve, size = place.at(residuals), float(trial.sizes[k])
            column = curve.columns[trial.kind]
            if trial.kind is Kind.shift:
                rows[place.rows] += curve.moved(curve.course, size) - curve.course
                column = curve.moved(column, size)
            else:
                rows[place.rows] += size * column
            slopes[place.rows, k] = column
        columns = np.column_stack([slopes, _shifted(trial, inside)])
        return replace(trial, rows=rows / self.sigma, slopes=columns / self.sigma[:, None])

    def leaves_noise(self, trial: Trial) -> bool:
        """Whether noise explains all curves once the mistake is corrected.

        A mistake that is corrected to first order alone always leaves something.
        """
        if any(trial.kind in place.curve.first_order for place in trial.curves):
            return True
        here = self.sized(trial)
        noise = np.zeros(self.known.size, dtype=bool)
        for place in self.curves:
            rows, curve = place.rows, place.curve
            white = here.rows[rows] - curve.centre / self.sigma[rows]
            along = correlation(white, white * self.sigma[rows] * curve.share)
            if not along.misfit.describes:
                return False
            if along.misfit is Misfit.NONE:
                noise[rows] = self.known[rows]
        freedom = np.count_nonzero(noise) - trial.x.size - here.slopes.shape[1]
        if freedom < 1:
            return True
        square = float(np.sum(here.rows[noise] ** 2))
        return misfit_of(square, freedom, tail(square, freedom)) is Misfit.NONE


def _descend(
    start: Trial, direction: Callable[[Trial], Callable[[float], Trial]], steps: int
) -> Trial:
    """So many steps, each halved until chi square falls; less than one is no gain."""
    here = start
    for _ in range(steps):
        move = direction(here)
        tries = (move(0.5**k) for k in range(HALVINGS))
        better = next((trial for trial in tries if trial.chi_square < here.chi_square), None)
        if better is None:
            break
        gain, here = here.chi_square - better.chi_square, better
        if gain < 1.0:
            break
    return here


def _shifted(trial: Trial, columns: FloatArray) -> FloatArray:
    """Slopes (m, k) of all rows, those of shifted curves moved with them."""
    if trial.kind is not Kind.shift:
        return columns
    moved = columns.copy()
    for place, size in zip(trial.curves, trial.sizes, strict=True):
        moved[place.rows] = place.curve.moved(columns[place.rows], float(size))
    return moved


def solved_inside(solution: Solution, point: Point) -> FloatArray:
    """Derivatives (m, k) of all rows by scales taken from rows and what else is solved inside.

    Args:
        solution: the end of a fit.
        point: where.
    """
    data = solution.objective.data
    of_scale = point.residuals + data.measured_rows  # d r/d ln chi
    blocks = [
        np.where(data.series_of_rows == k, of_scale, 0.0)[:, None]
        for k, series in enumerate(data.series)
        if any(m.series == series and own_scale(m) for m in data.measurements)
    ]
    if data.solved_inside:
        [answer] = solution.objective.response.evaluate_many([point.parameters])
        columns = [
            m.solved_columns(prediction) if m.rows else np.empty((0, 0))
            for m, prediction in zip(data.measurements, answer.predictions, strict=True)
        ]
        blocks.append(block_diag(*columns))
    return np.hstack([np.empty((data.sigma.size, 0)), *blocks])


# --- readings, experiments, labels ----------------------------------------------------------------

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
    scores = np.array([fit.rows / np.sqrt(np.maximum(1.0 - fit.leverage, 0.05)) for fit in fits])
    scores = scores[:, list(lines)]
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
            for k in range(m.rows):  # phases follow all amplitudes
                lines[rows.start + k] = (*peaks[k % len(peaks)], k >= len(peaks))
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
        pairs = zip(data.measurements, data.slices, strict=True)
        m, at = next((m, at) for m, at in pairs if at.start <= k < at.stop)
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
            one, other = e.peaks_v[[i, k]], e.peaks_v[[k, i]]
            as_is = float(np.sum(((model - one) / (one * sigma)) ** 2))
            swapped = float(np.sum(((model - other) / (other * sigma)) ** 2))
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
        measurements = list(objective.data.measurements)
        for k, m in enumerate(measurements):
            if isinstance(m, Tones) and m.series == name:
                experiments = []
                for e in m.experiments:
                    settings = dict(e.settings)
                    for key in settings.keys() & ends.keys():
                        settings[key] = sum(ends[key]) - float(settings[key])
                    experiments.append(replace(e, settings=settings))
                measurements[k] = replace(m, experiments=tuple(experiments))
        reversed_tones = tuple(measurements)
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
