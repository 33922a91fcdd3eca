"""A weak second line among the points of the first one, well apart from it.

What the best form of one line leaves is held against every place and width of a second one,

    r(f) = Re[c g'(f)]   of amplitudes,        r(f) = c g'(f)   of complex values

as the first one hardly turns in phase away from its top. The best place is where both are then
fitted together. A second line is there where noise gains as much at any of the points less often
than `BY_CHANCE`; it hangs together, or is of unequal size, as what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import fdtrc

from fitting.resonance.form import (
    AMPLITUDE_FORMS,
    FANO,
    FORMS,
    SLOPED,
    TRANSMISSION,
    ComplexForm,
    FittedForm,
    Guess,
    fit_amplitudes_with_second,
    fit_complex,
)
from fitting.resonance.trace import Trace
from fitting.signal.line_record import SecondLine
from fitting.signal.peaks import OFFSET, SINGLE, TAIL, mode_response
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: Mean of both widths that lie between two lines at least.
APART = 3.0
#: Widths over that of the first line that are tried, and over the span at most.
NARROWEST, WIDEST, OF_SPAN = 0.125, 8.0, 0.125
#: Widths over the distance of the points, at least; most places and points of one width.
LEAST_POINTS, MOST_PLACES = 1.5, 4_000_000
#: Gain over the noise from which both are fitted, and probability that noise gains as much.
WORTH_TRYING, BY_CHANCE = 20.0, 1e-4
#: Share of what is left that it explains, where what it leaves is no noise either.
EXPLAINED = 0.5


def second_place(trace: Trace, best: FittedForm) -> SecondLine | None:
    """Where a second line would explain most of what is left; None where that is little.

    Args:
        trace: what was measured.
        best: the form of one line that describes it best.
    """
    f = trace.frequency_hz
    top = float(np.max(trace.amplitude))
    left = (trace.values - best.curve) / top
    span, spacing = float(np.ptp(f)), float(np.median(np.diff(f)))
    found: list[tuple[float, SecondLine]] = []
    width = max(LEAST_POINTS * spacing, NARROWEST * best.width.value)
    while width <= min(WIDEST * best.width.value, OF_SPAN * span):
        places = _places(f, width, best)
        if 0 < places.size * f.size <= MOST_PLACES:
            found.append(_best_of(f, left, places, width))
        width *= 2.0
    if not found:
        return None
    gain, line = max(found, key=lambda each: each[0])
    rows = left.size * (2 if trace.is_complex else 1)
    noise = max((best.squares - gain) / max(1, rows - best.unknowns), SMALLEST_RESIDUAL**2)
    return line if gain > WORTH_TRYING * noise else None


def _places(f: FloatArray, width: float, best: FittedForm) -> FloatArray:
    """Where a line of a width may be: among the points, and apart from the first one."""
    count = max(2, int(2.0 * float(np.ptp(f)) / width))
    places = np.linspace(f[0] + 0.5 * width, f[-1] - 0.5 * width, count)
    apart = np.abs(places - best.frequency.value) > 0.5 * APART * (width + best.width.value)
    return np.asarray(places[apart])


def _best_of(
    f: FloatArray, left: FloatArray | ComplexArray, places: FloatArray, width: float
) -> tuple[float, SecondLine]:
    """What the best of these places gains in squares, and the line there."""
    shape = np.stack([mode_response(f, float(place), width) for place in places])
    if np.iscomplexobj(left):
        norms = np.sum(np.abs(shape) ** 2, axis=1)
        heights = (shape.conj() @ left) / norms
        gains = norms * np.abs(heights) ** 2
    else:
        x, y = shape.real, -shape.imag  # Re[c g'] = x Re c + y Im c
        xx, yy, xy = (np.sum(a * b, axis=1) for a, b in ((x, x), (y, y), (x, y)))
        xr, yr = x @ left, y @ left
        bottom = np.maximum(xx * yy - xy**2, np.finfo(float).tiny)
        heights = ((yy * xr - xy * yr) + 1j * (xx * yr - xy * xr)) / bottom
        gains = heights.real * xr + heights.imag * yr
    k = int(np.argmax(gains))
    return float(gains[k]), SecondLine.at(float(places[k]), width, complex(heights[k]))


#: A form of two lines, and its fit.
Attempt = tuple[tuple[str, bool], Callable[[], FittedForm]]


def fits_with_second(
    trace: Trace,
    forms: Sequence[FittedForm],
    place: SecondLine,
    asked: str = "",
    tails_hz: Sequence[tuple[float, float]] = (),
) -> list[FittedForm]:
    """Forms with the second line that are significantly better; empty without any.

    Args:
        trace: what was measured.
        forms: of one line, all that could be fitted, the one that describes it best first.
        place: where the second line may be.
        asked: the form that is wanted; empty: those that are no more than the best one has, too.
        tails_hz: frequency and width of lines outside of the points, Hz.
    """
    found, best = [], forms[0]
    for name in (asked,) if asked else _names(trace, best):
        try:
            form = _fitted(trace, best, place, name, tails_hz)
        except BadInput:
            continue
        if form is not None and _is_seen(trace, forms, form):
            found.append(form)
    return found


def _names(trace: Trace, best: FittedForm) -> tuple[str, ...]:
    """The forms that are tried: the simple ones, and that of the first line alone."""
    simple = FORMS if trace.is_complex else (TRANSMISSION, OFFSET, SLOPED)
    return tuple(dict.fromkeys((*simple, best.name)))


def _fitted(
    trace: Trace,
    best: FittedForm,
    place: SecondLine,
    name: str,
    tails_hz: Sequence[tuple[float, float]],
) -> FittedForm | None:
    f = trace.frequency_hz
    if trace.is_complex:
        form = ComplexForm(
            name=name,
            delayed=best.delay is not None,
            tails_hz=tails_hz,
            second_hz=(place.frequency.value, place.width.value),
        )
        delay = 0.0 if best.delay is None else best.delay.value
        begin = [Guess(best.frequency.value, best.width.value, delay)]
        y = np.asarray(trace.values, dtype=complex)
        return fit_complex(f, y, form, begin, trace.source)
    if name in (FANO, SINGLE, TAIL) or name not in AMPLITUDE_FORMS:
        return None
    return fit_amplitudes_with_second(f, trace.amplitude, best, name, place, trace.source)


def _is_seen(trace: Trace, forms: Sequence[FittedForm], both: FittedForm) -> bool:
    """Whether the second line is one: apart, among the points, and beyond what noise makes."""
    line, f = both.second, trace.frequency_hz
    if line is None:
        return False
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    place, width = line.frequency.value, line.width.value
    separate = (
        f[0] + 0.5 * width < place < f[-1] - 0.5 * width
        and abs(place - both.frequency.value) > 0.5 * APART * (width + both.width.value)
        and spacing < width < 2.0 * OF_SPAN * span
    )
    if not separate or line.share > 1.0:
        return False
    least = min(form.squares for form in forms)
    if both.structure.order > 0 and both.squares > (1.0 - EXPLAINED) * least:
        return False
    return all(_chance(trace, form, both) < BY_CHANCE for form in forms)


def _chance(trace: Trace, one: FittedForm, both: FittedForm) -> float:
    """Probability that noise gains as much by the second line, at any of the points.

    Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares), with
    Bonferroni's bound.
    """
    rows = trace.values.size * (2 if trace.is_complex else 1)
    more = max(1, both.unknowns - one.unknowns)
    freedom = max(1.0, (rows - both.unknowns) / both.structure.widening**2)
    squares = max(both.squares, rows * SMALLEST_RESIDUAL**2)
    gain = max(0.0, (one.squares - squares) / more * freedom / squares)
    return trace.values.size * float(fdtrc(more, freedom, gain))
