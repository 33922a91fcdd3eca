"""A second line: where residuals of one line show it, and whether both are there.

The residuals of the best single line are compared with a line at every place and of every width,

    r(f) = Re[c g'(f)]  of amplitudes,        r(f) = c g'(f)  of complex values,

and two lines with one top are begun next to each other about it. Both lines are then fitted
together. The second is there where noise gains as much, at any of the points, less often than
`BY_CHANCE` over every model of one line, a bent one included.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares), with
Bonferroni's bound.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.choice import chance
from fitting.lines.form import Form, LineFit, fit_form
from fitting.lines.starts import Start
from fitting.lines.sweep_model import Place
from fitting.signal.line_record import LineValues, SecondLine
from fitting.signal.peaks import mode_response
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: Mean of both widths that lie between two lines that are apart.
APART = 3.0
#: Widths over that of the first line that are tried, over the span and the point distance.
NARROWEST, WIDEST, OF_SPAN, LEAST_POINTS = 0.125, 8.0, 0.125, 1.5
#: Numbers of one comparison of places and points, at most.
MOST_PLACES = 4_000_000
#: Gain over the noise from which both lines are fitted, and probability that noise gains as much.
WORTH_TRYING, BY_CHANCE = 20.0, 1e-4
#: Share of the squares of one line that two explain where their own residuals are not noise.
EXPLAINED = 0.75
#: Probability of white noise from which residuals are noise.
NOISE_P = 1e-4
#: Fewest points of two lines, and least height of one over that of the other.
FEWEST, LEAST_HEIGHT = 12, 0.03
#: Distances from the middle of a top, and widths, over its width, from which a pair is fitted, and
#: phases of the upper line.
PAIRS = ((-0.35, 0.35, 0.7, 0.7), (-0.15, 0.35, 0.6, 0.9), (-0.35, 0.15, 0.9, 0.6), (0, 0, 0.3, 1))
PHASES = (0.4, 2.7)


@dataclass(frozen=True)
class TwoLines:
    """Two resonances: frequencies and FWHM, Hz, the lower one first.

    ``ratio`` is the complex height of the upper one over that of the lower one. ``std_hz`` are
    standard errors of the frequencies, then of the widths, Hz; ``times`` is what the best model of
    one line leaves over what both leave, in squares.
    """

    frequency_hz: tuple[float, float]
    width_hz: tuple[float, float]
    ratio: complex
    std_hz: tuple[float, ...] = ()
    times: float = math.nan

    @property
    def overlap(self) -> bool:
        """Whether no range contains one of them alone."""
        return self.frequency_hz[1] - self.frequency_hz[0] < sum(self.width_hz)

    @property
    def share(self) -> float:
        """Height of the lower one over that of the higher one."""
        size = abs(self.ratio)
        return min(size, 1.0 / size) if size > 0.0 else 0.0


class TwoResonances(BadInput):
    """A sweep shows two resonances where one is looked for: ``lines``."""

    def __init__(self, *errors: str, lines: TwoLines, phases_reversed: bool = False) -> None:
        super().__init__(*errors)
        self.lines, self.phases_reversed = lines, phases_reversed


def as_two(first: LineValues, second: SecondLine | None) -> TwoLines | None:
    """A line and a second one as two; None without a second one.

    Args:
        first: the line.
        second: the other one.
    """
    if second is None:
        return None
    both = sorted((first, second), key=lambda line: line.frequency.value)
    errors = [line.frequency.std for line in both] + [line.width.std for line in both]
    return TwoLines(
        frequency_hz=(both[0].frequency.value, both[1].frequency.value),
        width_hz=(both[0].width.value, both[1].width.value),
        ratio=second.height if both[1] is second else 1.0 / second.height,
        std_hz=() if any(map(math.isnan, errors)) else tuple(errors),
    )


def two_line_fits(
    frequency_hz: FloatArray,
    values: FloatArray | ComplexArray,
    singles: Sequence[LineFit],
    forms: Sequence[Form],
    weights: FloatArray | None = None,
) -> list[LineFit]:
    """Models of two lines that are significantly better than every model of one; mostly none.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes or complex values, shape (n,).
        singles: models of one line, the best one first.
        forms: those that are tried with a second line, the simple ones.
        weights: relative ones of the values, (n,).
    """
    f = frequency_hz
    if f.size < FEWEST:
        return []
    starts = list(_starts(f, values, singles))
    if not starts:
        return []
    made = []
    for form in forms:
        with contextlib.suppress(BadInput):
            two = replace(form, second=True)
            both = fit_form(f, values, two, starts, weights=weights)
            if both.second is not None and both.second.share > 1.0:  # the higher one is the first
                swapped = [_swapped(both, both.second)]
                both = fit_form(f, values, two, swapped, weights=weights)
            if _is_there(f, values, singles, both):
                made.append(both)
    return made


def _starts(
    f: FloatArray, values: FloatArray | ComplexArray, singles: Sequence[LineFit]
) -> Iterator[Start]:
    """Where two lines may begin: at the residuals of one, and next to each other about its top."""
    best = singles[0]
    delay = 0.0 if best.delay is None else best.delay.value
    first = Start(best.frequency.value, best.width.value, delay)
    place = _place(f, values, best)
    if place is not None:
        at, width, height = place
        yield replace(first, second=Place(at, width), height=height)
    if any(fit.structure.order == 0 for fit in singles):
        return
    width = best.width.value
    for low, up, one, two in PAIRS:
        for phase in PHASES:
            yield Start(
                best.frequency.value + low * width,
                one * width,
                delay,
                second=Place(best.frequency.value + up * width, two * width),
                height=complex(math.cos(phase), math.sin(phase)),
            )


def _swapped(line: LineFit, second: SecondLine) -> Start:
    """Where both lines begin with the second one in the place of the first."""
    return Start(
        second.frequency.value,
        second.width.value,
        0.0 if line.delay is None else line.delay.value,
        second=Place(line.frequency.value, line.width.value),
        height=1.0 / second.height,
    )


def _place(
    f: FloatArray, values: FloatArray | ComplexArray, best: LineFit
) -> tuple[float, float, complex] | None:
    """Where a second line would explain most of the residuals; None where that is little."""
    residuals = (values - best.curve) / float(np.max(np.abs(values)))
    span, spacing = float(np.ptp(f)), float(np.median(np.diff(f)))
    found = []
    width = max(LEAST_POINTS * spacing, NARROWEST * best.width.value)
    while width <= min(WIDEST * best.width.value, OF_SPAN * span):
        count = max(2, int(2.0 * span / width))
        places = np.linspace(f[0] + 0.5 * width, f[-1] - 0.5 * width, count)
        apart = np.abs(places - best.frequency.value) > 0.5 * APART * (width + best.width.value)
        places = places[apart]
        if 0 < places.size * f.size <= MOST_PLACES:
            found.append(_best_of(f, residuals, places, width))
        width *= 2.0
    if not found:
        return None
    gain, at, width, height = max(found, key=lambda each: each[0])
    rows = residuals.size * (2 if np.iscomplexobj(values) else 1)
    noise = max((best.squares - gain) / max(1, rows - best.unknowns), 1e-12)
    size = best.amplitude.value / float(np.max(np.abs(values)))
    return (at, width, height / size) if gain > WORTH_TRYING * noise else None


def _best_of(
    f: FloatArray, residuals: FloatArray | ComplexArray, places: FloatArray, width: float
) -> tuple[float, float, float, complex]:
    """What the best of these places gains in squares, the place, its width and height."""
    shape = np.stack([mode_response(f, float(place), width) for place in places])
    if np.iscomplexobj(residuals):
        norms = np.sum(np.abs(shape) ** 2, axis=1)
        heights = (shape.conj() @ residuals) / norms
        gains = norms * np.abs(heights) ** 2
    else:
        x, y = shape.real, -shape.imag  # Re[c g'] = x Re c + y Im c
        xx, yy, xy = (np.sum(a * b, axis=1) for a, b in ((x, x), (y, y), (x, y)))
        xr, yr = x @ residuals, y @ residuals
        bottom = np.maximum(xx * yy - xy**2, np.finfo(float).tiny)
        heights = ((yy * xr - xy * yr) + 1j * (xx * yr - xy * xr)) / bottom
        gains = heights.real * xr + heights.imag * yr
    k = int(np.argmax(gains))
    return float(gains[k]), float(places[k]), width, complex(heights[k])


def _is_there(
    f: FloatArray,
    values: FloatArray | ComplexArray,
    singles: Sequence[LineFit],
    both: LineFit,
) -> bool:
    """Whether points show both lines, and every model of one line leaves more than noise does."""
    line = both.second
    if line is None:
        return False
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    place, width = line.frequency.value, line.width.value
    resolved = f[0] + 0.5 * width < place < f[-1] - 0.5 * width and 0.5 * spacing < width < span
    heights = sorted((1.0, line.share))
    if not (resolved and 0.5 * spacing < both.width.value < span):
        return False
    if heights[0] < LEAST_HEIGHT * heights[1]:
        return False
    rows = values.size * (2 if np.iscomplexobj(values) else 1)
    least = min(single.squares for single in singles)
    noise = both.structure.p_value > NOISE_P
    if not noise and both.squares > (1.0 - EXPLAINED) * least:
        return False
    return all(
        f.size
        * chance(one.squares, one.unknowns, both.squares, both.unknowns, both.structure, rows)
        < BY_CHANCE
        for one in singles
    )
