"""What residuals are between places where they and their derivatives are known.

    r(u) = m + sum_b k(x - x_b) (a_b + (x - x_b) . g_b)        k(x) = exp(-|x|^2/2)

a Gaussian process through the values and the derivatives of every residual at the places u_b, in
units of the box; x are these over a length, and a periodic value is a point of a circle. It takes
no run of a model, and says how likely a point is, ln s = -|r|^2/2, so well that a walk that follows
it has few proposals to lose. It need not be right: draws are those of the posterior whatever s is.

Source: C. E. Rasmussen, C. Williams, "Gaussian Processes for Machine Learning" (2006), section 9.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from fitting.text.arrays import BoolArray, FloatArray

#: Lengths that are tried, in units of the box, and the share of places that judge them: one in so
#: many.
LENGTHS, JUDGES = (0.3, 1.0, 3.0), 4
#: Of the variance of what is known, added to it, the least by which equations can be solved:
#: rounding must not decide.
ROUNDINGS = (1e-10, 1e-8, 1e-6, 1e-4)
#: Values and derivatives of one residual that are made use of, at most: equations are solved.
MOST = 3000


@dataclass(frozen=True, kw_only=True)
class Places:
    """What is known: `places` (k, n) in units of the box, `rows` (k, m), `slopes` (k, m, n)."""

    places: FloatArray
    rows: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, known: Sequence[tuple[FloatArray, FloatArray, FloatArray]]) -> Places:
        """From each place, its residuals and their derivatives.

        Args:
            known: one at least.
        """
        places, rows, slopes = (np.array(part) for part in zip(*known, strict=True))
        return cls(places=places, rows=rows, slopes=slopes)

    def beside(self, other: Places) -> Places:
        """Both, the later ones of them where these are too many.

        Args:
            other: later ones.
        """
        most = MOST // (self.places.shape[1] + 1)
        return Places(
            places=np.concatenate([self.places, other.places])[-most:],
            rows=np.concatenate([self.rows, other.rows])[-most:],
            slopes=np.concatenate([self.slopes, other.slopes])[-most:],
        )

    def some(self, which: BoolArray) -> Places:
        """A part of them.

        Args:
            which: True for those that are wanted, (k,).
        """
        return Places(places=self.places[which], rows=self.rows[which], slopes=self.slopes[which])


@dataclass(frozen=True, kw_only=True)
class Surrogate:
    """Residuals anywhere: `known` places, `periods` (n,) in units of the box, inf for none.

    `length` over which residuals hang together, in units of the box; a period is as long as it.
    """

    known: Places
    periods: FloatArray
    length: float

    @classmethod
    def through(cls, known: Places, periods: FloatArray) -> Surrogate:
        """That of the length by which a part of the places tells the others best.

        Args:
            known: places.
            periods: (n,) in units of the box, inf for none.
        """
        judges = np.arange(len(known.places)) % JUDGES == JUDGES - 1
        asked = known.some(judges)

        def error(length: float) -> float:
            made = cls(known=known.some(~judges), periods=periods, length=length)
            return float(np.sum((made.rows(asked.places) - asked.rows) ** 2))

        return cls(known=known, periods=periods, length=min(LENGTHS, key=error))

    def log(self, table: FloatArray) -> FloatArray:
        """ln s, (p,): -inf outside of the box, and of the first period of a periodic value.

        Args:
            table: points in units of the box, (p, n).
        """
        inside = np.all((table >= 0.0) & (table <= np.minimum(self.periods, 1.0)), axis=1)
        found = np.full(len(table), -np.inf)
        found[inside] = -0.5 * np.sum(self.rows(table[inside]) ** 2, axis=1)
        return found

    def turns(self, table: FloatArray) -> FloatArray:
        """Whole periods by which points lie beyond the first, (p, n), in units of the box.

        Args:
            table: points in units of the box, (p, n).
        """
        whole = np.where(np.isinf(self.periods), 1.0, self.periods)
        return np.where(np.isinf(self.periods), 0.0, whole * np.floor(table / whole))

    def rows(self, table: FloatArray) -> FloatArray:
        """Residuals, (p, m).

        Args:
            table: points in units of the box, (p, n).
        """
        _, x, kernel = self._near(table)
        values, along = self._coefficients
        sums = (kernel @ along.reshape(len(along), -1)).reshape(*x.shape, -1)
        return np.asarray(self._mean + kernel @ values + np.einsum("pf,pfm->pm", x, sums))

    def slopes(self, table: FloatArray) -> FloatArray:
        """Derivatives of the residuals by the parameters in units of the box, (p, m, n).

        Args:
            table: points in units of the box, (p, n).
        """
        turned, x, kernel = self._near(table)
        values, along = self._coefficients
        found = np.empty((*x.shape, values.shape[1]))
        for p, (here, near) in enumerate(zip(x, kernel, strict=True)):
            lines = near[:, None] * (values + np.einsum("f,bfm->bm", here, along))
            found[p] = np.tensordot(near, along, 1) - (here - self._x).T @ lines
        return np.asarray(np.einsum("pfm,pfn->pmn", found, turned))

    def _near(self, table: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """dx/du (p, f, n), x (p, f), and the kernel between points and places (p, k)."""
        x, turned = _features(table, self.periods, self.length)
        squares = np.sum(x**2, axis=1)[:, None] + np.sum(self._x**2, axis=1) - 2.0 * x @ self._x.T
        return turned, x, np.exp(-0.5 * squares)

    @cached_property
    def _x(self) -> FloatArray:
        return _features(self.known.places, self.periods, self.length)[0]

    @cached_property
    def _mean(self) -> FloatArray:
        return np.asarray(np.mean(self.known.rows, axis=0))

    @cached_property
    def _coefficients(self) -> tuple[FloatArray, FloatArray]:
        """a_b - x_b . g_b (k, m), and g_b (k, f, m)."""
        turned = _features(self.known.places, self.periods, self.length)[1]
        k, m, n = self.known.slopes.shape
        apart = self._x[:, None] - self._x[None]
        kernel = np.exp(-0.5 * np.sum(apart**2, axis=2))
        by_first = np.einsum("abf,afn->abn", apart, turned)
        by_second = np.einsum("abf,bfn->abn", apart, turned)
        both = np.einsum("afn,bfm->abnm", turned, turned)
        both -= by_first[..., :, None] * by_second[..., None, :]
        between = (kernel[..., None] * by_second).reshape(k, k * n)
        within = (kernel[..., None, None] * both).transpose(0, 2, 1, 3).reshape(k * n, k * n)
        whole = np.block([[kernel, between], [between.T, within]])
        told = np.vstack(
            [self.known.rows - self._mean, self.known.slopes.transpose(0, 2, 1).reshape(-1, m)]
        )
        solved = _solved(whole, told)
        along = np.einsum("bfn,bnm->bfm", turned, solved[k:].reshape(k, n, m))
        return solved[:k] - np.einsum("bf,bfm->bm", self._x, along), along


def _solved(whole: FloatArray, told: FloatArray) -> FloatArray:
    """What a covariance solves; places that are as good as one leave nothing but rounding of it."""
    diagonal = np.diag(whole).copy()
    for rounding in ROUNDINGS:
        np.fill_diagonal(whole, (1.0 + rounding) * diagonal)
        try:
            return np.asarray(cho_solve(cho_factor(whole, lower=True), told))
        except LinAlgError:
            continue
    raise RuntimeError("a covariance without a root")


def _features(
    table: FloatArray, periods: FloatArray, length: float
) -> tuple[FloatArray, FloatArray]:
    """x (p, f) and dx/du (p, f, n): a periodic value is a point of a circle of circumference 1."""
    n = table.shape[1]
    values, slopes = [], []
    for i, period in enumerate(periods):
        slope = np.zeros((2, len(table), n))
        if math.isinf(period):
            slope[0, :, i] = 1.0
            values.append(table[:, i])
            slopes.append(slope[0])
            continue
        angle = 2.0 * math.pi * table[:, i] / period
        slope[0, :, i], slope[1, :, i] = -np.sin(angle) / period, np.cos(angle) / period
        values += [np.cos(angle) / (2.0 * math.pi), np.sin(angle) / (2.0 * math.pi)]
        slopes += [slope[0], slope[1]]
    return np.stack(values, axis=1) / length, np.stack(slopes, axis=1) / length
