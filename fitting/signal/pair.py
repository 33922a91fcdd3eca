"""Two lines in one sweep, however near to each other: places, widths, heights, with errors.

    S(f) = h1 g1(f) + h2 g2(f) + b        complex values, by `fitting.signal.lines_together`
    R(f) = |h1 g1(f) + h2 g2(f)|          amplitudes, h1 real

g of `fitting.signal.peaks.mode_response`. The heights are complex: two modes of the same output are
in phase only where each is a normal mode that real damping does not couple. Amplitudes are fitted
from several begins, as a top of two lines has many shapes: of two lines beside each other about the
middle of the top, and of a narrow one in a wide one.

Another form of line that is no special case of the pair is held against it by the extra sum of
squares as one that is,

    P = points P(F > ((S - S2)/(k2 - k)) ((m - k2)/w^2)/S2)

with S and k squares and unknowns of that form, k2 - k one at least, w the widening for residuals of
the pair, and all `points` at which noise may look like a second line (Bonferroni).

A line that bends with its amplitude, as a nonlinear resonator's does, looks like a pair, too: it is
one of the forms that are held against it (`bent_line`),

    s (1 + (2 (f - f0 - b s)/w)^2) = 1        |S|^2 = h^2 s

as long as it does not jump.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares); L. Landau and
E. Lifshitz, Mechanics, section 29, for the bent line.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from fitting.signal.least_squares import LeastSquaresFit, minimise_squares
from fitting.signal.line_record import CurveFit
from fitting.signal.lines_together import lines_together
from fitting.signal.peaks import mode_response
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, residual_structure
from fitting.text.arrays import ComplexArray, FloatArray, both_parts

#: Fewer points do not tell two lines from one and noise.
LEAST_POINTS = 12
#: Distances of the lines from the middle of the top, and widths, over its width, at the begin; and
#: the phases of the upper one against the lower one, rad, half a turn for a gap between them.
BEGINS = ((-0.35, 0.35, 0.7, 0.7), (-0.15, 0.35, 0.6, 0.9), (-0.35, 0.15, 0.9, 0.6), (0, 0, 0.3, 1))
TURNS = (0.4, 2.7)
#: Evaluations for each begin, and for the best one.
ROUNDS, ROUNDS_OF_BEST = 25, 200
GAIN, GAIN_OF_BEST = 1e-6, 1e-12
#: Least height of a line that counts, over the higher one.
LEAST_HEIGHT = 0.03
#: Probability from which what a pair leaves is no noise: it is held against whole models.
NO_NOISE = 1e-4
#: Halvings after which the power of a bent line is known to rounding.
HALVINGS = 50


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair(CurveFit):
    """Two lines, the lower one first, (2,) each: frequency and full width, Hz, complex height.

    `covariance` (4, 4) of both frequencies, then both widths, in Hz^2, with errors widened for
    correlated residuals. `curve` is over the largest value; there are so many `rows` of residuals.
    """

    frequency_hz: FloatArray
    width_hz: FloatArray
    height: ComplexArray
    covariance: FloatArray
    rows: int

    @property
    def std_hz(self) -> FloatArray:
        """Standard errors of both frequencies, then both widths, Hz, (4,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def is_noise(self) -> bool:
        """Whether what it leaves hangs together no more than noise does in one of 10,000 sweeps."""
        return self.structure.p_value > NO_NOISE

    def is_seen(self, frequency_hz: FloatArray) -> bool:
        """Whether points show both: tops among them, of widths and heights that they can tell.

        Args:
            frequency_hz: of the points (n,), Hz, rising.
        """
        spacing, span = float(np.median(np.diff(frequency_hz))), float(np.ptp(frequency_hz))
        f, w, sizes = self.frequency_hz, self.width_hz, np.abs(self.height)
        inside = np.all((frequency_hz[0] < f) & (f < frequency_hz[-1]))
        told = np.all((0.5 * spacing < w) & (w < span))
        return bool(inside and told and np.min(sizes) > LEAST_HEIGHT * np.max(sizes))

    def chance(self, squares: float, unknowns: int, points: int) -> float:
        """Probability that noise alone makes so much of what another form leaves.

        Args:
            squares: that the other form leaves, over the largest value.
            unknowns: real ones of the other form.
            points: at which noise may look like a second line; 1 for a form of two lines.
        """
        more = max(1, self.unknowns - unknowns)
        freedom = (self.rows - self.unknowns) / self.structure.widening**2
        left = max(self.squares, self.rows * SMALLEST_RESIDUAL**2)
        gain = max(0.0, (squares - self.squares) / more * freedom / left)
        return min(1.0, points * float(fdtrc(more, freedom, gain)))


def pair_of(frequency_hz: FloatArray, values: FloatArray | ComplexArray) -> Pair | None:
    """The two lines that a sweep follows best; None where no two can be fitted.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, shape (n,), any unit.
    """
    largest = float(np.max(np.abs(values)))
    if frequency_hz.size < LEAST_POINTS or not largest > 0.0:
        return None
    if np.iscomplexobj(values):
        return _of_complex(frequency_hz, np.asarray(values / largest, dtype=complex))
    return _of_amplitudes(frequency_hz, np.asarray(values / largest, dtype=float))


def _of_complex(f: FloatArray, y: ComplexArray) -> Pair | None:
    modes = lines_together(f, y, 2, 3).modes
    if len(modes) < 2:
        return None
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    places = [float(np.clip(mode.frequency_hz, f[0], f[-1])) for mode in modes]
    widths = [float(np.clip(abs(mode.width_hz), 0.1 * spacing, span)) for mode in modes]
    scale = _Scale(middle_hz=places, widths_hz=widths)

    def solved(x: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        columns = np.column_stack([*scale.modes(f, x), np.ones(f.size)])
        return columns, np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0])

    def curve(x: FloatArray) -> ComplexArray:
        columns, sizes = solved(x)
        return np.asarray(columns @ sizes)

    def residuals(x: FloatArray) -> FloatArray:
        return both_parts(curve(x) - y)

    fit = _lowest(residuals, [np.zeros(4)])
    if fit is None:
        return None
    columns, sizes = solved(fit.values)
    linear = np.hstack([both_parts(columns), both_parts(1j * columns)])
    slopes = np.column_stack([fit.jacobian, linear])
    return _pair(fit, slopes, scale, sizes[:2], np.asarray(columns @ sizes))


def _of_amplitudes(f: FloatArray, y: FloatArray) -> Pair | None:
    high = f[y >= math.sqrt(0.5) * float(np.max(y))]
    spacing, middle = float(np.median(np.diff(f))), 0.5 * float(high[0] + high[-1])
    width = max(float(high[-1] - high[0]), spacing)
    scale = _Scale(middle_hz=[middle, middle], widths_hz=[width, width])

    def curve(x: FloatArray) -> ComplexArray:
        one, two = scale.modes(f, x)
        return np.asarray(x[4] * one + (x[5] + 1j * x[6]) * two)

    def residuals(x: FloatArray) -> FloatArray:
        return np.asarray(np.abs(curve(x)) - y)

    begins = []
    for low, up, one, two in BEGINS:
        for turn in TURNS:
            begin = np.array([low, up, math.log(one), math.log(two), 1.0, *_polar(turn)])
            begin[4:] *= 1.0 / max(float(np.max(np.abs(curve(begin)))), 0.1)
            begins.append(begin)
    fit = _lowest(residuals, begins)
    if fit is None:
        return None
    x = fit.values
    sizes = np.array([x[4], x[5] + 1j * x[6]])
    return _pair(fit, fit.jacobian, scale, sizes, np.abs(curve(x)))


def bent_line(frequency_hz: FloatArray, values: FloatArray | ComplexArray) -> tuple[float, int]:
    """Squares over the largest value that a line which bends leaves, and its unknowns.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, beside which a constant may stand, shape (n,).
    """
    f, y = frequency_hz, values / float(np.max(np.abs(values)))
    size = np.abs(y)
    high = f[size >= math.sqrt(0.5) * float(np.max(size))]
    top, width = float(f[int(np.argmax(size))]), max(float(np.ptp(high)), float(np.ptp(f)) / f.size)

    def residuals(x: FloatArray) -> FloatArray:
        wide = math.exp(float(np.clip(x[1], -30.0, 30.0)))
        off = 2.0 * ((f - top) / width - x[0]) / wide
        power = _bent(off, float(x[2]))
        if not np.iscomplexobj(y):
            return np.asarray(x[3] * np.sqrt(power) - y)
        line = 1.0 / (1.0 + 1j * (off - x[2] * power))
        columns = np.column_stack([line, np.ones(f.size)])
        return both_parts(columns @ np.linalg.lstsq(columns, y, rcond=None)[0] - y)

    begins = [
        np.array([-0.5 * bend, 0.0, bend, *([] if np.iscomplexobj(y) else [1.0])])
        for bend in (0.3, -0.3)
    ]
    fit = _lowest(residuals, begins)
    squares = math.inf if fit is None else float(fit.residuals @ fit.residuals)
    return squares, 7 if np.iscomplexobj(y) else 4


def _bent(off: FloatArray, bend: float) -> FloatArray:
    """s (n,) of a line that bends by so many half widths: by halving, as s (...) - 1 rises in s."""
    low, high = np.zeros(off.size), np.ones(off.size)
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        over = middle * (1.0 + (off - bend * middle) ** 2) > 1.0
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return np.asarray(0.5 * (low + high))


def _polar(turn: float) -> tuple[float, float]:
    return math.cos(turn), math.sin(turn)


@dataclass(frozen=True, kw_only=True)
class _Scale:
    """What unknowns x mean: shifts of both lines over the `widths_hz`, and logarithms of widths."""

    middle_hz: Sequence[float]
    widths_hz: Sequence[float]

    def lines(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frequencies and widths of both, Hz, (2,) each."""
        widths = np.array(self.widths_hz)
        return np.array(self.middle_hz) + widths * x[:2], widths * np.exp(np.clip(x[2:4], -30, 30))

    def modes(self, f: FloatArray, x: FloatArray) -> list[ComplexArray]:
        """Responses of both, (n,) each."""
        return [
            mode_response(f, float(at), float(wide))
            for at, wide in zip(*self.lines(x), strict=True)
        ]


def _lowest(
    residuals: Callable[[FloatArray], FloatArray], begins: Sequence[FloatArray]
) -> LeastSquaresFit | None:
    """The lowest minimum that is reached from several begins."""
    found = []
    for begin in begins:
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            found.append(minimise_squares(residuals, begin, rounds=ROUNDS, gain=GAIN))
    if not found:
        return None
    best = min(found, key=lambda fit: float(fit.residuals @ fit.residuals))
    with contextlib.suppress(ValueError, np.linalg.LinAlgError):
        best = minimise_squares(residuals, best.values, rounds=ROUNDS_OF_BEST, gain=GAIN_OF_BEST)
    return best


def _pair(
    fit: LeastSquaresFit,
    slopes: FloatArray,
    scale: _Scale,
    sizes: ComplexArray,
    curve: FloatArray | ComplexArray,
) -> Pair:
    """The pair at a minimum, its slopes by all unknowns, those of the lines first."""
    structure = residual_structure(fit.residuals, slopes)
    squares = float(fit.residuals @ fit.residuals)
    rows, unknowns = slopes.shape
    places, widths = scale.lines(fit.values)
    units = np.array([*scale.widths_hz, *widths])
    noise = structure.widening**2 * squares / max(1, rows - unknowns)
    spread = noise * np.outer(units, units) * np.linalg.pinv(slopes.T @ slopes)[:4, :4]
    order = np.argsort(places)
    both = np.concatenate([order, order + 2])
    return Pair(
        frequency_hz=places[order],
        width_hz=widths[order],
        height=sizes[order],
        covariance=spread[np.ix_(both, both)],
        curve=curve,
        squares=squares,
        rows=rows,
        unknowns=unknowns,
        structure=structure,
    )
