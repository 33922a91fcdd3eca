"""Solver parameters: the tolerance or substep of an FMU, as coarse as a wanted accuracy allows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.simulate.probe import Probe
from fitting.simulate.settling import SAFETY
from fitting.text.arrays import Scalar
from fitting.text.errors import FmuFailure, NoAnswer

#: A refinement stops when its bound lies within its share and above this part of it.
WASTED = 0.02
ROUNDS = 10


@dataclass(frozen=True, kw_only=True)
class SolverParameter:
    """A parameter of the FMU that sets its solver's accuracy: a tolerance or a substep.

    Args:
        name: Of the variable.
        low: Least value that the FMU takes, in its unit.
        high: Largest one.
        part: By which part of it a value is tried finer.
        order: Power of the value that the error goes as, at a guess.
        probe: Runs of the drives.
        work: Most that a run may cost.
    """

    name: str
    low: float
    high: float
    part: float
    order: float
    probe: Probe
    work: float

    def error_at(self, settings: Mapping[str, Scalar], settle_s: float, value: float) -> float:
        """Change of the amplitudes by a finer value; infinite where the coarse one fails.

        Below zero: it is not this parameter that sets the accuracy. Where none is finer, the change
        from a coarser one, which is more than what is left.

        Args:
            settings: start values of all that is decided already.
            settle_s: time to settle, s.
            value: of the parameter.

        Raises:
            NoAnswer: a worker does not answer.
        """
        finer = max(value * self.part, self.low)
        coarser = value if finer < value else min(value / self.part, self.high)
        try:
            here = self.probe.read({**settings, self.name: coarser}, settle_s)
            better = self.probe.read({**settings, self.name: finer}, settle_s)
        except NoAnswer:
            raise
        except FmuFailure:
            return math.inf
        if all((a.tones == b.tones).all() for a, b in zip(here, better, strict=True)):
            return -1.0
        return max(SAFETY * self.probe.errors(here, better), self.probe.changes(better, here))

    def coarsest(
        self, settings: Mapping[str, Scalar], settle_s: float, first: float, share: float
    ) -> tuple[float, float]:
        """Bound and value, the coarsest whose measured error fits into a share.

        The bound is below zero where the parameter changes nothing.

        Args:
            settings: start values of all that is decided already.
            settle_s: time to settle, s.
            first: value to try first.
            share: relative error that is allowed.

        Raises:
            NoAnswer: a worker does not answer.
        """
        best, value = (math.inf, first), min(max(first, self.low), self.high)
        for _ in range(ROUNDS):
            bound = self.error_at(settings, settle_s, value)
            if bound < 0.0:
                return bound, value
            if _better(bound, value, best, share):
                best = bound, value
            if WASTED * share <= bound <= share:
                break
            factor = (0.3 * share / max(bound, 1e-300)) ** (1.0 / self.order)
            factor = min(max(factor, 0.05), 10.0)
            # no finer than runs may take: the work is taken to go as one over the value
            spent = self.probe.work({**settings, self.name: value}, settle_s) / self.work
            there = min(max(value * max(factor, min(1.0, spent)), self.low), self.high)
            if there == value or (bound > share and there > 0.9 * value):
                break
            value = there
        return best


def _better(bound: float, value: float, best: tuple[float, float], share: float) -> bool:
    """A value that keeps the share beats a finer one that does; else the smaller error."""
    if bound <= share:
        return best[0] > share or value > best[1]
    return bound < best[0]
