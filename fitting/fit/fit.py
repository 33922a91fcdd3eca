"""Algorithms 1 and 2 for a whole problem: every start, every discrete alternative, one `Fit`.

Writes nothing and draws nothing: progress, finished levels and the clock are handed in.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Protocol

from fitting.fit.alternative import Outcome, Solved, run_alternative, with_starts
from fitting.fit.choice import chosen, polished_ends
from fitting.fit.objective import Objective, make_objective
from fitting.fit.options import Options
from fitting.fit.path import AlternativeResult, HistoryRow, alternative_results, history_rows
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution, negligible, solution_of
from fitting.fit.solver.continuation import ContinuationStep, Course, Journal, Schedule
from fitting.fit.solver.evaluator import Counts, Evaluator
from fitting.measurements.measurement import Response
from fitting.text.arrays import FloatArray, Scalar

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """State of a running reconstruction, handed out before and after every level.

    `done` of at most `of` levels; `left_s` an estimate that starts go on alone, `seconds_each`
    what an evaluation has taken on average (NaN at first).
    """

    alternative: int
    alternatives: int
    start: int
    starts: int
    level: int
    levels: int
    nu: float
    j_fit: float
    j_reg: float
    evaluations: int
    done: int
    of: int
    elapsed_s: float
    left_s: float
    seconds_each: float


class Memory(Protocol):
    """Where finished levels are kept (`fitting.fit.checkpoint.Checkpoint`)."""

    def recall(self, alternative: int, start: int, level: int) -> ContinuationStep | None:
        """The finished step of that place, None if there is none.

        Args:
            alternative: its number.
            start: its number.
            level: of ν, from 0.
        """
        ...

    def record(self, step: ContinuationStep) -> None:
        """Keep a finished step.

        Args:
            step: a finished level of one start.
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
    """A solved problem: Algorithm 2 from every start and for every discrete alternative.

    `objectives` and `outcomes` stand in the order of the alternatives that were begun, `reported`
    is the place of the best, `solution` its end; `alternatives` and `path` are the same as records:
    where each alternative ended, and a row per level of nu. `cost` counts evaluations, Jacobians
    and simulation runs, `seconds` the time of the search.
    """

    problem: Problem
    options: Options
    objectives: tuple[Objective, ...]
    outcomes: tuple[Outcome, ...]
    reported: int
    solution: Solution
    alternatives: tuple[AlternativeResult, ...]
    path: tuple[HistoryRow, ...]
    cost: Counts
    status: Status
    message: str
    seconds: float

    @property
    def outcome(self) -> Outcome:
        """All chains of the reported alternative."""
        return self.outcomes[self.reported]

    @property
    def alternative(self) -> Mapping[str, Scalar]:
        """Start values of the reported alternative."""
        return self.problem.alternatives[self.reported]

    @property
    def success(self) -> bool:
        """Whether a linearised step promises no further decrease."""
        return self.status is Status.CONVERGED

    @property
    def x(self) -> FloatArray:
        """Fitted values (n,), each in its parameter's unit."""
        return self.solution.final.parameters

    @property
    def fun(self) -> float:
        """J_fit at the end."""
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
    """Algorithms 1 and 2 for every alternative and start; the best is reported.

    A KeyboardInterrupt ends the search: what was finished is reported, with that status.

    Args:
        problem: parameters, measurements and alternatives.
        respond: makes the response of one alternative, given as settings by name.
        options: schedule of ν and settings of the solves.
        hooks: progress, memory and clock.

    Raises:
        FmuFailure: the model failed inside the box.
        BadInput: nothing to fit.

    Source: the paper, Algorithms 1 and 2.
    """
    hooks = hooks or Hooks()
    begun = hooks.clock()
    watch = _Watch(len(problem.alternatives), options.schedule, hooks, begun)
    objectives: list[Objective] = []
    outcomes: list[Outcome] = []
    courses: list[Course] = []
    for k, alternative in enumerate(problem.alternatives):
        try:
            objectives.append(
                make_objective(respond(alternative), problem.parameters, problem.data)
            )
        except KeyboardInterrupt:
            break
        journal = Journal(
            recall=watch.recall, record=watch.record, entering=watch.entering, clock=hooks.clock
        )
        courses.append(_course(objectives[-1], options, k, journal))
        solved = [Solved(*pair) for pair in zip(objectives, outcomes, strict=False)]
        outcomes.append(run_alternative(courses[-1], solved))
        if outcomes[-1].interrupted:
            break
    if not outcomes:
        raise KeyboardInterrupt
    del objectives[len(outcomes) :]
    outcomes = polished_ends(courses[: len(outcomes)], outcomes)
    return _finished(problem, options, objectives, outcomes, hooks.clock() - begun)


def fit_from(fit: Fit, begins: Sequence[FloatArray], hooks: Hooks | None = None) -> Fit:
    """The same fit with further starts, lowered at the last nu; the least J of all is reported.

    For points of lower chi square that others come by, as those who walk profiles do.

    Args:
        fit: a solved problem.
        begins: search vectors of the reported alternative, (n,) each.
        hooks: clock.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    hooks = hooks or Hooks()
    begun = hooks.clock()
    journal = Journal(clock=hooks.clock)
    course = _course(fit.solution.objective, fit.options, fit.reported, journal)
    outcomes = list(fit.outcomes)
    [outcomes[fit.reported]] = polished_ends([course], [with_starts(course, fit.outcome, begins)])
    seconds = fit.seconds + hooks.clock() - begun
    return _finished(fit.problem, fit.options, fit.objectives, outcomes, seconds)


def promised_anew(fit: Fit, respond: Callable[[Mapping[str, Scalar]], Response]) -> Fit:
    """The same fit, its errors by what another response promises for the same answers.

    Args:
        fit: a solved problem.
        respond: makes the response of one alternative.

    Raises:
        FmuFailure: the model failed at the solution.
    """
    alternatives = fit.problem.alternatives[: len(fit.objectives)]
    pairs = zip(fit.objectives, alternatives, strict=True)
    objectives = [replace(each, response=respond(settings)) for each, settings in pairs]
    return _finished(fit.problem, fit.options, objectives, fit.outcomes, fit.seconds)


def _course(objective: Objective, options: Options, alternative: int, journal: Journal) -> Course:
    return Course(
        objective=objective,
        schedule=options.schedule,
        settings=options.solve,
        alternative=alternative,
        journal=journal,
    )


class _Watch:
    """Counts levels and time for the progress, and passes steps to and from the memory."""

    def __init__(self, alternatives: int, schedule: Schedule, hooks: Hooks, begun: float) -> None:
        self.alternatives, self.schedule, self.hooks, self.begun = (
            alternatives,
            schedule,
            hooks,
            begun,
        )
        self.done = self.fresh = self.evaluations = self.counted = 0
        self.spent = 0.0
        self.last: ContinuationStep | None = None

    def recall(self, alternative: int, start: int, level: int) -> ContinuationStep | None:
        if self.hooks.memory is None:
            return None
        step = self.hooks.memory.recall(alternative, start, level)
        if step is not None:
            self._count(step)
        return step

    def record(self, step: ContinuationStep) -> None:
        if self.hooks.memory is not None:
            self.hooks.memory.record(step)
        self.fresh += 1
        self.spent += step.seconds
        self.counted += step.evaluations
        self._count(step)
        self._tell(step.alternative, step.start, step.level)

    def entering(self, alternative: int, start: int, level: int) -> None:
        self._tell(alternative, start, level)

    def _count(self, step: ContinuationStep) -> None:
        self.done += 1
        self.evaluations += step.evaluations
        self.last = step

    def _tell(self, alternative: int, start: int, level: int) -> None:
        schedule = self.schedule
        # further starts are lowered at the last level alone
        whole = self.alternatives * (schedule.starts + schedule.levels - 1)
        mean = self.spent / self.fresh if self.fresh else float("nan")
        self.hooks.progress(
            Progress(
                alternative=alternative,
                alternatives=self.alternatives,
                start=start,
                starts=schedule.starts,
                level=level,
                levels=schedule.levels,
                nu=schedule.nu(level),
                j_fit=self.last.j_fit if self.last else float("nan"),
                j_reg=self.last.j_reg if self.last else float("nan"),
                evaluations=self.evaluations,
                done=self.done,
                of=max(whole, self.done),
                elapsed_s=self.hooks.clock() - self.begun,
                left_s=max(whole - self.done, 0) * mean,
                seconds_each=self.spent / self.counted if self.counted else float("nan"),
            )
        )


def _finished(
    problem: Problem,
    options: Options,
    objectives: Sequence[Objective],
    found: Sequence[Outcome],
    seconds: float,
) -> Fit:
    outcomes, reported = chosen(objectives[: len(found)], found)
    outcome, evaluator = outcomes[reported], Evaluator(objectives[reported])
    chain = outcome.best or outcome.chains[0]
    solution = solution_of(evaluator, chain, options.schedule, options.solve.misfit)
    status, message = _status(solution, outcomes, options.solve.misfit)
    _log.info("fit: %s: %s", status.value, message)
    return Fit(
        problem=problem,
        options=options,
        objectives=tuple(objectives[: len(outcomes)]),
        outcomes=tuple(outcomes),
        reported=reported,
        solution=solution,
        alternatives=alternative_results(objectives, outcomes, problem.alternatives, reported),
        path=history_rows(solution, outcome.chains[0]),
        cost=_cost(outcomes, evaluator.counts),
        status=status,
        message=message,
        seconds=seconds,
    )


def _cost(outcomes: Sequence[Outcome], rest: Counts) -> Counts:
    counts = rest
    for outcome in outcomes:
        counts += outcome.further
        for chain in outcome.chains:
            for step in chain.steps:
                counts += step.counts
    return counts


def _status(solution: Solution, outcomes: Sequence[Outcome], misfit: str) -> tuple[Status, str]:
    last = solution.last
    if any(outcome.interrupted for outcome in outcomes):
        reached = "the start" if last is None else f"ν = {last.nu:.1e}, J_fit = {last.j_fit:.6g}"
        return (
            Status.INTERRUPTED,
            f"Interrupted: the best so far is reported, reached at {reached}.",
        )
    if last is None:
        return Status.NOT_CONVERGED, "No level of ν was done."
    where = f"J_fit = {last.j_fit:.6g}, J_reg = {last.j_reg:.3g} at ν = {last.nu:.1e}"
    missed = solution.objective.data.unexplained(solution.final.residuals)
    if missed:
        return Status.NOT_CONVERGED, (
            f"The fit does not describe the data: {missed}; {where}. Wanted a start nearer to the "
            "solution, a wider box, or data above the noise."
        )
    said = f"{solution.chain.ended[:1].upper()}{solution.chain.ended[1:]}"
    promise = f"a linearised step promises no more than {last.optimality:.1e}"
    if last.status == "optimal":
        return Status.CONVERGED, f"{said}; {where}; {promise}."
    if last.optimality <= negligible(solution, misfit):
        return Status.CONVERGED, (
            f"{said}; {where}; {promise}, which neither the model's accuracy nor the noise of the "
            "data resolves."
        )
    return Status.NOT_CONVERGED, (
        f"Not optimal at the last ν: a linearised step still promises {last.optimality:.2e} "
        f"({last.message}); {where}."
    )
