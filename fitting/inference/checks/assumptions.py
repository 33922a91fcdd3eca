"""What a fit would give if an assumption of its campaign did not hold: shifts of all its values.

Let r be the whitened rows at the solution x, W their derivatives and P the inverse prior. With
something else in place of what is assumed the rows are r', and the fit moves by

    dx = -(W^T W + P)^-1 W^T (r' - r)

which is repeated from there with the same W until it moves no more; where rows do not get smaller
so, the model is fitted anew. A value moves by what dx changes of it, and by what the assumption
changes of it at one x. The rise of chi square is whether the data would show it.

Source: G. Box, "Use and abuse of regression", Technometrics 8 (1966) 625: bias by what is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.bound import Assumption
from fitting.campaign.laws import in_base
from fitting.campaign.parameters import prior_sigmas, to_model, to_search
from fitting.fit.likelihood.descent import most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_with
from fitting.fit.objective import Objective, evaluate_many
from fitting.fit.outputs import output_means
from fitting.fit.solution import Solution
from fitting.inference.checks.assumed_values import left_of
from fitting.inference.equivalent_fits import turned_to
from fitting.inference.solved import Solved
from fitting.measurements.fmu_response import FmuResponse
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure, OutOfBudget
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind, note

#: Steps at most by the derivatives at the solution, and share of a standard error that ends them.
STEPS, SMALL = 8, 0.05
#: Prefix of the shift of a value among the numbers of a finding.
SHIFT = "shift_"


@dataclass(frozen=True)
class _Moved:
    """Where a fit would be: search vector (n,), the model there, and the rise of chi square."""

    x: FloatArray
    objective: Objective
    chi_square: float


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
    for words, by_series in by_words.items():
        try:
            moved = _moved(solution, by_series)
            numbers = _shifts(solution, moved, known)
        except (FmuFailure, BadInput, OutOfBudget, np.linalg.LinAlgError):
            continue
        numbers["chi_square"] = moved.chi_square
        yield note(Kind.assumption, words, None, **numbers)


def _moved(solution: Solution, assumed: Mapping[str, Assumption]) -> _Moved:
    first, x = next(iter(assumed.values())), solution.final.x
    if first.setup is None:  # another start of the same model
        parameters = solution.parameters
        fitted = dict(zip((p.name for p in parameters), solution.final.parameters, strict=True))
        other = {name: law.value(fitted) for name, law in first.start.items()}
        start = [other.get(p.name, float(fitted[p.name])) for p in parameters]
        begin = to_search(parameters, np.array(start, dtype=float))
        return _fitted(solution, solution.objective, begin)
    response = solution.objective.response
    assert isinstance(response, FmuResponse)  # noqa: S101 - asked by the caller
    models = dict(response.models)
    for series, assumption in assumed.items():
        if assumption.setup is not None:
            models[series] = replace(models[series], setup=assumption.setup)
    objective = replace(solution.objective, response=replace(response, models=models))
    return _followed(solution, objective) or _fitted(solution, objective, x)


def _followed(solution: Solution, other: Objective) -> _Moved | None:
    """Where the fit of another model goes by the derivatives at the solution; None: it is too far.

    A few evaluations, where a fit of its own takes derivatives as well.
    """
    whitened = solution.noise.covariance.whitened
    prior = prior_sigmas(solution.parameters, solution.nu)
    matrix = np.vstack([whitened(solution.seen), np.diag(1.0 / prior)])
    start, here = solution.final.x, solution.final.residuals
    errors = np.sqrt(np.diag(solution.errors.covariance))

    def rows_at(x: FloatArray) -> FloatArray:
        [point] = evaluate_many(other, [x])
        return np.append(whitened(point.residuals - here), (x - start) / prior)

    x, rows = start, rows_at(start)
    for _ in range(STEPS):
        _, step = left_of(matrix, rows)
        try:
            there = rows_at(x + step)
        except FmuFailure:
            return None
        if np.all(np.abs(step) < SMALL * errors):
            return _Moved(x + step, other, _rise(solution, there[: here.size]))
        if float(there @ there) >= float(rows @ rows):
            return None
        x, rows = x + step, there
    return None


def _fitted(solution: Solution, objective: Objective, x: FloatArray) -> _Moved:
    """Where a fit ends from a place, perhaps beyond the bounds of the campaign."""
    evaluator = LikelihoodEvaluator(likelihood_with(objective, solution.noise))
    errors = np.sqrt(np.diag(solution.errors.covariance))
    evaluator.likelihood = evaluator.likelihood.let_out(x, errors)
    optimum = most_likely(evaluator, [x])
    likelihood = optimum.likelihood
    rows = likelihood.inflation * optimum.expansion.sample.rows[: likelihood.data_rows]
    before = solution.noise.covariance.whitened(solution.final.residuals)
    return _Moved(optimum.expansion.x, objective, _rise(solution, rows - before))


def _rise(solution: Solution, change: FloatArray) -> float:
    """Rise of chi square of the data with a ``change`` (m,) of the whitened rows."""
    before = solution.noise.covariance.whitened(solution.final.residuals)
    return float(change @ (change + 2.0 * before))


def _shifts(
    solution: Solution, moved: _Moved, known: Mapping[str, FittedEstimate]
) -> dict[str, float]:
    """Shift of every value in SI units, by its prefixed name."""
    parameters, x = solution.parameters, solution.final.x
    here, there = solution.final.parameters, to_model(parameters, moved.x)

    def outputs(objective: Objective, at: FloatArray) -> dict[str, float]:
        means = output_means(objective.response, parameters, [at])
        return {name: float(values[0]) for name, values in means.items()}

    before = {p.name: float(value) for p, value in zip(parameters, here, strict=True)}
    after = {
        p.name: turned_to(float(value), float(old), p.period)
        for p, value, old in zip(parameters, there, here, strict=True)
    }
    before |= outputs(solution.objective, x)
    after |= outputs(moved.objective, moved.x)
    shifts = {}
    for name, value in known.items():
        shift = after.get(name, np.nan) - before.get(name, np.nan)
        if np.isfinite(shift):
            shifts[f"{SHIFT}{name}"] = in_base(value.unit, name)[0] * shift
    return shifts
