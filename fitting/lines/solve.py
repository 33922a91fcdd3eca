"""Least squares of a curve of which some unknowns enter linearly: variable projection.

    curve = sum_k c_k B_k(x)        residual = W (y - curve)

The linear c are solved at every x: with W B = Q R the residual (1 - Q Q^H) W y is a function of x
alone, of which the derivatives are, dB = W dB/dx,

    d residual/dx = -(1 - Q Q^H) dB c - Q R^-H dB^H residual

so that one call of MINPACK's Levenberg-Marquardt fits any model with analytic derivatives. Values
are real, or complex with complex c; rows of complex residuals are all real parts, then all
imaginary ones.

The densities y of a noise spectrum have all unknowns in one call instead (`fit_densities`), by
residuals whose squares are twice the loss of Whittle's log likelihood at the density S of a curve,

    r = sign(y - S) sqrt(2 (y/S - 1 - ln(y/S)))

so that the least sum of squares is the largest likelihood, and J^T J there is the information.

Source: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413; P. Whittle, Ark. Mat. 2 (1953)
423; P. McCullagh and J. Nelder, Generalized Linear Models, section 2.3 (deviance residuals).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.optimize import leastsq

from fitting.signal.residual_tests import Structure, residual_structure
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray

#: Relative gain of the squares, and step, at which the solver ends; evaluations at most.
TOLERANCE, FINEST, EVALUATIONS = 1e-10, 1e-14, 400
#: Share of a column that other columns lack, below which it is one of them.
COLLINEAR = 1e-11
#: Relative deviation of a density below which the logarithm of its loss is a series.
SMALL_LOSS = 1e-4
#: Condition of the scaled derivatives from which a direction is not determined.
UNDETERMINED = 1e-13
#: Share of the largest singular value below which a direction may be folded; first step along it.
FOLDED, SMALL = 0.1, 0.01

Array = FloatArray | ComplexArray


class Columns(NamedTuple):
    """Curves (n, k) that enter linearly, and their derivatives by x (q, n, k)."""

    values: Array
    slopes: Array


class Model(Protocol):
    """What can be fitted: columns as a function of the unknowns that do not enter linearly."""

    def columns(self, x: FloatArray) -> Columns:
        """Columns at x (q,), each unknown counted in units in which it is of order one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A model at its least sum of squares, or its largest likelihood.

    Attributes:
        x: unknowns that do not enter linearly, (q,).
        coefficients: those that do, (k,), real or complex.
        curve: fitted values, (n,).
        residuals: (rows,), over the noise as far as the likelihood states it.
        jacobian: their derivatives by x, then by the coefficients, of complex ones by real and
            imaginary part of each in turn, (rows, unknowns).
        converged: whether the solver ended by itself.
        message: how it ended.
        pull: weights of the rows of x that were fitted, too.
        folds: inverse to be taken in place of (J^T J)^-1, see `folded`.
    """

    x: FloatArray
    coefficients: Array
    curve: Array
    residuals: FloatArray
    jacobian: FloatArray
    converged: bool
    message: str
    pull: FloatArray | None = None
    folds: FloatArray | None = None

    @property
    def squares(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def unknowns(self) -> int:
        """Number of real unknowns."""
        return int(self.jacobian.shape[1])

    @property
    def dof(self) -> int:
        """Rows less unknowns, one at least."""
        return max(1, self.residuals.size - self.unknowns)

    @cached_property
    def structure(self) -> Structure:
        """What the order of the residuals shows of the noise."""
        is_complex = np.iscomplexobj(self.curve)
        return residual_structure(self.residuals, self.jacobian, quadratures=is_complex)

    @cached_property
    def inverse(self) -> FloatArray:
        """(J^T J)^-1 (unknowns, unknowns); infinite where the data do not determine a direction."""
        if self.folds is not None:
            return self.folds
        rows = self.jacobian
        if self.pull is not None:
            rows = np.concatenate(
                [rows, np.eye(self.pull.size, rows.shape[1]) * self.pull[:, None]]
            )
        with np.errstate(over="ignore"):
            sizes = np.linalg.norm(rows, axis=0)
        count = sizes.size
        if not (np.all(np.isfinite(sizes)) and np.all(sizes > 0.0)):
            return np.full((count, count), np.inf)
        _, singular, directions = np.linalg.svd(rows / sizes, full_matrices=False)
        if singular.size < count or singular[-1] <= UNDETERMINED * singular[0]:
            return np.full((count, count), np.inf)
        weighted = directions / singular[:, None]
        return np.asarray(weighted.T @ weighted / np.outer(sizes, sizes))


def fit_model(
    model: Model,
    values: Array,
    starts: Sequence[FloatArray],
    *,
    weights: FloatArray | None = None,
    pull: FloatArray | None = None,
    tries: int = 1,
) -> Fit:
    """Fit a model to values, from the best of several starts.

    Args:
        model: the curve.
        values: measured, shape (n,), real or complex, of order one.
        starts: where x may start, one at least, shape (q,) each.
        weights: one over the standard deviation of every value, shape (n,); None: all are alike.
        pull: weights of rows ``pull * x`` that count with the residuals, (q,); they are not among
            those of the result.
        tries: from how many starts the fit is made, those with the least sums of squares; the best
            minimum is taken.

    Raises:
        ValueError: fewer rows than unknowns, or a curve that is not finite.
    """
    problem = _Problem(model, values, weights, pull)
    if tries < len(starts):
        starts = sorted(starts, key=lambda x: problem.at(x).squares)[:tries]
    minima = [_minimum(problem.residuals, problem.slopes, start) for start in starts]
    x, converged, message = min(minima, key=lambda end: problem.at(end[0]).squares)
    return problem.fit(problem.at(x), converged=converged, message=message)


@dataclass(frozen=True, eq=False)
class _Point:
    """The model at one x: coefficients that are best there, and what they leave."""

    x: FloatArray
    columns: Columns
    basis: Array
    upper: Array
    coefficients: Array
    residuals: Array

    @property
    def squares(self) -> float:
        squares = float(np.sum(self.residuals.real**2 + self.residuals.imag**2))
        return squares if np.isfinite(squares) else np.inf


class _Problem:
    """Values and a model; the last point is stored, as a solver takes residuals, then slopes."""

    def __init__(
        self,
        model: Model,
        values: Array,
        weights: FloatArray | None,
        pull: FloatArray | None = None,
    ) -> None:
        self.model, self.weights, self.pull = model, weights, pull
        self.values = values if weights is None else np.asarray(values * weights)
        self.is_complex = np.iscomplexobj(values)
        self._last: _Point | None = None

    def at(self, x: FloatArray) -> _Point:
        if self._last is not None and np.array_equal(self._last.x, x):
            return self._last
        columns = self.model.columns(x)
        if self.weights is not None:
            columns = Columns(
                columns.values * self.weights[:, None], columns.slopes * self.weights[:, None]
            )
        basis, upper = np.linalg.qr(columns.values)
        diagonal = np.abs(np.diag(upper))
        # a column that others hold has no coefficient of its own
        upper[diagonal <= COLLINEAR * np.max(diagonal, initial=0.0), :] = 0.0
        known = np.diag(upper) != 0.0
        basis = basis * known
        upper = upper + np.diag(~known)
        along = basis.conj().T @ self.values
        point = _Point(
            x=np.array(x),
            columns=columns,
            basis=basis,
            upper=upper,
            coefficients=np.linalg.solve(upper, along),
            residuals=self.values - basis @ along,
        )
        self._last = point
        return point

    def rows(self, values: Array) -> FloatArray:
        """Real rows (m, ...) of values (n, ...)."""
        if not self.is_complex:
            return np.asarray(values.real)
        return np.concatenate([values.real, values.imag])

    def residuals(self, x: FloatArray) -> FloatArray:
        rows = self.rows(self.at(x).residuals)
        return rows if self.pull is None else np.concatenate([rows, self.pull * x])

    def slopes(self, x: FloatArray) -> FloatArray:
        point = self.at(x)
        moved = point.columns.slopes @ point.coefficients  # (q, n)
        apart = moved.T - point.basis @ (point.basis.conj().T @ moved.T)
        across = np.conj(point.columns.slopes).transpose(2, 0, 1) @ point.residuals  # (k, q)
        apart += point.basis @ np.linalg.solve(point.upper.conj().T, across)
        rows = -self.rows(apart)
        return rows if self.pull is None else np.concatenate([rows, np.diag(self.pull)])

    def jacobian(self, point: _Point) -> FloatArray:
        """Derivatives of the residuals by all unknowns."""
        moved = (point.columns.slopes @ point.coefficients).T
        linear = point.columns.values
        if self.is_complex:
            linear = np.stack([linear, 1j * linear], axis=2).reshape(linear.shape[0], -1)
        return -self.rows(np.concatenate([moved, linear], axis=1))

    def fit(self, point: _Point, *, converged: bool, message: str) -> Fit:
        curve = point.columns.values @ point.coefficients
        return Fit(
            x=point.x,
            coefficients=point.coefficients,
            curve=curve if self.weights is None else curve / self.weights,
            residuals=self.rows(point.residuals),
            jacobian=self.jacobian(point),
            pull=self.pull,
            converged=converged and bool(np.all(np.isfinite(point.residuals))),
            message=message,
        )


def _minimum(
    residuals: Callable[[FloatArray], FloatArray],
    slopes: Callable[[FloatArray], FloatArray],
    start: FloatArray,
) -> tuple[FloatArray, bool, str]:
    """The x of least squares near a start, whether the solver ended there by itself, and how."""
    if start.size == 0:
        return start, True, "nothing but linear unknowns"
    if residuals(start).size < start.size:
        raise ValueError("fewer values than unknowns")
    with np.errstate(all="ignore"):
        x, _, _, message, status = leastsq(
            residuals,
            start,
            Dfun=slopes,
            full_output=True,
            ftol=TOLERANCE,
            xtol=FINEST,
            gtol=0.0,
            maxfev=EVALUATIONS,
        )
    converged = status in (1, 2, 3, 4, 6, 7, 8) and np.all(np.isfinite(x))
    return np.asarray(x, dtype=float), bool(converged), " ".join(str(message).split())


def fit_densities(model: Model, densities: FloatArray, start: FloatArray) -> Fit:
    """The fit of largest likelihood near a start, to densities that are single periodograms.

    Those of an average of M have errors that are smaller by sqrt(M).

    Args:
        model: the curve.
        densities: measured, shape (n,), above zero.
        start: of all unknowns, the coefficients last, (q + k,).

    Raises:
        ValueError: fewer rows than unknowns.
    """
    count, tiny = start.size - model.columns(start).values.shape[1], np.finfo(float).tiny
    measured = np.maximum(densities, tiny)

    def curve(unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns = model.columns(unknowns[:count])
        moved = (columns.slopes @ unknowns[count:]).T
        slopes = np.concatenate([moved, columns.values], axis=1)
        return np.asarray(columns.values @ unknowns[count:]), np.asarray(slopes)

    def loss(unknowns: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """y/S - 1, the root of the loss, and where both are so small that it is a series."""
        off = measured / np.maximum(curve(unknowns)[0], tiny) - 1.0
        small = np.abs(off) < SMALL_LOSS
        safe = np.where(small, 1.0, off)
        series = off**2 * (0.5 - off / 3.0 + 0.25 * off**2)
        values = np.where(small, series, safe - np.log1p(safe))
        return off, np.sqrt(np.maximum(values, 0.0)), small

    def residuals(unknowns: FloatArray) -> FloatArray:
        off, size, _ = loss(unknowns)
        return np.asarray(math.sqrt(2.0) * np.sign(off) * size)

    def jacobian(unknowns: FloatArray) -> FloatArray:
        off, size, small = loss(unknowns)
        there, slopes = curve(unknowns)
        # d loss/dS = -off/S, of which half over the size stays finite where values meet the curve
        root = 0.5 * np.abs(off) / np.where(small, 1.0, size)
        share = np.where(small, np.sqrt(0.5) * (1.0 + off / 3.0), root)
        return (-math.sqrt(2.0) * share / np.maximum(there, tiny))[:, None] * slopes

    unknowns, converged, message = _minimum(residuals, jacobian, start)
    there, slopes = curve(unknowns)
    return Fit(
        x=unknowns[:count],
        coefficients=unknowns[count:],
        curve=there,
        residuals=residuals(unknowns),
        jacobian=-slopes / there[:, None],  # of the expected information
        converged=converged,
        message=message,
    )


def folded(model: Model, values: Array, fit: Fit, weights: FloatArray | None = None) -> Fit:
    """The fit with errors that hold where residuals are even along a direction.

    Two minima that lie mirrored merge where the truth is near the mirror: r(x + t v) = r + t^2 h/2,
    and the slope along v, a right singular vector of the jacobian with value s, vanishes though the
    data bound t. Where |h'| sigma > s^2, with h' the part of h that other unknowns do not make up
    for, h takes the place of the slope and t^2/2 that of t:

        |t| = sqrt(2 sigma/|h'|)

    Args:
        model: that was fitted.
        values: measured, (n,), real.
        fit: its minimum.
        weights: with which it was fitted, (n,).
    """
    count = fit.x.size
    whole = np.concatenate([fit.x, fit.coefficients])

    def residuals(unknowns: FloatArray) -> FloatArray:
        left = values - model.columns(unknowns[:count]).values @ unknowns[count:]
        return np.asarray(left if weights is None else weights * left)

    pull = np.zeros((0, whole.size))
    if fit.pull is not None:
        pull = np.eye(count, whole.size) * fit.pull[:, None]
    left, singular, rows = np.linalg.svd(np.concatenate([fit.jacobian, pull]), full_matrices=False)
    sigma = math.sqrt(fit.squares / fit.dof)
    columns, known, bends = left * singular, np.ones(singular.size, dtype=bool), []
    for k, along in enumerate(rows):
        if singular[k] > FOLDED * singular[0]:
            continue
        bend = np.concatenate([_bend(residuals, whole, fit, along, sigma), np.zeros(len(pull))])
        rest = np.delete(left, k, axis=1)
        own = float(np.linalg.norm(bend - rest @ (rest.T @ bend)))
        if own * sigma > singular[k] ** 2:
            columns[:, k], known[k] = bend, False
            bends.append(k)
    if not bends or np.linalg.matrix_rank(columns) < whole.size:
        return fit
    spread = np.linalg.pinv(columns.T @ columns)
    inverse = rows[known].T @ spread[np.ix_(known, known)] @ rows[known]
    for k in bends:  # spread is that of t^2/2 over sigma^2
        inverse = inverse + 2.0 * math.sqrt(spread[k, k]) / sigma * np.outer(rows[k], rows[k])
    return replace(fit, folds=inverse)


def _bend(
    residuals: Callable[[FloatArray], FloatArray],
    whole: FloatArray,
    fit: Fit,
    along: FloatArray,
    sigma: float,
) -> FloatArray:
    """Second derivative (m,) along a direction, over the step that the data allow."""
    step = SMALL
    for _ in range(2):
        ends = residuals(whole + step * along) + residuals(whole - step * along)
        bend = (ends - 2.0 * fit.residuals) / step**2
        size = float(np.linalg.norm(bend))
        step = float(np.clip(math.sqrt(2.0 * sigma / size), 0.01 * SMALL, 1.0)) if size else SMALL
    return np.asarray(bend)
