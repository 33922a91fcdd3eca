"""Algorithm 2: the regularisation is taken back step by step, each solve starting from the last.

    for nu_l = nu_0 beta^l:  x_(l+1) = argmin misfit + nu_l/2 |x|^2 from x_l
    until E = |x_(l+1) - x_l| + |J_fit - J_reg(nu_(l+1))| <= tol  or  l = l_max

One start goes through all levels: the campaign's own. What a search of the box finds besides is
lowered at the last nu only, since large ones pull all starts together. Nothing here writes:
finished steps are handed out, and may be handed back in to go on after an interruption.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import Protocol

import numpy as np

from fitting.campaign.file import Continuation
from fitting.campaign.parameters import Parameter, search_bounds, starts, to_search
from fitting.fit.objective import Nu, Objective, j_reg, weights
from fitting.fit.solver.evaluator import Counts, Evaluator, total
from fitting.fit.solver.interior_point import (
    Solve,
    SolveSettings,
    along_the_valley,
    crept,
    finish,
    inside,
    solve,
    to_the_last_digits,
)
from fitting.text.arrays import FloatArray

_log = logging.getLogger(__name__)

#: Starts that end closer than this, in units of the search vector, ended in one minimum ...
SAME_POINT = 1e-2
#: ... if their J agree to this share of J and to this amount.
SAME_SHARE, SAME_AMOUNT = 1e-3, 1e-6
#: Difference of J, and share of it, from which one of two ends is the lower all the same.
LOWER = 1e-6


@dataclass(frozen=True, kw_only=True)
class Schedule(Continuation):
    """nu_l = nu_start beta^l for l < levels; `tolerance` for E; starts and seed of the search.

    The first of `starts` is the campaign's own, the others are the lowest minima that a search of
    the box finds; with one start there is no search.
    """

    levels: int = 9

    def nu(self, level: int) -> float:
        """Regularisation of one level.

        Args:
            level: of ν, from 0.
        """
        return self.nu_start * self.beta**level


@dataclass(frozen=True, kw_only=True)
class Level:
    """One solved level: at what nu, at what misfit it ended, and how well.

    `change` is the paper's E, `optimality` the decrease of J that a linearised step still promises;
    iterations, evaluations and seconds are of this level alone.
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


@dataclass(frozen=True, kw_only=True)
class ContinuationStep(Level):
    """One solved level of one start of one alternative, and where it ended.

    What a search found is lowered at the last nu, as one level more than the schedule has; a level
    beyond that goes along a bent valley, where straight steps crept, and is told with the last.
    `x` search vector, `parameters` the same in their units.
    """

    alternative: int
    start: int
    x: tuple[float, ...]
    parameters: tuple[float, ...]
    jacobians: int
    runs: int

    @property
    def j(self) -> float:
        """J = J_fit + J_reg at this level's nu."""
        return self.j_fit + self.j_reg

    @property
    def counts(self) -> Counts:
        """What this level cost."""
        return Counts(self.evaluations, self.jacobians, self.runs)


@dataclass(frozen=True)
class Chain:
    """One start and the levels it went through.

    `joined` is the start whose minimum it ended in, None if there is none; `ended` says why it
    stopped; `polished` whether its end went on along a bent valley.
    """

    start: int
    begun: tuple[float, ...]
    _: KW_ONLY
    steps: tuple[ContinuationStep, ...] = ()
    joined: int | None = None
    ended: str = ""
    polished: bool = False

    @property
    def nu(self) -> float:
        """Where it stands: the last nu that is done, infinite before the first."""
        return self.steps[-1].nu if self.steps else math.inf


@dataclass(frozen=True, kw_only=True)
class Journal:
    """How a run is watched and resumed: every hook may be left out.

    `recall(alternative, start, level)` gives a step finished earlier or None; `record(step)` is
    called after each newly finished one; `clock` measures seconds.
    """

    recall: Callable[[int, int, int], ContinuationStep | None] = lambda *key: None
    record: Callable[[ContinuationStep], None] = lambda step: None
    entering: Callable[[int, int, int], None] = lambda *key: None
    clock: Callable[[], float] = time.perf_counter


@dataclass(frozen=True, kw_only=True)
class Course:
    """How the levels of one discrete alternative are solved, and who is told."""

    objective: Objective
    schedule: Schedule
    settings: SolveSettings
    alternative: int = 0
    journal: Journal = field(default_factory=Journal)


def own_start(parameters: Sequence[Parameter]) -> FloatArray:
    """Search vector of the campaign's start, strictly inside the box.

    Args:
        parameters: the fitted parameters.
    """
    return inside(to_search(parameters, starts(parameters)), *search_bounds(parameters))


def next_level(course: Course, chain: Chain) -> Chain:
    """The chain one level further: a regularised problem, solved from its last point.

    Depends on nothing but that point.

    Args:
        course: schedule, settings and journal.
        chain: that has not ended.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    level, schedule = len(chain.steps), course.schedule
    x = np.array(chain.steps[-1].x if chain.steps else chain.begun)
    work = _solving(course, x, solve, last=level + 1 == schedule.levels)
    step = _level(course, chain.start, level, schedule.nu(level), x, work)
    ended = ""
    if step.change <= schedule.tolerance:
        ended = f"E = {step.change:.2e} fell to the tolerance"
    elif level + 1 == schedule.levels:
        ended = (
            f"all {schedule.levels} levels of nu were done"
            if schedule.levels > 1
            else "the one level of nu was done"
        )
    return replace(chain, steps=(*chain.steps, step), ended=ended)


def lowered(
    course: Course, start: int, nu: float, begun: FloatArray, x: FloatArray, least: float = math.inf
) -> Chain:
    """A chain of one level, beyond the schedule: J at the last nu from a point near a minimum.

    Args:
        course: schedule, settings and journal.
        start: its number.
        nu: the last one.
        begun: where the search came from, (n,).
        x: search vector that it found, (n,).
        least: J of the lowest end that is known.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    work = _solving(course, x, finish, last=True, least=least)
    step = _level(course, start, course.schedule.levels, nu, x, work)
    return Chain(
        start,
        tuple(map(float, begun)),
        steps=(step,),
        ended=f"lowered at ν = {nu:.1e} from a minimum of χ² that was found elsewhere",
    )


def has_crept(course: Course, chain: Chain) -> bool:
    """Whether a chain ended at the last nu where curved steps may lower J further.

    Args:
        course: schedule and settings.
        chain: with a level done.
    """
    last = chain.steps[-1]
    open_ = chain.ended and chain.joined is None and not chain.polished
    asked = course.settings.polish and bool(open_)
    return asked and crept(last.optimality, last.j, course.settings.misfit)


def polished(course: Course, chain: Chain) -> Chain:
    """The chain with its last level taken on by curved steps, where straight ones crept.

    Args:
        course: schedule, settings and journal.
        chain: that has crept.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    last, x = chain.steps[-1], np.array(chain.steps[-1].x)
    found = Solve(
        x=x,
        optimality=last.optimality,
        status=last.status,
        message=last.message,
        iterations=0,
        steps=0,
    )

    def work(evaluator: Evaluator, nu: Nu, generator: np.random.Generator) -> Solve:
        return along_the_valley(evaluator, found, nu, course.settings)

    step = _level(course, chain.start, course.schedule.levels + 1, last.nu, x, work)
    whole = replace(
        step,
        level=last.level,
        change=last.change,
        iterations=last.iterations,
        evaluations=last.evaluations + step.evaluations,
        jacobians=last.jacobians + step.jacobians,
        runs=last.runs + step.runs,
        seconds=last.seconds + step.seconds,
    )
    return replace(chain, steps=(*chain.steps[:-1], whole), polished=True)


class _Solver(Protocol):
    def __call__(
        self,
        evaluator: Evaluator,
        start: FloatArray,
        nu: Nu,
        settings: SolveSettings,
        generator: np.random.Generator,
    ) -> Solve: ...


#: What is done at one level: from what the evaluator and the Tikhonov weights say.
_Work = Callable[[Evaluator, Nu, np.random.Generator], Solve]


def _solving(
    course: Course, x: FloatArray, solver: _Solver, *, last: bool, least: float = math.inf
) -> _Work:
    """A solve from x; at the last nu to the last digits."""

    def work(evaluator: Evaluator, nu: Nu, generator: np.random.Generator) -> Solve:
        found = solver(evaluator, x, nu, course.settings, generator)
        return to_the_last_digits(evaluator, found, nu, course.settings, least) if last else found

    return work


def _level(
    course: Course, start: int, level: int, nu: float, x: FloatArray, work: _Work
) -> ContinuationStep:
    """A level as it was finished earlier, else solved and recorded."""
    course.journal.entering(course.alternative, start, level)
    step = course.journal.recall(course.alternative, start, level)
    if step is None:
        step = _solved(course, start, level, nu, x, work)
        course.journal.record(step)
    return step


def _solved(
    course: Course, start: int, level: int, nu: float, x: FloatArray, work: _Work
) -> ContinuationStep:
    begun = course.journal.clock()
    evaluator = Evaluator(course.objective)
    seeds = [course.schedule.seed, course.alternative, start, level]
    misfit = course.settings.misfit
    tikhonov_weights = weights(course.objective, nu, misfit)
    answer = work(evaluator, tikhonov_weights, np.random.default_rng(seeds))
    point = evaluator.point(answer.x)
    following = j_reg(answer.x, weights(course.objective, nu * course.schedule.beta, misfit))
    step = ContinuationStep(
        alternative=course.alternative,
        start=start,
        level=level,
        nu=nu,
        x=tuple(map(float, answer.x)),
        parameters=tuple(map(float, point.parameters)),
        j_fit=point.j_fit,
        j_reg=total(point, tikhonov_weights, misfit) - total(point, 0.0, misfit),
        change=float(np.linalg.norm(answer.x - x)) + abs(point.j_fit - following),
        optimality=answer.optimality,
        status=answer.status,
        message=answer.message,
        iterations=answer.iterations,
        evaluations=evaluator.counts.evaluations,
        jacobians=evaluator.counts.jacobians,
        runs=evaluator.counts.runs,
        seconds=course.journal.clock() - begun,
    )
    _log.info(
        "alternative %d, start %d, ν = %.1e: J = %.6g, %s, %d evaluations, %.1f s",
        step.alternative + 1,
        step.start + 1,
        nu,
        step.j,
        step.status,
        step.evaluations,
        step.seconds,
    )
    return step


def met(
    parameters: Sequence[Parameter],
    chain: Chain,
    others: Sequence[Chain],
    images: Sequence[FloatArray] = (),
) -> Chain:
    """The chain, joined to the first of some others that ended in the same minimum.

    Args:
        parameters: the fitted parameters.
        chain: with a level done.
        others: before it.
        images: search vectors, (n,) each, that are its end all the same: its twins.
    """
    end = chain.steps[-1]
    for other in others:
        if not other.steps or other.joined is not None:
            continue
        there = other.steps[-1]
        for k, x in enumerate((np.array(end.x), *images)):
            near = distance(parameters, x, np.array(there.x)) <= SAME_POINT
            if near and equal_j(end.j, there.j):
                twin = "a twin of " if k else ""
                said = f"met {twin}start {other.start + 1} at ν = {end.nu:.1e}"
                return replace(chain, joined=other.start, ended=said)
    return chain


def equal_j(one: float, other: float) -> bool:
    """Whether two values of J count as the same minimum.

    Args:
        one: value of J.
        other: value of J.
    """
    return abs(one - other) <= SAME_AMOUNT + SAME_SHARE * min(abs(one), abs(other))


def is_lower(one: float, other: float) -> bool:
    """Whether a value of J is below another by more than what solving leaves.

    Args:
        one: value of J.
        other: value of J.
    """
    return one < other - LOWER * (1.0 + abs(other))


def distance(parameters: Sequence[Parameter], x: FloatArray, y: FloatArray) -> float:
    """Largest difference of two search vectors, periodic ones modulo their period.

    Args:
        parameters: the fitted parameters.
        x: search vector (n,).
        y: another search vector (n,).
    """
    difference = np.abs(x - y)
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:
            period = parameter.period / parameter.scale
            rest = float(np.mod(difference[i], period))
            difference[i] = min(rest, period - rest)
    return float(np.max(difference))
