"""What values rest on: start values that were not measured, and assumptions of a campaign.

Let t be start values that were not measured and T = V^-1/2 dr/dt, next to the whitened derivatives
W of the fit. With t free the covariance is

    C' = ([W T]^T [W T] + P)^-1,     P the prior of the parameters alone

Where C'_ii is about C_ii, a wrong t would show in the residuals. Where it is much larger, another t
with other values fits as well. T follows the power with which t acts: a coupling of zero moves
lines by its fourth.

Let r be the whitened rows at the solution x. With something else in place of what is assumed the
rows are r', and the fit moves by

    dx = -(W^T W + P)^-1 W^T (r' - r)

which is repeated from there with the same W until it moves no more; where rows do not get smaller
so, the model is fitted anew. A value moves by what dx changes of it, and by what the assumption
changes of it at one x. The rise of chi square is whether the data would show it.

Sources: C. R. Rao, Linear Statistical Inference and Its Applications (partitioned normal
equations); G. Box, "Use and abuse of regression", Technometrics 8 (1966) 625.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.bound import Assumption
from fitting.campaign.laws import in_base
from fitting.campaign.parameters import prior_sigmas, to_model, to_search
from fitting.fit.fit import Solution
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.objective import Objective, evaluate_many
from fitting.fit.optimum import most_likely
from fitting.fit.outputs import output_means
from fitting.inference.checks.solutions import Solved
from fitting.inference.statuses import nearest_image
from fitting.measurements.fmu_response import FmuResponse
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import BadInput, FmuFailure, OutOfBudget
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind, note, warning

#: Factor on an error, with the assumed value free, from which the value depends on it: a wrong one
#: then fits as well, with a value one standard error off.
RESTS = 1.5
#: Steps of an assumed value, as shares of its size, or of one where it is zero.
STEPS = tuple(10.0**k for k in range(-5, 9))
#: Length of a step's change, in standard deviations of the rows, that is measured well.
VISIBLE = 0.3
#: The same from which a step is too long, and how often it is shortened.
LONGEST, SHORTENED = 3.0, 6
#: The highest power with which anything changes: lines move with the fourth of a coupling.
POWERS = 4
#: Share of a column that others leave, below which it is determined by none of the data.
UNTOLD = 0.05
#: Rise of chi square up to which a fit is as good.
AS_GOOD = 1.0
#: Share of a column's square that keeps apart columns that the data do not.
RIDGE = 1e-12
#: Steps at most by the derivatives at the solution, and share of a standard error that ends them.
MOST_STEPS, SMALL = 8, 0.05
#: Prefix of the shift of a value among the numbers of a finding.
SHIFT = "shift_"


# --- start values that were not measured ----------------------------------------------------------


@dataclass(frozen=True)
class _Column:
    """Change of the whitened rows (m,) by a step of an assumed value; it goes with step^power."""

    name: str
    unit: str
    value: float
    step: float
    power: int
    change: FloatArray


def check_assumed_values(solved: Solved) -> Iterator[Finding]:
    """Values that depend on start values which were not measured and the data do not determine."""
    solution, response = solved.fit.solution, solved.fit.solution.objective.response
    # parameters of the campaign that have a value and an error
    known = [
        n for n, v in solved.parameters.items() if v.asked and v.status.has_value and v.std > 0.0
    ]
    if not (solved.describes and known and isinstance(response, FmuResponse)):
        return
    assumed = {
        name: (float(bound.setup.start_values[name]), "" if unit == "1" else unit)
        for bound in solved.problem.campaigns.values()
        for name, unit in bound.taken.items()
    }
    each = (_column(solution, response, name, *about) for name, about in assumed.items())
    columns = [column for column in each if column is not None]
    if not columns:
        return
    prior = prior_sigmas(solution.parameters, solution.nu)
    whitened = solution.noise.covariance.whitened
    fixed = np.vstack([whitened(solution.secant_matrix), np.diag(1.0 / prior)])
    rows = np.column_stack([column.change for column in columns])
    added = np.vstack([rows, np.zeros((prior.size, len(columns)))])
    places = {p.name: i for i, p in enumerate(solution.parameters)}
    try:
        depends = _depends(fixed, added)
    except np.linalg.LinAlgError:  # rows that are not finite
        return
    resting = [name for name in known if depends[places[name]]]
    if not resting:
        return
    stds = {name: solved.parameters[name].std for name in resting}
    more, example = _example(solution, columns, fixed, added, stds)
    assumed_names = tuple(column.name for column in columns)
    names = {"values": tuple(resting), "assumed": assumed_names, "example": example}
    names["units"] = tuple(column.unit for column in columns)
    numbers = {f"assumed_{column.name}": column.value for column in columns} | more
    yield warning(Kind.assumed_value, ", ".join(assumed_names), names, **numbers)


def _column(
    solution: Solution, response: FmuResponse, name: str, value: float, unit: str
) -> _Column | None:
    """The change by the smallest step that is measured well; None where no step changes much."""
    whitened, here = solution.noise.covariance.whitened, solution.final.residuals

    def change(step: float) -> FloatArray:
        other = replace(solution.objective, response=response.with_settings({name: value + step}))
        [point] = evaluate_many(other, [solution.final.x])
        return whitened(point.residuals - here)

    def power(step: float, column: FloatArray) -> int:
        half = float(np.linalg.norm(change(0.5 * step)))
        ratio = float(np.linalg.norm(column)) / max(half, 1e-300)
        return min(max(round(math.log2(max(ratio, 1.0))), 1), POWERS)

    steps: Iterable[float] = (share * (abs(value) or 1.0) for share in STEPS)
    try:
        changes = ((step, change(step)) for step in steps)
        step, column = next(each for each in changes if np.linalg.norm(each[1]) > VISIBLE)
        # a step of more than a few standard deviations is bent
        for _ in range(SHORTENED):
            length = float(np.linalg.norm(column))
            if length < LONGEST:
                break
            step *= (0.5 * LONGEST / length) ** (1.0 / power(step, column))
            column = change(step)
        return _Column(name, unit, value, step, power(step, column), column)
    except (StopIteration, FmuFailure, BadInput):  # the FMU does not have such a value
        return None


def _depends(fixed: FloatArray, added: FloatArray) -> BoolArray:
    """Which values depend on what is added, (n,): a wrong one would not show.

    All of them where nothing determines one of its directions: what moves no value to first order,
    as a drive of mode 2 against a read-out of it, moves them further off.
    """
    n, both = fixed.shape[1], np.column_stack([fixed, added])
    free = any(
        np.linalg.norm(left_of(np.delete(both, n + k, axis=1), added[:, k])[0])
        < UNTOLD * np.linalg.norm(added[:, k])
        for k in range(added.shape[1])
    )
    return np.asarray((np.sqrt(_variances(both)[:n] / _variances(fixed)) > RESTS) | free)


def left_of(matrix: FloatArray, column: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What a matrix leaves of a column, (m,), and the step that it takes for it, (n,).

    Args:
        matrix: derivatives of whitened rows, those of the prior below them, shape (m, n).
        column: what changes of the rows, shape (m,).
    """
    size = np.linalg.norm(matrix, axis=0)
    follow = -np.linalg.lstsq(matrix / size, column, rcond=1e-9)[0] / size
    return column + matrix @ follow, follow


def _variances(matrix: FloatArray) -> FloatArray:
    """Variances of a linear problem, (n,), finite where columns are alike."""
    size = np.linalg.norm(matrix, axis=0)
    scaled = matrix / size
    normal = scaled.T @ scaled + RIDGE * np.eye(size.size)
    return np.asarray(np.diag(np.linalg.inv(normal)) / size**2)


def _example(
    solution: Solution,
    columns: Sequence[_Column],
    fixed: FloatArray,
    added: FloatArray,
    stds: Mapping[str, float],
) -> tuple[dict[str, float], tuple[str, ...]]:
    """The least visible change of an assumed value that moves a value by its standard error.

    The step of the assumed value and the sign of the move; the names of both, with a unit between;
    empty where chi square would show it.
    """
    places = {p.name: i for i, p in enumerate(solution.parameters)}
    rises: list[tuple[float, str, float, _Column]] = []
    for k, column in enumerate(columns):
        left, follow = left_of(fixed, added[:, k])
        for name, std in stds.items():
            move = follow[places[name]] * solution.parameters[places[name]].scale / std
            if abs(move) > 0.0:
                rises.append((float(left @ left) / move**2, name, move, column))
    good = [each for each in rises if each[0] <= AS_GOOD]
    if not good:
        return {}, ()
    _, name, move, column = min(good, key=lambda each: each[0])
    step = column.step * abs(1.0 / move) ** (1.0 / column.power)
    return {"step": step, "move": math.copysign(1.0, move)}, (column.name, column.unit, name)


# --- assumptions ----------------------------------------------------------------------------------


def check_assumptions(solved: Solved) -> Iterator[Finding]:
    """Shift of every value without an assumption of the campaigns, a finding for each of these.

    The subject names what is assumed and what might be instead. Numbers are ``shift_NAME`` of each
    value, in SI units, and ``chi_square``, by which that of the data would be larger. Assumptions
    under which the model fails have none.
    """
    solution = solved.fit.solution
    known = {n: v for n, v in solved.values.items() if v.status.has_value and v.std > 0.0}
    if not (solved.describes and known and isinstance(solution.objective.response, FmuResponse)):
        return
    by_words: dict[str, dict[str, Assumption]] = {}  # several campaigns may share one
    for series, bound in solved.problem.campaigns.items():
        for assumption in bound.assumptions:
            by_words.setdefault(assumption.words, {})[series] = assumption
    refitted = {f.subject: f.numbers for f in solved.earlier if f.kind is Kind.assumption}
    for words, by_series in by_words.items():
        before = refitted.get(words, {})
        if all(f"{SHIFT}{name}" in before for name in known):
            wanted = {"chi_square", *(f"{SHIFT}{name}" for name in known)}
            numbers = {name: before[name] for name in before if name in wanted}
            yield note(Kind.assumption, words, None, **numbers)
            continue
        try:
            objective, x, chi_square = _refit(solution, by_series)
            numbers = _shifts(solution, objective, x, known)
        except (FmuFailure, BadInput, OutOfBudget, np.linalg.LinAlgError):
            continue
        numbers["chi_square"] = chi_square
        yield note(Kind.assumption, words, None, **numbers)


def _refit(
    solution: Solution, assumed: Mapping[str, Assumption]
) -> tuple[Objective, FloatArray, float]:
    """The model without the assumption, its search vector (n,), and the rise of chi square."""
    first, x = next(iter(assumed.values())), solution.final.x
    if first.setup is None:  # another start of the same model
        parameters = solution.parameters
        fitted = dict(zip((p.name for p in parameters), solution.final.parameters, strict=True))
        other = {name: law.value(fitted) for name, law in first.start.items()}
        start = [other.get(p.name, float(fitted[p.name])) for p in parameters]
        begin = to_search(parameters, np.array(start, dtype=float))
        return solution.objective, *_fit_from(solution, solution.objective, begin)
    response = solution.objective.response
    assert isinstance(response, FmuResponse)  # noqa: S101 - asked by the caller
    models = dict(response.models)
    for series, assumption in assumed.items():
        if assumption.setup is not None:
            models[series] = replace(models[series], setup=assumption.setup)
    objective = replace(solution.objective, response=replace(response, models=models))
    moved = _follow_slopes(solution, objective) or _fit_from(solution, objective, x)
    return objective, *moved


def _follow_slopes(solution: Solution, other: Objective) -> tuple[FloatArray, float] | None:
    """Where the fit of another model goes by the derivatives at the solution; None: it is too far.

    Its search vector and the rise of chi square. A few evaluations, where a fit of its own takes
    derivatives as well.
    """
    whitened = solution.noise.covariance.whitened
    prior = prior_sigmas(solution.parameters, solution.nu)
    matrix = np.vstack([whitened(solution.secant_matrix), np.diag(1.0 / prior)])
    start, here = solution.final.x, solution.final.residuals
    errors = np.sqrt(np.diag(solution.errors.covariance))

    def rows_at(x: FloatArray) -> FloatArray:
        [point] = evaluate_many(other, [x])
        return np.append(whitened(point.residuals - here), (x - start) / prior)

    x, rows = start, rows_at(start)
    for _ in range(MOST_STEPS):
        _, step = left_of(matrix, rows)
        try:
            there = rows_at(x + step)
        except FmuFailure:
            return None
        if np.all(np.abs(step) < SMALL * errors):
            return x + step, _rise(solution, there[: here.size])
        if float(there @ there) >= float(rows @ rows):
            return None
        x, rows = x + step, there
    return None


def _fit_from(solution: Solution, objective: Objective, x: FloatArray) -> tuple[FloatArray, float]:
    """Where a fit ends from a place, and the rise of chi square.

    The place may lie beyond the bounds: so may the fit.
    """
    likelihood = likelihood_of(objective, solution.noise)
    low, high = x - likelihood.widths, x + likelihood.widths
    likelihood = replace(
        likelihood,
        lower=np.minimum(likelihood.lower, low),
        upper=np.maximum(likelihood.upper, high),
    )
    optimum = most_likely(LikelihoodEvaluator(likelihood), [x])
    likelihood = optimum.likelihood
    rows = likelihood.inflation * optimum.expansion.sample.rows[: likelihood.data_rows]
    before = solution.noise.covariance.whitened(solution.final.residuals)
    return optimum.expansion.x, _rise(solution, rows - before)


def _rise(solution: Solution, change: FloatArray) -> float:
    """Rise of chi square of the data with a ``change`` (m,) of the whitened rows."""
    before = solution.noise.covariance.whitened(solution.final.residuals)
    return float(change @ (change + 2.0 * before))


def _shifts(
    solution: Solution, other: Objective, x: FloatArray, known: Mapping[str, FittedEstimate]
) -> dict[str, float]:
    """Shift of every value to another model at x, in SI units, by its prefixed name."""
    parameters = solution.parameters
    here, there = solution.final.parameters, to_model(parameters, x)

    def outputs(objective: Objective, at: FloatArray) -> dict[str, float]:
        means = output_means(objective.response, parameters, [at])
        return {name: float(values[0]) for name, values in means.items()}

    before = {p.name: float(value) for p, value in zip(parameters, here, strict=True)}
    after = {
        p.name: nearest_image(float(value), float(old), p.period)
        for p, value, old in zip(parameters, there, here, strict=True)
    }
    before |= outputs(solution.objective, solution.final.x)
    after |= outputs(other, x)
    shifts = {}
    for name, value in known.items():
        shift = after.get(name, np.nan) - before.get(name, np.nan)
        if np.isfinite(shift):
            shifts[f"{SHIFT}{name}"] = in_base(value.unit, name)[0] * shift
    return shifts
