"""Algorithm 1: the factor chi between simulated and measured amplitudes, and how far to trust it.

Near a resonance 1/A(f)^2 is a polynomial of degree four for one damped mode, and all but one for a
mode among others: interpolating *that* instead of A itself finds the maximum between grid points
to far better than the spacing suggests, and comparing two orders gives the error that is left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

#: Points used by the fine interpolation (degree four) and by the coarse one (degree two).
FINE_POINTS = 5
COARSE_POINTS = 3
#: Points above this share of the largest one count as the top of a measured resonance.
TOP_SHARE = 0.7


@dataclass(frozen=True)
class Maximum:
    """Maximum of a resonance curve; `bias` is the relative error left by the grid.

    `bracketed` is False where the largest point is the first or the last one: the curve may rise
    beyond the grid, `value` is then that point and `bias` infinite.
    """

    value: float
    frequency_hz: float
    bias: float
    bracketed: bool


@dataclass(frozen=True)
class LaboratoryMaximum:
    """Maximum of a measured sweep, as it stands and by a fit of its top.

    `value_v` is the largest point (Algorithm 1 as written); `fitted_v` the top of a parabola
    through 1/A^2 of the points above 70 % of it; `scatter` the relative standard deviation of
    those points about the parabola; `bias` = value/fitted - 1, what noise (positive) and grid
    (negative) did to the largest point; `bias_std` the statistical error of `bias`.
    """

    value_v: float
    frequency_hz: float
    fitted_v: float
    scatter: float
    bias: float
    bias_std: float


def refine_maximum(frequency_hz: FloatArray, amplitude: FloatArray) -> Maximum:
    """Maximum of a noise-free resonance curve between its grid points.

    With t = (f - f_k)/h about the largest point k, y(t) = 1/A^2 is interpolated by the polynomial
    of degree four through the five points nearest to k; the minimum of y gives the maximum of A.
    The bias bound is the distance to the same from degree two through three points; with fewer
    than five points in all, at least the fall to the lower neighbour.

    Args:
        frequency_hz: increasing, shape (n,), n >= 3.
        amplitude: positive, shape (n,), any unit.

    Raises:
        ValueError: fewer than three points, or an amplitude that is not positive and finite.

    Source: the paper's Algorithm 1, line 6, with the maximum freed from its grid.
    """
    f = np.asarray(frequency_hz, dtype=float)
    a = np.asarray(amplitude, dtype=float)
    if f.size < COARSE_POINTS or f.shape != a.shape:
        raise ValueError(f"a maximum needs {COARSE_POINTS} points or more, got {f.size}")
    if not (np.all(np.isfinite(a)) and np.all(a > 0)):
        raise ValueError("the sweep holds an amplitude that is not positive and finite")
    k = int(np.argmax(a))
    if k in (0, f.size - 1):
        return Maximum(float(a[k]), float(f[k]), float("inf"), bracketed=False)
    t_coarse, y_coarse = _lowest(f, a, k, COARSE_POINTS, 0.0)
    t_fine, y_fine = _lowest(f, a, k, min(FINE_POINTS, f.size), t_coarse)
    h = 0.5 * (f[k + 1] - f[k - 1])
    bias = abs(float(np.sqrt(y_fine / y_coarse)) - 1.0)
    if f.size < FINE_POINTS:  # two fits through so few points can agree by symmetry alone
        bias = max(bias, float(a[k] / min(a[k - 1], a[k + 1])) - 1.0)
    return Maximum(float(a[k] / np.sqrt(y_fine)), float(f[k] + h * t_fine), bias, bracketed=True)


def _lowest(f: FloatArray, a: FloatArray, k: int, points: int, guess: float) -> tuple[float, float]:
    """Minimum (t, y) of the polynomial through (a_k/a)^2 at `points` points about k."""
    low = min(max(k - points // 2, 0), f.size - points)
    window = slice(low, low + points)
    t = (f[window] - f[k]) / (0.5 * (f[k + 1] - f[k - 1]))
    matrix = np.vander(t, increasing=True)
    coefficients = np.linalg.solve(matrix, (a[k] / a[window]) ** 2).tolist()
    best = guess
    for _ in range(20):  # Newton: the start is the parabola's own vertex, four rounds are usual
        _, slope, bend = _taylor(coefficients, best)
        if bend <= 0.0:  # no minimum nearby: the grid point itself is the better answer
            return 0.0, 1.0
        move = slope / bend
        best = min(max(best - move, float(t[0])), float(t[-1]))
        if abs(move) < 1e-14:
            break
    return best, max(_taylor(coefficients, best)[0], np.finfo(float).tiny)


def _taylor(coefficients: list[float], t: float) -> tuple[float, float, float]:
    """Value, slope and second derivative of a polynomial (lowest power first), by Horner."""
    value = slope = bend = 0.0
    for c in reversed(coefficients):
        bend = bend * t + 2.0 * slope
        slope = slope * t + value
        value = value * t + c
    return value, slope, bend


def laboratory_maximum(frequency_hz: FloatArray, amplitude_v: FloatArray) -> LaboratoryMaximum:
    """Largest point of a measured sweep, with what noise and grid did to it.

    A parabola in (f - f_k) is fitted to 1/A^2 of the points above 70 % of the largest, weighted by
    A^3 (equal errors of A); needs four such points, else value and fit are the same and the
    scatter is zero.

    Args:
        frequency_hz: shape (n,).
        amplitude_v: V peak, shape (n,).

    Raises:
        ValueError: an empty sweep.

    Source: the paper's Algorithm 1, line 6, numerator.
    """
    f = np.asarray(frequency_hz, dtype=float)
    a = np.asarray(amplitude_v, dtype=float)
    if f.size == 0:
        raise ValueError("the sweep has no points")
    k = int(np.argmax(a))
    top = a >= TOP_SHARE * a[k]
    plain = LaboratoryMaximum(float(a[k]), float(f[k]), float(a[k]), 0.0, 0.0, 0.0)
    if np.count_nonzero(top) < 4:
        return plain
    t = (f[top] - f[k]) / max(float(np.ptp(f[top])), np.finfo(float).tiny)
    relative = a[top] / a[k]
    polynomial = np.polynomial.Polynomial.fit(t, relative**-2.0, 2, w=relative**3)
    curve = np.asarray(polynomial(t))
    c0, c1, c2 = map(float, polynomial.convert().coef)
    lowest = c0 - c1 * c1 / (4 * c2) if c2 > 0 else 0.0
    if lowest <= 0.0 or np.any(curve <= 0.0):
        return plain
    residuals = relative - curve**-0.5
    scatter = float(np.sqrt(np.sum(residuals**2) / (relative.size - 3)))
    fitted = float(a[k] / np.sqrt(lowest))
    # a parabola through n points knows its top to about 1.5 scatter/sqrt(n)
    error = 1.5 * scatter / float(np.sqrt(relative.size))
    return LaboratoryMaximum(
        float(a[k]), float(f[k]), fitted, scatter, float(a[k]) / fitted - 1.0, error
    )


def chi_of_maxima(laboratory_v: float, simulated: float) -> float:
    """Algorithm 1: chi = max(laboratory FRF)/max(simulated FRF), V per unit of the simulation.

    Raises:
        ValueError: a maximum that is not positive and finite.

    Source: the paper's Algorithm 1, line 6.
    """
    if not (np.isfinite(simulated) and simulated > 0 and np.isfinite(laboratory_v)):
        raise ValueError(f"maxima {laboratory_v:g} (laboratory) and {simulated:g} give no scale")
    return laboratory_v / simulated


def chi_of_sweep(laboratory_v: FloatArray, simulated: FloatArray) -> float:
    """Scale chi = sum(L S)/sum(S^2), the least-squares scale of a whole sweep, both of shape (n,).

    Not biased by the noise of the largest point; wants the simulation at the measured frequencies.

    Raises:
        ValueError: shapes that differ, or a simulation that is zero everywhere.
    """
    if laboratory_v.shape != simulated.shape:
        raise ValueError(f"sweeps of {laboratory_v.size} and {simulated.size} points")
    norm = float(np.dot(simulated, simulated))
    if not norm > 0.0:
        raise ValueError("the simulated sweep is zero everywhere and gives no scale")
    return float(np.dot(laboratory_v, simulated)) / norm


def nodes_around(frequency_hz: float, spacing_hz: float, points: int = FINE_POINTS) -> FloatArray:
    """`points` equidistant frequencies centred on one, shape (points,), Hz."""
    offsets = np.arange(points) - 0.5 * (points - 1)
    return np.asarray(frequency_hz + spacing_hz * offsets, dtype=float)


def half_power_width(frequency_hz: FloatArray, amplitude: FloatArray) -> float:
    """Rough full width where A^2 is half its maximum, Hz: the span of the points above it.

    Never below the grid's median spacing; only used to place simulation points.
    """
    above = amplitude >= float(np.max(amplitude)) / np.sqrt(2.0)
    spacing = float(np.median(np.diff(frequency_hz)))
    return max(float(np.ptp(frequency_hz[above])), spacing)
