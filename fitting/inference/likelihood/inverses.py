"""Outputs that say the same of a sample, one inverse to the other: walked once, told twice.

A quality factor is eta over the width: where eta is known their product does not move, and a
profile of one is that of the other. Where eta is fitted, or drifts with what is, the product moves,
but by far less than either is known to. Found by their values, without knowing the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.fit.likelihood.descent import Optimum
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Exhausted, Request
from fitting.fit.search.box import Box
from fitting.inference.likelihood.profiles import ProfileBranch, ProfilePoint, Quantity
from fitting.text.arrays import FloatArray

Branches = tuple[ProfileBranch, ProfileBranch]
RangeEnds = tuple[ProfilePoint | None, ProfilePoint | None]

#: Points of the box at which products are compared, and at how many they must exist.
DRAWN, FEWEST = 8, 4
#: How little a product moves, and how much its factors at least, as shares.
SAME, MOVES = 1e-6, 1e-2
#: A product may move by this part of a factor's standard deviation, all over the box up to such a
#: share, where the data hold it up to the other.
UNSEEN, MOST, MOST_HELD = 0.01, 1e-2, 0.1


@dataclass(frozen=True)
class Inverse:
    """`quantity` is `product` over another one, which is walked in its place."""

    quantity: Quantity
    of: str
    product: float

    def branches(self, walked: Branches) -> Branches:
        """Its branches, downward and upward, from those of the other.

        Args:
            walked: of the other.
        """
        down, up = walked
        return self._branch(up), self._branch(down)

    def range_ends(self, reached: RangeEnds) -> RangeEnds:
        """The points at its low and high end, from those of the other.

        Args:
            reached: of the other.
        """
        low, high = (None if point is None else self._point(point) for point in reached)
        return high, low

    def _branch(self, branch: ProfileBranch) -> ProfileBranch:
        return replace(
            branch,
            points=tuple(map(self._point, branch.points)),
            at_68=self.product / branch.at_68,
            at_95=self.product / branch.at_95,
        )

    def _point(self, point: ProfilePoint) -> ProfilePoint:
        return replace(point, value=self.product / point.value)


def inverses(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    covariance: FloatArray,
    chosen: Sequence[Quantity],
    seed: int = 1,
) -> list[Inverse]:
    """Those outputs among some quantities whose product with an earlier one does not move.

    Args:
        evaluator: of the likelihood; outputs alone are asked for.
        optimum: the most likely point and its likelihood.
        covariance: of the parameters in x there, shape (n, n).
        chosen: quantities that are profiled.
        seed: of the points that are compared.
    """
    outputs = [q for q in chosen if q.output >= 0]
    spread = Box(optimum.likelihood.parameters).spread(DRAWN, seed)
    if len(outputs) < 2 or not spread:
        return []
    try:
        [samples] = evaluator([Request(tuple(spread), rows=False)])
    except Exhausted:
        return []
    table = np.array([optimum.expansion.sample.outputs, *(s.outputs for s in samples)])
    found: dict[str, Inverse] = {}
    for k, later in enumerate(outputs):
        for first in outputs[:k]:
            if first.name in found or later.name in found:
                continue
            factors = table[:, [first.output, later.output]]
            factors = factors[np.all(np.isfinite(factors) & (factors > 0.0), axis=1)]
            product = float(first.best * later.best)
            if len(factors) < FEWEST or not product > 0.0:
                continue
            moves = float(np.max(np.abs(np.prod(factors, axis=1) / product - 1.0)))
            unseen = UNSEEN * first.sigma / abs(first.best)
            still = moves <= min(max(SAME, unseen), MOST)
            held = moves <= MOST_HELD and _spread(optimum, covariance, first, later) <= unseen
            if (still or held) and np.min(np.ptp(np.log(factors), axis=0)) > MOVES:
                found[later.name] = Inverse(later, first.name, product)
    return list(found.values())


def _spread(optimum: Optimum, covariance: FloatArray, first: Quantity, later: Quantity) -> float:
    """Standard deviation of a product as the data have it, as a share; infinite without slopes."""
    slopes = optimum.expansion.outward
    slope = slopes[first.output] / first.best + slopes[later.output] / later.best
    if not np.all(np.isfinite(slope)):
        return float("inf")
    return float(np.sqrt(max(0.0, slope @ covariance @ slope)))


def told_twice(walked: Mapping[str, Branches], found: Sequence[Inverse]) -> dict[str, Branches]:
    """Branches by quantity, with those of the inverses.

    Args:
        walked: of the quantities that were walked.
        found: inverses of some of them.
    """
    return dict(walked) | {i.quantity.name: i.branches(walked[i.of]) for i in found}
