"""Rational functions through few complex values: how a linear response goes on between them.

The steady response of a linear system is a rational function of the drive frequency, of a degree of
two for each mode that is seen; over a narrow band less does. Few values so give the whole curve,
resonances and antiresonances included, wherever the values stand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray


class Interpolated(NamedTuple):
    """Values (..., n) of functions at frequencies (n,), and their `uncertainty` (..., n)."""

    values: ComplexArray
    uncertainty: FloatArray


@dataclass(frozen=True, kw_only=True)
class Interpolation:
    """A rational function of degree m - 1 through values at some frequencies, or several at once.

    It passes through `supports` (..., m) at `supports_hz`; `others` (..., n) at `others_hz` fix its
    weights by least squares of relative errors. Of these m - 1 would do. With m of them there is a
    check: without any one of them the function is another one, as far as it is uncertain.

    Source: barycentric form of Berrut and Trefethen, SIAM Review 46, 501 (2004); the weights are
    those of Nakatsukasa, Sete and Trefethen, SIAM J. Sci. Comput. 40, A1494 (2018), without their
    choice of supports, so that they depend smoothly on the values.
    """

    supports_hz: FloatArray
    supports: ComplexArray
    others_hz: FloatArray
    others: ComplexArray

    @property
    def degree(self) -> int:
        """Of numerator and denominator."""
        return int(self.supports_hz.size) - 1

    @property
    def frequency_hz(self) -> FloatArray:
        """Where it has been given values, Hz."""
        return np.concatenate([self.supports_hz, self.others_hz])

    def function(self, frequency_hz: FloatArray) -> ComplexArray:
        """Values (..., n) of the function that all values give.

        Args:
            frequency_hz: frequencies (n,), Hz.
        """
        return self.at(frequency_hz).values

    def uncertainty(self, frequency_hz: FloatArray) -> FloatArray:
        """Largest relative change (..., n) that one of the other values makes; infinite without.

        Args:
            frequency_hz: frequencies (n,), Hz.
        """
        return self.at(frequency_hz).uncertainty

    @cached_property
    def _weights(self) -> tuple[ComplexArray, ComplexArray]:
        """Weights (k, m) that all values give, (k, n, m) that all but one of the others do.

        NaN where there are none.
        """
        others, supports = (np.atleast_2d(x) for x in (self.others, self.supports))
        apart, n = self.others_hz[:, np.newaxis] - self.supports_hz, self.others_hz.size
        sizes = np.abs(others)[..., np.newaxis]
        with np.errstate(all="ignore"):  # relative errors at the others by weight, (k, n, m)
            equations = (others[..., np.newaxis] - supports[:, np.newaxis]) / apart / sizes
        kept = np.array([[i for i in range(n) if i != k] for k in range(n)], dtype=np.intp)
        return _null_vectors(equations), _null_vectors(equations[:, kept.reshape(n, n - 1)])

    def at(self, frequency_hz: FloatArray) -> Interpolated:
        """Values, and the largest relative change that one of the others makes; infinite without.

        Args:
            frequency_hz: frequencies (n,), Hz.
        """
        apart = frequency_hz[:, np.newaxis] - self.supports_hz
        place, node = np.nonzero(apart == 0.0)
        apart[place, node] = 1.0
        inverse, supports = 1.0 / apart, np.atleast_2d(self.supports)
        weights, one = self._weights
        above, below = (_product(inverse, w) for w in (weights * supports, weights))
        one_above, one_below = (
            _product(inverse, w.reshape(-1, weights.shape[1])).reshape(len(apart), len(weights), -1)
            for w in (one * supports[:, np.newaxis], one)
        )
        with np.errstate(all="ignore"):
            values = above / below
            # N'/D' over N/D, less one, without a division
            mine = one_below * above[:, :, np.newaxis]
            off = one_above * below[:, :, np.newaxis] - mine
            changes = np.sqrt(np.max(_squared(off) / _squared(mine), axis=2))
        values[place] = supports[:, node].T
        changes[place] = np.where(values[place] == 0.0, np.inf, 0.0)
        known = np.isfinite(changes) & np.isfinite(values)
        shape = (*self.supports.shape[:-1], len(apart))
        changes = np.where(known, changes, np.inf)
        return Interpolated(values.T.reshape(shape), changes.T.reshape(shape))

    def wanted_hz(self, frequency_hz: FloatArray) -> tuple[float, float]:
        """Where two further values determine most: a support and another, of many frequencies.

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


def _product(real: FloatArray, several: ComplexArray) -> ComplexArray:
    """real (n, m) times several (k, m), transposed: (n, k), by one product of real numbers."""
    columns = np.ascontiguousarray(several.T, dtype=complex)
    return np.asarray((real @ columns.view(float)).view(complex))


def _squared(values: ComplexArray) -> FloatArray:
    return np.asarray(values.real**2 + values.imag**2)


def _null_vectors(equations: ComplexArray) -> ComplexArray:
    """What equations (..., n, m) send nearest to zero, columns of one size: (..., m); NaN: none."""
    with np.errstate(all="ignore"):
        size = np.sqrt(np.sum(_squared(equations), axis=-2))
        size = np.where(size > 0.0, size, 1.0)
        matrices = equations / size[..., np.newaxis, :]
    usable = np.all(np.isfinite(matrices), axis=(-2, -1))
    matrices = np.where(usable[..., np.newaxis, np.newaxis], matrices, 0.0)
    vectors = np.linalg.svd(matrices)[2][..., -1, :].conj() / size
    return np.asarray(np.where(usable[..., np.newaxis], vectors, np.nan))
