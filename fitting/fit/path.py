"""Algorithm 2: the regularisation is taken back level by level, each solve starting from the last.

    for nu_l = nu_0 beta^l:  x_(l+1) = argmin misfit + nu_l/2 |x|^2 from x_l
    until E = |x_(l+1) - x_l| + |J_fit - J_reg(nu_(l+1))| <= tol  or  l = l_max

`PATH` is the published method: every level by the interior point from the solution of the level
before it and from nothing else. `GLOBAL` is what the levels would be if each were minimised over
the whole box. Neither changes the reported estimate, which is the likelihood's.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, search_bounds, starts, to_search
from fitting.fit.interior_point import Solve, inside, second_value, solve
from fitting.fit.objective import Counts, Evaluator, Objective, j_reg, total, weights
from fitting.fit.options import Options
from fitting.fit.outputs import mean
from fitting.fit.search import Box
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
class Level:
    """One level of ν: its misfit and convergence.

    `change`: the paper's E; `optimality`: the largest component of the Lagrangian's gradient;
    `second_j`: J of a second solver from there (NaN: none); `status`: "converged" or "iteration
    limit".
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
    """A level with its values by name; level -1 is the campaign's start.

    `change`: the paper's E; `optimality`: the largest component of the Lagrangian's gradient;
    `second_j`: J of a second solver from there (NaN: none); `status`: "converged" or "iteration
    limit".
    """

    parameters: Mapping[str, float]
    derived: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class Progress:
    """State of a running fit: which `stage` it is in, and what it has taken so far.

    `stage` is "search", "path" or "global"; `done` of `of` alternatives, or levels of ν, are done.
    `nu`, `j_fit` and `j_reg` are those of the last level (NaN in a search).
    """

    stage: str
    done: int
    of: int
    nu: float = math.nan
    j_fit: float = math.nan
    j_reg: float = math.nan
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


def own_start(parameters: Sequence[Parameter]) -> FloatArray:
    """Search vector of the campaign's start, strictly inside the box.

    Args:
        parameters: the fitted parameters.
    """
    return inside(to_search(parameters, starts(parameters)), *search_bounds(parameters))


def follow_path(
    objective: Objective,
    options: Options,
    alternative: int = 0,
    hooks: Hooks | None = None,
    kind: str = PATH,
    others: Sequence[FloatArray] = (),
) -> Iterator[PathLevel]:
    """The levels of ν in turn, as they were finished earlier, else solved and recorded.

    Args:
        objective: of one discrete alternative.
        options: schedule and misfit.
        alternative: its number.
        hooks: progress, memory and clock.
        kind: `PATH`, Algorithm 2 as published; `GLOBAL`: the least J of a multistart at every ν,
            from points of the box and from what is known.
        others: search vectors from which a multistart begins as well, (n,) each, as the ends of
            the levels of `PATH`.

    Raises:
        FmuFailure: the model failed inside the box.

    Source: the paper's Algorithm 2.
    """
    hooks, schedule, misfit = hooks or Hooks(), options.schedule, options.misfit
    x, started, spent = own_start(objective.parameters), hooks.clock(), 0
    last: dict[str, float] = {}
    for number in range(schedule.iterations):
        now, nu = hooks.clock(), schedule.nu(number)
        state = Progress(
            stage=kind,
            done=number,
            of=schedule.iterations,
            nu=nu,
            **last,
            evaluations=spent,
            elapsed_s=now - started,
        )
        hooks.progress(state)
        memory = hooks.memory
        step = None if memory is None else memory.recall(kind, alternative, number)
        if step is None:
            evaluator, pull = Evaluator(objective), weights(objective, nu, misfit)
            if kind == PATH:
                end = solve(evaluator, x, pull, misfit)
            else:
                end = _multistart(evaluator, options, pull, [x, *others])
            second = second_value(evaluator, end.x, pull, misfit)
            point = evaluator.point(end.x)
            following = j_reg(end.x, weights(objective, nu * schedule.beta, misfit))
            step = PathLevel(
                kind=kind,
                alternative=alternative,
                level=number,
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
                seconds=hooks.clock() - now,
            )
            words = "%s, ν = %.1e: J = %.6g, %s, %d iterations, %d evaluations, %.1f s"
            counts = step.status, step.iterations, step.evaluations, step.seconds
            _log.info(words, kind, nu, step.j, *counts)
            if memory is not None:
                memory.record(step)
        yield step
        if kind == PATH and step.change <= schedule.tolerance:
            return
        x, spent = np.array(step.x), spent + step.evaluations
        last = {"j_fit": step.j_fit, "j_reg": step.j_reg}


def _multistart(
    evaluator: Evaluator, options: Options, nu: FloatArray, begins: Sequence[FloatArray]
) -> Solve:
    """The lowest end of all starts, its last digits with curvature."""
    misfit, box = options.misfit, Box(evaluator.objective.parameters)
    points = evaluator.trials([*begins, *box.spread(SCREENED, options.schedule.seed)])
    chosen: list[FloatArray] = []
    for point in sorted(points, key=lambda each: total(each, nu, misfit)):
        if len(chosen) < STARTS and all(box.apart(point.x, x) > APART for x in chosen):
            chosen.append(point.x)
    ends = [solve(evaluator, x, nu, misfit, iterations=GLOBAL_ITERATIONS) for x in chosen]
    lowest = min(ends, key=lambda end: end.value)
    for curved in (True, False, True):
        further = solve(
            evaluator, lowest.x, nu, misfit, iterations=GLOBAL_ITERATIONS, curved=curved
        )
        lowest = min(lowest, further, key=lambda end: end.value)
    return lowest


def history_rows(
    objective: Objective, options: Options, levels: Sequence[PathLevel]
) -> tuple[HistoryRow, ...]:
    """The campaign's start and every level, with values by name and means of the outputs.

    Args:
        objective: of one discrete alternative.
        options: schedule and misfit.
        levels: of one kind; empty: no rows.
    """
    if not levels:
        return ()
    misfit = options.misfit
    point = Evaluator(objective).point(own_start(objective.parameters))
    start = Level(
        level=-1,
        nu=math.nan,
        j_fit=total(point, 0.0, misfit),
        j_reg=j_reg(point.x, weights(objective, options.schedule.nu(0), misfit)),
        change=math.nan,
        optimality=math.nan,
        status="start",
        message="where the levels begin",
        iterations=0,
        evaluations=0,
        seconds=0.0,
    )
    places = [point.parameters, *(np.array(level.parameters) for level in levels)]
    outputs = objective.response.derived_many(places)
    return tuple(
        HistoryRow(
            parameters=named(objective.parameters, p),
            derived={name: mean(values) for name, values in there.items()},
            **{each.name: getattr(row, each.name) for each in fields(Level)},
        )
        for row, p, there in zip([start, *levels], places, outputs, strict=True)
    )


def named(parameters: Sequence[Parameter], p: FloatArray) -> dict[str, float]:
    """Values by name, periodic ones in their first period.

    Args:
        parameters: what the values belong to.
        p: values (n,), each in its parameter's unit.
    """
    shown = canonical(parameters, p)
    return {q.name: float(value) for q, value in zip(parameters, shown, strict=True)}
