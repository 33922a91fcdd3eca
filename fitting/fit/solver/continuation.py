"""Algorithm 2: the regularisation is taken back step by step, each solve starting from the last.

    for nu_l = nu_0 beta^l:  x_(l+1) = argmin misfit + nu_l/2 |x|^2 from x_l
    until E = |x_(l+1) - x_l| + |J_fit - J_reg(nu_(l+1))| <= tol  or  l = l_max

Several starts run side by side, level by level; where two meet they go on as one. Nothing here
writes: finished steps are handed out, and may be handed back in to go on after an interruption.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds, starts, to_search
from fitting.fit.objective import Objective, j_reg, weights
from fitting.fit.solver.evaluator import Counts, Evaluator, total
from fitting.fit.solver.interior_point import SolveSettings, inside, solve
from fitting.text.arrays import FloatArray

#: Starts that come closer than this, in units of the search vector, go on as one ...
SAME_POINT = 1e-2
#: ... if their J agree to this share of J and to this amount.
SAME_SHARE, SAME_AMOUNT = 1e-3, 1e-6


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """nu_l = nu_start beta^l for l < levels; `tolerance` for E; starts and seed of the search."""

    nu_start: float = 0.1
    beta: float = 0.1
    levels: int = 9
    tolerance: float = 2.22e-16
    starts: int = 3
    seed: int = 1

    def nu(self, level: int) -> float:
        """Regularisation of one level.

        Args:
            level: of ν, from 0.
        """
        return self.nu_start * self.beta**level


@dataclass(frozen=True, kw_only=True)
class ContinuationStep:
    """One solved level of one start: where it ended, at what misfit, and how well.

    `x` search vector, `parameters` the same in their units; `change` the paper's E; `optimality`
    the decrease of J that a linearised step still promises; counts and seconds of this level.
    """

    alternative: int
    start: int
    level: int
    nu: float
    x: tuple[float, ...]
    parameters: tuple[float, ...]
    j_fit: float
    j_reg: float
    change: float
    optimality: float
    status: str
    message: str
    iterations: int
    evaluations: int
    jacobians: int
    runs: int
    seconds: float

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

    `joined` is the start it met, None while it goes on; `ended` says why it stopped.
    """

    start: int
    begun: tuple[float, ...]
    _: KW_ONLY
    steps: tuple[ContinuationStep, ...] = ()
    joined: int | None = None
    ended: str = ""


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


@dataclass(frozen=True)
class Outcome:
    """All chains of one alternative; `interrupted` where the user stopped it."""

    chains: tuple[Chain, ...]
    interrupted: bool = False

    @property
    def best(self) -> Chain | None:
        """The chain that goes furthest with the least J; None before the first level is done.

        Of chains with equal J the first: the campaign's own start, if it is among them.
        """
        done = [chain for chain in self.chains if chain.steps and chain.joined is None]
        furthest = max((len(chain.steps) for chain in done), default=0)
        done = [chain for chain in done if len(chain.steps) == furthest]
        least = min((chain.steps[-1].j for chain in done), default=0.0)
        return next((chain for chain in done if equal_j(chain.steps[-1].j, least)), None)


@dataclass(kw_only=True)
class _Run:
    """What one call of `run_alternative` holds together."""

    objective: Objective
    schedule: Schedule
    settings: SolveSettings
    alternative: int
    journal: Journal
    chains: list[Chain] = field(default_factory=list)


def start_vectors(parameters: Sequence[Parameter], schedule: Schedule) -> list[FloatArray]:
    """Search vectors to start from: the campaign's own first, then seeded ones in the box.

    All strictly inside. More than one, because a symmetric start can be a stationary point of the
    misfit (theta = 0 of two coupled modes is). What has a prior of its own starts alike every time.

    Args:
        parameters: the fitted parameters.
        schedule: of ν.
    """
    lower, upper = search_bounds(parameters)
    generator = np.random.default_rng(schedule.seed)
    own = to_search(parameters, starts(parameters))
    free = np.array([p.prior_sigma is None for p in parameters])
    seeded = [np.array(own) for _ in range(schedule.starts - 1)]
    for x in seeded:
        x[free] = generator.uniform(lower[free], upper[free])
    return [inside(x, lower, upper) for x in [own, *seeded]]


def run_alternative(
    objective: Objective,
    schedule: Schedule,
    settings: SolveSettings,
    alternative: int = 0,
    journal: Journal | None = None,
) -> Outcome:
    """Algorithm 2 for one discrete alternative, from all starts.

    A KeyboardInterrupt ends it with what is finished and `interrupted` set.

    Args:
        objective: rows, parameters and weights.
        schedule: of ν.
        settings: of each solve.
        alternative: its number.
        journal: remembers finished levels and is told of new ones.

    Raises:
        FmuFailure: the model failed inside the box.

    Source: the paper's Algorithm 2.
    """
    vectors = start_vectors(objective.parameters, schedule)
    run = _Run(
        objective=objective,
        schedule=schedule,
        settings=settings,
        alternative=alternative,
        journal=journal or Journal(),
    )
    run.chains = [Chain(k, tuple(map(float, x))) for k, x in enumerate(vectors)]
    try:
        for level in range(schedule.levels):
            _one_level(run, level)
    except KeyboardInterrupt:
        return Outcome(tuple(run.chains), interrupted=True)
    for k, chain in enumerate(run.chains):
        if not chain.ended:
            run.chains[k] = replace(chain, ended=f"all {schedule.levels} levels of nu were done")
    return Outcome(tuple(run.chains))


def _one_level(run: _Run, level: int) -> None:
    for k, chain in enumerate(run.chains):
        if chain.ended:
            continue
        run.journal.entering(run.alternative, chain.start, level)
        step = run.journal.recall(run.alternative, chain.start, level)
        if step is None:
            step = _solve_level(run, chain, level)
            run.journal.record(step)
        ended = ""
        if step.change <= run.schedule.tolerance:
            ended = f"E = {step.change:.2e} fell to the tolerance"
        run.chains[k] = replace(chain, steps=(*chain.steps, step), ended=ended)
    _join(run)


def _solve_level(run: _Run, chain: Chain, level: int) -> ContinuationStep:
    """One regularised problem, from the chain's last point; depends on nothing but that point."""
    begun = run.journal.clock()
    nu = run.schedule.nu(level)
    x = np.array(chain.steps[-1].x if chain.steps else chain.begun)
    evaluator = Evaluator(run.objective)
    seeds = [run.schedule.seed, run.alternative, chain.start, level]
    misfit = run.settings.misfit
    tikhonov_weights = weights(run.objective, nu, misfit)
    answer = solve(evaluator, x, tikhonov_weights, run.settings, np.random.default_rng(seeds))
    point = evaluator.point(answer.x)
    following = j_reg(answer.x, weights(run.objective, run.schedule.nu(level + 1), misfit))
    return ContinuationStep(
        alternative=run.alternative,
        start=chain.start,
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
        seconds=run.journal.clock() - begun,
    )


def _join(run: _Run) -> None:
    """End every chain that stands where an earlier one stands: they would go on alike."""
    going = [k for k, chain in enumerate(run.chains) if not chain.ended]
    kept: list[int] = []
    for k in going:
        chain = run.chains[k]
        twin = next((i for i in kept if _same(run, run.chains[i], chain)), None)
        if twin is None:
            kept.append(k)
            continue
        met = run.chains[twin].start
        ended = f"met start {met + 1} at nu = {chain.steps[-1].nu:.1e}"
        run.chains[k] = replace(chain, joined=met, ended=ended)


def _same(run: _Run, one: Chain, other: Chain) -> bool:
    a, b = one.steps[-1], other.steps[-1]
    near = distance(run.objective.parameters, np.array(a.x), np.array(b.x)) <= SAME_POINT
    return near and equal_j(a.j, b.j)


def equal_j(one: float, other: float) -> bool:
    """Whether two values of J count as the same minimum.

    Args:
        one: value of J.
        other: value of J.
    """
    return abs(one - other) <= SAME_AMOUNT + SAME_SHARE * min(abs(one), abs(other))


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
