"""Profile likelihood: how far a value can go while the rest follows it as well as it can.

    Dchi^2(c) = min { chi^2(x) : g(x) = c } - min chi^2

for g a parameter or a derived output. The values with Dchi^2 <= 1 and <= 3.84 are the 68 % and 95 %
intervals, asymmetric where the data are, and nothing is linearised. Where the residuals tell the
noise, Dchi^2 is t^2 of Student's distribution, and stands here as the normal deviate's square of
the same probability (`fitting.signal.student`), so that the thresholds are these. Branches
go outward from the most likely point, each point begins where the last one ended; all branches go
in lockstep.

Source: D. Venzon and S. Moolgavkar, Applied Statistics 37 (1988) 87; A. Raue et al.,
Bioinformatics 25 (2009) 1923.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import search_bounds
from fitting.fit.likelihood.descent import (
    Constraint,
    Expansion,
    Optimum,
    descend,
    expansion_at,
    held_at,
)
from fitting.fit.likelihood.lockstep import Exhausted, Task
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95

#: Steps across the range, at least, points of a branch, and refinements of a crossing, at most.
STEPS, POINTS, REFINEMENTS = 10, 40, 20
#: How much shorter a step is tried after one that led nowhere, and how often.
SHORTER, MOST_MISSES = 0.25, 4
#: Points between two others at which no minimum is reached, after which no more are tried.
MISSES = 3
#: A step of sqrt(Dchi^2) across the threshold that is no crossing, once the points are close.
JUMP = 0.5
#: A crossing is found where sqrt(Dchi^2) is this close to its threshold.
CLOSE = 0.02
#: Decrease of Dchi^2 that makes another valley the lower one.
LOWER = 0.1
#: Shares of the range: this near its end a branch has reached it; a step that small got nowhere.
AT_END, NOWHERE = 1e-3, 0.05
#: Points inside, next to the threshold, whose slopes are kept.
KEPT_PLACES = 2
#: Dchi^2 at which the end of a range is known to fit without being followed to its minimum.
ENOUGH = 0.5
#: Dchi^2 from which the end of a range is excluded for good, three sigma.
EXCLUDED = 9.0
#: Weight of the row that holds an output, over the step: it misses its target by next to nothing.
HOLD = 30.0


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is profiled, a parameter (x_index) or an output, in x or in the output's unit.

    `best` at the most likely point, `sigma` linearised (very large where the data do not see it);
    `low`, `high` are where its branches end, `first` the longest first step; `round`: a parameter
    that comes back to itself there. `reach`: by how many sigma the simulation's own error may move
    it, at most; `freedom`: degrees of freedom of its noise, infinite where that is known.
    """

    name: str
    index: int
    output: int
    best: float
    sigma: float
    low: float
    high: float
    first: float = math.inf
    round: bool = False
    reach: float = 0.0
    freedom: float = math.inf

    @property
    def width(self) -> float:
        """Range without data."""
        return self.high - self.low

    def at(self, expansion: Expansion) -> float:
        """Its value at a point.

        Args:
            expansion: the point.
        """
        if self.index >= 0:
            return float(expansion.x[self.index])
        return float(expansion.sample.outputs[self.output])

    def of(self, point: ProfilePoint, periods: FloatArray) -> float:
        """Its value at a point of any profile; of a parameter that goes round, the image nearest.

        Args:
            point: with outputs.
            periods: of the parameters in x, infinite without one, shape (n,).
        """
        if self.index < 0:
            return float(point.outputs[self.output])
        value, period = float(point.x[self.index]), float(periods[self.index])
        if math.isfinite(period):
            value -= period * round((value - self.best) / period)
        return value

    def constraint(self, target: float, step: float) -> Constraint:
        """What holds it at a target that is a step away.

        Args:
            target: value, in x or in the output's unit.
            step: from where the search begins, likewise.
        """
        if self.index >= 0:
            return Constraint(target, index=self.index)
        return Constraint(
            target, output=self.output, weight=HOLD / max(abs(step), 1e-12 * self.width)
        )


@dataclass(frozen=True, kw_only=True)
class ProfilePoint:
    """A point of a profile: value, Dchi^2, search vector and outputs there."""

    value: float
    delta: float
    x: FloatArray
    outputs: FloatArray

    @property
    def root(self) -> float:
        """sqrt(Dchi^2), zero where it is a little better than the optimum."""
        return math.sqrt(max(0.0, self.delta))


@dataclass(frozen=True, kw_only=True)
class ProfileBranch:
    """One side of a profile: its points outward, how it ended (`knowledge.ENDS`), its crossings.

    `at_95` is the value where it crosses the 95 % threshold, `at_68` where it last does that of
    68 %: what fits farther out belongs to the interval. NaN where it does not cross. A branch that
    was "lost" (nothing beyond that fits or exists, no minimum found, or chi square jumps) or cut
    for its "cost" has no claim on what lies beyond; where parameters are `held` at a limit of their
    room when it crosses, that limit ended it and not the data.
    """

    points: tuple[ProfilePoint, ...]
    end: str
    at_68: float
    at_95: float
    held: tuple[int, ...] = ()


def trace_branch(
    optimum: Optimum,
    quantity: Quantity,
    direction: float,
    steps: int = STEPS,
    begin: FloatArray | None = None,
) -> Task[ProfileBranch]:
    """Go outward along the profile until it crosses the 95 % threshold or meets the end.

    At most `steps` strides across the range, as far as nothing on the way asks for shorter ones.

    Args:
        optimum: what chi square is counted from.
        quantity: what is profiled.
        direction: -1 downward, 1 upward.
        steps: strides across the range, at most.
        begin: search vector of a point that fits, where it sets out from; None: the optimum.
    """
    tracer = _BranchTracer(optimum, quantity, direction, steps)
    try:
        if begin is not None:
            tracer.set_out(
                (yield from expansion_at(optimum.likelihood, begin, quantity.output >= 0))
            )
        end = yield from tracer.go()
    except Exhausted:
        end = "cost"
    return ProfileBranch(
        points=tuple(tracer.points),
        end=end,
        at_68=last_crossing(tracer.points, quantity.best, ROOT_68),
        at_95=_crossing(tracer.points, quantity.best, 0.0, ROOT_95),
        held=tracer.held if end == "held" else (),
    )


class _BranchTracer:
    """State of one branch: where it stands, its step, the points so far in order of the value."""

    def __init__(self, optimum: Optimum, quantity: Quantity, direction: float, steps: int) -> None:
        self.optimum, self.quantity, self.direction = optimum, quantity, direction
        self.limit = quantity.high if direction > 0.0 else quantity.low
        self.span = abs(self.limit - quantity.best)
        self.longest, self.steps = self.span / steps, steps
        self.here = optimum.expansion
        self.points: list[ProfilePoint] = []
        self.places: dict[int, Expansion] = {}
        self.held: tuple[int, ...] = ()

    def set_out(self, begin: Expansion) -> None:
        """Begin at another point than the optimum.

        Args:
            begin: the point with its slopes.
        """
        self.here = begin
        self._keep(begin)

    def go(self) -> Task[str]:
        """Walk; the word for how it ended.

        A walk that used its points up creeps along a bent valley: a lower one may lie beside it,
        where another parameter is at an end of its room. It goes on there.
        """
        end = yield from self._walked()
        if end == "spent" and (yield from self._beside()):
            end = yield from self._walked()
        return "lost" if end == "spent" else end

    def _beside(self) -> Task[bool]:
        """Whether a lower point of the same value is come by from an end of another parameter."""
        likelihood, here, quantity = self.optimum.likelihood, self.here, self.quantity
        open_ = ~np.isfinite(likelihood.periods) & ~(likelihood.inverse_prior_sigma > 0.0)
        if quantity.index >= 0:
            open_[quantity.index] = False
        value = quantity.at(here)
        for axis in np.flatnonzero(open_):
            for end in (likelihood.lower[axis], likelihood.upper[axis]):
                x = here.x.copy()
                x[axis] = end
                begin = yield from expansion_at(likelihood, x, quantity.output >= 0)
                found = yield from self._profiled(value, abs(value - quantity.best), begin)
                if found is not None and self._delta(found) < self._delta(self.here) - LOWER:
                    self.here = found
        if self.here is here:
            return False
        self._keep(self.here)
        return True

    def _left(self) -> float:
        """The way to the end of the range."""
        return abs(self.limit - self.quantity.at(self.here))

    def _walked(self) -> Task[str]:
        """Walk as far as one walk's points go; the word for how it ended, or "spent"."""
        quantity = self.quantity
        first = quantity.first if self.steps >= STEPS else math.inf
        step = min(self.longest, 1.03 * quantity.sigma, first)
        misses = 0
        for _ in range(POINTS):
            left = self._left()
            if left <= AT_END * self.span:
                return "bound"
            step = left if step > 0.8 * left else step
            if not (yield from self._stride(step)):
                misses += 1
                if self._flat_over_box() or misses > MOST_MISSES:
                    first = step * SHORTER ** -(misses - 1)
                    if misses > MOST_MISSES and (yield from self._passed(first)):
                        misses, step = 0, first
                        continue
                    # wherever other parameters stand: what lies beyond has not been seen
                    return "bound" if self._flat_over_box() else "lost"
                step *= SHORTER
                continue
            misses = max(0, misses - 1)
            if self._root() > ROOT_95:
                end = yield from self._crossed()
                if end:
                    return end
            step = min(self.longest, self._next(step))
        return "spent"

    def _flat_over_box(self) -> bool:
        """Whether the data see nothing up to the end of a parameter's own box, and this is beyond.

        A walk that goes no further there has come to where the model ends: nothing is decided by
        how far that is.
        """
        index = self.quantity.index
        if index < 0 or self.quantity.round or not self.points:
            return False
        farthest = max(self.points, key=lambda point: self.direction * point.value)
        limits = search_bounds(self.optimum.likelihood.parameters)
        end = float(limits[1 if self.direction > 0.0 else 0][index])
        return self.direction * (farthest.value - end) >= 0.0 and farthest.delta < ENOUGH

    def _stride(self, step: float) -> Task[bool]:
        """One step along the profile; whether it led anywhere."""
        before = self.quantity.at(self.here)
        found = yield from self._profiled(before + self.direction * step, step, self.here)
        if found is None or self.direction * (self.quantity.at(found) - before) < NOWHERE * step:
            return False
        self.here = found
        self._keep(found)
        return True

    def _passed(self, step: float) -> Task[bool]:
        """Whether a point beyond a place where the walk got stuck is come by from the optimum."""
        if self.here is self.optimum.expansion:
            return False
        target = self.quantity.at(self.here) + self.direction * step
        way = abs(target - self.quantity.at(self.optimum.expansion))
        found = yield from self._profiled(target, way, self.optimum.expansion)
        if found is None or self.direction * (self.quantity.at(found) - target) < -NOWHERE * step:
            return False
        self.here = found
        self._keep(found)
        return True

    def _profiled(self, target: float, step: float, begin: Expansion) -> Task[Expansion | None]:
        constraint = self.quantity.constraint(target, step)
        found = yield from descend(self.optimum.likelihood, begin, constraint)
        if found is None or not math.isfinite(self.quantity.at(found)):
            return None
        return found

    def _keep(self, found: Expansion) -> None:
        delta = self._delta(found)
        point = ProfilePoint(
            value=self.quantity.at(found), delta=delta, x=found.x, outputs=found.sample.outputs
        )
        self.points.append(point)
        self.points.sort(key=lambda point: self.direction * point.value)
        self.places[id(point)] = found
        # a crossing is looked for between points that are next to it: slopes of a thousand
        # parameters are too much to keep for all others
        outside = next((k for k, p in enumerate(self.points) if p.root > ROOT_95), None)
        for point in self.points[:outside][:-KEPT_PLACES]:
            self.places.pop(id(point), None)

    def _delta(self, found: Expansion) -> float:
        return self.optimum.delta(found.chi_square, self.quantity.freedom)

    def _root(self) -> float:
        return self.points[-1].root

    def _next(self, step: float) -> float:
        """Step to the next threshold, from the slope of sqrt(Dchi^2), which is straight at best."""
        inner = self.points[-2] if len(self.points) > 1 else None
        at, root = (self.quantity.best, 0.0) if inner is None else (inner.value, inner.root)
        gone = abs(self.points[-1].value - at)
        mark = ROOT_68 if self._root() < 0.9 * ROOT_68 else ROOT_95
        if not gone > 0.0 or self._root() <= root:  # the same value again: nothing tells a slope
            return 2.0 * step
        slope = (self._root() - root) / gone
        return float(np.clip((mark + 0.5 * CLOSE - self._root()) / slope, 0.2 * step, 2.0 * step))

    def _crossed(self) -> Task[str]:
        """Narrow the crossing down; the word for it, none where the walk goes on beyond it."""
        continuous = yield from self._refine()
        if not continuous and (yield from self._regained()):
            return ""
        if not continuous:
            return "lost"
        inside, outside = self._bracket()
        besides = [self.quantity.index] if self.quantity.index >= 0 else []
        step = abs(outside.value - (self.quantity.best if inside is None else inside.value))
        near = outside  # the last step may have gone far beyond the crossing
        if inside is not None and ROOT_95 - inside.root < outside.root - ROOT_95:
            near = inside
        self.held = held_at(
            self.optimum.likelihood,
            self.places[id(near)],
            besides,
            self.quantity.constraint(near.value, step),
        )
        return "held" if self.held else "crossed"

    def _regained(self) -> Task[bool]:
        """Whether the point outside was one of another valley, and this one fits there as well."""
        inside, outside = self._bracket()
        if inside is None:
            return False
        gap = abs(outside.value - inside.value)
        found = yield from self._profiled(outside.value, gap, self.places[id(inside)])
        if found is None or self._delta(found) > ROOT_95**2:
            return False
        self.points = [point for point in self.points if point.root <= ROOT_95]
        self.here = found
        self._keep(found)
        return True

    def _bracket(self) -> tuple[ProfilePoint | None, ProfilePoint]:
        """The last point inside before the first outside, None for the optimum itself."""
        first = next(k for k, point in enumerate(self.points) if point.root > ROOT_95)
        return (self.points[first - 1] if first else None), self.points[first]

    def _refine(self) -> Task[bool]:
        """Points closer to the crossing, from both sides; whether the profile is continuous there.

        Where chi square still jumps across the threshold between points that are close, one side
        has left the least chi square for another valley: the crossing is then none.
        """
        missed = 0
        for attempt in range(REFINEMENTS):
            inside, outside = self._bracket()
            at, root = (self.quantity.best, 0.0) if inside is None else (inside.value, inside.root)
            if min(ROOT_95 - root, outside.root - ROOT_95) < CLOSE:
                return True
            share = float(np.clip((ROOT_95 - root) / (outside.root - root), 0.1, 0.9))
            share = 0.5 ** max(missed, 1) if attempt > 1 or missed else share
            gap = abs(outside.value - at)
            target = at + share * (outside.value - at)
            inner = self.optimum.expansion if inside is None else self.places[id(inside)]
            found = yield from self._profiled(target, gap, inner)
            expected = (root + share * (outside.root - root) + JUMP) ** 2
            if found is None or self._delta(found) > expected:
                other = yield from self._profiled(target, gap, self.places[id(outside)])
                found = _lower(found, other)
            if found is not None:
                self._keep(found)
            elif missed == MISSES:
                break
            else:  # no minimum is reached there: perhaps one is elsewhere between the two
                missed += 1
        inside, outside = self._bracket()
        return outside.root - (0.0 if inside is None else inside.root) < JUMP


def _lower(one: Expansion | None, other: Expansion | None) -> Expansion | None:
    """The likelier of two points."""
    if one is None or other is None:
        return other if one is None else one
    return one if one.chi_square <= other.chi_square else other


def _crossing(points: Sequence[ProfilePoint], at: float, height: float, root: float) -> float:
    """Where sqrt(Dchi^2) first reaches a threshold, linear between the points; NaN if nowhere.

    `height` is what it is before the first of them, `at` where that is.
    """
    for point in points:
        there = point.root
        if there >= root:
            share = (root - height) / (there - height) if there > height else 1.0
            return at + share * (point.value - at)
        at, height = point.value, there
    return float("nan")


def last_crossing(points: Sequence[ProfilePoint], best: float, root: float) -> float:
    """Where sqrt(Dchi^2) goes beyond a threshold for good, linear between points; NaN if nowhere.

    Args:
        points: outward.
        best: where it is zero.
        root: the threshold.
    """
    last = max((k for k, point in enumerate(points) if point.root < root), default=-1)
    at, height = (best, 0.0) if last < 0 else (points[last].value, points[last].root)
    return _crossing(points[last + 1 :], at, height, root)


def fit_at_end(
    optimum: Optimum,
    quantity: Quantity,
    begin: FloatArray,
    end: float,
    frozen: tuple[int, ...] = (),
    loose: float = 0.0,
) -> Task[ProfilePoint | None]:
    """The point at the end of a range, if the data do not exclude it for good, else None.

    A range that the data leave open from end to end is found so at once, also where no branch would
    get through. With `frozen` axes the search keeps to the rest; the quantity is then where `begin`
    has it.

    Args:
        optimum: what chi square is counted from.
        quantity: what is profiled.
        begin: search vector where the search begins, shape (n,).
        end: of the range, in x or in the output's unit.
        frozen: axes that stay where `begin` has them.
        loose: chi square more by which the data have to exclude it.
    """
    likelihood, least = optimum.likelihood, optimum.least + loose
    constraint = quantity.constraint(end, abs(end - quantity.best) / STEPS)
    if frozen:
        constraint = Constraint(end, frozen=frozen)
    try:
        here = yield from expansion_at(likelihood, begin)
        if not math.isfinite(quantity.at(here)):
            return None
        found = yield from descend(
            likelihood,
            here,
            constraint,
            enough=least + ENOUGH,
            wanted=least + reach(math.sqrt(EXCLUDED), quantity.freedom) ** 2,
        )
    except Exhausted:
        return None
    if found is None:
        return None
    # with frozen axes the rest has moved from `here` to `found`, and outputs were not asked for
    outputs = np.empty(0) if frozen or quantity.output < 0 else found.sample.outputs
    value = quantity.at(here if frozen else found)
    delta = optimum.delta(found.chi_square - loose, quantity.freedom)
    if not (abs(value - end) <= 0.02 * abs(end - quantity.best) and delta <= EXCLUDED):
        return None
    return ProfilePoint(
        value=value,
        delta=delta,
        x=found.x,
        outputs=outputs,
    )


def interval(
    quantity: Quantity,
    branches: tuple[ProfileBranch, ProfileBranch],
    ends_fit: tuple[bool, bool],
    mark: str = "95",
) -> tuple[float, float]:
    """The interval of a profile: crossings, or the ends of the range where it does not cross.

    Where the simulation may move the estimate by `reach` sigma, the true value lies where
    sqrt(Dchi^2) is below its threshold plus that: sides are longer in that ratio, each by its own,
    from the minimum in whose valley it crosses. No side goes beyond the range.

    `branches` are (downward, upward), `ends_fit` whether the ends of the range fit the data.

    Args:
        quantity: what is profiled.
        branches: downward and upward.
        ends_fit: whether the low and the high end of the range fit the data.
        mark: "95" or "68", per cent.
    """
    ends = []
    for branch, limit, fits in zip(branches, (quantity.low, quantity.high), ends_fit, strict=True):
        crossing = branch.at_95 if mark == "95" else branch.at_68
        if fits or math.isnan(crossing):
            ends.append(limit)
            continue
        root = ROOT_95 if mark == "95" else ROOT_68
        longer = quantity.reach / reach(root, quantity.freedom)
        far = crossing + longer * _valley(quantity, branch, crossing, root)
        ends.append(max(far, limit) if limit < quantity.best else min(far, limit))
    return ends[0], ends[1]


def _valley(quantity: Quantity, branch: ProfileBranch, crossing: float, root: float) -> float:
    """Way to a crossing per share by which the root of Dchi^2 grows there, as of a parabola.

    Its valley is that of the last minimum before it, whose Dchi^2 is m: then it is the distance
    from that over 1 - m/root^2. Never more than from the best value.
    """
    whole = crossing - quantity.best
    inside = [x for x in branch.points if abs(x.value - quantity.best) < abs(whole)]
    if not inside:
        return whole
    lowest = inside[-1]
    for point in reversed(inside[:-1]):
        if point.delta > lowest.delta:
            break
        lowest = point
    else:
        return whole  # down to the best value itself
    left = 1.0 - lowest.delta / root**2
    own = (crossing - lowest.value) / left if left > 0.0 else whole
    return own if abs(own) < abs(whole) else whole
