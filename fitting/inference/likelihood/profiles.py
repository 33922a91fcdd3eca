"""Profile likelihood: how far a value can go while the rest follows it as well as it can.

    Dchi^2(c) = min { chi^2(x) : g(x) = c } - min chi^2

for g a parameter or a derived output. The values with Dchi^2 <= 1 and <= 3.84 are the 68 % and 95 %
intervals, asymmetric where the data are, and nothing is linearised. Branches go outward from the
most likely point, each point begins where the last one ended; all branches go in lockstep.

Source: D. Venzon and S. Moolgavkar, Applied Statistics 37 (1988) 87; A. Raue et al.,
Bioinformatics 25 (2009) 1923.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.fit.likelihood.descent import (
    Constraint,
    Expansion,
    Optimum,
    descend,
    expansion_at,
)
from fitting.fit.likelihood.lockstep import Exhausted, Task
from fitting.text.arrays import FloatArray

#: Square roots of Dchi^2 at the ends of the 68 % and 95 % intervals.
ROOT_68, ROOT_95 = 1.0, 1.959964
#: Steps across the box, at least, points of a branch, and refinements of a crossing, at most.
STEPS, POINTS, REFINEMENTS = 10, 40, 4
#: A crossing is found where sqrt(Dchi^2) is this close to its threshold.
CLOSE = 0.02
#: Shares of the range: this near its end a branch has reached it; a step that small got nowhere.
AT_END, NOWHERE = 1e-3, 0.05
#: Dchi^2 at which the end of a range is known to fit without being followed to its minimum.
ENOUGH = 0.5
#: Dchi^2 from which the end of a range is excluded for good, three sigma.
EXCLUDED = 9.0
#: Weight of the row that holds an output, over the step: it misses its target by next to nothing.
HOLD = 30.0


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is profiled, a parameter (x_index) or an output, in x or in the output's unit.

    `best` at the most likely point, `sigma` linearised (infinite where the data do not see it);
    `low`, `high` are where its branches end; `round`: a parameter that comes back to itself there.
    """

    name: str
    index: int
    output: int
    best: float
    sigma: float
    low: float
    high: float
    round: bool = False

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


@dataclass(frozen=True, kw_only=True)
class ProfileBranch:
    """One side of a profile: its points outward, how it ended (`knowledge.ENDS`), its crossings.

    `at_68`, `at_95` are the values where it crosses the 68 % and 95 % thresholds, NaN where it does
    not cross. A branch that was "lost" (nothing beyond that fits or exists, or no minimum found) or
    cut for its "cost" has no claim on what lies beyond.
    """

    points: tuple[ProfilePoint, ...]
    end: str
    at_68: float
    at_95: float


def trace_branch(
    optimum: Optimum, quantity: Quantity, direction: float, steps: int = STEPS
) -> Task[ProfileBranch]:
    """Go outward along the profile until it crosses the 95 % threshold or meets the end.

    At most `steps` strides across the range, as far as nothing on the way asks for shorter ones.

    Args:
        optimum: where it sets out from.
        quantity: what is profiled.
        direction: -1 downward, 1 upward.
        steps: strides across the range, at most.
    """
    tracer = _BranchTracer(optimum, quantity, direction, steps)
    try:
        end = yield from tracer.go()
    except Exhausted:
        end = "cost"
    return ProfileBranch(
        points=tuple(tracer.points),
        end=end,
        at_68=_crossing(tracer.points, quantity.best, ROOT_68),
        at_95=_crossing(tracer.points, quantity.best, ROOT_95),
    )


class _BranchTracer:
    """State of one branch: where it stands, its step, the points so far in order of the value."""

    def __init__(self, optimum: Optimum, quantity: Quantity, direction: float, steps: int) -> None:
        self.optimum, self.quantity, self.direction = optimum, quantity, direction
        self.limit = quantity.high if direction > 0.0 else quantity.low
        self.longest = quantity.width / steps
        self.here = optimum.expansion
        self.points: list[ProfilePoint] = []

    def go(self) -> Task[str]:
        """Walk; the word for how it ended."""
        quantity = self.quantity
        step = min(self.longest, 1.03 * quantity.sigma)
        misses = 0
        for _ in range(POINTS):
            left = abs(self.limit - quantity.at(self.here))
            if left <= AT_END * quantity.width:
                return "bound"
            step = left if step > 0.8 * left else step
            if not (yield from self._stride(step)):
                misses += 1
                if misses > 4:
                    return "lost"
                step *= 0.25
                continue
            if self._root() > ROOT_95:
                yield from self._refine()
                return "crossed"
            step = min(self.longest, self._next(step))
        return "lost"

    def _stride(self, step: float) -> Task[bool]:
        """One step along the profile; whether it led anywhere."""
        before = self.quantity.at(self.here)
        found = yield from self._profiled(before + self.direction * step, step, self.here)
        if found is None or self.direction * (self.quantity.at(found) - before) < NOWHERE * step:
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
        delta = found.chi_square - self.optimum.least
        point = ProfilePoint(
            value=self.quantity.at(found), delta=delta, x=found.x, outputs=found.sample.outputs
        )
        self.points.append(point)
        self.points.sort(key=lambda point: self.direction * point.value)

    def _root(self) -> float:
        return math.sqrt(max(0.0, self.points[-1].delta))

    def _next(self, step: float) -> float:
        """Step to the next threshold, from the slope of sqrt(Dchi^2), which is straight at best."""
        inner = self.points[-2] if len(self.points) > 1 else None
        at, root = (
            (self.quantity.best, 0.0)
            if inner is None
            else (inner.value, math.sqrt(max(0.0, inner.delta)))
        )
        gone = abs(self.points[-1].value - at)
        slope = (self._root() - root) / gone
        mark = ROOT_68 if self._root() < 0.9 * ROOT_68 else ROOT_95
        if slope <= 0.0:
            return 2.0 * step
        return float(np.clip((mark + 0.5 * CLOSE - self._root()) / slope, 0.2 * step, 2.0 * step))

    def _refine(self) -> Task[None]:
        """Points closer to the crossing, between the last point inside and the first outside."""
        for _ in range(REFINEMENTS):
            inside = [p for p in self.points if p.delta <= ROOT_95**2]
            outside = [p for p in self.points if p.delta > ROOT_95**2]
            near = min(
                (abs(math.sqrt(max(0.0, p.delta)) - ROOT_95) for p in self.points), default=1.0
            )
            if near < CLOSE or not outside:
                return
            at, root = (
                (inside[-1].value, math.sqrt(max(0.0, inside[-1].delta)))
                if inside
                else (self.quantity.best, 0.0)
            )
            share = (ROOT_95 - root) / (math.sqrt(outside[0].delta) - root)
            target = at + float(np.clip(share, 0.1, 0.9)) * (outside[0].value - at)
            found = yield from self._profiled(target, abs(outside[0].value - at), self.here)
            if found is None:
                return
            self._keep(found)


def _crossing(points: Sequence[ProfilePoint], best: float, root: float) -> float:
    """Where sqrt(Dchi^2) first reaches a threshold, linear between the points; NaN if nowhere."""
    at, height = best, 0.0
    for point in points:
        there = math.sqrt(max(0.0, point.delta))
        if there >= root:
            share = (root - height) / (there - height) if there > height else 1.0
            return at + share * (point.value - at)
        at, height = point.value, there
    return float("nan")


def fit_at_end(
    optimum: Optimum,
    quantity: Quantity,
    begin: FloatArray,
    end: float,
    frozen: tuple[int, ...] = (),
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
    """
    likelihood = optimum.likelihood
    constraint = quantity.constraint(end, quantity.width / STEPS)
    if frozen:
        constraint = Constraint(end, frozen=frozen)
    try:
        here = yield from expansion_at(likelihood, begin)
        if not math.isfinite(quantity.at(here)):
            return None
        found = yield from descend(likelihood, here, constraint, enough=optimum.least + ENOUGH)
    except Exhausted:
        return None
    if found is None:
        return None
    outputs = here.sample.outputs if frozen else found.sample.outputs
    value = quantity.at(here if frozen else found)
    delta = found.chi_square - optimum.least
    if not (abs(value - end) <= 0.01 * quantity.width and delta <= EXCLUDED):
        return None
    return ProfilePoint(
        value=value,
        delta=delta,
        x=found.x,
        outputs=outputs if quantity.output >= 0 else np.empty(0),
    )


def interval(
    quantity: Quantity,
    branches: tuple[ProfileBranch, ProfileBranch],
    ends_fit: tuple[bool, bool],
    mark: str = "95",
) -> tuple[float, float]:
    """The interval of a profile: crossings, or the ends of the range where it does not cross.

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
        ends.append(limit if fits or math.isnan(crossing) else crossing)
    return ends[0], ends[1]
