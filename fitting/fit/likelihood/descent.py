"""Least squares over the likelihood, as a search that runs beside others; the most likely point.

Levenberg and Marquardt's method with bounds and forward differences. Where something is held, as
along a profile, slopes are carried on over a few good steps by Broyden's update, which takes an
evaluation instead of n + 1; a minimum is only called one by slopes that were taken there. It moves
along directions that the data see and stays where it is along those that they do not: what it finds
there is where it began, never where rounding took it.

Source: J. More, "The Levenberg-Marquardt algorithm", Lecture Notes in Mathematics 630 (1978);
C. G. Broyden, "A class of methods for solving nonlinear simultaneous equations", Mathematics of
Computation 19 (1965) 577.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH, own_count
from fitting.fit.differences import forward
from fitting.fit.likelihood.likelihood import Likelihood, LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Request, Sample, Task, run_in_lockstep
from fitting.fit.linearisation import SMALLEST_SIGMA, Linearisation
from fitting.signal.chi_square import tail
from fitting.signal.least_squares import damped_step
from fitting.signal.student import normal_square
from fitting.text.arrays import FloatArray
from fitting.text.errors import OutOfBudget

#: A descent ends where a linearised step promises less than this of chi square.
PROMISE = 2e-3
ITERATIONS = 30
#: Share of that from which a step by new slopes is still tried where carried ones led to an end.
WORTH_A_LOOK = 1e-4
#: Steps whose pace tells whether a descent comes to where it is wanted, and how often that pace it
#: may still take up.
PACED, SPEEDUP = 3, 2.0
#: Chi square that a step across the whole box costs at first, and from which nothing moves.
LEAST_DAMPING, MOST_DAMPING = 0.1, 1e8
#: Free promises below which a descent that got stuck has arrived all the same.
STALLED = 1.0
#: Chi square beyond what the linearised step foresees from which it went astray.
ASTRAY = 20.0
#: Steps at most over which slopes are carried on; share of the promise of a step that it must gain,
#: and chi square beyond what it foresees that it may end at, for them to be good enough.
CARRIED, KEPT_SHARE, KEPT_EXCESS = 3, 0.7, 1.0
#: Parameters of single experiments that are few, and steps at most over which slopes are carried
#: then: their nodes share most runs with their point's own, and each step of few is a batch.
FEW_OWN, CARRIED_OF_FEW = 12, 2
#: Probability of a chi square below which it is taken for more than noise.
TOO_LARGE_P = 0.05
#: Chi square by which the data may be described better with wider noise, and times that a descent
#: is gone on with where they are: then it had been stuck.
MISSED, ONCE_MORE = 0.1, 3
#: Gain in chi square for which the most likely point may leave the box of the campaign.
WORTH_LEAVING = 0.1
#: Gain in chi square, were a limit not there, from which the limit is said to hold a point.
HELD = 0.1
#: Times that noise is taken anew from the residuals that it leaves, and the change that is none.
SCATTER_ROUNDS, SAME_SCATTER = 4, 1e-3
#: Relative error of a slope by forward differences, at most.
BLURRED = 1e-3
#: Distance from a limit, in widths of the box, at which a point is at it.
AT_LIMIT = 1e-6


@dataclass(frozen=True)
class Expansion:
    """A sample with its slopes: the first-order expansion of rows and outputs about it.

    `matrix` is d rows/dx (m, n), `outward` d outputs/dx (k, n).
    """

    sample: Sample
    matrix: FloatArray
    outward: FloatArray

    @property
    def x(self) -> FloatArray:
        """The search vector."""
        return self.sample.x

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows; infinite where the model failed, there or at the stencil."""
        square = float(self.sample.rows @ self.sample.rows)
        return square if np.isfinite(square) and np.all(np.isfinite(self.matrix)) else np.inf


@dataclass(frozen=True)
class Constraint:
    """What a descent keeps to: x_index at `target`, or output `output` near it with that `weight`.

    `frozen` axes stay where they are.

    With a weight w the minimum of chi^2 + w^2 (g - target)^2 lies on the profile of g all the same:
    at its own g, which is read off afterwards.
    """

    target: float
    _: KW_ONLY
    index: int = -1
    output: int = -1
    weight: float = 0.0
    frozen: tuple[int, ...] = ()

    def residual(self, sample: Sample) -> float:
        """Weighted distance of the held output from its target; zero for a parameter.

        Args:
            sample: with outputs, if one of them is held.
        """
        if self.output < 0:
            return 0.0
        return self.weight * float(sample.outputs[self.output] - self.target)


UNCONSTRAINED = Constraint(0.0)


def expansion_at(
    likelihood: Likelihood, x: FloatArray, outputs: bool = True, known: Sample | None = None
) -> Task[Expansion]:
    """A point with its slopes, in one round; without those of the outputs if not wanted.

    Where the model fails a step away, as it may beyond the box, the step is taken the other way.

    Args:
        likelihood: whose stencil is evaluated.
        x: search vector, shape (n,).
        outputs: whether their slopes are wanted.
        known: the point itself, if it has been evaluated.
    """
    around = forward(x, likelihood.objective.steps, likelihood.upper)
    if known is None:
        samples = yield Request(around.nodes, outputs=outputs)
    else:
        samples = [known, *(yield Request(around.nodes[1:], outputs=outputs))]
    failed = [i for i in range(x.size) if not np.all(np.isfinite(samples[i + 1].rows))]
    if failed and np.all(np.isfinite(samples[0].rows)):
        around = around.turned(failed)
        again = yield Request(tuple(around.nodes[i + 1] for i in failed), outputs=outputs)
        samples = list(samples)
        for i, sample in zip(failed, again, strict=True):
            samples[i + 1] = sample
    matrix = around.quotients([sample.rows for sample in samples])
    return Expansion(samples[0], matrix, around.quotients([sample.outputs for sample in samples]))


def _carried(likelihood: Likelihood, here: Expansion, sample: Sample) -> Expansion:
    """A point with the slopes of another one, mended along the way between them.

    B' = B + (dr - B dx) dx^T W/(dx^T W dx), W the inverse squares of the widths of the box.
    """
    way = sample.x - here.x
    weighted = way / likelihood.widths**2
    along = weighted / max(float(way @ weighted), 1e-300)

    def mended(slopes: FloatArray, change: FloatArray) -> FloatArray:
        return np.asarray(slopes + np.outer(change - slopes @ way, along))

    outward = np.empty((0, way.size))
    if sample.outputs.size:
        with np.errstate(invalid="ignore"):  # of an infinite output no slope is known
            outward = mended(here.outward, sample.outputs - here.sample.outputs)
    return Expansion(sample, mended(here.matrix, sample.rows - here.sample.rows), outward)


@dataclass(frozen=True)
class Descent:
    """Where a descent ended, and whether that is a minimum as far as it can tell."""

    end: Expansion
    reached: bool

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows at the end."""
        return self.end.chi_square


def descend(
    likelihood: Likelihood,
    here: Expansion,
    constraint: Constraint = UNCONSTRAINED,
    promise: float = PROMISE,
    enough: float = -np.inf,
    wanted: float = np.inf,
) -> Task[Expansion | None]:
    """The nearest minimum of chi square under `constraint`; None where none was reached.

    It ends where a linearised step promises less than `promise`, or where chi square, with the row
    of the constraint, is as low as `enough`; without a minimum where it will not come to `wanted`.

    Args:
        likelihood: whose chi square is lowered.
        here: where it begins.
        constraint: that the minimum keeps to.
        promise: decrease of chi square that is no longer worth a step.
        enough: chi square that is low enough.
        wanted: chi square above which a minimum is of no interest.
    """
    found = yield from lower(likelihood, here, constraint, promise, enough, wanted)
    return found.end if found.reached else None


def lower(
    likelihood: Likelihood,
    here: Expansion,
    constraint: Constraint = UNCONSTRAINED,
    promise: float = PROMISE,
    enough: float = -np.inf,
    wanted: float = np.inf,
) -> Task[Descent]:
    """The same as `descend`, with the lowest point that was come by where no minimum was reached.

    Args:
        likelihood: whose chi square is lowered.
        here: where it begins.
        constraint: that the minimum keeps to.
        promise: decrease of chi square that is no longer worth a step.
        enough: chi square that is low enough.
        wanted: chi square above which a minimum is of no interest.
    """
    if not np.isfinite(here.chi_square):
        return Descent(here, reached=False)
    walker = _Walker(likelihood, here, constraint, wanted)
    while walker.steps < ITERATIONS:
        ended = yield from walker.go(promise, enough)
        if ended is not None:
            return ended
    yield from walker.renewed()
    return Descent(walker.here, reached=False)


class _Walker:
    """Where a descent stands, how many steps it took, how they are damped, how old its slopes are.

    `moved`: whether a held parameter has been brought to its value, if there is one; `age`: steps
    over which slopes were carried, zero where they were taken; `hope`: least that a damped step
    promised by slopes that were taken.
    """

    def __init__(
        self, likelihood: Likelihood, here: Expansion, constraint: Constraint, wanted: float
    ) -> None:
        self.likelihood, self.here, self.constraint = likelihood, here, constraint
        self.moved = constraint.index < 0
        self.steps = self.age = 0
        self.damping, self.hope, self.pace = LEAST_DAMPING, np.inf, _Pace(wanted)
        self._oldest = _most_carried(likelihood, constraint)
        self._led_by_carried = False
        self._sound = here, self.moved  # where slopes were taken last

    @property
    def merit(self) -> float:
        """What is lowered, here."""
        return _merit(self.here, self.constraint)

    def go(self, promise: float, enough: float) -> Task[Descent | None]:
        """One step, or what it takes to see that there is none left; the end, once it is there.

        Args:
            promise: decrease of the merit that is no longer worth a step.
            enough: merit that is low enough.
        """
        step, promised, left = _proposed(self.likelihood, self.here, self.constraint, self.damping)
        if not self.age:
            self.hope = min(self.hope, promised) if self.damping > LEAST_DAMPING else promised
        if self.moved and (promised < promise or self.merit <= enough):
            if (yield from self.renewed()):
                return None
            if self.merit > enough and promised > WORTH_A_LOOK * promise:
                yield from self._looked_at(step)
            # a step that is damped promises little anywhere: what did any promise least? The free
            # step here would be stricter, but ends walks of profiles that do go on (q2, seed 70005)
            return Descent(self.here, self.hope < STALLED or self.merit <= enough)
        if self.moved and self.pace.is_hopeless(self.merit, ITERATIONS - self.steps):
            return Descent(self.here, reached=False)
        trial = yield from self._tried(step)
        if not self.moved:
            return (yield from self._brought(trial, left))
        return (yield from self._lowered(trial, promised, promise))

    def renewed(self) -> Task[bool]:
        """Take the slopes here anew; False where they are.

        Where the model fails a step away the point is none to stay at: back to the last one that
        was, and from there on no slopes are carried.
        """
        if not self.age:
            return False
        here = yield from expansion_at(
            self.likelihood, self.here.x, self.constraint.output >= 0, self.here.sample
        )
        self.age = 0
        if np.isfinite(here.chi_square):
            self._sound = here, True
        else:
            self._oldest = 0
        self.here, self.moved = self._sound
        return True

    def _tried(self, step: FloatArray) -> Task[Expansion]:
        """The point a step away, with slopes that are carried on as long as that may be."""
        self.steps += 1
        x, outputs = self.here.x + step, self.constraint.output >= 0
        if self.age == self._oldest:
            return (yield from expansion_at(self.likelihood, x, outputs))
        [sample] = yield Request((x,), outputs=outputs)
        return _carried(self.likelihood, self.here, sample)

    def _brought(self, trial: Expansion, left: float) -> Task[Descent | None]:
        """Take a step that brings a held parameter to its value, or hold the rest back."""
        merit = _merit(trial, self.constraint)
        if merit > left + ASTRAY and self.damping < MOST_DAMPING:
            self.damping *= 1e3  # the free step threw the rest out of the valley
            return None
        if not np.isfinite(merit):
            return Descent(self.here, reached=False)
        free = self.damping == LEAST_DAMPING
        self.damping = LEAST_DAMPING
        yield from self._taken(trial, as_foreseen=free and merit < left + KEPT_EXCESS)
        return None

    def _lowered(self, trial: Expansion, promised: float, promise: float) -> Task[Descent | None]:
        """Take a step that gains, or damp the next one; the end where neither is of any use."""
        gain = self.merit - _merit(trial, self.constraint)
        if gain > 0.0:
            self.damping = max(0.1 * self.damping, LEAST_DAMPING)
            free = self.damping == LEAST_DAMPING
            enough = max(KEPT_SHARE * promised, promised - KEPT_EXCESS)
            yield from self._taken(trial, as_foreseen=gain > enough)
            small = gain < promise and promised < 10.0 * promise and free
            if small and not (yield from self.renewed()):
                return Descent(self.here, reached=True)
        elif (yield from self.renewed()):
            self.steps -= 1  # old slopes led astray: no step of the descent, and no pace of it
            self.pace.merits.pop()
        else:
            self.damping *= 30.0
            if self.damping > MOST_DAMPING:
                return Descent(self.here, self.hope < STALLED)
        return None

    def _taken(self, trial: Expansion, *, as_foreseen: bool) -> Task[None]:
        """Go there; slopes that did not foresee what was found are taken anew."""
        fresh = self.age == self._oldest
        self._led_by_carried = self.age > 0
        self.here, self.moved, self.age = trial, True, 0 if fresh else self.age + 1
        if fresh:
            self._sound = trial, True
        elif not as_foreseen:
            yield from self.renewed()

    def _looked_at(self, step: FloatArray) -> Task[None]:
        """Go a last short step by slopes of here, if carried ones led here and it is lower there.

        A step by slopes of its own point leaves the square of what was to go, one by carried slopes
        a share of it. The slopes here are those at its end, as far as anything can tell.
        """
        if not self._led_by_carried:
            return
        [sample] = yield Request((self.here.x + step,), outputs=self.constraint.output >= 0)
        trial = Expansion(sample, self.here.matrix, self.here.outward)
        if _merit(trial, self.constraint) < self.merit:
            self.here = trial


def _most_carried(likelihood: Likelihood, constraint: Constraint) -> int:
    """Steps at most over which slopes are carried."""
    if constraint == UNCONSTRAINED:
        return 0  # these are few, and which of several minima is lowest hangs on their last step
    return CARRIED_OF_FEW if 0 < own_count(likelihood.parameters) <= FEW_OWN else CARRIED


class _Pace:
    """Whether a descent comes to `wanted` in the steps that are left, at the pace of its last ones.

    Ends of boxes that thousands of sigma exclude would else take every one of its steps.
    """

    def __init__(self, wanted: float) -> None:
        self.wanted = wanted
        self.merits: list[float] = []

    def is_hopeless(self, merit: float, left: int) -> bool:
        """Whether it does not, not even at `SPEEDUP` times that pace.

        Args:
            merit: before its next step.
            left: steps that it still has.
        """
        self.merits.append(merit)
        if not np.isfinite(self.wanted) or len(self.merits) <= PACED:
            return False
        pace = (self.merits[-1 - PACED] - merit) / PACED
        return merit - SPEEDUP * pace * left > self.wanted


def _merit(expansion: Expansion, constraint: Constraint) -> float:
    merit = expansion.chi_square + constraint.residual(expansion.sample) ** 2
    return merit if np.isfinite(merit) else np.inf


def _proposed(
    likelihood: Likelihood, here: Expansion, constraint: Constraint, damping: float
) -> tuple[FloatArray, float, float]:
    """Step of the damped, bounded problem, the decrease of the merit it promises, and the rest."""
    reach = np.minimum(likelihood.widths, 0.25 * likelihood.periods)
    rows, target = [here.matrix], [-here.sample.rows]
    if constraint.output >= 0:
        outward = np.where(
            np.isfinite(here.outward[constraint.output]), here.outward[constraint.output], 0.0
        )
        rows.append(constraint.weight * outward[np.newaxis])
        target.append(np.array([-constraint.residual(here.sample)]))
    matrix, wanted = np.concatenate(rows), np.concatenate(target)
    low = np.maximum(likelihood.lower - here.x, -reach)
    high = np.minimum(likelihood.upper - here.x, reach)
    fixed = np.zeros(here.x.size)
    free = np.ones(here.x.size, dtype=bool)
    free[list(constraint.frozen)] = False
    if constraint.index >= 0:
        free[constraint.index] = False
        fixed[constraint.index] = constraint.target - here.x[constraint.index]
    step = fixed.copy()
    if np.any(free):
        widths = likelihood.widths[free]  # damping costs the same along every axis of the box
        step[free] = widths * damped_step(
            matrix[:, free] * widths,
            matrix @ fixed - wanted,
            damping,
            (low[free] / widths, high[free] / widths),
        )
    left = wanted - matrix @ step
    return step, float(wanted @ wanted - left @ left), float(left @ left)


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """The most likely point: its likelihood (inflation in it) and the point with its slopes.

    `chi_square` of the data before inflation, against `degrees_of_freedom`; `converged`
    whether a minimum was reached. `noise_freedom` are the degrees of freedom of the noise where
    the residuals tell it, infinite where it is known as it is stated.
    """

    likelihood: Likelihood
    expansion: Expansion
    chi_square: float
    degrees_of_freedom: float
    converged: bool
    noise_freedom: float = np.inf

    @property
    def least(self) -> float:
        """Chi square (inflated, priors included) at the optimum."""
        return self.expansion.chi_square

    @property
    def data_square(self) -> float:
        """Chi square of the data at the optimum itself, by the noise as it is stated."""
        rows = self.expansion.sample.rows[: self.likelihood.data_rows]
        return self.likelihood.inflation**2 * float(rows @ rows)

    def delta(self, chi_square: float, freedom: float | None = None) -> float:
        """Dchi^2 of a point, as improbable as of noise that is known (`normal_square`).

        Args:
            chi_square: at the point, inflated and with priors.
            freedom: of the noise; None: that of all rows.
        """
        return self.calibrated(chi_square - self.least, freedom)

    def calibrated(self, increase: float, freedom: float | None = None) -> float:
        """An increase of chi square, as improbable as of noise that is known.

        Args:
            increase: over the optimum.
            freedom: of the noise; None: that of all rows.
        """
        return normal_square(increase, self.noise_freedom if freedom is None else freedom)

    def freedom_along(self, slope: FloatArray, covariance: FloatArray) -> float:
        """Degrees of freedom of the noise of one value; those of all rows without a slope.

        Args:
            slope: d value/dx, shape (n,).
            covariance: of x, shape (n, n).
        """
        likelihood, m = self.likelihood, self.likelihood.data_rows
        if np.isinf(self.noise_freedom) or not np.all(np.isfinite(slope)):
            return self.noise_freedom
        told = likelihood.scatter if likelihood.inflation == 1.0 else np.ones(m)
        here = Linearisation(
            rows=self.expansion.sample.rows[:m],
            matrix=self.expansion.matrix[:m],
            prior=np.ones(slope.size),
            scatter=told,
            freedom=self.noise_freedom,
        )
        return here.freedom_of(slope, covariance)


def most_likely(evaluator: LikelihoodEvaluator, starts: Sequence[FloatArray]) -> Optimum:
    """Least squares in the box from several starts; residuals beyond the noise widen them.

    The first start wins where another is no better by PROMISE: in a valley the point beside the
    reported solution is taken. k^2 = chi^2/freedom where noise alone reaches that chi^2 less often
    than TOO_LARGE_P, else one (`inflation_of`). Wider noise leaves no less of the data than the
    least chi square: where it does, the descent had been stuck, and is gone on with.

    Args:
        evaluator: evaluates the likelihood without inflation; is given the inflated one.
        starts: search vectors, the end of Algorithm 2 first.

    Raises:
        OutOfBudget: the evaluator's limit does not let it begin.
        FmuFailure: the model failed at the first start.
    """
    stated = evaluator.likelihood
    found = _judged(evaluator, starts)
    for _ in range(ONCE_MORE):
        if found.data_square > found.chi_square - MISSED:
            break
        evaluator.likelihood = stated
        found = _judged(evaluator, [found.expansion.x])
    with evaluator.beyond_limit():  # what is said of outputs rests on it
        asked = expansion_at(evaluator.likelihood, found.expansion.x)
        [whole] = run_in_lockstep([asked], evaluator)
    return found if whole is None else replace(found, expansion=whole)


def _judged(evaluator: LikelihoodEvaluator, starts: Sequence[FloatArray]) -> Optimum:
    """The lowest end of some descents, gone on from with wider noise where it wants that."""
    best, converged = _best_of(evaluator, starts)
    best, converged, noise_freedom = _with_own_scatter(evaluator, best, converged)
    likelihood = evaluator.likelihood
    data = best.sample.rows[: likelihood.data_rows]
    chi_square = float(data @ data)
    free = freedom_of(likelihood, best)
    told = likelihood.objective.data.noise_freedom
    inflation = inflation_of(chi_square, free, noise_freedom=told)
    if inflation > 1.0:
        noise_freedom = free
        evaluator.likelihood = replace(likelihood, inflation=inflation)
        best, converged = _best_of(evaluator, [best.x])
    return Optimum(
        likelihood=evaluator.likelihood,
        expansion=best,
        chi_square=chi_square,
        degrees_of_freedom=free,
        converged=converged,
        noise_freedom=noise_freedom,
    )


def _with_own_scatter(
    evaluator: LikelihoodEvaluator, best: Expansion, converged: bool
) -> tuple[Expansion, bool, float]:
    """The same with noise that the residuals tell taken from those of the best point itself.

    s^2 = sum r^2/nu over such rows, nu what parameters, scales and backgrounds leave of them: chi
    square is then nu, however the rows were weighed on the way here. With the degrees of freedom.
    """
    if not evaluator.likelihood.scatter.size:
        return best, converged, np.inf
    freedom = np.inf
    for _ in range(SCATTER_ROUNDS):
        likelihood, m = evaluator.likelihood, evaluator.likelihood.data_rows
        own = likelihood.scatter > 0.0
        here = _of_data(likelihood, best)
        solved = likelihood.objective.data.solved_of(known=False)
        freedom = float(np.count_nonzero(own) - np.sum(here.leverage[own]) - solved)
        if freedom < 0.5:  # as many unknowns as rows: their scatter tells nothing
            return best, converged, 0.5
        left = (best.sample.rows[:m] * likelihood.scatter)[own]
        sigma = likelihood.noise.sigma.copy()
        sigma[own] *= np.sqrt(float(left @ left) / freedom)
        sigma = np.maximum(sigma, SMALLEST_SIGMA)
        if np.all(np.abs(sigma / likelihood.noise.sigma - 1.0) < SAME_SCATTER):
            break
        noise = replace(likelihood.noise, sigma=sigma)
        evaluator.likelihood = replace(likelihood, noise=noise)
        best, converged = _best_of(evaluator, [best.x])
    return best, converged, freedom


def let_out(evaluator: LikelihoodEvaluator, optimum: Optimum) -> Optimum:
    """The optimum in the room of profiles about it, outside the box where the data want it there.

    Args:
        evaluator: is given the likelihood in that room.
        optimum: found in the box.

    Raises:
        FmuFailure: the model failed at the optimum.
    """
    x = optimum.expansion.x
    evaluator.likelihood = optimum.likelihood.let_out(
        x, _errors(optimum.likelihood, optimum.expansion)
    )
    inside = replace(optimum, likelihood=evaluator.likelihood)
    if not held_at(optimum.likelihood, optimum.expansion, ()):
        return inside
    moved, _ = _best_of(evaluator, [x])
    if moved.chi_square > optimum.least - WORTH_LEAVING:
        return inside
    # residuals that the box alone had made are no noise that widens errors
    stated = optimum.likelihood.stated
    evaluator.likelihood = stated.let_out(moved.x, _errors(stated, moved))
    return most_likely(evaluator, [moved.x])


def _errors(likelihood: Likelihood, here: Expansion) -> FloatArray:
    """Linearised standard deviations in x, (n,), the box counting as a uniform prior."""
    prior = likelihood.widths / UNIFORM_WIDTH
    known = Linearisation(rows=here.sample.rows, matrix=here.matrix, prior=prior)
    return np.asarray(np.sqrt(np.diag(known.covariance)))


def held_at(
    likelihood: Likelihood,
    here: Expansion,
    besides: Sequence[int],
    constraint: Constraint = UNCONSTRAINED,
) -> tuple[int, ...]:
    """Parameters that a limit holds against the data, though the model allows what lies beyond.

    Without the limit the parameter would lower the merit, as far as that is straight, while the
    others follow that are at no limit themselves: with a' the parameter's column without what the
    others take away,

        gain = (a' r)^2/(a' a')

    Slopes by forward differences are known to `BLURRED`: what is no larger is none.

    Args:
        likelihood: with the limits.
        here: a point with its slopes.
        besides: parameters that are held on purpose.
        constraint: that the point keeps to.
    """
    rows, matrix = here.sample.rows, here.matrix * likelihood.widths
    blur = BLURRED * np.linalg.norm(rows) * np.linalg.norm(matrix, axis=0)
    if constraint.output >= 0:
        outward = np.nan_to_num(here.outward[constraint.output]) * likelihood.widths
        rows = np.append(rows, constraint.residual(here.sample))
        matrix = np.vstack([matrix, constraint.weight * outward])
    least, most = likelihood.declared
    near = AT_LIMIT * likelihood.widths
    below, above = here.x - likelihood.lower <= near, likelihood.upper - here.x <= near
    movable = (below & (likelihood.lower > least + near)) | (
        above & (likelihood.upper < most - near)
    )
    free = ~(below | above)
    free[list(besides)] = False
    damped = np.vstack([matrix, np.sqrt(LEAST_DAMPING) * np.eye(free.size)])
    basis, _ = np.linalg.qr(damped[:, free])
    held = []
    for i in map(int, np.flatnonzero(movable)):
        column = damped[:, i] - basis @ (basis.T @ damped[:, i])
        slope = float(column[: rows.size] @ rows)
        pushed = slope > blur[i] if below[i] else slope < -blur[i]
        if i not in besides and pushed and slope**2 > HELD * float(column @ column):
            held.append(i)
    return tuple(held)


def _best_of(
    evaluator: LikelihoodEvaluator, starts: Sequence[FloatArray]
) -> tuple[Expansion, bool]:
    likelihood = evaluator.likelihood
    # whatever begins later begins where something was found, which is not to be lost
    with evaluator.beyond_limit() if evaluator.evaluations else nullcontext():
        expansions = run_in_lockstep(
            [expansion_at(likelihood, x, False) for x in starts], evaluator
        )
    begun = [expansion for expansion in expansions if expansion is not None]
    if not begun:
        least = len(starts) * (len(likelihood.parameters) + 1)
        raise OutOfBudget(
            f"budget: found {evaluator.limit}, wanted more: the first linearisation alone takes "
            f"{least} evaluations"
        )
    ended = run_in_lockstep([descend(likelihood, expansion) for expansion in begun], evaluator)
    best, converged = begun[0], False
    for begin, end in zip(begun, ended, strict=True):
        found = end if end is not None else begin
        if found.chi_square < best.chi_square - (PROMISE if converged else 0.0) or begin is best:
            best, converged = found, end is not None
    return best, converged


def freedom_of(likelihood: Likelihood, end: Expansion) -> float:
    """Degrees of freedom that the rows of the data keep: less what is solved for inside them.

    Args:
        likelihood: of the data.
        end: rows and slopes at the point where the fit ended.
    """
    here = _of_data(likelihood, end)
    return max(0.5, here.degrees_of_freedom - likelihood.objective.data.solved_inside)


def _of_data(likelihood: Likelihood, end: Expansion) -> Linearisation:
    """The rows of the data alone, with box and priors beside them."""
    m = likelihood.data_rows
    prior = 1.0 / np.hypot(UNIFORM_WIDTH / likelihood.widths, likelihood.inverse_prior_sigma)
    return Linearisation(rows=end.sample.rows[:m], matrix=end.matrix[:m], prior=prior)


def inflation_of(
    chi_square: float,
    free: float,
    least_p: float = TOO_LARGE_P,
    noise_freedom: float = np.inf,
) -> float:
    """Factor on standard deviations for residuals beyond the noise: sqrt(chi^2/freedom) or one.

    Args:
        chi_square: of the data.
        free: degrees of freedom that it is held against.
        least_p: probability of such a chi square below which it is too large for noise.
        noise_freedom: degrees of freedom of the noise where it is estimated, else infinite.

    Source: the scale factor of the Particle Data Group, Review of Particle Physics, section 5.2.2,
    used only where chi^2 is too large for noise.
    """
    if free <= 0.0 or tail(chi_square, free, noise_freedom) >= least_p:
        return 1.0
    return max(1.0, float(np.sqrt(chi_square / free)))
