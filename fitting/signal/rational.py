"""Rational functions through few complex values: how a linear response goes on between them.

The steady response of a linear system is a rational function of the drive frequency, of a degree of
two for each mode that is seen; over a narrow band less does. Few values so give the whole curve,
resonances and antiresonances included, wherever the values stand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitting.text.arrays import BoolArray, ComplexArray, FloatArray


@dataclass(frozen=True)
class RationalFunction:
    """r(f) = sum_j w_j v_j/(f - f_j) / sum_j w_j/(f - f_j): it is v_j at f_j, all of shape (m,).

    Source: Berrut and Trefethen, SIAM Review 46, 501 (2004), barycentric form.
    """

    nodes_hz: FloatArray
    values: ComplexArray
    weights: ComplexArray

    def __call__(self, frequency_hz: FloatArray) -> ComplexArray:
        """Values, shape (n,), at frequencies (n,), Hz."""
        apart = frequency_hz[:, np.newaxis] - self.nodes_hz
        place, node = np.nonzero(apart == 0.0)
        apart[place, node] = 1.0
        terms = self.weights / apart
        with np.errstate(all="ignore"):
            found = np.asarray((terms @ self.values) / np.sum(terms, axis=1))
        found[place] = self.values[node]
        return found


@dataclass(frozen=True, kw_only=True)
class Interpolation:
    """A rational function of degree m - 1 through values at some frequencies.

    It passes through `supports` (m,) at `supports_hz`; `others` (n,) at `others_hz` fix its weights
    by least squares of relative errors. Of these m - 1 would do. With m of them there is a check:
    without any one of them the function is another one, as far as it is uncertain.

    Source: the weights are those of Nakatsukasa, Sete and Trefethen, SIAM J. Sci. Comput. 40, A1494
    (2018), without their choice of supports, so that they depend smoothly on the values.
    """

    supports_hz: FloatArray
    supports: ComplexArray
    others_hz: FloatArray
    others: ComplexArray

    @property
    def degree(self) -> int:
        """Of numerator and denominator."""
        return int(self.supports.size) - 1

    @property
    def frequency_hz(self) -> FloatArray:
        """Where it has been given values, Hz."""
        return np.concatenate([self.supports_hz, self.others_hz])

    @cached_property
    def function(self) -> RationalFunction:
        """The function that all values give."""
        return self._by(np.ones(self.others.size, dtype=bool))

    @cached_property
    def _without_one(self) -> tuple[RationalFunction, ...]:
        """The functions that all values but one of the others give."""
        every = np.arange(self.others.size)
        return tuple(self._by(every != k) for k in every)

    def uncertainty(self, frequency_hz: FloatArray) -> FloatArray:
        """Largest relative change (n,) that one of the other values makes; infinite without value.

        Args:
            frequency_hz: frequencies (n,), Hz.
        """
        here = self.function(frequency_hz)
        changes = [np.abs(without(frequency_hz) - here) for without in self._without_one]
        with np.errstate(all="ignore"):
            largest = np.max(changes, axis=0) / np.abs(here)
        return np.where(np.isfinite(largest), largest, np.inf)

    def wanted_hz(self, frequency_hz: FloatArray) -> tuple[float, float]:
        """Where two further values tell most: a support and another, at two of many frequencies.

        The most uncertain place and the top of the curve; where that is known, the most uncertain
        place beyond the next values.

        Args:
            frequency_hz: to choose from, increasing, Hz; at least two of them without a value.

        Raises:
            ValueError: too few to choose from.
        """
        free = frequency_hz[~np.isin(frequency_hz, self.frequency_hz)]
        if free.size < 2:
            raise ValueError(f"{free.size} frequencies are free, wanted two")
        apart = self.uncertainty(free)
        first = float(free[int(np.argmax(apart))])
        top = float(frequency_hz[int(np.argmax(np.abs(self.function(frequency_hz))))])
        if top in free and top != first:
            return first, top
        gaps = np.searchsorted(np.sort(self.frequency_hz), free)
        beyond = gaps != gaps[int(np.argmax(apart))]
        if not np.any(beyond):
            beyond = free != first
        return first, float(free[beyond][int(np.argmax(apart[beyond]))])

    def with_values(self, frequency_hz: tuple[float, float], values: ComplexArray) -> Interpolation:
        """The interpolation of one degree more, by a further support and another value.

        Args:
            frequency_hz: of both, Hz.
            values: there, shape (2,).
        """
        return replace(
            self,
            supports_hz=np.append(self.supports_hz, frequency_hz[0]),
            supports=np.append(self.supports, values[0]),
            others_hz=np.append(self.others_hz, frequency_hz[1]),
            others=np.append(self.others, values[1]),
        )

    def _by(self, used: BoolArray) -> RationalFunction:
        """By these of the others: weights are the null vector of their linear equations."""
        others_hz, others = self.others_hz[used, np.newaxis], self.others[used, np.newaxis]
        with np.errstate(all="ignore"):
            rows = (others - self.supports) / (others_hz - self.supports_hz) / np.abs(others)
            size = np.linalg.norm(rows, axis=0)
            matrix = rows / np.where(size > 0.0, size, 1.0)
        if not np.all(np.isfinite(matrix)):
            weights = np.full(self.supports.size, np.nan, dtype=complex)
        else:
            weights = np.linalg.svd(matrix)[2][-1].conj() / np.where(size > 0.0, size, 1.0)
        return RationalFunction(self.supports_hz, self.supports, weights)
