"""Why a model does not describe the data: a mistake that one number would mend.

    min_(x, c) |r + J x + C c|^2        C: a gain, an offset, a shift of the axis, a level of noise

One column C at a time is added to the problem linearised at its end, over the rows of one curve. A
cause is named where it removes most of what chi square has beyond its degrees of freedom, and no
other one removes nearly as much. Of single peaks each experiment is left out in turn, and the drift
is taken the other way round.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import inverse_priors, search_bounds
from fitting.fit.fit import Fit
from fitting.fit.likelihood.descent import most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_with
from fitting.fit.objective import Objective, evaluate_many, jacobian
from fitting.fit.solution import Solution
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.measurements.measurement import DivisibleResponse, Measurement
from fitting.measurements.residual_curve import ResidualCurve
from fitting.measurements.tones import Tones
from fitting.signal.chi_square import tail
from fitting.signal.misfit import (
    IMPROBABLE,
    NOTICED,
    excess_share,
    far_off,
    scaled_solution,
)
from fitting.signal.residual_tests import LAGS, autoregression
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.finding import Finding, Kind
from fitting.text.notation import hertz, number

#: Share of the misfit that a cause may leave, and how many times as much every other one leaves.
MOST_LEFT, CLEARLY = 0.3, 2.0
#: Share that a linear step may leave where a fit with the column is made; for how many candidates,
#: of how many parameters at most, steps of it, and halvings of a step.
WORTH_A_FIT, CANDIDATES, MOST_FITTED, STEPS, HALVINGS = 0.8, 2, 12, 6, 4
#: The same of the drift the other way round.
MOST_LEFT_TURNED = 0.1
#: Length of a column, what is fitted projected out of it, below which it is fitted already.
FITTED = 1e-6
#: Standard deviation of a row that counts for nothing.
NOTHING = 1e6
#: Experiments of which one is left out in a fit, those that promise most.
TRIED = 2


@dataclass(frozen=True)
class _Whole:
    """The problem linearised at its end, whitened: rows (m,), slopes (m + n, n), their basis."""

    rows: FloatArray
    sigma: FloatArray
    basis: FloatArray

    def left(self, values: FloatArray) -> FloatArray:
        """What a fit leaves of rows with those of the priors, (m + n,)."""
        return np.asarray(values - self.basis @ (self.basis.T @ values))


def causes_of(fit: Fit, adequacy: Adequacy | None) -> tuple[Finding, ...]:
    """What may be why, as findings; none where the residuals are what they should be.

    Args:
        fit: a solved problem.
        adequacy: of its residuals; None: nobody asked.
    """
    if adequacy is None or adequacy.against or adequacy.absent:
        return ()
    found = [*_single_rows(fit, adequacy)]
    if adequacy.describes and not adequacy.is_correlated:
        return tuple(found)
    try:
        found += _along_curves(fit.solution)
        if not found and not adequacy.describes:
            found += _of_experiments(fit)
    except (FmuFailure, NoScale, np.linalg.LinAlgError):  # where the model fails nothing is known
        return tuple(found)
    return tuple(found)


def without_outliers(fit: Fit, adequacy: Adequacy) -> Adequacy:
    """The same; where single rows make up what looks like larger noise, these instead of that.

    Args:
        fit: a solved problem.
        adequacy: of its residuals.
    """
    if not adequacy.noise_factor > 1.0:
        return adequacy
    solution, data = fit.solution, fit.problem.data
    known = data.sigma > 0.0
    try:
        columns = np.column_stack(
            [solution.matrix, _solved_inside(solution, solution.final.parameters)]
        )[known]
    except (FmuFailure, NoScale):
        return adequacy
    sigma = solution.noise.sigma[known]
    found = far_off(solution.final.residuals[known] / sigma, columns / sigma[:, None])
    if not found:
        return adequacy
    rows = tuple(int(k) for k in np.flatnonzero(known)[list(found)])
    return replace(adequacy, noise_factor=1.0, outliers=rows)


def cause_sentence(finding: Finding) -> str:
    """A cause, or what is far off, in words.

    Args:
        finding: of `causes_of`.
    """
    of, n = finding.subject or "The data", finding.numbers
    removed = f"removes {number(100.0 * n.get('removed', math.nan), 2)} % of the misfit"
    factor = number(1.0 + n.get("size", math.nan), 3)
    size = number(n.get("size", math.nan), 3)
    place = (
        hertz(n["frequency_hz"]) if "frequency_hz" in n else f"{n.get('time_s', math.nan):.6g} s"
    )
    said = {
        Kind.gain: f"{of}: a factor of {factor} on the model's output {removed}. Wanted the unit "
        "and the gain of the read-out, or a gain that is fitted.",
        Kind.offset: f"{of}: an offset of {size} {removed}. Wanted an offset or a background that "
        "is fitted.",
        Kind.shift: f"{of}: a shift of its axis by {size} {removed}. Wanted the frequency, or the "
        "time, of the measurement.",
        Kind.noise_level: f"{of}: {factor} times the level of the noise {removed}. Wanted the "
        "temperature, the mass and the read-out.",
        Kind.drift_exchanged: f"{of}: fits with the values before and after the series exchanged. "
        "Wanted their order.",
    }
    if finding.kind is not Kind.outlier:
        return said[finding.kind]
    if "chi_square" in n:
        return (
            f"{of}: without it χ² is {number(n['chi_square'], 3)} on {number(n['freedom'], 3)}: "
            f"its peaks are {number(n['factor'], 3)} times as high as the others make likely."
        )
    return f"{of}: the point at {place} is {number(n['sigmas'], 3)} standard deviations off."


def _single_rows(fit: Fit, adequacy: Adequacy) -> Iterator[Finding]:
    data, point = fit.problem.data, fit.solution.final
    sigma = fit.solution.noise.sigma
    for k in adequacy.outliers:
        for m, at in zip(data.measurements, data.slices, strict=True):
            if not at.start <= k < at.stop:
                continue
            curves = m.residual_curves(point.residuals[at])
            curve = next((c for c in curves if k - at.start in c.rows), None)
            numbers = {"sigmas": float(-point.residuals[k] / sigma[k])}
            name = "" if curve is None else curve.name
            if curve is not None and curve.axis.size:
                place = float(curve.axis[np.flatnonzero(curve.rows == k - at.start)[0]])
                numbers["time_s" if m.is_trace else "frequency_hz"] = place
            elif isinstance(m, Tones):
                name, numbers["frequency_hz"] = _line(m, k - at.start)
            subject = "/".join(filter(None, (m.series, name))) or "measurement"
            yield Finding(kind=Kind.outlier, severity="warning", subject=subject, numbers=numbers)


def _line(tones: Tones, row: int) -> tuple[str, float]:
    """Experiment and frequency of the line of a row."""
    lines = [(e.label, float(f)) for e in tones.experiments for f in e.read_hz]
    return lines[row % len(lines)]


def _along_curves(solution: Solution) -> Iterator[Finding]:
    data = solution.objective.data
    for m, at in zip(data.measurements, data.slices, strict=True):
        for k, curve in enumerate(m.residual_curves(solution.final.residuals[at])):
            if not curve.columns:
                continue
            found = _cause(solution, at.start + curve.rows, curve, (m, at, k))
            if found is not None:
                kind, size, removed = found
                yield Finding(
                    kind=kind,
                    severity="warning",
                    subject="/".join(filter(None, (m.series, curve.name))) or "measurement",
                    numbers={"size": size, "removed": removed},
                )


def _cause(
    solution: Solution,
    mine: IntArray,
    curve: ResidualCurve,
    at: tuple[Measurement, slice, int],
) -> tuple[Kind, float, float] | None:
    """The one column that mends a curve: its kind, size, and the share that it removes."""
    whole = _whole(solution, mine)
    rows = np.append(whole.rows, np.zeros(whole.basis.shape[0] - whole.rows.size))
    left = whole.left(rows)
    before = float(left[mine] @ left[mine])
    tried: list[tuple[float, Kind, float]] = []
    for kind, column in curve.columns.items():
        c = np.zeros(rows.size)
        c[mine] = column / whole.sigma[mine]
        apart = whole.left(c)
        if not np.linalg.norm(apart) > FITTED * np.linalg.norm(c):
            continue
        size = -float(apart @ left) / float(apart @ apart)
        after = left[mine] + size * apart[mine]
        tried.append((excess_share(float(after @ after), before, mine.size), kind, size))
    if not tried:
        return None
    tried.sort(key=lambda each: each[0])
    if tried[0][0] > WORTH_A_FIT:
        return None
    if len(solution.parameters) <= MOST_FITTED:
        fits = (_mended(solution, at, mine, kind) for _, kind, _ in tried[:CANDIDATES])
        tried = sorted([*fits, *tried[CANDIDATES:]], key=lambda each: each[0])
    rest, kind, size = tried[0]
    others = min((each[0] for each in tried[1:]), default=1.0)
    if rest > MOST_LEFT or others < CLEARLY * rest:
        return None
    return kind, size, 1.0 - rest


def _mended(
    solution: Solution, at: tuple[Measurement, slice, int], mine: IntArray, kind: Kind
) -> tuple[float, Kind, float]:
    """A fit with the number of a column beside the parameters: share that it leaves, kind, size."""
    objective, parameters = solution.objective, solution.parameters
    measurement, place, order = at
    lower, upper = search_bounds(parameters)
    held, sigma = inverse_priors(parameters), _sigma(solution, mine)

    def columns_at(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows, and the column beside what is solved inside: what is linear beside x."""
        [point] = evaluate_many(objective, [x])
        column = np.zeros(sigma.size)
        column[mine] = measurement.residual_curves(point.residuals[place])[order].columns[kind]
        linear = np.column_stack([column, _solved_inside(solution, point.parameters)])
        return point.residuals / sigma, linear / sigma[:, None]

    def left_at(x: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        rows, linear = columns_at(x)
        size = -scaled_solution(linear, rows)
        return rows + linear @ size, linear, float(size[0])

    x = solution.final.x
    before = solution.final.residuals[mine] / sigma[mine]
    left, linear, size = left_at(x)
    for _ in range(STEPS):
        matrix = np.column_stack([jacobian(objective, x) / sigma[:, None], linear])
        priors = np.hstack([np.diag(held), np.zeros((held.size, linear.shape[1]))])
        stacked, target = np.vstack([matrix, priors]), np.append(left, held * x)
        step = -scaled_solution(stacked, target)
        trials = (np.clip(x + 0.5**k * step[: x.size], lower, upper) for k in range(HALVINGS))
        better = next(
            ((y, *found) for y in trials if np.sum((found := left_at(y))[0] ** 2) < left @ left),
            None,
        )
        if better is None:
            break
        gained = left @ left - better[1] @ better[1]
        x, left, linear, size = better
        if gained < 1.0:
            break
    after = float(left[mine] @ left[mine])
    return excess_share(after, float(before @ before), float(mine.size)), kind, size


def _sigma(solution: Solution, mine: IntArray) -> FloatArray:
    """Noise of all rows, (m,); what a curve leaves at random tells its own where nobody does."""
    data, sigma = solution.objective.data, solution.noise.sigma.copy()
    if not np.all(data.sigma[mine] > 0.0):
        residuals = solution.final.residuals[mine]
        news = residuals.copy()
        for lag, a in enumerate(autoregression(news, min(LAGS, news.size // 5)), start=1):
            news[lag:] -= a * residuals[:-lag]
        sigma[mine] = float(np.sqrt(np.mean(news**2))) or 1.0
    return sigma


def _whole(solution: Solution, mine: IntArray) -> _Whole:
    """The linearised problem, with the noise of one curve."""
    sigma, residuals = _sigma(solution, mine), solution.final.residuals
    inside = _solved_inside(solution, solution.final.parameters)
    columns = np.column_stack([solution.matrix, inside]) / sigma[:, None]
    held = inverse_priors(solution.parameters)
    priors = np.column_stack([np.diag(held), np.zeros((held.size, inside.shape[1]))])
    stacked = np.vstack([columns, priors])
    sizes = np.linalg.norm(stacked, axis=0)
    left, singular, _ = np.linalg.svd(stacked / np.where(sizes, sizes, 1.0), full_matrices=False)
    basis = left[:, singular > FITTED * max(singular.max(initial=0.0), FITTED)]
    return _Whole(rows=residuals / sigma, sigma=sigma, basis=basis)


def _solved_inside(solution: Solution, parameters: FloatArray) -> FloatArray:
    """Derivatives (m, k) of all rows by what is solved inside them, at parameters (n,)."""
    data = solution.objective.data
    if not data.solved_inside:
        return np.empty((data.sigma.size, 0))
    [answer] = solution.objective.response.evaluate_many([parameters])
    blocks = []
    pairs = zip(data.measurements, data.slices, answer.predictions, strict=True)
    for m, at, prediction in pairs:
        columns = m.solved_columns(prediction) if m.rows else np.empty((0, 0))
        block = np.zeros((data.sigma.size, columns.shape[1]))
        block[at] = columns
        blocks.append(block)
    return np.hstack(blocks)


# --- single peaks -------------------------------------------------------------------------------


def _of_experiments(fit: Fit) -> list[Finding]:
    """Drift the other way round, else the experiment without which the rest fits."""
    if not fit.problem.data.tones:
        return []
    exchanged = _exchanged(fit)
    return [exchanged] if exchanged is not None else [*_left_out(fit)]


@dataclass(frozen=True)
class _Refit:
    """Chi square of the rows that count, its freedom, and residuals of all rows, (m,)."""

    square: float
    freedom: float
    residuals: FloatArray

    @property
    def fits(self) -> bool:
        """Whether noise explains chi square, or nearly."""
        if self.freedom < 1.0:
            return False
        return (
            tail(self.square, self.freedom) >= IMPROBABLE or self.square <= NOTICED * self.freedom
        )

    @property
    def numbers(self) -> dict[str, float]:
        """Chi square and freedom, by name."""
        return {"chi_square": self.square, "freedom": self.freedom}


def _refitted(objective: Objective, fit: Fit, without: IntArray) -> _Refit:
    """A fit in which some rows count for nothing."""
    noise = fit.solution.noise
    sigma = noise.sigma.copy()
    sigma[without] *= NOTHING
    evaluator = LikelihoodEvaluator(likelihood_with(objective, replace(noise, sigma=sigma)))
    found = most_likely(evaluator, [fit.solution.final.x])
    rows = found.likelihood.residuals(found.expansion.sample.rows[: sigma.size])
    return _Refit(found.chi_square, found.degrees_of_freedom - without.size, rows)


def _exchanged(fit: Fit) -> Finding | None:
    """That the values before and after a series have changed places."""
    objective = fit.solution.objective
    response = objective.response
    if not isinstance(response, DivisibleResponse):
        return None
    for name, bound in fit.problem.campaigns.items():
        if not any(before != after for before, after in bound.drift.ends.values()):
            continue
        turned = tuple(
            _turned(m, bound.drift.ends) if isinstance(m, Tones) and m.series == name else m
            for m in objective.data.measurements
        )
        other = replace(
            objective,
            response=response.answering(turned),
            data=replace(objective.data, measurements=turned),
        )
        nothing = np.empty(0, dtype=np.intp)
        refit, before = _refitted(other, fit, nothing), _refitted(objective, fit, nothing)
        left = excess_share(refit.square, before.square, refit.freedom)
        if refit.fits or left < MOST_LEFT_TURNED:  # a drift that bends leaves some
            return Finding(
                kind=Kind.drift_exchanged,
                severity="warning",
                subject=name or "drift",
                numbers=refit.numbers,
            )
    return None


def _turned(tones: Tones, ends: Mapping[str, tuple[float, float]]) -> Measurement:
    """Tones under a drift from its last values to its first."""
    experiments = tuple(
        replace(
            e,
            settings={
                name: sum(ends[name]) - float(value) if name in ends else value
                for name, value in e.settings.items()
            },
        )
        for e in tones.experiments
    )
    return replace(tones, experiments=experiments)


def _left_out(fit: Fit) -> Iterator[Finding]:
    """The experiment without which noise explains the rest, if it is one alone."""
    groups = _experiment_rows(fit.solution.objective.data.measurements, fit)
    if len(groups) < 3:
        return
    promising = sorted(groups, key=lambda label: _without(fit.solution, groups[label]))[:TRIED]
    found = []
    for label in promising:
        refit = _refitted(fit.solution.objective, fit, groups[label])
        if refit.fits:
            found.append((label, refit))
    if len(found) != 1:
        return
    [(label, refit)] = found
    # rows are model/data - 1
    factor = float(np.mean(1.0 / np.maximum(1.0 + refit.residuals[groups[label]], FITTED)))
    yield Finding(
        kind=Kind.outlier,
        severity="warning",
        subject=label,
        numbers={**refit.numbers, "factor": factor},
    )


def _experiment_rows(measurements: Sequence[Measurement], fit: Fit) -> dict[str, IntArray]:
    """Rows of every experiment, by its label."""
    found: dict[str, IntArray] = {}
    for m, at in zip(measurements, fit.problem.data.slices, strict=True):
        if not isinstance(m, Tones):
            continue
        labels = np.array([e.label for e in m.experiments for _ in e.read_hz])
        halves = np.tile(labels, m.rows // max(labels.size, 1))
        for e in m.experiments:
            found[e.label] = at.start + np.flatnonzero(halves == e.label)
    return found


def _without(solution: Solution, mine: IntArray) -> float:
    """Chi square of the linearised problem without some rows."""
    sigma = solution.noise.sigma.copy()
    sigma[mine] *= NOTHING
    rows, matrix = solution.final.residuals / sigma, solution.matrix / sigma[:, None]
    held = inverse_priors(solution.parameters)
    stacked = np.vstack([matrix, np.diag(held)])
    target = np.append(rows, held * solution.final.x)
    left = target - stacked @ scaled_solution(stacked, target)
    return float(left @ left)
