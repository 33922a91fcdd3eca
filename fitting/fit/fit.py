"""From a problem to a `Fit`: the most likely point of every alternative, and Algorithm 2.

Writes nothing and draws nothing: progress, finished levels and the clock are handed in.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from fitting.campaign.parameters import Parameter, prior_sigmas, search_bounds, starts, to_search
from fitting.fit.alternative import (
    EQUAL,
    AlternativeResult,
    Outcome,
    alternative_results,
    chi_squares,
    search_alternative,
    with_values,
)
from fitting.fit.covariance import WhitenedErrors
from fitting.fit.linearisation import Linearisation, linearise
from fitting.fit.noise import RowNoise, fitted_noise
from fitting.fit.objective import Counts, Evaluator, Objective, Point, j_reg, make_objective
from fitting.fit.options import Options
from fitting.fit.outputs import runs_of_outputs
from fitting.fit.path import (
    GLOBAL,
    HistoryRow,
    Hooks,
    PathLevel,
    Progress,
    follow_path,
    history_rows,
)
from fitting.fit.problem import Problem
from fitting.measurements.measurement import Response
from fitting.signal.residual_tests import Structure, residual_structure
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.rendering import phrase

#: Step off a plane of symmetry, as a share of the box (at most in units of x).
STRIDE = 0.1
#: Mean change of a row over such a step below which a column counts as vanished.
FLAT = 1e-6


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The reported end, and what was evaluated there.

    `initial` is the campaign's start, `final` the solution; `matrix` dr/dx there, `secant_matrix`
    the same with secants for variables without a first-order effect (`secants`), `secant_points`
    the points of these; `noise` of the rows, `errors` by it; `structure` that of the sweep's
    residuals, None where the sweep is not fitted; `nu` is the last weight of the Tikhonov term.
    """

    objective: Objective
    nu: float
    initial: Point
    final: Point
    matrix: FloatArray
    secant_matrix: FloatArray
    noise: RowNoise
    errors: Linearisation
    structure: Structure | None
    secant_points: Mapping[int, FloatArray]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The fitted parameters."""
        return self.objective.parameters

    @property
    def j_reg(self) -> float:
        """The Tikhonov term at the last nu."""
        return j_reg(self.final.x, self.nu)

    @property
    def predicted_decrease(self) -> float:
        """Decrease of chi square that a linearised step promises, bounds that hold left aside."""
        lower, upper = search_bounds(self.parameters)
        x, rows, matrix = self.final.x, self.errors.rows, self.errors.matrix
        slope = matrix.T @ rows
        is_active = ((x <= lower) & (slope > 0.0)) | ((x >= upper) & (slope < 0.0))
        free = matrix[:, ~is_active]
        return float(rows @ free @ np.linalg.lstsq(free, rows, rcond=None)[0])

    def weighed(self, noise: RowNoise) -> Solution:
        """The same end, its errors by another noise of the rows.

        Args:
            noise: of the rows.
        """
        errors = _errors(
            self.objective, self.final, self.secant_matrix, noise, self.structure, self.nu
        )
        return replace(self, noise=noise, errors=errors)


def solution_of(evaluator: Evaluator, x: FloatArray, nu: float) -> Solution:
    """Evaluate the campaign's start and an end, with Jacobian and covariance at the end.

    Args:
        evaluator: of the objective.
        x: search vector where the fit ended, (n,).
        nu: last weight of the Tikhonov term.

    Raises:
        FmuFailure: the model failed at one of them.
    """
    objective = evaluator.objective
    parameters = objective.parameters
    initial, final = evaluator.points([to_search(parameters, starts(parameters)), x], whole=True)
    matrix = evaluator.jacobian(x)
    secant_matrix, secant_points = secants(evaluator, x, matrix)
    noise = fitted_noise(objective, final, secant_matrix, prior_sigmas(parameters, nu))
    structure = curve_structure(objective, final, matrix, noise)
    return Solution(
        objective=objective,
        nu=nu,
        initial=initial,
        final=final,
        matrix=matrix,
        secant_matrix=secant_matrix,
        noise=noise,
        errors=_errors(objective, final, secant_matrix, noise, structure, nu),
        structure=structure,
        secant_points=secant_points,
    )


def _errors(
    objective: Objective,
    final: Point,
    secant_matrix: FloatArray,
    noise: RowNoise,
    structure: Structure | None,
    nu: float,
) -> Linearisation:
    """The problem linearised at its end; curves count by what their residuals are worth."""
    data = objective.data
    stated = widened = noise
    if structure is not None:
        widened = noise.widened(data.curve_rows, structure.widening)
        stated = noise.widened(data.curve_rows, structure.excess)
    errors = linearise(
        final.residuals,
        secant_matrix,
        stated.covariance,
        prior_sigmas(objective.parameters, nu),
        widened.covariance,
        data.solved_inside,
    )
    errors = replace(errors, scatter=widened.scatter, freedom=noise.freedom)
    if not noise.bounded.columns:
        return errors
    counted = widened.covariance.times(errors.inflation)
    return replace(errors, bounded=WhitenedErrors(noise.bounded, counted))


def curve_structure(
    objective: Objective, final: Point, matrix: FloatArray, noise: RowNoise
) -> Structure | None:
    """Structure of the residuals along curves; what they are solved for inside is fitted, too.

    Of the many spectra of a map each has a scale of its own. Where noise is of one size in volts,
    rows of a small spectrum have more, and so has its scale: that error is not used, nor are
    those of gain, offset and start of a trace.

    Rows count as the fit weighs them, by their noise over its root mean square: where that is
    stated, residuals that grow with it are of one size.

    Args:
        objective: response, parameters and data.
        final: where the fit ended.
        matrix: dr/dx there, shape (m, n).
        noise: of all rows, as stated or as they scatter.
    """
    data = objective.data
    mine = data.curve_rows
    rows, columns = final.residuals[mine], matrix[mine]
    if not rows.size:
        return None
    if any(m.rows and m.scaling.from_rows for m in data.measurements if m.is_curve):
        columns = np.column_stack([columns, rows + data.measured_rows[mine]])  # d r/d ln chi
    # what the rows are solved for inside takes degrees of freedom, too: columns of one curve, of
    # the spectra of a map, and of stretches of rows that follow each other
    own = maps = np.empty((rows.size, 0))
    stretches = [np.empty((rows.size, 0))]
    curves = [(k, m) for k, m in enumerate(data.measurements) if m.is_curve]
    if any(m.solved_inside for _, m in curves):
        [answer] = objective.response.evaluate_many([final.parameters])
        of_own, of_maps, stretches = [], [], []
        for k, m in curves:
            prediction, nothing = answer.predictions[k], np.empty((m.rows, 0))
            inside = nothing if m.is_trace else m.solved_columns(prediction)
            of_own.append(nothing if m.control_units else inside)
            of_maps.append(inside if m.control_units else nothing)
            stretches += m.solved_blocks(prediction) if m.is_trace else [nothing]
        own, maps = np.asarray(block_diag(*of_own)), np.asarray(block_diag(*of_maps))
    columns = np.column_stack([columns, own])
    sigma = noise.sigma[mine]
    weights = float(np.sqrt(np.mean(sigma**2))) / sigma
    along = weights[:, None]
    parts = np.split(along, np.cumsum([len(block) for block in stretches])[:-1])
    weighted = [block * part for block, part in zip(stretches, parts, strict=True)]
    structure = residual_structure(rows * weights, columns * along, maps * along, weighted)
    taken = columns.shape[1] + maps.shape[1] + sum(block.shape[1] for block in stretches)
    freedom = max(1, rows.size - taken)
    return structure.beyond(float(np.sum((rows / sigma) ** 2)) / freedom)


def secants(
    evaluator: Evaluator, x: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """dr/dx with finite differences in place of flat columns where these see more, (m, n).

    The second result gives for each such column the point that the difference was taken to.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        matrix: dr/dx there, shape (m, n).
    """
    strides = STRIDE * np.minimum(evaluator.upper - evaluator.lower, 1.0)
    flat = np.flatnonzero(np.mean(np.abs(matrix), axis=0) * strides <= FLAT)
    changed, points = matrix.copy(), {}
    rows = evaluator.point(x).residuals
    for i in map(int, flat):
        for step in (strides[i], -strides[i]):
            moved = x.copy()
            moved[i] = np.clip(x[i] + step, evaluator.lower[i], evaluator.upper[i])
            if abs(moved[i] - x[i]) <= 0.5 * abs(step):
                continue  # no room on that side
            column = (evaluator.point(moved).residuals - rows) / (moved[i] - x[i])
            if np.linalg.norm(column) > np.linalg.norm(changed[:, i]):
                changed[:, i], points[i] = column, moved
    return changed, points


# --- fits -----------------------------------------------------------------------------------------

_log = logging.getLogger(__name__)

#: Rows beyond which a sum of absolute values has too many slacks: the factors of the interior point
#: fill as their number squared, since every row sees every parameter (of 2400 rows 0.4 GB).
MOST_SLACKS = 2000


class Status(StrEnum):
    """How a fit ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    INTERRUPTED = "interrupted"
    MISFIT = "does not describe the data"


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A solved problem: the most likely point of every discrete alternative.

    `outcomes` are in the order of the alternatives that were begun, `reported` is the place of the
    best, `solution` its end, `alternatives` where each ended. `levels` are those
    of Algorithm 2 for the reported one and `path` the same by name, with the start before them;
    `global_path` the least J at every ν. `cost` counts all of it, runs that only read outputs too;
    `seconds` its time.
    """

    problem: Problem
    options: Options
    outcomes: tuple[Outcome, ...]
    reported: int
    solution: Solution
    alternatives: tuple[AlternativeResult, ...]
    cost: Counts
    status: Status
    message: str
    seconds: float
    levels: tuple[PathLevel, ...] = ()
    path: tuple[HistoryRow, ...] = ()
    global_path: tuple[HistoryRow, ...] = ()

    @property
    def outcome(self) -> Outcome:
        """What the search of the reported alternative came to."""
        return self.outcomes[self.reported]

    @property
    def alternative(self) -> Mapping[str, Scalar]:
        """Start values of the reported alternative."""
        return self.problem.alternatives[self.reported]

    @property
    def x(self) -> FloatArray:
        """Fitted values (n,), each in its parameter's unit."""
        return self.solution.final.parameters

    @property
    def paper(self) -> FloatArray:
        """Values (n,) where Algorithm 2 ended; NaN where it was not carried out."""
        if not self.levels:
            return np.full(self.x.size, np.nan)
        return np.array(self.levels[-1].parameters)


def solve_problem(
    problem: Problem,
    respond: Callable[[Mapping[str, Scalar]], Response],
    options: Options,
    hooks: Hooks | None = None,
) -> Fit:
    """The most likely point of every alternative; the best is reported. Without Algorithm 2.

    A KeyboardInterrupt ends the search: what was finished is reported, with that status.

    Args:
        problem: parameters, measurements and alternatives.
        respond: makes the response of one alternative, given as settings by name.
        options: starts and seed of the search.
        hooks: progress and clock.

    Raises:
        FmuFailure: the model failed inside the box.
        BadInput: nothing to fit.
    """
    hooks = hooks or Hooks()
    started = hooks.clock()
    outcomes: list[Outcome] = []
    for k, alternative in enumerate(problem.alternatives):
        state = Progress(
            stage="search",
            done=k,
            of=len(problem.alternatives),
            evaluations=sum(each.counts.evaluations for each in outcomes),
            elapsed_s=hooks.clock() - started,
        )
        hooks.progress(state)
        try:
            response = respond(alternative)
            objective = make_objective(response, problem.parameters, problem.data)
        except KeyboardInterrupt:
            break
        outcomes.append(search_alternative(objective, options.schedule, outcomes))
        if outcomes[-1].interrupted:
            break
    if not outcomes:
        raise KeyboardInterrupt
    return _assemble(problem, options, outcomes, hooks.clock() - started)


def with_path(fit: Fit, hooks: Hooks | None = None) -> Fit:
    """The same fit with Algorithm 2 for its alternative, as far as its options ask for it.

    A KeyboardInterrupt ends it with the levels that are finished and that status.

    Args:
        fit: a solved problem.
        hooks: progress, memory and clock.

    Raises:
        FmuFailure: the model failed inside the box.
        BadInput: a sum of absolute values over too many rows.
    """
    if not fit.options.needs_path or fit.status is Status.INTERRUPTED:
        return fit
    rows = fit.solution.final.residuals.size
    if fit.options.misfit != "squares" and rows > MOST_SLACKS:
        raise BadInput(
            f"continuation: misfit is {fit.options.misfit!r} for {rows} rows, wanted 'squares' "
            f"beyond {MOST_SLACKS}, or no path (--no-path)"
        )
    hooks = hooks or Hooks()
    started = hooks.clock()
    objective, options = fit.solution.objective, fit.options
    response = objective.response
    levels, lowest = list[PathLevel](), list[PathLevel]()
    try:
        # one by one: those before an interruption stay
        for level in follow_path(objective, options, fit.reported, hooks):
            levels.append(level)
        if options.global_path:
            known = [fit.solution.final.x, *(np.array(level.x) for level in levels)]
            for level in follow_path(objective, options, fit.reported, hooks, GLOBAL, known):
                lowest.append(level)
    except KeyboardInterrupt:
        message = phrase("fit", "interrupted", len(levels))
        fit = replace(fit, status=Status.INTERRUPTED, message=message)
    before, path = runs_of_outputs(response), history_rows(objective, options, levels)
    global_rows = history_rows(objective, options, lowest)
    read = Counts(runs=runs_of_outputs(response) - before)
    return replace(
        fit,
        levels=tuple(levels),
        path=path,
        global_path=global_rows,
        cost=sum((level.counts for level in (*levels, *lowest)), fit.cost + read),
        seconds=fit.seconds + hooks.clock() - started,
    )


def fit_from(fit: Fit, x: FloatArray) -> Fit:
    """The same fit, reported at another place where chi square is lower there; else itself.

    For points that others come by, as those who scan profiles do.

    Args:
        fit: a solved problem.
        x: search vector of the reported alternative, (n,).

    Raises:
        FmuFailure: the model failed there.
    """
    there = replace(fit.outcome, x=x)
    (here_value, there_value), _ = chi_squares([fit.outcome, there])
    if not there_value < here_value - EQUAL * (1.0 + here_value):
        return fit
    outcomes = list(fit.outcomes)
    outcomes[fit.reported] = there
    return _assemble_again(fit, outcomes)


def promised_anew(fit: Fit, respond: Callable[[Mapping[str, Scalar]], Response]) -> Fit:
    """The same fit, its errors by what another response promises for the same answers.

    Args:
        fit: a solved problem.
        respond: makes the response of one alternative.

    Raises:
        FmuFailure: the model failed at the solution.
    """
    pairs = zip(fit.outcomes, fit.problem.alternatives, strict=False)
    outcomes = [
        replace(each, objective=replace(each.objective, response=respond(settings)))
        for each, settings in pairs
    ]
    return _assemble_again(fit, outcomes)


def _assemble_again(fit: Fit, outcomes: Sequence[Outcome]) -> Fit:
    """The fit put together anew; its levels of ν stay."""
    anew = _assemble(fit.problem, fit.options, outcomes, fit.seconds)
    paths: dict[str, Any] = {"levels": fit.levels, "path": fit.path, "global_path": fit.global_path}
    return replace(anew, cost=anew.cost + sum((v.counts for v in fit.levels), Counts()), **paths)


def _assemble(problem: Problem, options: Options, ended: Sequence[Outcome], seconds: float) -> Fit:
    outcomes = tuple(map(with_values, ended))
    alternatives = alternative_results(outcomes, problem.alternatives)
    reported = next(k for k, each in enumerate(alternatives) if each.reported)
    evaluator = Evaluator(outcomes[reported].objective)
    last = options.schedule.nu(options.schedule.iterations - 1)
    solution = solution_of(evaluator, outcomes[reported].x, last)
    missed = solution.objective.data.unexplained(solution.final.residuals)
    if any(each.interrupted for each in outcomes):
        status = Status.INTERRUPTED
    else:
        is_reached = outcomes[reported].converged and not missed
        status = Status.CONVERGED if is_reached else Status.NOT_CONVERGED
    message = phrase("fit", "ended", status.value, missed, solution)
    read = Counts(runs=sum(runs_of_outputs(each.objective.response) for each in outcomes))
    _log.info("fit: %s: %s", status.value, message)
    return Fit(
        problem=problem,
        options=options,
        outcomes=outcomes,
        reported=reported,
        solution=solution,
        alternatives=alternatives,
        cost=sum((outcome.counts for outcome in outcomes), evaluator.counts + read),
        status=status,
        message=message,
        seconds=seconds,
    )
