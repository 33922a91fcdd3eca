"""Algorithm 1: the factor chi between simulated and measured amplitudes, and how far to trust it.

Near a resonance 1/A(f)^2 is a polynomial of degree four for one damped mode, and all but one for a
mode among others: interpolating *that* instead of A itself finds the maximum between grid points
to far better than the spacing suggests, and comparing two orders gives the error that is left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.signal.student import widening95
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import NoScale

SCALES = ("maximum", "grid", "fit", "robust", "free", "none")
#: Points used by the fine interpolation (degree four) and by the coarse one (degree two).
FINE_POINTS = 5
COARSE_POINTS = 3
#: Two orders may agree by chance: the cubics through four of the five points count as well,
#: and as close as they are to the quartic they count this many times.
CHANCE = 5.0
#: Points above this share of the largest one count as the top of a measured resonance.
TOP_SHARE = 0.7
#: Points of that top, at least, an odd number; as many at a time next to it show the noise, too.
FEWEST = 5
#: Share of the largest point below which a point is too faint to show it.
FAINT = 0.15
#: Curvature of 1/A^2 over the fitted points that is rounding: such a parabola has its top anywhere.
FLAT = 1e-12
#: Smallest double with all its digits.
TINY = float(np.finfo(float).tiny)
#: A bias of the largest point counts from this share on, and from two standard errors.
LEAST_BIAS = 1e-3


@dataclass(frozen=True, kw_only=True)
class Maximum:
    """Maximum of a resonance curve; `bias` is the relative error left by the grid.

    `bracketed` is False where the largest point is the first or the last one: the curve may rise
    beyond the grid, `value` is then that point and `bias` infinite.
    """

    value: float
    frequency_hz: float
    bias: float
    bracketed: bool


@dataclass(frozen=True, kw_only=True)
class LaboratoryMaximum:
    """Maximum of a measured sweep, as it stands and by a fit of its top.

    `value_v` is the largest point (Algorithm 1 as written); `fitted_v` the top of a parabola
    through 1/A^2 of the points above 70 % of it; `scatter` the relative standard deviation of
    those points about the parabola; `noise` that of any point of the sweep, from `freedom` degrees
    of freedom: `scatter`, or more where the points next to the top scatter more; `bias` =
    value/fitted - 1, what noise (positive) and grid (negative) did to the largest point; `bias_std`
    the statistical error of `bias`. Where no top can be fitted `fitted_v` and `bias` are NaN.
    `fall` is the drop to the lower neighbour, as a share; `on_edge`: the largest point is the first
    or the last one.
    """

    value_v: float
    frequency_hz: float
    fitted_v: float
    scatter: float
    bias: float
    bias_std: float
    noise: float = 0.0
    freedom: float = math.inf
    fall: float = 0.0
    on_edge: bool = False

    @property
    def is_biased(self) -> bool:
        """Whether the largest point is further from the fitted top than noise explains."""
        return bool(abs(self.bias) > max(2.0 * self.bias_std, LEAST_BIAS))

    @property
    def sigma(self) -> float:
        """Relative error of the largest point as a maximum: noise, and a bias beyond it.

        Its 1.96 standard deviations reach as far as Student's t does.
        """
        if np.isnan(self.bias):
            return self.fall
        return float(np.hypot(self.spread, self.bias if self.is_biased else 0.0))

    @property
    def spread(self) -> float:
        """Relative noise of any point; its 1.96 standard deviations reach as far as Student's t."""
        return self.noise * widening95(self.freedom)


def refine_maximum(
    frequency_hz: FloatArray, amplitude: FloatArray, bend: float | None = None
) -> Maximum:
    """Maximum of a noise-free resonance curve between its grid points.

    With t = (f - f_k)/h about the largest point k, y(t) = 1/A^2 is interpolated by the polynomial
    of degree four through the five points nearest to k; the minimum of y gives the maximum of A.
    The bias bound is the distance to the same from degree two through three points, and at least
    five times that from either cubic through four of them; with fewer than five points in all, at
    least the fall to the lower neighbour.

    With `bend`, a bound of |y3|/y2 in 1/Hz (third over second derivative of y), three points do:
    the remainder of their parabola at its vertex is at most bend y2/6 |(f - f_1)(f - f_2)(f - f_3)|
    (Cauchy), and the relative bias of the maximum half of that over y at the vertex.

    Args:
        frequency_hz: increasing, shape (n,), n >= 3.
        amplitude: positive, shape (n,), any unit.
        bend: bound of |y3|/y2 around the maximum in 1/Hz, None where it is not known.

    Raises:
        ValueError: fewer than three points.
        NoScale: an amplitude that is not positive and finite, or too small for all its digits.

    Source: the paper's Algorithm 1, line 6, with the maximum freed from its grid.
    """
    f = np.asarray(frequency_hz, dtype=float)
    a = np.asarray(amplitude, dtype=float)
    if f.size < COARSE_POINTS or f.shape != a.shape:
        raise ValueError(f"a maximum needs {COARSE_POINTS} points or more, got {f.size}")
    good = np.isfinite(a) & (a >= TINY)
    if not np.all(good):
        raise NoScale(
            f"the simulated sweep has an amplitude of {a[~good][0]:.3g} at {f[~good][0]:.9g} Hz, "
            "wanted positive and finite ones (does the drive reach the observed output?)"
        )
    k = int(np.argmax(a))
    if k in (0, f.size - 1):
        return Maximum(value=float(a[k]), frequency_hz=float(f[k]), bias=math.inf, bracketed=False)
    if f.size == COARSE_POINTS and bend is not None:
        return _of_three(f, a, bend)
    try:
        return _of_many(f, a, k)
    except np.linalg.LinAlgError:  # two points are one but for rounding: nothing is known between
        return Maximum(value=float(a[k]), frequency_hz=float(f[k]), bias=math.inf, bracketed=True)


def _of_many(f: FloatArray, a: FloatArray, k: int) -> Maximum:
    """Maximum about the largest of several points, with the bias that two orders show."""
    t_coarse, y_coarse = _lowest(f, a, k, COARSE_POINTS, 0.0)
    t_fine, y_fine = _lowest(f, a, k, min(FINE_POINTS, f.size), t_coarse)
    h = 0.5 * (f[k + 1] - f[k - 1])
    bias = abs(float(np.sqrt(y_fine / y_coarse)) - 1.0)
    if f.size >= FINE_POINTS:  # the two cubics that leave out an end of the five points
        low = min(max(k - FINE_POINTS // 2, 0), f.size - FINE_POINTS)
        for first in (low, low + 1):
            _, y = _lowest(f, a, k, FINE_POINTS - 1, t_coarse, first)
            bias = max(bias, CHANCE * abs(float(np.sqrt(y_fine / y)) - 1.0))
    else:  # two fits through so few points can agree by symmetry alone
        bias = max(bias, float(a[k] / min(a[k - 1], a[k + 1])) - 1.0)
    return Maximum(
        value=float(a[k] / np.sqrt(y_fine)),
        frequency_hz=float(f[k] + h * t_fine),
        bias=bias,
        bracketed=True,
    )


def _of_three(f: FloatArray, a: FloatArray, bend: float) -> Maximum:
    """Maximum between three points, the middle one the largest, with the remainder's bound."""
    t, y = f - f[1], (a[1] / a) ** 2
    rise, fall = (y[2] - y[1]) / t[2], (y[0] - y[1]) / t[0]
    half_bend = (rise - fall) / (t[2] - t[0])
    slope = rise - half_bend * t[2]
    at = float(-0.5 * slope / half_bend)
    least = float(max(1.0 + 0.5 * slope * at, np.finfo(float).tiny))
    remainder = bend * 2.0 * half_bend / 6.0 * abs(float(np.prod(at - t)))
    bias = 0.5 * float(remainder) / least
    return Maximum(
        value=float(a[1] / np.sqrt(least)), frequency_hz=float(f[1] + at), bias=bias, bracketed=True
    )


def bend_of(frequency_hz: FloatArray, amplitude: FloatArray) -> tuple[float, FloatArray]:
    """Largest |y3|/y2 (1/Hz) of y = (a_max/A)^2 among five points, and its quartic there.

    y2, the second derivative, at the least point, y3, the third, over all; coefficients (5,) in
    (f - f_3), lowest power first; infinite where y has no minimum, or where the response is zero.
    Both arguments have shape (5,).

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude: amplitudes (n,), V peak.
    """
    if not np.all(amplitude > 0.0):
        return math.inf, np.zeros(5)
    t = frequency_hz - frequency_hz[2]
    scale = float(t[-1])
    y = (float(np.max(amplitude)) / amplitude) ** 2
    c = np.linalg.solve(np.vander(t / scale, increasing=True), y)
    c = np.asarray(c / scale ** np.arange(5), dtype=np.float64)
    polynomial = np.polynomial.Polynomial(c)
    second = float(polynomial.deriv(2)(t[int(np.argmin(y))]))
    third = float(np.max(np.abs(polynomial.deriv(3)(t))))
    return (third / second if second > 0.0 else math.inf), np.asarray(c, dtype=np.float64)


def _lowest(
    f: FloatArray, a: FloatArray, k: int, points: int, guess: float, first: int | None = None
) -> tuple[float, float]:
    """Minimum (t, y) of the polynomial through (a_k/a)^2 at points about k, or from `first` on."""
    low = min(max(k - points // 2, 0), f.size - points) if first is None else first
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
    A^3 (equal errors of A). Where these are fewer than five, it is fitted to the five nearest:
    through three it would show no scatter.

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
    on_edge = k in (0, f.size - 1)
    fall = 1.0 - float(np.min(a[max(0, k - 1) : k + 2]) / a[k]) if a[k] > 0.0 else 0.0
    plain = LaboratoryMaximum(
        value_v=float(a[k]),
        frequency_hz=float(f[k]),
        fitted_v=math.nan,
        scatter=0.0,
        bias=math.nan,
        bias_std=0.0,
        fall=fall,
        on_edge=on_edge,
    )
    top = a >= TOP_SHARE * a[k]
    if np.count_nonzero(top) < FEWEST:
        half = FEWEST // 2
        top = np.abs(np.arange(f.size) - min(max(k, half), f.size - 1 - half)) <= half
    if np.count_nonzero(top) < 3 or not np.all(a[top] > 0.0):
        return plain
    relative = a / a[k]
    parabola = _parabola(f[top] - f[k], relative[top])
    if parabola is None:
        return plain
    lowest, residuals = parabola
    freedom = max(residuals.size - 3, 1)
    scatter = float(np.sqrt(np.sum(residuals**2) / freedom))
    noise, freedom = _noise(f, relative, top, scatter)
    fitted = float(a[k] / np.sqrt(lowest))
    # a parabola through n points knows its top to about 1.5 noise/sqrt(n)
    error = 1.5 * noise / float(np.sqrt(residuals.size))
    return LaboratoryMaximum(
        value_v=float(a[k]),
        frequency_hz=float(f[k]),
        fitted_v=fitted,
        scatter=scatter,
        bias=float(a[k]) / fitted - 1.0,
        bias_std=error,
        noise=noise,
        freedom=float(freedom),
        fall=fall,
        on_edge=on_edge,
    )


def _parabola(t: FloatArray, relative: FloatArray) -> tuple[float, FloatArray] | None:
    """Least 1/A^2 of a parabola through it, equal errors of A, and what is left of A, (n,).

    None where it has no minimum above zero, or leaves the positive numbers at one of the points.
    """
    t = t / max(float(np.ptp(t)), TINY)
    c2, c1, c0 = (float(c) for c in np.polyfit(t, relative**-2.0, 2, w=relative**3))
    lowest = c0 - c1 * c1 / (4 * c2) if c2 > FLAT else 0.0
    curve = c0 + t * (c1 + t * c2)
    if lowest <= 0.0 or not np.all(curve > 0.0):
        return None
    return lowest, np.asarray(relative - curve**-0.5)


def _noise(
    f: FloatArray, relative: FloatArray, top: BoolArray, scatter: float
) -> tuple[float, int]:
    """Noise of a point relative to the largest one, and its degrees of freedom.

    Few points of a top scatter little now and then. So do the next ones, five at a time:
    of a resonance their 1/A^2 is a parabola, too. Their median is not moved by another line. The
    top's own scatter stands where it is more: noise may grow with the amplitude.
    """
    inside = np.flatnonzero(top)
    own = max(inside.size - 3, 1)
    starts = [
        *range(inside[0] - FEWEST, -1, -FEWEST),
        *range(inside[-1] + 1, relative.size - FEWEST + 1, FEWEST),
    ]
    squares = []
    for window in (slice(low, low + FEWEST) for low in starts):
        parabola = None
        if np.all(relative[window] >= FAINT):
            parabola = _parabola(f[window] - f[window].mean(), relative[window])
        if parabola is not None:
            squares.append(float(np.sum(parabola[1] ** 2)) / (FEWEST - 3))
    others = len(squares)
    if not squares:
        return scatter, own
    # squares of two degrees of freedom have a median of ln 2 of their mean, that of half as many
    median = float(np.median(squares)) / math.log(2.0)
    both = math.sqrt((own * scatter**2 + others * median) / (own + others))
    return max(scatter, both), own + others


def chi_of_maxima(laboratory_v: float, simulated: float) -> float:
    """Algorithm 1: chi = max(laboratory FRF)/max(simulated FRF), V per unit of the simulation.

    Args:
        laboratory_v: measured maximum, V peak.
        simulated: simulated maximum, in model units.

    Raises:
        NoScale: maxima without a ratio that is positive and finite, with all its digits.

    Source: the paper's Algorithm 1, line 6.
    """
    with np.errstate(all="ignore"):
        chi = float(np.divide(laboratory_v, simulated))
    if not (np.isfinite(chi) and chi >= TINY):
        raise NoScale(
            f"maxima {laboratory_v:g} (laboratory) and {simulated:g} (simulated) give no scale, "
            "wanted a ratio within the range of numbers (is a level or a unit wrong?)"
        )
    return chi


def chi_of_sweep(laboratory_v: FloatArray, simulated: FloatArray) -> float:
    """Scale chi = sum(L S)/sum(S^2), the least-squares scale of a whole sweep, both of shape (n,).

    Not biased by the noise of the largest point; wants the simulation at the measured frequencies.
    Each sweep counts relative to its largest point, so that no square leaves the range of numbers.

    Args:
        laboratory_v: measured amplitudes (n,), V peak.
        simulated: simulated amplitudes (n,), in model units.

    Raises:
        ValueError: shapes that differ.
        NoScale: a simulation that is zero everywhere, or a scale that no double holds.
    """
    return _scaled(laboratory_v, simulated)[0]


def _scaled(
    laboratory_v: FloatArray, simulated: FloatArray
) -> tuple[float, float, FloatArray, FloatArray]:
    """The least-squares scale, its slope of both sweeps over their largest points, and these."""
    if laboratory_v.shape != simulated.shape:
        raise ValueError(f"sweeps of {laboratory_v.size} and {simulated.size} points")
    largest, height = float(np.max(laboratory_v)), float(np.max(simulated))
    if not height >= TINY:
        raise NoScale(
            "the simulated sweep is zero everywhere and gives no scale, wanted a drive that "
            "reaches the observed output"
        )
    measured, shape = laboratory_v / largest, simulated / height
    slope = float(np.dot(measured, shape) / np.dot(shape, shape))
    return chi_of_maxima(largest, height) * slope, slope, measured, shape


def chi_robust(laboratory_v: FloatArray, simulated: FloatArray) -> float:
    """Scale of a whole sweep by Huber's estimate, both of shape (n,).

    chi minimises sum rho((L - chi S)/s), rho quadratic within 1.345 s and linear beyond, s the
    median absolute residual over 0.6745: single bad points (a burst, a spurious line, a jump of the
    sample) do not carry it away.

    Args:
        laboratory_v: measured amplitudes (n,), V peak.
        simulated: simulated amplitudes (n,), in model units.

    Raises:
        ValueError: shapes that differ.
        NoScale: as `chi_of_sweep`.

    Source: P. Huber, Robust Statistics (1981), section 7.
    """
    chi, plain, measured, shape = _scaled(laboratory_v, simulated)
    slope = plain
    for _ in range(200):
        left = np.abs(measured - slope * shape)
        spread = float(np.median(left)) / 0.6745
        if spread <= 1e-14:  # an exact fit of half the points is the answer
            break
        weight = np.minimum(1.0, 1.345 * spread / np.maximum(left, np.finfo(float).tiny))
        moved = float(np.dot(weight * measured, shape) / np.dot(weight * shape, shape))
        done = abs(moved - slope) <= 1e-13 * abs(slope)
        slope = moved
        if done:
            break
    return chi * slope / plain


def nodes_around(frequency_hz: float, spacing_hz: float, points: int = FINE_POINTS) -> FloatArray:
    """`points` equidistant frequencies centred on one, shape (points,), Hz.

    Args:
        frequency_hz: frequency, Hz.
        spacing_hz: of the nodes, Hz.
        points: number of nodes.
    """
    offsets = np.arange(points) - 0.5 * (points - 1)
    return np.asarray(frequency_hz + spacing_hz * offsets, dtype=float)


def half_power_width(frequency_hz: FloatArray, amplitude: FloatArray) -> float:
    """Rough full width where A^2 is half its maximum, Hz: the span of the points above it.

    Never below the grid's median spacing; only used to place simulation points.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude: amplitudes (n,), V peak.
    """
    above = amplitude >= float(np.max(amplitude)) / np.sqrt(2.0)
    spacing = float(np.median(np.diff(frequency_hz)))
    return max(float(np.ptp(frequency_hz[above])), spacing)
