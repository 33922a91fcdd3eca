"""The box of a problem as a unit cube: points that fill it evenly, and how far apart they are.

A positive parameter that may be ten times larger or smaller is spread in its logarithm, a periodic
one over one period. What the model depends on is searched whether it has a prior or not, as far as
that may reach; offsets of single experiments that have one stay at their start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds, starts, to_model, to_search
from fitting.text.arrays import BoolArray, FloatArray

#: How far a prior reaches from its middle, in standard deviations: beyond, nothing fits as well.
PRIOR_SIGMAS = 3.0


class Box:
    """Box of the parameters that are looked for, seen as a cube of unit edges."""

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.parameters = parameters
        self.free = np.array([p.is_searched for p in parameters], dtype=bool)
        self.lower, self.upper = search_bounds(parameters)
        self._ends = np.array([_ends(p) for p in parameters]).reshape(-1, 2)
        self._log: BoolArray = np.array([p.spans_decades for p in parameters], dtype=bool)
        self._round: BoolArray = np.array([_goes_round(p) for p in parameters], dtype=bool)

    def spread(self, number: int, seed: int, skip: int = 0) -> list[FloatArray]:
        """Search vectors that fill the box evenly; a longer list goes on where a shorter ended.

        Args:
            number: of points, a power of two.
            seed: of the scrambling.
            skip: points of the same sequence that were used before.

        Source: I. Sobol, USSR Comput. Math. Math. Phys. 7 (1967) 86; A. Owen's scrambling.
        """
        count = int(np.count_nonzero(self.free))
        if not count:
            return []
        # takes a third of a second to load: only where a box is searched
        from scipy.stats.qmc import Sobol

        sequence = Sobol(count, scramble=True, seed=np.random.default_rng(seed))
        if skip:
            sequence.fast_forward(skip)
        return [self.from_cube(u) for u in sequence.random(number)]

    def to_cube(self, x: FloatArray) -> FloatArray:
        """Where a search vector stands in the cube, (n,); beyond it where a period was added.

        Args:
            x: search vector, shape (n,).
        """
        p = to_model(self.parameters, x)
        low, high = self._ends.T
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithmic = np.log(np.maximum(p, low) / low) / np.log(high / low)
        return np.asarray(np.where(self._log, logarithmic, (p - low) / (high - low)))

    def apart(self, x: FloatArray, y: FloatArray) -> float:
        """Largest distance of two search vectors along an edge of the cube, periods taken off.

        Args:
            x: search vector, shape (n,).
            y: another, shape (n,).
        """
        gap = np.abs(self.to_cube(x) - self.to_cube(y))
        turned = np.mod(gap, 1.0)
        gap = np.where(self._round, np.minimum(turned, 1.0 - turned), gap)
        return float(np.max(gap[self.free], initial=0.0))

    def from_cube(self, u: FloatArray) -> FloatArray:
        """The search vector at a point of the cube, (n,); what is not looked for is at its start.

        Args:
            u: in the unit cube of what is looked for.
        """
        p = starts(self.parameters)
        x = to_search(self.parameters, p)
        p[self.free] = _spread(self._ends[self.free].T, u, self._log[self.free])
        x[self.free] = to_search(self.parameters, p)[self.free]
        return np.clip(x, self.lower, self.upper)


def _spread(ends: FloatArray, u: float | FloatArray, is_log: bool | BoolArray) -> FloatArray:
    """Values at places u (n,) between ends (2, n), of ratios where `is_log`; or one of each."""
    low, high = ends
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithmic = low * (high / low) ** u
    return np.asarray(np.where(is_log, logarithmic, low + u * (high - low)))


def _goes_round(parameter: Parameter) -> bool:
    period = parameter.period
    low, high = _searched_range(parameter)
    return period is not None and high - low >= period * (1.0 - 1e-9)


def _ends(parameter: Parameter) -> tuple[float, float]:
    low, high = _searched_range(parameter)
    if _goes_round(parameter):
        return low, low + (parameter.period or math.inf)
    return low, high


def _searched_range(parameter: Parameter) -> tuple[float, float]:
    """The bounds; of a value that has a prior and is searched, as far as that may reach."""
    low, high = parameter.lower, parameter.upper
    if parameter.prior_sigma is None or not parameter.is_searched:
        return low, high
    reach = PRIOR_SIGMAS * parameter.prior_sigma
    near = max(low, parameter.reference - reach), min(high, parameter.reference + reach)
    return near if near[0] < near[1] else (low, high)
