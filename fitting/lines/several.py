"""Several lines in one sweep: where residuals of fewer show one more, and whether it is there.

The residuals of the best single line are compared with a line at every place and of every width,

    r(f) = Re[c g'(f)]  of amplitudes,        r(f) = c g'(f)  of complex values,

and two lines with one top are started next to each other about it, lines of complex values also at
poles (`fitting.lines.starts`). All lines are then fitted together. A further one is there where
noise gains as much, at any of the points, less often than `BY_CHANCE` over every model of fewer, a
bent one included.

Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares), with
Bonferroni's bound.
"""

from __future__ import annotations

import cmath
import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.choice import BY_CHANCE, chance
from fitting.lines.form import AMPLITUDE_FORMS, COMPLEX_FORMS, Form, LineFit, fit_form
from fitting.lines.lorentzian import mode_response
from fitting.lines.record import LineValues, SecondLine
from fitting.lines.starts import Start, poles
from fitting.lines.sweep_model import Place
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: Mean of both widths that lie between two lines that are apart.
APART = 3.0
#: Widths over that of the first line that are tried, over the span and the point distance.
NARROWEST, WIDEST, OF_SPAN, LEAST_POINTS = 0.125, 8.0, 0.125, 1.5
#: Numbers of one comparison of places and points, at most.
MOST_PLACES = 4_000_000
#: Gain over the noise from which both lines are fitted.
WORTH_TRYING = 20.0
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
    one_top = not any(fit.structure.order == 0 for fit in singles)
    least, made = min(single.squares for single in singles), []
    for fit in with_one_more(f, values, singles[0], forms, weights, one_top=one_top):
        both = fit
        with contextlib.suppress(BadInput):
            if both.others[0].share > 1.0:  # the higher one is the first
                both = fit_form(f, values, both.form, [_start_at(both)], weights=weights)
            white = both.structure.p_value > NOISE_P
            if not (white or both.squares <= (1.0 - EXPLAINED) * least):
                continue
            if shows_all(f, both) and not_by_chance(values, singles, both):
                made.append(both)
    return made


def with_one_more(
    frequency_hz: FloatArray,
    values: FloatArray | ComplexArray,
    fewer: LineFit,
    forms: Sequence[Form],
    weights: FloatArray | None = None,
    *,
    one_top: bool,
) -> list[LineFit]:
    """Every form with one line more than a fit has, as far as it can be fitted.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes or complex values, shape (n,).
        fewer: the best fit of the lines before.
        forms: the simple ones.
        weights: relative ones of the values, (n,).
        one_top: whether two lines may have one top.
    """
    starts = list(_starts(frequency_hz, values, fewer, one_top=one_top))
    made = []
    for form in forms if starts else ():
        with contextlib.suppress(BadInput):
            more = replace(form, further=len(fewer.others) + 1)
            made.append(fit_form(frequency_hz, values, more, starts, weights=weights))
    return made


def fit_lines(
    frequency_hz: FloatArray, values: FloatArray | ComplexArray, count: int, background: int = 1
) -> LineFit | None:
    """So many lines fitted together, each with a complex height; None where that is not possible.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes or complex values, shape (n,).
        count: number of lines.
        background: below complex values: 0 nothing, 1 a constant, 2 a slope, too.
    """
    f, is_complex = frequency_hz, np.iscomplexobj(values)
    if (count > 1 and f.size < FEWEST) or not np.any(values):
        return None
    names = ("transmission", "fano", "sloped")
    form = COMPLEX_FORMS[names[background]] if is_complex else AMPLITUDE_FORMS["transmission"]
    starts: list[Start] = []
    if is_complex:
        spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
        with contextlib.suppress(np.linalg.LinAlgError):
            places = [
                Place(
                    float(np.clip(eta, f[0] - span, f[-1] + span)),
                    float(np.clip(width, 0.1 * spacing, span)),
                )
                for eta, width in poles(f, np.asarray(values, dtype=complex), count)
            ]
            if len(places) == count:
                others = tuple((place, 0j) for place in places[1:])
                starts.append(Start(*places[0], others=others))
    if count > 1:  # poles miss a line in noise, but not residuals of fewer lines
        fewer = fit_lines(f, values, count - 1, background)
        if fewer is not None:
            starts += _starts(f, values, fewer, one_top=count == 2 and not is_complex)
    if not starts and (is_complex or count > 1):
        return None
    with contextlib.suppress(BadInput):
        return fit_form(f, values, replace(form, further=count - 1), starts)
    return None


def shows_all(frequency_hz: FloatArray, fit: LineFit) -> bool:
    """Whether points show every line: its top among them, and a width and height that they resolve.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        fit: of several lines.
    """
    f = frequency_hz
    spacing, span = float(np.median(np.diff(f))), float(np.ptp(f))
    shares = [1.0, *(other.share for other in fit.others)]
    inside = [
        f[0] + 0.5 * line.width.value < line.frequency.value < f[-1] - 0.5 * line.width.value
        for line in fit.others
    ]
    wide = [0.5 * spacing < line.width.value < span for line in (fit, *fit.others)]
    return all(inside) and all(wide) and min(shares) >= LEAST_HEIGHT * max(shares)


def not_by_chance(
    values: FloatArray | ComplexArray, fewer: Sequence[LineFit], fit: LineFit
) -> bool:
    """Whether every model of fewer lines leaves more than noise does, at any of the points.

    Args:
        values: amplitudes or complex values, shape (n,).
        fewer: models of fewer lines.
        fit: with one more.
    """
    rows = values.size * (2 if np.iscomplexobj(values) else 1)
    return all(
        values.size
        * chance(one.squares, one.unknowns, fit.squares, fit.unknowns, fit.structure, rows)
        < BY_CHANCE
        for one in fewer
    )


def _start_at(fit: LineFit) -> Start:
    """Where lines start that were fitted, the higher one of two first."""
    delay = 0.0 if fit.delay is None else fit.delay.value
    lines = [(Place(line.frequency.value, line.width.value), line) for line in (fit, *fit.others)]
    heights = [1.0 + 0j, *(other.height for other in fit.others)]
    first = max(range(len(lines)), key=lambda k: abs(heights[k]))
    others = tuple(
        (place, heights[k] / heights[first]) for k, (place, _) in enumerate(lines) if k != first
    )
    return Start(*lines[first][0], delay_s=delay, others=others)


def _starts(
    f: FloatArray, values: FloatArray | ComplexArray, fewer: LineFit, *, one_top: bool
) -> Iterator[Start]:
    """Where one more line may start: at the residuals, and next to the one of a common top."""
    near = _start_at(fewer)
    place = _place(f, values, fewer)
    if place is not None:
        at, width, height = place
        yield replace(near, others=(*near.others, (Place(at, width), height)))
    if not one_top:
        return
    lines = [(Place(near.frequency_hz, near.width_hz), 1.0 + 0j), *near.others]
    for k, ((middle, width), height) in enumerate(lines):
        for low, up, one, two in PAIRS:
            here = Place(middle + low * width, one * width)
            # heights of complex values are linear: it does not matter where they start
            for phase in PHASES[: 1 if np.iscomplexobj(values) else None]:
                other = Place(middle + up * width, two * width), height * cmath.rect(1.0, phase)
                both = [*lines[:k], (here, height), *lines[k + 1 :], other]
                eta, wide = both[0][0]
                yield replace(near, frequency_hz=eta, width_hz=wide, others=tuple(both[1:]))


def _place(
    f: FloatArray, values: FloatArray | ComplexArray, best: LineFit
) -> tuple[float, float, complex] | None:
    """Where one more line would explain most of the residuals; None where that is little."""
    residuals = (values - best.curve) / float(np.max(np.abs(values)))
    known = [Place(line.frequency.value, line.width.value) for line in (best, *best.others)]
    widths = NARROWEST * best.width.value, WIDEST * best.width.value
    strongest = strongest_line(f, residuals, widths, known)
    if strongest is None:
        return None
    gain, at, width, height = strongest
    rows = residuals.size * (2 if np.iscomplexobj(values) else 1)
    noise = max((best.squares - gain) / max(1, rows - best.unknowns), 1e-12)
    size = best.amplitude.value / float(np.max(np.abs(values)))
    return (at, width, height / size) if gain > WORTH_TRYING * noise else None


def strongest_line(
    frequency_hz: FloatArray,
    residuals: FloatArray | ComplexArray,
    widths_hz: tuple[float, float] = (0.0, math.inf),
    known: Sequence[Place] = (),
) -> tuple[float, float, float, complex] | None:
    """The line, among those of every place and width, that explains most of residuals.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        residuals: of amplitudes or of complex values, shape (n,), any unit.
        widths_hz: least and largest FWHM, as far as points and span show them, Hz.
        known: lines from which it is apart.

    Returns:
        By how much it reduces the squares, its frequency and FWHM, Hz, and its complex height; None
        where there is no such place.
    """
    f = frequency_hz
    span, spacing = float(np.ptp(f)), float(np.median(np.diff(f)))
    gains, width = [], max(LEAST_POINTS * spacing, widths_hz[0])
    while width <= min(widths_hz[1], OF_SPAN * span):
        count = max(2, int(2.0 * span / width))
        places = np.linspace(f[0] + 0.5 * width, f[-1] - 0.5 * width, count)
        for line in known:
            apart = 0.5 * APART * (width + line.width_hz)
            places = places[np.abs(places - line.frequency_hz) > apart]
        if 0 < places.size * f.size <= MOST_PLACES:
            gains.append(_best_of(f, residuals, places, width))
        width *= 2.0
    return max(gains, key=lambda each: each[0], default=None)


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
