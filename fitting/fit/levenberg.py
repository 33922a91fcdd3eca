"""Many bounded least-squares searches side by side: Levenberg and Marquardt in curved valleys.

    chi^2(x) = |r(x)|^2 -> min,  lower <= x <= upper,  x_i = c or w^2 (g(x) - c)^2 added

Every round takes one batch of the model for all searches, so that worker processes have work and
runs that points share are simulated once. Slopes come from forward differences; along accepted
steps they follow Broyden's update, which takes an evaluation in place of n + 1, and are taken anew
where a step did not gain what they foresee. Where a step along the tangent gains nothing, the
curvature of the rows along it is measured, and steps follow parabolas from then on: a narrow valley
that bends is followed in a few of them. Priors are rows. A periodic parameter has no bounds.
With a weight w the minimum lies on the profile of an output g at its own value of g, which
is read off afterwards, so that w need not be large.

Source: J. More, "The Levenberg-Marquardt algorithm", Lecture Notes in Mathematics 630 (1978);
C. G. Broyden, Mathematics of Computation 19 (1965) 577; M. Transtrum, J. Sethna, "Improvements to
the Levenberg-Marquardt algorithm for nonlinear least-squares minimization", arXiv:1201.5885 (2012),
for the parabolas (geodesic acceleration).
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

import numpy as np

from fitting.fit.likelihood import Exhausted, Request, Sample, Space
from fitting.fit.objective import forward
from fitting.signal.least_squares import damped_step
from fitting.text.arrays import FloatArray

#: Decrease of chi square that is no longer worth a step.
PROMISE = 2e-3
#: Share of that from which a last step by slopes of the end itself is taken where others led there.
WORTH_A_STEP = 1e-3
#: Steps of a search by slopes that were taken there, at most.
ITERATIONS = 30
#: Chi square that a step across the whole box costs at first, and from which nothing moves.
LEAST_DAMPING, MOST_DAMPING = 0.1, 1e14
#: Shares of the foreseen gain above which damping falls tenfold, and by half; below it doubles. A
#: step that gains nothing multiplies it by `GROWTH`; one that is to bring a parameter to its value
#: and leaves the valley, by the square of it.
BOLD, TIMID, GROWTH = 0.75, 0.25, 30.0
#: Share of the foreseen gain, less one of chi square, from which slopes serve another step.
TRUSTED = 0.7
#: Chi square beyond the foreseen one from which the jump to a held value left the valley.
DIVERGED = 20.0
#: Foreseen gain up to which a search that no step lowers has arrived all the same.
STALLED = 1.0
#: Share of a step over which the curvature of the rows along it is taken; shares of a parabola that
#: are weighed.
PROBE, SHARES = 0.1, 50
#: Steps over which the pace is taken that has to lead to the wanted chi square, twice as fast.
PACED = 3
#: Numbers in the slopes of searches that run side by side, at most: a quarter of a gigabyte.
MOST_NUMBERS = 32_000_000

Answer = TypeVar("Answer")
#: What asks for evaluations and is told them, and what it comes to.
Task = Generator[Request, list[Sample], Answer]


class Evaluates(Protocol):
    """Rows and outputs at search vectors of a space, in batches."""

    @property
    def space(self) -> Space:
        """Where searches move."""
        ...

    def __call__(self, requests: Sequence[Request]) -> list[list[Sample]]:
        """Samples for the requests of a round.

        Args:
            requests: one for each search.

        Raises:
            Exhausted: no more are allowed.
        """
        ...


@dataclass(frozen=True)
class Expansion:
    """A sample with its slopes: the first-order expansion of rows and outputs about it.

    `matrix` is d rows/dx (m, n), `outward` d outputs/dx (k, n); `age` counts the steps over which
    they were updated, zero where they were taken at the point itself.
    """

    sample: Sample
    matrix: FloatArray
    outward: FloatArray
    age: int = 0

    @property
    def x(self) -> FloatArray:
        """The search vector."""
        return self.sample.x

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows; infinite where the model failed, there or at the stencil."""
        square = float(self.sample.rows @ self.sample.rows)
        return square if np.isfinite(square) and np.all(np.isfinite(self.matrix)) else np.inf


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """What a search keeps to: x_index at `target`, or an output near it with that `weight`.

    `frozen` axes stay where they are.
    """

    target: float = 0.0
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

    def merit(self, sample: Sample) -> float:
        """What a search lowers: chi square, and that residual squared; infinite without a value.

        Args:
            sample: with outputs, if one of them is held.
        """
        merit = float(sample.rows @ sample.rows) + self.residual(sample) ** 2
        return merit if np.isfinite(merit) else np.inf


UNCONSTRAINED = Constraint()


@dataclass(frozen=True, kw_only=True)
class Goal:
    """When a search may end.

    `enough` is a chi square that is low enough, `wanted` one above which a minimum is of no
    interest; `promise` a gain that is not worth a step. With `confirmed` a minimum is only called
    one by slopes that were taken there.
    """

    promise: float = PROMISE
    enough: float = -np.inf
    wanted: float = np.inf
    confirmed: bool = True


MINIMUM = Goal()


@dataclass(frozen=True)
class Descent:
    """Where a search ended, whether that is a minimum, and whether the budget ended it."""

    end: Expansion
    reached: bool
    is_cut: bool = False

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows at the end."""
        return self.end.chi_square


def expand(
    evaluator: Evaluates, xs: Sequence[FloatArray], *, outputs: bool = True
) -> list[Expansion]:
    """Points with their slopes, in one batch; steps at which the model fails go the other way.

    Args:
        evaluator: of rows and outputs.
        xs: search vectors, (n,) each.
        outputs: whether derived outputs and their slopes are wanted.

    Raises:
        Exhausted: the budget does not allow them.
        FmuFailure: the model failed at a dozen points and has answered at none.
    """
    return _side_by_side(evaluator, [_expand(evaluator.space, x, outputs) for x in xs])


def minimise(
    evaluator: Evaluates,
    begins: Sequence[Expansion],
    constraints: Sequence[Constraint] = (),
    goal: Goal = MINIMUM,
    offsets: Sequence[FloatArray] = (),
) -> list[Descent]:
    """The nearest minima of chi square from several points, side by side.

    Args:
        evaluator: of rows and outputs; its space bounds every search.
        begins: where the searches begin, slopes may be those of a point nearby.
        constraints: one for each, or none at all.
        goal: when they may end.
        offsets: rows less by these are those of each search, as of synthetic data.

    Raises:
        FmuFailure: the model failed at a dozen points and has answered at none.
    """
    constraints = constraints or [UNCONSTRAINED] * len(begins)
    at_once = max(1, MOST_NUMBERS // max((b.matrix.size for b in begins), default=1))
    ended: list[Descent] = []
    for first in range(0, len(begins), at_once):
        some = slice(first, first + at_once)
        pairs = zip(begins[some], constraints[some], strict=True)
        tasks = [_descent(evaluator.space, b, c, goal) for b, c in pairs]
        ended += _side_by_side(evaluator, tasks, offsets[some])
    return ended


def _side_by_side(
    evaluator: Evaluates,
    tasks: Sequence[Task[Answer]],
    offsets: Sequence[FloatArray] = (),
) -> list[Answer]:
    """What tasks come to that are asked in common batches, less their offsets, in their order."""
    answers: dict[int, Answer] = {}
    requested: dict[int, Request] = {}

    def go_on(k: int, samples: list[Sample] | None, failure: Exhausted | None = None) -> None:
        try:
            task = tasks[k]
            requested[k] = task.send(samples) if failure is None else task.throw(failure)  # type: ignore[arg-type]
        except StopIteration as ended:
            answers[k] = ended.value

    for k in range(len(tasks)):
        go_on(k, None)
    while requested:
        requests, requested = requested, {}
        try:
            batches = evaluator(list(requests.values()))
        except Exhausted as failure:
            for k in requests:
                go_on(k, None, failure)
            continue
        for k, samples in zip(requests, batches, strict=True):
            if offsets:
                samples = [Sample(s.x, s.rows - offsets[k], s.outputs) for s in samples]
            go_on(k, samples)
    return [answers[k] for k in range(len(tasks))]


def _expand(
    space: Space, x: FloatArray, outputs: bool, here: Sample | None = None
) -> Task[Expansion]:
    """A point with its slopes; `here` is what is known there."""
    around = forward(x, space.steps, space.upper)
    samples = [] if here is None else [here]
    samples += yield Request(around.nodes[len(samples) :], outputs=outputs)
    if np.all(np.isfinite(samples[0].rows)):
        failed = [i for i, s in enumerate(samples[1:]) if not np.all(np.isfinite(s.rows))]
        if failed:  # a step at which the model fails goes the other way
            around = around.reversed_along(failed)
            others = yield Request(tuple(around.nodes[i + 1] for i in failed), outputs=outputs)
            for i, sample in zip(failed, others, strict=True):
                samples[i + 1] = sample
    matrix = around.quotients([sample.rows for sample in samples])
    return Expansion(samples[0], matrix, around.quotients([s.outputs for s in samples]))


def _descent(space: Space, here: Expansion, constraint: Constraint, goal: Goal) -> Task[Descent]:
    """The nearest minimum under a constraint."""
    reads = constraint.output >= 0
    damping, hope, taken = LEAST_DAMPING, np.inf, 0
    is_stale = is_led = is_bent = False  # slopes wanted anew, taken on the way; the valley bends
    merits: list[float] = []
    try:
        here, is_stale = yield from _project_to_constraint(space, here, constraint)
        while np.isfinite(here.chi_square) and damping <= MOST_DAMPING:
            merit = constraint.merit(here.sample)
            if merit <= goal.enough:
                return Descent(here, reached=True)
            if is_stale:
                fresh = yield from _expand(space, here.x, reads, here.sample)
                if not np.isfinite(fresh.chi_square):
                    return Descent(here, reached=False)
                here, is_led, is_stale = fresh, True, False
            tangent = _Tangent(space, here, constraint)
            step, left = tangent.step(damping)
            promised = merit - left
            # the least that slopes of the point itself promised since steps were not held back
            since = hope if damping > LEAST_DAMPING else np.inf
            hope = hope if here.age and goal.confirmed else min(since, promised)
            if promised < goal.promise:
                if here.age and goal.confirmed:
                    is_stale = True
                    continue
                if is_led and promised > WORTH_A_STEP * goal.promise:
                    # slopes of the end leave the square of what was to go, old ones a share of it
                    [last] = yield Request((here.x + step,), outputs=reads)
                    here = replace(here, sample=last) if constraint.merit(last) < merit else here
                return Descent(here, reached=hope < STALLED)
            if _is_out_of_reach([*merits, merit], taken, goal):
                return Descent(here, reached=False)
            if is_bent:
                [probe] = yield Request((here.x + PROBE * step,), outputs=reads)
                step, left = tangent.parabola(step, probe, damping)
                promised = merit - left
                if promised < goal.promise:  # the valley bends too much for a step as long as that
                    is_stale, damping = bool(here.age), damping if here.age else GROWTH * damping
                    continue
            [sample] = yield Request((here.x + step,), outputs=reads)
            taken += not here.age  # updated slopes are none of the effort
            gain = merit - constraint.merit(sample)
            if gain > 0.0:
                # as straight as foreseen: bolder; far less gain: the valley bends within a step
                share = gain / max(promised, gain)
                factor = 0.1 if share > BOLD else 0.5 if share > TIMID else 2.0
                damping = max(factor * damping, LEAST_DAMPING)
                merits.append(merit)
                here = _broyden_update(space, here, sample)
                # as many updates as there are slopes to take cost as much as these
                is_trusted = gain > max(TRUSTED * promised, promised - 1.0)
                is_stale = is_bent or not is_trusted or here.age >= here.x.size
            elif here.age:
                is_stale = True
            elif not is_bent and np.isfinite(gain):
                is_bent = True
            else:
                damping *= GROWTH
    except Exhausted:
        return Descent(here, reached=False, is_cut=True)
    return Descent(here, reached=damping > MOST_DAMPING and hope < STALLED)


def _project_to_constraint(
    space: Space, here: Expansion, constraint: Constraint
) -> Task[tuple[Expansion, bool]]:
    """A held parameter at its value, the others following, whatever that costs.

    Returns the point and whether slopes are wanted anew there.
    """
    is_there = constraint.index < 0 or here.x[constraint.index] == constraint.target
    if is_there or not np.isfinite(here.chi_square):
        return here, False
    tangent, damping = _Tangent(space, here, constraint), LEAST_DAMPING
    while True:
        step, left = tangent.step(damping)
        [sample] = yield Request((here.x + step,), outputs=False)
        merit = constraint.merit(sample)
        if merit <= left + DIVERGED or damping >= MOST_DAMPING:
            break
        damping *= GROWTH**2
    is_straight = damping == LEAST_DAMPING and merit < left + 1.0
    return _broyden_update(space, here, sample), not is_straight


def _broyden_update(space: Space, here: Expansion, sample: Sample) -> Expansion:
    """The expansion after a step: B' = B + (dr - B dx) dx^T W/(dx^T W dx).

    W are the inverse squares of the widths of the box.
    """
    way = sample.x - here.x
    weighted = way / space.widths**2
    along = weighted / max(float(way @ weighted), 1e-300)
    matrix = here.matrix + np.outer(sample.rows - here.sample.rows - here.matrix @ way, along)
    outward = here.outward
    if sample.outputs.size and outward.size:
        with np.errstate(invalid="ignore"):  # of an infinite output no slope is known
            change = sample.outputs - here.sample.outputs
            outward = outward + np.outer(change - outward @ way, along)
    return Expansion(sample, matrix, outward, here.age + 1)


def _is_out_of_reach(merits: Sequence[float], taken: int, goal: Goal) -> bool:
    """Whether no step is left, or too few for the wanted chi square at twice the pace of late."""
    if taken >= ITERATIONS:
        return True
    if not np.isfinite(goal.wanted) or len(merits) <= PACED:
        return False
    pace = (merits[-1 - PACED] - merits[-1]) / PACED
    return merits[-1] - 2.0 * pace * (ITERATIONS - taken) > goal.wanted


class _Tangent:
    """Rows and slopes at a point, in widths of the box, with the row that holds an output."""

    def __init__(self, space: Space, here: Expansion, constraint: Constraint) -> None:
        self.constraint, self.x, self.widths = constraint, here.x, space.widths
        self.rows, self.matrix = self._rows_of(here.sample), here.matrix * self.widths
        if constraint.output >= 0:
            slope = np.nan_to_num(here.outward[constraint.output], posinf=0.0, neginf=0.0)
            self.matrix = np.vstack([self.matrix, constraint.weight * slope * self.widths])
        self.free = np.ones(self.x.size, dtype=bool)
        self.free[list(constraint.frozen)] = False
        self.fixed = np.zeros(self.x.size)
        if constraint.index >= 0:
            k = constraint.index
            self.free[k], self.fixed[k] = False, (constraint.target - self.x[k]) / self.widths[k]
        # no step is longer than the box, nor than a quarter of a period
        longest = np.minimum(self.widths, 0.25 * space.periods)
        self.low = np.maximum(space.lower - self.x, -longest) / self.widths
        self.high = np.minimum(space.upper - self.x, longest) / self.widths

    def _rows_of(self, sample: Sample) -> FloatArray:
        """The rows of a sample, that of a held output last."""
        if self.constraint.output < 0:
            return sample.rows
        return np.append(sample.rows, self.constraint.residual(sample))

    def step(self, damping: float) -> tuple[FloatArray, float]:
        """The damped step in the box, (n,), and the merit that it leaves by the slopes."""
        step = self.fixed.copy()
        rows = self.rows + self.matrix @ step
        room = self.low[self.free], self.high[self.free]
        step[self.free] = damped_step(self.matrix[:, self.free], rows, damping, room)
        left = self.rows + self.matrix @ step
        return step * self.widths, float(left @ left)

    def parabola(self, step: FloatArray, probe: Sample, damping: float) -> tuple[FloatArray, float]:
        """The step along a parabola that stays in a valley that bends, and the merit it leaves.

        The rows along the step v are r + s B v + s^2 e, with e from a probe at x + h v. With

            w = argmin |e + B w|^2 + damping |w|^2

        they are r + s B v + s^2 (e + B w) along x + s v + s^2 w; s in (0, 1] is where these are
        least, as far as the parabola stays in the box.
        """
        v = step / self.widths
        along = self.matrix @ v
        excess = ((self._rows_of(probe) - self.rows) / PROBE - along) / PROBE
        if not np.all(np.isfinite(excess)):  # the model failed there: no curvature is known
            excess = np.zeros_like(along)
        # what stands at a bound and is pushed beyond it stays there
        pinned = (v == 0.0) & ((self.low >= 0.0) | (self.high <= 0.0))
        w, free = np.zeros(v.size), self.free & ~pinned
        w[free] = damped_step(self.matrix[:, free], excess, damping)
        shares = np.linspace(0.0, 1.0, SHARES + 1)[1:, None]
        steps = shares * v + shares**2 * w
        foreseen = self.rows + shares * along + shares**2 * (excess + self.matrix @ w)
        inside = np.all((steps >= self.low) & (steps <= self.high) | ~free, axis=1)
        merits = np.where(inside, np.sum(foreseen**2, axis=1), np.inf)
        best = int(np.argmin(merits))
        return steps[best] * self.widths, float(merits[best])
