"""Algorithm 2: the regularisation is taken back level by level, each solve starting from the last.

    for nu_l = nu_0 beta^l:  x_(l+1) = argmin misfit + nu_l/2 |x|^2 from x_l
    until E = |x_(l+1) - x_l| + |J_fit - J_reg(nu_(l+1))| <= tol  or  l = l_max

`follow_path` is the published method: every level by the interior point from the solution of the
level before it and from nothing else. `global_path` is what the levels would be if each were
minimised over the whole box. Neither changes the reported estimate, which is the likelihood's.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any

import numpy as np

from fitting.campaign.file import Continuation
from fitting.campaign.parameters import Parameter, canonical, search_bounds, starts, to_search
from fitting.fit.evaluator import Counts, Evaluator, total
from fitting.fit.interior_point import Solve, inside, second_value, solve
from fitting.fit.objective import Objective, j_reg, weights
from fitting.fit.outputs import mean
from fitting.fit.search.box import Box
from fitting.text.arrays import FloatArray

_log = logging.getLogger(__name__)

#: Share of J by which a level may lie above what the second solver comes by.
MINIMISED = 1e-4
#: Points of the box that a level of `global_path` is screened at, a power of two; the lowest of
#: them that it starts from, apart by a share of the box; and iterates of each start.
SCREENED, STARTS, APART, GLOBAL_ITERATIONS = 256, 12, 0.15, 100
#: The two kinds of levels.
PATH, GLOBAL = "path", "global"


@dataclass(frozen=True, kw_only=True)
class Schedule(Continuation):
    """nu_l = nu_start beta^l for l < levels; `tolerance` for E; starts and seed of the search."""

    levels: int = 9

    def nu(self, level: int) -> float:
        """Regularisation of one level.

        Args:
            level: of ν, from 0.
        """
        return self.nu_start * self.beta**level


@dataclass(frozen=True, kw_only=True)
class Level:
    """One level of ν: at what misfit it ended, and how well.

    `change` is the paper's E; `optimality` the largest component of the Lagrangian's gradient;
    `second_j` the J that a second solver comes by from there (NaN where none was asked); `status`
    is "converged" or "iteration limit". Iterations, evaluations and seconds are of this level.
    """

    level: int
    nu: float
    j_fit: float
    j_reg: float
    change: float
    optimality: float
    status: str
    message: str
    iterations: int
    evaluations: int
    seconds: float
    second_j: float = math.nan

    @property
    def j(self) -> float:
        """J = J_fit + J_reg at this level's nu."""
        return self.j_fit + self.j_reg

    @property
    def gap(self) -> float:
        """Share of J by which the level lies above what the second solver came by; NaN: unknown."""
        return (self.j - self.second_j) / self.j if self.j > 0.0 else self.second_j

    @property
    def is_minimised(self) -> bool:
        """Whether the solver met a tolerance, and the second one came by nothing lower."""
        return self.status == "converged" and not self.gap > MINIMISED


@dataclass(frozen=True, kw_only=True)
class PathLevel(Level):
    """One solved level of one alternative, and where it ended.

    `kind` is `PATH` or `GLOBAL`, `x` (n,) the search vector, `parameters` (n,) the same in their
    units.
    """

    kind: str
    alternative: int
    x: tuple[float, ...]
    parameters: tuple[float, ...]
    jacobians: int
    runs: int

    @property
    def counts(self) -> Counts:
        """What this level cost."""
        return Counts(self.evaluations, self.jacobians, self.runs)


@dataclass(frozen=True, kw_only=True)
class HistoryRow(Level):
    """A level with its values by name; level -1 is the campaign's start, before any solve."""

    parameters: Mapping[str, float]
    derived: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Journal:
    """How levels are watched and resumed: every hook may be left out.

    `recall(kind, alternative, level)` gives a level finished earlier or None; `record(level)` is
    called after each newly finished one; `clock` measures seconds.
    """

    recall: Callable[[str, int, int], PathLevel | None] = lambda *key: None
    record: Callable[[PathLevel], None] = lambda level: None
    entering: Callable[[str, int, int], None] = lambda *key: None
    clock: Callable[[], float] = time.perf_counter


@dataclass(frozen=True, kw_only=True)
class Course:
    """What is minimised at every ν, for one discrete alternative."""

    objective: Objective
    schedule: Schedule
    misfit: str
    alternative: int
    journal: Journal


def own_start(parameters: Sequence[Parameter]) -> FloatArray:
    """Search vector of the campaign's start, strictly inside the box.

    Args:
        parameters: the fitted parameters.
    """
    return inside(to_search(parameters, starts(parameters)), *search_bounds(parameters))


def follow_path(course: Course) -> Iterator[PathLevel]:
    """The levels of Algorithm 2 as published, one after the other.

    Args:
        course: objective, schedule and misfit.

    Raises:
        FmuFailure: the model failed inside the box.

    Source: the paper's Algorithm 2.
    """
    x = own_start(course.objective.parameters)
    for level in range(course.schedule.levels):
        step = _level(course, PATH, level, x, partial(_interior_point, course.misfit))
        yield step
        if step.change <= course.schedule.tolerance:
            return
        x = np.array(step.x)


def global_path(course: Course, others: Sequence[FloatArray]) -> Iterator[PathLevel]:
    """The least J of a multistart at every ν: from points of the box and from what is known.

    Args:
        course: objective, schedule and misfit.
        others: search vectors to start from as well, (n,) each, as the ends of `follow_path`.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    x = own_start(course.objective.parameters)
    for level in range(course.schedule.levels):
        begins = [x, *others]
        step = _level(course, GLOBAL, level, x, partial(_multistart, course, begins))
        yield step
        x = np.array(step.x)


#: Solves one level: evaluator, Tikhonov weights, where it starts; J of a second solver with it.
_Work = Callable[[Evaluator, FloatArray, FloatArray], tuple[Solve, float]]


def _interior_point(
    misfit: str, evaluator: Evaluator, nu: FloatArray, start: FloatArray
) -> tuple[Solve, float]:
    end = solve(evaluator, start, nu, misfit)
    return end, second_value(evaluator, end.x, nu, misfit)


def _multistart(
    course: Course,
    begins: Sequence[FloatArray],
    evaluator: Evaluator,
    nu: FloatArray,
    start: FloatArray,
) -> tuple[Solve, float]:
    """The lowest end of all starts, its last digits with curvature."""
    misfit, evaluator_of = course.misfit, partial(total, nu=nu, misfit=course.misfit)
    box = Box(course.objective.parameters)
    spread = box.spread(SCREENED, course.schedule.seed)
    chosen: list[FloatArray] = []
    for point in sorted(evaluator.points([*begins, *spread]), key=evaluator_of):
        if len(chosen) < STARTS and all(box.apart(point.x, x) > APART for x in chosen):
            chosen.append(point.x)
    ends = [solve(evaluator, x, nu, misfit, iterations=GLOBAL_ITERATIONS) for x in chosen]
    lowest = min(ends, key=lambda end: end.value)
    for curved in (True, False, True):
        further = solve(
            evaluator, lowest.x, nu, misfit, iterations=GLOBAL_ITERATIONS, curved=curved
        )
        lowest = min(lowest, further, key=lambda end: end.value)
    return lowest, second_value(evaluator, lowest.x, nu, misfit)


def _level(course: Course, kind: str, level: int, x: FloatArray, work: _Work) -> PathLevel:
    """A level as it was finished earlier, else solved and recorded."""
    journal = course.journal
    journal.entering(kind, course.alternative, level)
    step = journal.recall(kind, course.alternative, level)
    if step is None:
        step = _solved(course, kind, level, x, work)
        journal.record(step)
    return step


def _solved(course: Course, kind: str, level: int, x: FloatArray, work: _Work) -> PathLevel:
    begun, schedule, misfit = course.journal.clock(), course.schedule, course.misfit
    evaluator, nu = Evaluator(course.objective), schedule.nu(level)
    pull = weights(course.objective, nu, misfit)
    end, second = work(evaluator, pull, x)
    point = evaluator.point(end.x)
    following = j_reg(end.x, weights(course.objective, nu * schedule.beta, misfit))
    step = PathLevel(
        kind=kind,
        alternative=course.alternative,
        level=level,
        nu=nu,
        x=tuple(map(float, end.x)),
        parameters=tuple(map(float, point.parameters)),
        j_fit=total(point, 0.0, misfit),
        j_reg=j_reg(end.x, pull),
        change=float(np.linalg.norm(end.x - x)) + abs(point.j_fit - following),
        optimality=end.optimality,
        second_j=second,
        status="converged" if end.converged else "iteration limit",
        message=end.message,
        iterations=end.iterations,
        evaluations=evaluator.counts.evaluations,
        jacobians=evaluator.counts.jacobians,
        runs=evaluator.counts.runs,
        seconds=course.journal.clock() - begun,
    )
    words = "%s, ν = %.1e: J = %.6g, %s, %d iterations, %d evaluations, %.1f s"
    counts = step.status, step.iterations, step.evaluations, step.seconds
    _log.info(words, kind, nu, step.j, *counts)
    return step


def history_rows(course: Course, levels: Sequence[PathLevel]) -> tuple[HistoryRow, ...]:
    """The campaign's start and every level, with values by name and means of the outputs.

    Args:
        course: objective, schedule and misfit.
        levels: of one kind; empty: no rows.
    """
    if not levels:
        return ()
    objective, evaluator = course.objective, Evaluator(course.objective)
    x = own_start(objective.parameters)
    point, pull = evaluator.point(x), weights(objective, course.schedule.nu(0), course.misfit)
    nothing: dict[str, Any] = {each.name: math.nan for each in fields(Level)}
    counts = {"iterations": 0, "evaluations": 0, "seconds": 0.0}
    j = {"j_fit": total(point, 0.0, course.misfit), "j_reg": j_reg(x, pull)}
    where = {"level": -1, "status": "start", "message": "where the levels begin"}
    rows = [{**nothing, **counts, **j, **where}]
    rows += [{each.name: getattr(level, each.name) for each in fields(Level)} for level in levels]
    places = [point.parameters, *(np.array(level.parameters) for level in levels)]
    outputs = objective.response.derived_many(places)
    return tuple(
        HistoryRow(
            parameters=named(objective.parameters, p),
            derived={name: mean(values) for name, values in there.items()},
            **row,
        )
        for row, p, there in zip(rows, places, outputs, strict=True)
    )


def named(parameters: Sequence[Parameter], p: FloatArray) -> dict[str, float]:
    """Values by name, periodic ones in their first period.

    Args:
        parameters: what the values belong to.
        p: values (n,), each in its parameter's unit.
    """
    shown = canonical(parameters, p)
    return {q.name: float(value) for q, value in zip(parameters, shown, strict=True)}
