"""From a problem to a `Fit`: the most likely point of every alternative, and Algorithm 2.

Writes nothing and draws nothing: progress, finished levels and the clock are handed in.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Protocol

import numpy as np

from fitting.fit.alternative import (
    EQUAL,
    AlternativeResult,
    Outcome,
    Solved,
    alternative_results,
    best_alternative,
    chi_squares,
    is_complete,
    search_alternative,
    with_values,
)
from fitting.fit.evaluator import Counts, Evaluator
from fitting.fit.objective import Objective, make_objective
from fitting.fit.options import Options
from fitting.fit.outputs import runs_of_outputs
from fitting.fit.path import (
    Course,
    HistoryRow,
    Journal,
    PathLevel,
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


@dataclass(frozen=True, kw_only=True)
class Progress:
    """State of a running fit: which `stage` it is in, and what it has taken so far.

    `stage` is "search", "path" or "global"; `done` of `of` alternatives, or levels of ν, are done.
    `nu`, `j_fit` and `j_reg` are those of the last level (NaN in a search).
    """

    stage: str
    done: int
    of: int
    nu: float
    j_fit: float
    j_reg: float
    evaluations: int
    elapsed_s: float


class Memory(Protocol):
    """Where finished levels are kept (`fitting.fit.checkpoint.Checkpoint`)."""

    def recall(self, kind: str, alternative: int, level: int) -> PathLevel | None:
        """The finished level of that place, None if there is none.

        Args:
            kind: of the path.
            alternative: its number.
            level: of ν, from 0.
        """
        ...

    def record(self, level: PathLevel) -> None:
        """Keep a finished level.

        Args:
            level: of one alternative.
        """
        ...


@dataclass(frozen=True)
class Hooks:
    """Watching and resuming, all optional."""

    progress: Callable[[Progress], None] = lambda state: None
    memory: Memory | None = None
    clock: Callable[[], float] = time.perf_counter


class Status(StrEnum):
    """How a fit ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    INTERRUPTED = "interrupted"
    MISFIT = "does not describe the data"


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A solved problem: the most likely point of every discrete alternative.

    `objectives` and `outcomes` are in the order of the alternatives that were begun, `reported` is
    the place of the best, `solution` its end, `alternatives` where each ended. `levels` are those
    of Algorithm 2 for the reported one and `path` the same by name, with the start before them;
    `global_path` the least J at every ν. `cost` counts all of it, runs that only read outputs too;
    `seconds` its time.
    """

    problem: Problem
    options: Options
    objectives: tuple[Objective, ...]
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
    def success(self) -> bool:
        """Whether no linearised step promises a decrease of chi square."""
        return self.status is Status.CONVERGED

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

    @property
    def fun(self) -> float:
        """J_fit at the fitted values."""
        return self.solution.final.j_fit

    @property
    def nfev(self) -> int:
        """Evaluations of the objective."""
        return self.cost.evaluations

    @property
    def njev(self) -> int:
        """Jacobians."""
        return self.cost.jacobians


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
    begun, nan = hooks.clock(), float("nan")
    solved: list[Solved] = []
    for k, alternative in enumerate(problem.alternatives):
        spent = sum(each.outcome.counts.evaluations for each in solved)
        hooks.progress(
            Progress(
                stage="search",
                done=k,
                of=len(problem.alternatives),
                nu=nan,
                j_fit=nan,
                j_reg=nan,
                evaluations=spent,
                elapsed_s=hooks.clock() - begun,
            )
        )
        try:
            response = respond(alternative)
            objective = make_objective(response, problem.parameters, problem.data)
        except KeyboardInterrupt:
            break
        outcome = search_alternative(objective, options.schedule, solved)
        solved.append(Solved(objective, outcome))
        if outcome.interrupted:
            break
    if not solved:
        raise KeyboardInterrupt
    objectives, outcomes = zip(*((s.objective, s.outcome) for s in solved), strict=True)
    return _finished(problem, options, objectives, outcomes, hooks.clock() - begun)


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
    begun = hooks.clock()
    watch = _Watch(fit, hooks)
    course = Course(
        objective=fit.solution.objective,
        schedule=fit.options.schedule,
        misfit=fit.options.misfit,
        alternative=fit.reported,
        journal=Journal(
            recall=watch.recall, record=watch.record, entering=watch.entering, clock=hooks.clock
        ),
    )
    levels, lowest = list[PathLevel](), list[PathLevel]()
    try:
        _take(levels, follow_path(course))
        if fit.options.global_path:
            ends = [np.array(level.x) for level in levels]
            _take(lowest, global_path(course, [fit.solution.final.x, *ends]))
    except KeyboardInterrupt:
        message = phrase("fit", "interrupted", len(levels))
        fit = replace(fit, status=Status.INTERRUPTED, message=message)
    response = course.objective.response
    before, path = runs_of_outputs(response), history_rows(course, levels)
    global_rows = history_rows(course, lowest)
    read = Counts(runs=runs_of_outputs(response) - before)
    return replace(
        fit,
        levels=tuple(levels),
        path=path,
        global_path=global_rows,
        cost=sum((level.counts for level in (*levels, *lowest)), fit.cost + read),
        seconds=fit.seconds + hooks.clock() - begun,
    )


def _take(taken: list[PathLevel], levels: Iterator[PathLevel]) -> None:
    """Levels one by one: those before an interruption stay."""
    for level in levels:
        taken.append(level)


def fit_from(fit: Fit, x: FloatArray) -> Fit:
    """The same fit, reported at another place where chi square is lower there; else itself.

    For points that others come by, as those who scan profiles do.

    Args:
        fit: a solved problem.
        x: search vector of the reported alternative, (n,).

    Raises:
        FmuFailure: the model failed there.
    """
    objective = fit.solution.objective
    there = replace(fit.outcome, x=x)
    (here_value, there_value), _ = chi_squares([objective, objective], [fit.outcome, there])
    if not there_value < here_value - EQUAL * (1.0 + here_value):
        return fit
    outcomes = list(fit.outcomes)
    outcomes[fit.reported] = there
    return _again(fit, fit.objectives, outcomes)


def promised_anew(fit: Fit, respond: Callable[[Mapping[str, Scalar]], Response]) -> Fit:
    """The same fit, its errors by what another response promises for the same answers.

    Args:
        fit: a solved problem.
        respond: makes the response of one alternative.

    Raises:
        FmuFailure: the model failed at the solution.
    """
    pairs = zip(fit.objectives, fit.problem.alternatives, strict=False)
    objectives = [replace(each, response=respond(settings)) for each, settings in pairs]
    return _again(fit, objectives, fit.outcomes)


def _again(fit: Fit, objectives: Sequence[Objective], outcomes: Sequence[Outcome]) -> Fit:
    """The fit put together anew; its levels of ν stay."""
    anew = _finished(fit.problem, fit.options, objectives, outcomes, fit.seconds)
    paths: dict[str, Any] = {"levels": fit.levels, "path": fit.path, "global_path": fit.global_path}
    return replace(anew, cost=anew.cost + sum((v.counts for v in fit.levels), Counts()), **paths)


class _Watch:
    """Tells the progress of levels, and passes them to and from the memory."""

    def __init__(self, fit: Fit, hooks: Hooks) -> None:
        self.schedule, self.hooks = fit.options.schedule, hooks
        self.begun, self.evaluations = hooks.clock(), 0
        self.last: PathLevel | None = None

    def recall(self, kind: str, alternative: int, level: int) -> PathLevel | None:
        memory = self.hooks.memory
        return None if memory is None else memory.recall(kind, alternative, level)

    def record(self, level: PathLevel) -> None:
        if self.hooks.memory is not None:
            self.hooks.memory.record(level)
        self.evaluations += level.evaluations
        self.last = level

    def entering(self, kind: str, alternative: int, level: int) -> None:
        last, nan = self.last, float("nan")
        self.hooks.progress(
            Progress(
                stage=kind,
                done=level,
                of=self.schedule.levels,
                nu=self.schedule.nu(level),
                j_fit=last.j_fit if last else nan,
                j_reg=last.j_reg if last else nan,
                evaluations=self.evaluations,
                elapsed_s=self.hooks.clock() - self.begun,
            )
        )


def _finished(
    problem: Problem,
    options: Options,
    objectives: Sequence[Objective],
    ended: Sequence[Outcome],
    seconds: float,
) -> Fit:
    outcomes = tuple(with_values(*pair) for pair in zip(objectives, ended, strict=True))
    values, _ = chi_squares(objectives, outcomes)
    pairs = zip(objectives, outcomes, strict=True)
    reported = best_alternative(values, [is_complete(each, o.x) for each, o in pairs])
    evaluator = Evaluator(objectives[reported])
    last = options.schedule.nu(options.schedule.levels - 1)
    solution = solution_of(evaluator, outcomes[reported].x, last)
    status, message = _status(solution, outcomes, outcomes[reported])
    alternatives = alternative_results(objectives, outcomes, problem.alternatives, reported)
    read = Counts(runs=sum(runs_of_outputs(each.response) for each in objectives))
    _log.info("fit: %s: %s", status.value, message)
    return Fit(
        problem=problem,
        options=options,
        objectives=tuple(objectives),
        outcomes=outcomes,
        reported=reported,
        solution=solution,
        alternatives=alternatives,
        cost=sum((outcome.counts for outcome in outcomes), evaluator.counts + read),
        status=status,
        message=message,
        seconds=seconds,
    )


def _status(
    solution: Solution, outcomes: Sequence[Outcome], outcome: Outcome
) -> tuple[Status, str]:
    missed = solution.objective.data.unexplained(solution.final.residuals)
    if any(each.interrupted for each in outcomes):
        status = Status.INTERRUPTED
    else:
        status = Status.NOT_CONVERGED if missed or not outcome.converged else Status.CONVERGED
    return status, phrase("fit", "ended", status.value, missed, solution)
