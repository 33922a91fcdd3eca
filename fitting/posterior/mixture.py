"""Draws about many places at once: a mixture of Student's t, one about each place.

    q(u) = sum_k w_k t_5(u; c_k, R_k)        ln t_5 = ln |det R| - (5 + n)/2 ln(1 + |R (u - c)|^2/5)

R is a root of the information about the place c, R^T R its inverse covariance, in units of the box.
Walkers begin at such draws about the minima. As proposals of Metropolis and Hastings they take a
walker from one place to any other, each as often as it is likely; the tails of t_5 are wider than
those of a posterior that falls as a Gaussian does. A mixture is worth the share of independent
draws among its proposals

    share = 1/(<w> <1/w>)        w = posterior/mixture, means over draws of the posterior

Source: L. Tierney, Annals of Statistics 22 (1994) 1701 (independence chains).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from fitting.extension.problem import UNIFORM_WIDTH
from fitting.text.arrays import FloatArray, IntArray

#: Degrees of freedom of Student's t.
DOF = 5.0
#: Reach of a place along a bent posterior at least, in units of the box.
LEAST_REACH = 1e-3
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

    @property
    def log(self) -> float:
        """ln of the posterior at it, but for the same constant: without its width."""
        return self.weight + float(np.sum(np.log(np.abs(np.diag(self.root)))))

    def distances(self, table: FloatArray) -> FloatArray:
        """|R (u - c)|, (k,).

        Args:
            table: points in units of the box, (k, n).
        """
        return np.asarray(np.linalg.norm((table - self.centre) @ self.root.T, axis=1))


@dataclass(frozen=True)
class Mixture:
    """A mixture: `centres` (K, n), `roots` (K, n, n) upper triangular, `weights` (K,) of sum 1."""

    centres: FloatArray
    roots: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, minima: Sequence[Minimum]) -> Mixture:
        """That of all minima.

        Args:
            minima: one at least.
        """
        log = np.array([m.weight for m in minima])
        shares = np.exp(log - logsumexp(log))
        return cls(
            np.array([m.centre for m in minima]),
            np.array([m.root for m in minima]),
            np.asarray(EQUAL / len(minima) + (1.0 - EQUAL) * shares),
        )

    @classmethod
    def along(cls, places: Sequence[Minimum]) -> Mixture:
        """Of places along a bent posterior: as wide as the data allow, along it to the next one.

        Args:
            places: two at least, with roots that count the bounds as a uniform prior.
        """
        centres = np.array([m.centre for m in places])
        distances = np.linalg.norm(centres[:, None] - centres, axis=2)
        reach = max(float(np.median(np.sort(distances, axis=1)[:, 1])), LEAST_REACH)
        more = math.sqrt(max(reach**-2 - UNIFORM_WIDTH**2, 0.0)) * np.eye(centres.shape[1])
        roots = [np.linalg.qr(np.vstack([m.root, more]), mode="r") for m in places]
        return cls(centres, np.array(roots), np.full(len(places), 1.0 / len(places)))

    def joined(self, other: Mixture) -> Mixture:
        """Both in one, each with half of the weight."""
        return Mixture(
            np.concatenate([self.centres, other.centres]),
            np.concatenate([self.roots, other.roots]),
            0.5 * np.concatenate([self.weights, other.weights]),
        )

    def draw(self, count: int, rng: np.random.RandomState) -> FloatArray:
        """Points in units of the box, (count, n); not all need be inside.

        Args:
            count: how many.
            rng: of the draws.
        """
        whose = np.asarray(rng.choice(len(self.weights), size=count, p=self.weights), dtype=np.intp)
        return self._about(whose, rng)

    def spread(self, count: int, rng: np.random.RandomState) -> FloatArray:
        """Points inside of the box to begin at, (count, n): about every place its share.

        Args:
            count: how many, no fewer than there are places.
            rng: of the draws.
        """
        steps = (np.arange(count) + 0.5) / count
        whose = np.searchsorted(np.cumsum(self.weights), steps).clip(max=len(self.weights) - 1)
        whose[: len(self.weights)] = np.arange(len(self.weights))
        folded = np.mod(self._about(whose, rng), 2.0)  # back into the box at its faces
        return np.asarray(np.where(folded > 1.0, 2.0 - folded, folded))

    def log_density(self, table: FloatArray) -> FloatArray:
        """ln q, (k,), but for a constant.

        Args:
            table: points in units of the box, (k, n).
        """
        n = table.shape[1]
        rotated = self._stacked @ table.T - self._root_centres
        parts = rotated.reshape(*self.centres.shape, -1)
        squares = np.einsum("kip,kip->kp", parts, parts)
        logs = self._sizes[:, None] - 0.5 * (DOF + n) * np.log1p(squares / DOF)
        most = np.max(logs, axis=0)
        return np.asarray(most + np.log(np.sum(np.exp(logs - most), axis=0)))

    @cached_property
    def _stacked(self) -> FloatArray:
        """All roots, one below the other, (K n, n): one product for all of them."""
        return np.asarray(self.roots.reshape(-1, self.roots.shape[2]))

    @cached_property
    def _root_centres(self) -> FloatArray:
        """R c, one below the other, (K n, 1)."""
        return np.asarray(np.einsum("kij,kj->ki", self.roots, self.centres).reshape(-1, 1))

    @cached_property
    def _sizes(self) -> FloatArray:
        """ln of weight and |det R|, (K,)."""
        diagonals = np.abs(np.diagonal(self.roots, axis1=1, axis2=2))
        return np.asarray(np.log(self.weights) + np.sum(np.log(diagonals), axis=1))

    def _about(self, whose: IntArray, rng: np.random.RandomState) -> FloatArray:
        normal = rng.standard_normal((len(whose), self.centres.shape[1], 1))
        steps = np.linalg.solve(self.roots[whose], normal)[..., 0]
        wide = np.sqrt(DOF / rng.chisquare(DOF, whose.size))
        return np.asarray(self.centres[whose] + wide[:, None] * steps)


def share_of(mixture: Mixture, places: FloatArray, log: FloatArray) -> float:
    """Share of independent draws among proposals of a mixture inside the bounds; see the module.

    Args:
        mixture: that proposes.
        places: draws of the posterior in units of the box, shape (k, n).
        log: ln of the posterior there, (k,).
    """
    logs = log - mixture.log_density(places)
    return float(np.exp(2.0 * math.log(logs.size) - logsumexp(logs) - logsumexp(-logs)))
