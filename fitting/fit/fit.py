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

from fitting.fit.alternative import (
    EQUAL,
    AlternativeResult,
    Outcome,
    alternative_results,
    chi_squares,
    search_alternative,
    with_values,
)
from fitting.fit.objective import Counts, Evaluator, make_objective
from fitting.fit.options import Options
from fitting.fit.outputs import runs_of_outputs
from fitting.fit.path import (
    Course,
    HistoryRow,
    Hooks,
    PathLevel,
    Progress,
    follow_path,
    global_path,
    history_rows,
)
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution, solution_of
from fitting.measurements.measurement import Response
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.rendering import phrase

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
    course = Course(
        objective=fit.solution.objective,
        options=fit.options,
        alternative=fit.reported,
        hooks=hooks,
    )
    response = course.objective.response
    levels, lowest = list[PathLevel](), list[PathLevel]()
    try:
        # one by one: those before an interruption stay
        for level in follow_path(course):
            levels.append(level)
        if fit.options.global_path:
            known = [fit.solution.final.x, *(np.array(level.x) for level in levels)]
            for level in global_path(course, known):
                lowest.append(level)
    except KeyboardInterrupt:
        message = phrase("fit", "interrupted", len(levels))
        fit = replace(fit, status=Status.INTERRUPTED, message=message)
    before, path = runs_of_outputs(response), history_rows(course, levels)
    global_rows = history_rows(course, lowest)
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
    last = options.schedule.nu(options.schedule.levels - 1)
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
