"""What may be wrong with a sweep of amplitudes that ought to be one damped line.

Four faults that a line fitted blindly turns into a wrong width, each as one more number:

    power       L = A |g|^k                 decibels of the wrong kind: k = 2 or 1/2
    saturation  L = A |g| (1 - s |g|^2)     a detector, or a resonator, that gives way at the top,
                L = A tanh(|g| t)/t         softly, or up to a limit
    clipping    the largest points are equal
    outlier     one point stands off the line of the others

and, by `fitting.signal.peaks.fit_resonance`, a complex background. A fault is told where its number
is far from none and what it leaves is noise; where nothing leaves noise, nothing is said: the sweep
may show more than one line. Two lines that overlap look like many a fault: where they fit as well,
that is told beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from scipy.special import fdtrc

from fitting.signal.least_squares import LeastSquaresFit, minimise_squares
from fitting.signal.peaks import MIN_SWEEP_POINTS, mode_response
from fitting.signal.residual_tests import STRUCTURED, residual_structure, white_noise_p
from fitting.text.arrays import ComplexArray, FloatArray

#: A fault is told where noise alone would look as bad less often than this.
TOLD_P = 1e-4
#: Equal largest points that noise does not make.
CLIPPED_POINTS = 3
#: Two lines are looked for so many widths apart; the second up to so many times as wide or narrow.
APART, LIKE = (-6.0, -2.0, -0.6, 0.6, 2.0, 6.0), 8.0
#: Relative fall of the squares below which a step of that search is the last one.
TELLING = 1e-9
#: Residuals below this share of the top are rounding: nothing can be wrong.
ROUNDING = 1e-6


class Fault(Enum):
    """What is wrong with a sweep."""

    POWER = "power"
    SATURATION = "saturation"
    CLIPPING = "clipping"
    OUTLIER = "outlier"
    BACKGROUND = "background"


@dataclass(frozen=True, kw_only=True)
class SweepFault:
    """One fault: its number with standard deviation, where it is, and what it does to the width.

    `size` is k of a power, the share that is missing at the top of a saturated line (of the law
    that fits best: another may fit as well with another size and width) or above the clipped
    points, the distance of an outlier over the top of the line, or that of a background.
    `width_hz` is the full width without and with the fault taken into account. `p_value` is the
    probability that noise alone gains as much. `two_lines` says whether two lines that overlap
    leave noise, too.
    """

    fault: Fault
    size: float
    std: float
    frequency_hz: float
    width_hz: tuple[float, float]
    p_value: float
    two_lines: bool = False


def sweep_faults(frequency_hz: FloatArray, amplitude_v: FloatArray) -> tuple[SweepFault, ...]:
    """The fault that explains a sweep which one damped line does not; none where none does.

    Several are told where each leaves noise and none is better by more than a factor of 1000 in
    probability.

    Args:
        frequency_hz: rising, shape (n,).
        amplitude_v: shape (n,), any unit.

    Source: N. Draper and H. Smith, Applied Regression Analysis, for the extra sum of squares and
    for the largest studentised residual with Bonferroni's bound.
    """
    top = float(np.max(amplitude_v, initial=0.0))
    if amplitude_v.size < MIN_SWEEP_POINTS + 3 or not top > 0.0:
        return ()
    sweep = _Sweep(frequency_hz, amplitude_v / top)
    plain = sweep.fitted(PLAIN)
    if plain is None:
        return ()
    clipped = sweep.clipping(plain)
    if clipped is not None:
        return (clipped,)
    if math.sqrt(plain.squares / amplitude_v.size) < ROUNDING:
        return ()
    found = [f for f in sweep.faults(plain) if f.p_value < TOLD_P]
    if not found:
        return ()
    best = min(f.p_value for f in found)
    as_good = max(1e3 * best, 1e-300)
    two_lines = sweep.two_lines_p(plain) < TOLD_P
    return tuple(replace(f, two_lines=two_lines) for f in found if f.p_value <= as_good)


def _equal(line: FloatArray, _: float) -> FloatArray:
    return np.ones(line.size)


@dataclass(frozen=True)
class _Form:
    """A line with a fault: its curve from g and x (more,), where x begins, its number from x.

    `noise` is what the fault makes of noise of one size, from the curve and the number.
    """

    fault: Fault
    curve: Callable[[ComplexArray, FloatArray], FloatArray]
    begin: tuple[float, ...]
    size: Callable[[FloatArray], float]
    noise: Callable[[FloatArray, float], FloatArray] = _equal


def _softly(g: ComplexArray, x: FloatArray) -> FloatArray:
    return np.asarray(np.abs(g) * (1.0 - x[0] * np.abs(g) ** 2))


def _up_to_a_limit(g: ComplexArray, x: FloatArray) -> FloatArray:
    return np.asarray(np.tanh(np.abs(g) * x[0]) / x[0])


def _exponent(x: FloatArray) -> float:
    return math.exp(min(float(x[0]), 5.0))


def _of_a_power(line: FloatArray, exponent: float) -> FloatArray:
    """d(a^k) = k a^(k - 1) da, over that at the top, where a^k is one."""
    return np.asarray(np.maximum(line, ROUNDING) ** (1.0 - 1.0 / exponent))


PLAIN = _Form(Fault.OUTLIER, lambda g, _: np.asarray(np.abs(g)), (), lambda _: 0.0)
FORMS = (
    _Form(
        Fault.POWER,
        lambda g, x: np.asarray(np.abs(g) ** _exponent(x)),
        (0.0,),
        _exponent,
        _of_a_power,
    ),
    # beyond 1/3 the curve has two tops: begun on the near side, where a detector begins
    _Form(Fault.SATURATION, _softly, (0.05,), lambda x: float(x[0])),
    _Form(Fault.SATURATION, _softly, (0.3,), lambda x: float(x[0])),
    _Form(
        Fault.SATURATION,
        _up_to_a_limit,
        (0.5,),
        lambda x: 1.0 - math.tanh(abs(float(x[0]))) / max(abs(float(x[0])), 1e-12),
    ),
    _Form(
        Fault.BACKGROUND,
        lambda g, x: np.asarray(np.abs(g + x[0] + 1j * x[1])),
        (0.01, 0.01),
        lambda x: float(np.hypot(x[0], x[1])),
    ),
)


@dataclass(frozen=True)
class _Line:
    """A form fitted to the sweep `shape`: eta, ln width and height first, over their guesses."""

    form: _Form
    shape: FloatArray
    fit: LeastSquaresFit
    eta_hz: float
    width_hz: float

    @property
    def squares(self) -> float:
        return float(self.fit.residuals @ self.fit.residuals)

    @property
    def is_noise(self) -> bool:
        """Whether what is left is white, as it is or over what the fault makes of equal noise."""
        left, line = self.fit.residuals, self.shape + self.fit.residuals
        alike = left / self.form.noise(line, self.size)
        return max(white_noise_p(left), white_noise_p(alike)) >= STRUCTURED

    @property
    def height(self) -> float:
        return abs(float(self.fit.values[2]))

    @property
    def size(self) -> float:
        return self.form.size(self.fit.values[3:])

    @property
    def std(self) -> float:
        """Standard deviation of the size, linearised."""
        x, spread = self.fit.values[3:], self.fit.covariance[3:, 3:]
        steps = 1e-6 * np.eye(x.size)
        slope = np.array([(self.form.size(x + h) - self.form.size(x - h)) / 2e-6 for h in steps])
        return math.sqrt(max(0.0, float(slope @ spread @ slope)))

    def at(self, frequency_hz: float) -> float:
        """What the line is there, over the top of the sweep."""
        g = mode_response(np.array([frequency_hz]), self.eta_hz, self.width_hz)
        return float(self.fit.values[2] * self.form.curve(g, self.fit.values[3:])[0])


class _Sweep:
    """The sweep over its top, and the line that is guessed from it."""

    def __init__(self, frequency_hz: FloatArray, shape: FloatArray) -> None:
        self.f, self.a = frequency_hz, shape
        high = frequency_hz[shape >= math.sqrt(0.5) * np.max(shape)]
        spacing = float(np.median(np.diff(frequency_hz)))
        self.eta_hz = float(0.5 * (high[0] + high[-1]))
        self.width_hz = max(float(high[-1] - high[0]), spacing)
        self.span_hz = float(np.ptp(frequency_hz))

    def fitted(self, form: _Form) -> _Line | None:
        """The line of a form; None where the sweep holds no such line."""

        def line(x: FloatArray) -> tuple[float, float]:
            width_hz = self.width_hz * math.exp(min(float(x[1]), 50.0))
            return float(self.eta_hz + self.width_hz * x[0]), width_hz

        def residuals(x: FloatArray) -> FloatArray:
            return np.asarray(x[2] * form.curve(mode_response(self.f, *line(x)), x[3:]) - self.a)

        try:
            fit = minimise_squares(residuals, np.array([0.0, 0.0, 1.0, *form.begin]))
        except (ValueError, np.linalg.LinAlgError):
            return None
        eta_hz, width_hz = line(fit.values)
        inside = self.f[0] <= eta_hz <= self.f[-1] and width_hz < 3.0 * self.span_hz
        return _Line(form, self.a, fit, eta_hz, width_hz) if fit.converged and inside else None

    def two_lines_p(self, plain: _Line) -> float:
        """Probability that noise gains as much as a second line does; one where it leaves more."""
        begins = [self._two_lines(plain, apart) for apart in APART]
        left = [fit for fit in begins if fit is not None]
        if not left:
            return 1.0
        best = min(left, key=lambda fit: float(fit.residuals @ fit.residuals))
        if white_noise_p(best.residuals) < STRUCTURED:
            return 1.0
        after = float(best.residuals @ best.residuals)
        return _gain_p(plain.squares, after, 4, self.a.size - 7)

    def _two_lines(self, plain: _Line, apart: float) -> LeastSquaresFit | None:
        """|h g1 + (a + i b) g2| fitted from a second line so many widths beside the first."""
        eta, width = plain.eta_hz, plain.width_hz

        def second(x: FloatArray) -> ComplexArray:
            wide = width * math.exp(math.log(LIKE) * math.tanh(float(x[4])))
            return mode_response(self.f, float(eta + width * x[3]), wide)

        def residuals(x: FloatArray) -> FloatArray:
            wide = width * math.exp(min(float(x[1]), 50.0))
            first = mode_response(self.f, float(eta + width * x[0]), wide)
            return np.asarray(np.abs(x[2] * first + (x[5] + 1j * x[6]) * second(x)) - self.a)

        begin = np.array([0.0, 0.0, plain.height, apart, 0.0, 0.1, 0.1])
        try:
            # how much it gains is compared with what chance gains: more digits of it tell nothing
            fit = minimise_squares(residuals, begin, gain=TELLING)
        except (ValueError, np.linalg.LinAlgError):
            return None
        beside_hz = eta + width * fit.values[3]
        near = self.f[0] - self.span_hz <= beside_hz <= self.f[-1] + self.span_hz
        return fit if near else None

    def without(self, k: int) -> _Sweep:
        """The sweep without one point."""
        return _Sweep(np.delete(self.f, k), np.delete(self.a, k))

    def faults(self, plain: _Line) -> list[SweepFault]:
        """Every fault that leaves noise; of two forms of one fault the better one."""
        lines = [line for form in FORMS if (line := self.fitted(form)) is not None]
        best: dict[Fault, _Line] = {}
        for line in sorted(lines, key=lambda each: -each.squares):
            # a top that is too high is no saturation, and what is no larger than its error nothing
            if line.is_noise and line.size > line.std:
                best[line.form.fault] = line
        told = [self._told(plain, line) for line in best.values()]
        outlier = self._outlier(plain)
        return told if outlier is None else [*told, outlier]

    def _told(self, plain: _Line, line: _Line) -> SweepFault:
        more = len(line.form.begin)
        return SweepFault(
            fault=line.form.fault,
            size=line.size,
            std=line.std,
            frequency_hz=math.nan,
            width_hz=(plain.width_hz, line.width_hz),
            p_value=_gain_p(plain.squares, line.squares, more, self.a.size - 3 - more),
        )

    def _outlier(self, plain: _Line) -> SweepFault | None:
        """The point whose absence leaves least, if what it leaves is noise of one size.

        Where noise grows with the amplitude some point stands off by chance.
        """
        farthest = [int(k) for k in np.argsort(-np.abs(plain.fit.residuals))[:3]]
        lines = [(k, self.without(k).fitted(PLAIN)) for k in farthest]
        left = [(k, line) for k, line in lines if line is not None and line.is_noise]
        if not left:
            return None
        k, line = min(left, key=lambda each: each[1].squares)
        if residual_structure(line.fit.residuals, line.fit.jacobian).is_unequal:
            return None
        freedom = self.a.size - 4
        at = float(self.f[k])
        return SweepFault(
            fault=Fault.OUTLIER,
            size=(float(self.a[k]) - line.at(at)) / line.height,
            std=math.sqrt(line.squares / freedom) / line.height,
            frequency_hz=at,
            width_hz=(plain.width_hz, line.width_hz),
            p_value=min(1.0, self.a.size * _gain_p(plain.squares, line.squares, 1, freedom)),
        )

    def clipping(self, plain: _Line) -> SweepFault | None:
        """Equal largest points, and the line of the others."""
        flat = self.a >= float(np.max(self.a)) * (1.0 - 1e-12)
        count = int(np.sum(flat))
        if count < CLIPPED_POINTS or self.a.size - count < MIN_SWEEP_POINTS:
            return None
        line = _Sweep(self.f[~flat], self.a[~flat]).fitted(PLAIN)
        if line is None or line.height <= 1.0:
            return None
        return SweepFault(
            fault=Fault.CLIPPING,
            size=1.0 - 1.0 / line.height,
            std=math.sqrt(float(line.fit.covariance[2, 2])) / line.height**2,
            frequency_hz=float(np.mean(self.f[flat])),
            width_hz=(plain.width_hz, line.width_hz),
            p_value=0.0,
        )


def _gain_p(before: float, after: float, more: int, freedom: int) -> float:
    """Probability that noise alone lets `more` numbers lower a sum of squares so far (F-test)."""
    if not after > 0.0:
        return 0.0
    return float(fdtrc(more, freedom, max(0.0, (before - after) / more * freedom / after)))
