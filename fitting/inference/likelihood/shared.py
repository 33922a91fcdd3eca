"""What all scans of one optimum share: the evaluator, known minima, every point that fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import drift_square
from fitting.fit.levenberg import Expansion
from fitting.fit.likelihood import Exhausted, LikelihoodEvaluator, Request, Sample
from fitting.fit.optimum import Optimum
from fitting.fit.twins import Twin
from fitting.inference.likelihood.profile import Quantity, ScanPoint, Side
from fitting.inference.likelihood.ranges import OutputRange
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95

#: Share of an increase of chi square by priors of what drifts from which they close an interval.
BY_PRIORS = 0.5


class Shared:
    """What all scans of one optimum share: evaluator, known minima, accepted points."""

    def __init__(
        self,
        evaluator: LikelihoodEvaluator,
        optimum: Optimum,
        ranges: Mapping[str, OutputRange],
        minima: Sequence[ScanPoint],
        twins: Sequence[Twin],
    ) -> None:
        self.evaluator, self.optimum, self.ranges = evaluator, optimum, ranges
        self.twins = twins
        self.minima = [m for m in self.read(minima) if m.delta <= ROOT_95**2]
        self.accepted: list[ScanPoint] = list(self.minima)

    @property
    def periods(self) -> FloatArray:
        """Of the parameters, (n,)."""
        return self.optimum.likelihood.periods

    def point(self, quantity: Quantity, at: Expansion) -> ScanPoint:
        """A point of the profile of a quantity; chi square without the row that holds it."""
        square = float(at.sample.rows @ at.sample.rows)
        delta = self.optimum.delta(square, quantity.freedom)
        return ScanPoint(value=quantity.of(at.sample, self.periods), delta=delta, at=at)

    def with_outputs(self, points: Sequence[ScanPoint]) -> list[ScanPoint]:
        """The points with their outputs; without those that lack one that the optimum has.

        A fit at parameters for which the model has no such output is no fit of that model.
        """
        exists = np.isfinite(self.optimum.expansion.sample.outputs)
        read = [p for p in self.read(points) if p.outputs.size == exists.size]
        return [p for p in read if np.all(np.isfinite(p.outputs[exists]))]

    def read(self, points: Sequence[ScanPoint]) -> tuple[ScanPoint, ...]:
        """The points with their outputs, as far as the budget allows."""
        bare = [p for p in points if not p.outputs.size]
        if not self.optimum.likelihood.names or not bare:
            return tuple(points)
        try:
            [read] = self.evaluator([Request(tuple(p.x for p in bare), rows=False)])
        except Exhausted:
            return tuple(points)
        known = {id(p): s.outputs for p, s in zip(bare, read, strict=True)}
        return tuple(_knowing(p, known[id(p)]) if id(p) in known else p for p in points)

    def fitting(self) -> list[ScanPoint]:
        """Every accepted point inside the 95 % threshold, with outputs."""
        self.accepted = self.with_outputs(self.accepted)
        return self.accepted

    def accept(self, points: Sequence[ScanPoint]) -> None:
        """Share points that fit, and their images by the symmetries of the model."""
        parameters = self.optimum.likelihood.parameters
        for point in points:
            if not point.delta <= ROOT_95**2:
                continue
            self.accepted.append(point)
            for twin in self.twins:
                image = twin.of(parameters, point.x)
                if image is not None:
                    sample = Sample(image, point.at.sample.rows, np.empty(0))
                    nothing = np.empty((0, 0))  # slopes there are not known
                    bare = Expansion(sample, nothing, nothing, age=1)
                    self.accepted.append(replace(point, at=bare))


def _knowing(point: ScanPoint, outputs: FloatArray) -> ScanPoint:
    return replace(point, at=replace(point.at, sample=replace(point.at.sample, outputs=outputs)))


def by_data_or_priors(shared: Shared, beyond: ScanPoint) -> str:
    """What excludes a point: data, or priors of what drifts, which say nothing of the sample.

    Priors that hold what differs between experiments are stated for lack of anything better, of
    offsets that may be correlated.
    """
    parameters = shared.optimum.likelihood.parameters
    least = drift_square(parameters, shared.optimum.expansion.x)
    more = drift_square(parameters, beyond.x) - least
    return "prior" if more > BY_PRIORS * beyond.delta else "data"


def with_simulation(q: Quantity, side: int, known: Side, origin: float) -> Side:
    """A side, longer by what the simulation may be off by; never beyond the range.

    Where it may move the estimate by `reach` sigma, the true value lies where sqrt(Dchi^2) is below
    its threshold plus that: sides are longer in that ratio, each by its own.
    """
    limit = (q.low, q.high)[side]
    ends = []
    for end, root in ((known.end68, ROOT_68), (known.end95, ROOT_95)):
        far = end + q.reach / reach(root, q.freedom) * (end - origin)
        ends.append(max(far, limit) if side == 0 else min(far, limit))
    if ends[1] == limit and q.reach and known.closed == "data":
        known = replace(known, closed="bound")
    return replace(known, end68=ends[0], end95=ends[1])
