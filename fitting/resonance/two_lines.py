"""Whether a trace shows two resonances, where one is looked for.

Complex values by a rational function of degree two (`fitting.signal.lines_together`); amplitudes by
a second line beside the first, begun where most is left. Of two that overlap so that they have one
top `fitting.signal.pair` tells, where every form of one line leaves more than noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from fitting.resonance.form import FittedForm
from fitting.resonance.trace import Trace
from fitting.signal.least_squares import minimise_squares
from fitting.signal.line_record import LineValues, SecondLine
from fitting.signal.lines_together import lines_together
from fitting.signal.pair import bent_line, pair_of
from fitting.signal.peaks import mode_response
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: A second line counts from this share of the first one's height, if it explains so much.
LEAST_HEIGHT, EXPLAINED = 0.03, 0.75
#: Fewer points do not tell two lines from one and noise, and noise gains as much less often.
LEAST_POINTS, BY_CHANCE = 12, 1e-3
#: Noise gains so much by two lines with one top less often than this.
OVERLAP_BY_CHANCE = 1e-4
#: Evaluations after which a second line that is still looked for is none.
ROUNDS_FOR_SECOND = 60


@dataclass(frozen=True)
class TwoLines:
    """Two resonances: frequencies and full widths, Hz, the lower one first.

    ``ratio`` is the complex height of the upper one over that of the lower one. Where both have one
    top, ``std_hz`` are standard errors of the frequencies, then of the widths, Hz, and ``times`` is
    what the best form of one line leaves, over what they leave, in squares.
    """

    frequency_hz: tuple[float, float]
    width_hz: tuple[float, float]
    ratio: complex
    std_hz: tuple[float, ...] = ()
    times: float = math.nan

    @property
    def overlap(self) -> bool:
        """Whether no range holds one of them alone."""
        return self.frequency_hz[1] - self.frequency_hz[0] < sum(self.width_hz)

    @property
    def share(self) -> float:
        """Height of the lower one over that of the higher one."""
        size = abs(self.ratio)
        return min(size, 1.0 / size) if size > 0.0 else 0.0


def as_two(first: LineValues, second: SecondLine | None) -> TwoLines | None:
    """A line and a second one as two; None without a second one.

    Args:
        first: the line.
        second: the other one.
    """
    if second is None:
        return None
    lower, upper = sorted((each.frequency.value, each.width.value) for each in (first, second))
    is_upper = upper == (second.frequency.value, second.width.value)
    ratio = second.height if is_upper else 1.0 / second.height
    return TwoLines((lower[0], upper[0]), (lower[1], upper[1]), ratio)


class TwoResonances(BadInput):
    """A trace shows two resonances where one is looked for: ``lines``."""

    def __init__(self, *complaints: str, lines: TwoLines, phases_reversed: bool = False) -> None:
        super().__init__(*complaints)
        self.lines, self.phases_reversed = lines, phases_reversed


def overlapping(trace: Trace, forms: Sequence[FittedForm]) -> TwoLines | None:
    """Two lines with one top, which the points show where no form of one line leaves noise.

    A line that bends with its amplitude is one of those.

    Args:
        trace: what was measured.
        forms: of one line, all that could be fitted.
    """
    f = trace.frequency_hz
    if any(form.structure.order == 0 for form in forms):
        return None
    values = trace.values if trace.is_complex else trace.amplitude
    pair = pair_of(f, values)
    if pair is None or not (pair.is_noise and pair.is_seen(f)):
        return None
    chances = [pair.chance(form.squares, form.unknowns, f.size) for form in forms]
    if max(chances) > OVERLAP_BY_CHANCE:
        return None
    if pair.chance(*bent_line(f, values), f.size) > OVERLAP_BY_CHANCE:
        return None
    one, two = pair.height
    return TwoLines(
        frequency_hz=(float(pair.frequency_hz[0]), float(pair.frequency_hz[1])),
        width_hz=(float(pair.width_hz[0]), float(pair.width_hz[1])),
        ratio=complex(two / one),
        std_hz=tuple(map(float, pair.std_hz)),
        times=min(form.squares for form in forms) / pair.squares,
    )


def two_lines(trace: Trace, best: FittedForm) -> TwoLines | None:
    """The two resonances of a trace; None where one explains it about as well.

    Args:
        trace: what was measured.
        best: the form of one line that describes it best.
    """
    f = trace.frequency_hz
    if f.size < LEAST_POINTS:
        return None
    largest = float(np.max(trace.amplitude))
    if trace.is_complex:
        y: ComplexArray = np.asarray(trace.values / largest, dtype=complex)
        found = _of_complex(f, y)
    else:
        found = _of_amplitudes(f, trace.amplitude / largest, best)
    if found is None:
        return None
    squares, lines = found
    if _chance(trace, best, squares) > BY_CHANCE:
        return None
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    seen = [
        (eta, width, height)
        for eta, width, height in lines
        if f[0] < eta < f[-1] and 0.5 * spacing < width < span
    ]
    if len(seen) < 2 or squares > (1.0 - EXPLAINED) * best.squares:
        return None
    heights = sorted(abs(height) for _, _, height in seen)
    lower, upper = sorted(seen, key=lambda line: line[0])
    (low, low_width, _), (high, high_width, _) = lower, upper
    apart = high - low > 0.5 * (low_width + high_width)
    if heights[0] < LEAST_HEIGHT * heights[1] or not apart:
        return None
    return TwoLines((low, high), (low_width, high_width), upper[2] / lower[2])


def _chance(trace: Trace, best: FittedForm, squares: float) -> float:
    """Probability that noise gains as much by the second line, at any of the points.

    Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares), with
    Bonferroni's bound.
    """
    rows, unknowns = (2 * trace.values.size, 10) if trace.is_complex else (trace.values.size, 7)
    more = max(1, unknowns - best.unknowns)
    freedom = max(1.0, (rows - unknowns) / best.structure.together**2)
    if not squares > 0.0:
        return 0.0
    gain = max(0.0, (best.squares - squares) / more * freedom / squares)
    return min(1.0, trace.frequency_hz.size * float(fdtrc(more, freedom, gain)))


#: Frequency, width and complex height of each line.
_Lines = Iterable[tuple[float, float, complex]]


def _of_complex(f: FloatArray, y: ComplexArray) -> tuple[float, _Lines] | None:
    """Sum of squares and (frequency, width, height) of two lines with a constant background."""
    found = lines_together(f, y, 2, 3)
    if len(found.modes) < 2:
        return None
    lines = [(mode.frequency_hz, abs(mode.width_hz), mode.height) for mode in found.modes]
    return found.squares(y), lines


def _of_amplitudes(f: FloatArray, y: FloatArray, best: FittedForm) -> tuple[float, _Lines] | None:
    """The same of |h1 g1 + (a + i b) g2|, begun at the largest residual, above or below."""
    left = y - np.abs(best.curve) / float(np.max(np.abs(best.curve)))
    spacing = float(np.median(np.diff(f)))
    top = float(f[int(np.argmax(y))])
    width0 = max(min(best.width.value, 0.2 * float(np.ptp(f))), 2.0 * spacing)
    found = None
    for first, second in {
        (top, float(f[int(np.argmax(np.where(np.abs(f - top) > width0, y, 0.0)))])),
        (top, float(f[int(np.argmax(left))])),
        (best.frequency.value, float(f[int(np.argmin(left))])),
    }:
        fit = _fitted(f, y, (first, second), max(0.5 * width0, spacing))
        if fit is not None and (found is None or fit[0] < found[0]):
            found = fit
    return found


def _fitted(
    f: FloatArray, y: FloatArray, begin: tuple[float, float], width0: float
) -> tuple[float, _Lines] | None:
    def lines(x: FloatArray) -> list[tuple[float, float]]:
        widths = [width0 * math.exp(float(np.clip(v, -30.0, 30.0))) for v in x[2:4]]
        return [(b + width0 * float(v), w) for b, v, w in zip(begin, x, widths, strict=False)]

    def residuals(x: FloatArray) -> FloatArray:
        one, two = (mode_response(f, *line) for line in lines(x))
        return np.asarray(np.abs(x[4] * one + (x[5] + 1j * x[6]) * two) - y)

    heights = [float(np.interp(b, f, y)) for b in begin]
    try:
        begin_at = np.array([0, 0, 0, 0, heights[0], heights[1], 0.1])
        fit = minimise_squares(residuals, begin_at, rounds=ROUNDS_FOR_SECOND)
    except (ValueError, np.linalg.LinAlgError):
        return None
    sizes = complex(fit.values[4]), complex(fit.values[5], fit.values[6])
    found = [(*line, size) for line, size in zip(lines(fit.values), sizes, strict=True)]
    return float(fit.residuals @ fit.residuals), found
