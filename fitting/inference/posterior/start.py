"""Draws about all minima at once: a mixture of Student's t, one about each minimum.

    q(u) = sum_k w_k t_5(u; c_k, R_k)        ln t_5 = ln |det R| - (5 + n)/2 ln(1 + |R (u - c)|^2/5)

R is a root of the information at the minimum c, R^T R its inverse covariance, in units of the box.
Walkers begin at such draws. As proposals of Metropolis and Hastings they take a walker from one
minimum to another, each as often as it is likely; the tails of t_5 are wider than those of any
posterior that falls as a Gaussian does.

Source: L. Tierney, Annals of Statistics 22 (1994) 1701 (independence chains).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from fitting.text.arrays import FloatArray

FREEDOM = 5.0
#: Share of draws that all minima have in equal parts, however unlike their weights.
EQUAL = 0.5
#: A minimum that is this much less likely (ln) than the best is none to set out from.
UNLIKELY = 20.0


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """A minimum: where it is, how sharp, how likely.

    `centre` (n,) in units of the box; `root` (n, n) upper triangular; `weight` ln of the posterior
    mass about it but for a constant that all share; `origin` who knows of it; `copy_of` the number
    of the minimum that is the same but for whole periods, -1 where it is the first of these.
    """

    centre: FloatArray
    root: FloatArray
    weight: float
    origin: str
    copy_of: int = -1

    def distances(self, table: FloatArray) -> FloatArray:
        """|R (u - c)|, (k,).

        Args:
            table: points in units of the box, (k, n).
        """
        return np.asarray(np.linalg.norm((table - self.centre) @ self.root.T, axis=1))


class Mixture:
    """The mixture of some minima.

    Args:
        minima: One at least.
    """

    def __init__(self, minima: Sequence[Minimum]) -> None:
        weights = np.array([m.weight for m in minima])
        shares = np.exp(weights - logsumexp(weights))
        self.minima = tuple(minima)
        self.weights = EQUAL / len(minima) + (1.0 - EQUAL) * shares

    def draw(self, count: int, rng: np.random.RandomState) -> FloatArray:
        """Points in units of the box, (count, n); not all need be inside.

        Args:
            count: how many.
            rng: of the draws.
        """
        whose = rng.choice(len(self.minima), size=count, p=self.weights)
        return self._about(whose, rng)

    def spread(self, count: int, rng: np.random.RandomState) -> FloatArray:
        """Points inside of the box to begin at, (count, n): of every minimum its share.

        Args:
            count: how many, no fewer than there are minima.
            rng: of the draws.
        """
        places = (np.arange(count) + 0.5) / count
        whose = np.searchsorted(np.cumsum(self.weights), places).clip(max=len(self.minima) - 1)
        whose[: len(self.minima)] = np.arange(len(self.minima))
        return _reflected(self._about(whose, rng))

    def log_density(self, table: FloatArray) -> FloatArray:
        """ln q, (k,), but for a constant.

        Args:
            table: points in units of the box, (k, n).
        """
        n = table.shape[1]
        rows = [
            np.log(w)
            + np.sum(np.log(np.abs(np.diag(m.root))))
            - 0.5 * (FREEDOM + n) * np.log1p(m.distances(table) ** 2 / FREEDOM)
            for w, m in zip(self.weights, self.minima, strict=True)
        ]
        return np.asarray(logsumexp(rows, axis=0))

    def _about(self, whose: FloatArray, rng: np.random.RandomState) -> FloatArray:
        n = self.minima[0].centre.size
        normal = rng.standard_normal((whose.size, n))
        wide = np.sqrt(FREEDOM / rng.chisquare(FREEDOM, whose.size))
        found = [
            self.minima[k].centre + scale * np.linalg.solve(self.minima[k].root, z)
            for k, scale, z in zip(whose, wide, normal, strict=True)
        ]
        return np.array(found)


def _reflected(table: FloatArray) -> FloatArray:
    """Points folded back into the box at its faces."""
    folded = np.mod(table, 2.0)
    return np.asarray(np.where(folded > 1.0, 2.0 - folded, folded))
