"""Poles of complex values by linear least squares: where fits of lines begin, what is plausible.

    S(u) exp(i 2 pi u tau) = (a0 + a1 x + a2 x^2 ...)/(1 + b1 x + ... + bp x^p)

Its p poles are damped modes, eta + i w/2 for responses that count phases as exp(+i 2 pi u t), each
seen through a complex gain of its own: with p coefficients above nothing is next to them, with
p + 1 a complex constant. x is (u - u0)/half the span, u0 the middle of the sweep, tau a cable's
delay.

Source: C. Sanathanan and J. Koerner, IEEE Trans. Autom. Control 8 (1963) 56.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.text.arrays import BoolArray, ComplexArray, FloatArray

#: Least squares with new weights: Sanathanan and Koerner's denominator settles by then.
ROUNDS = 4
#: Delays that are tried about the first guess: their number each way, and how many in 1/span; how
#: many times as many at most, where gaps make the span longer than what was measured in it.
TRIED, PER_SPAN, MOST = 32, 8, 32.0
#: Spreads of the values, as a share of the largest, that are rounding: a constant is no line.
CONSTANT = 1e-12
#: Times that delays are tried four times as close about the best one.
CLOSER = 4
#: Delays, the best ones, about which that is done where the sweep has gaps.
PROMISING = 8
#: Widths about a top or a bottom of which a line is guessed.
NEAR = 4.0


@dataclass(frozen=True, kw_only=True)
class ComplexLine:
    """A mode in complex data: `eta_hz` and full width `width_hz`, behind a delay `delay_s`.

    The width is negative where phases are counted as exp(-i 2 pi u t). `left` is what is left, root
    mean square over the largest modulus, `misfit` over that of the data about their mean;
    `top` is the value at eta, in their unit, the delay taken off.
    """

    eta_hz: float
    width_hz: float
    delay_s: float
    misfit: float
    left: float
    top: complex = 0j


def complex_line(
    frequency_hz: FloatArray, values: ComplexArray, delay_s: float | None = 0.0
) -> ComplexLine:
    """The mode that complex values follow; values that are one constant have no width, NaN.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit.
        delay_s: known delay, s; None: it is looked for.
    """
    largest = float(np.max(np.abs(values)))
    if not float(np.max(np.abs(values - values[0]))) > CONSTANT * largest:
        return _no_line(frequency_hz, complex(values[0]), delay_s or 0.0)
    f, s = frequency_hz, values / largest
    if delay_s is not None:
        line = _line(f, s, delay_s)
        return replace(line, top=line.top * largest)
    span = float(np.ptp(f))
    guess, measured_hz = mean_delay(f, s)
    tried = int(TRIED * min(max(1.0, span / measured_hz), MOST))
    steps = np.arange(-tried, tried + 1) / (PER_SPAN * span)
    misfits = [_line(f, s, guess + step).left for step in steps]
    # over a gap a turn more fits nearly as well: which one is seen close by alone
    lowest = [
        guess + float(steps[k]) for k in np.argsort(misfits)[: PROMISING if tried > TRIED else 1]
    ]
    ends = [_closer(f, s, begin) for begin in (*lowest, *far_delays(f, s))]
    best = min(ends, key=lambda tau: _line(f, s, tau).left)
    return complex_line(frequency_hz, values, best)


def extent(frequency_hz: FloatArray, chosen: BoolArray, middle: int) -> float:
    """Width of the region about a point where all points are chosen, Hz.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        chosen: shape (n,).
        middle: number of the point.
    """
    others = np.flatnonzero(~chosen)
    low = int(np.max(others[others < middle], initial=0))
    high = int(np.min(others[others > middle], initial=frequency_hz.size - 1))
    return float(frequency_hz[high] - frequency_hz[low])


def tops_and_bottoms(frequency_hz: FloatArray, values: ComplexArray) -> dict[float, float]:
    """Where the largest and the smallest modulus is, Hz, and how far it reaches, Hz.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit.
    """
    f, size = frequency_hz, np.abs(values)
    top, bottom = int(np.argmax(size)), int(np.argmin(size))
    half = 0.5 * (float(np.median(size)) + size[bottom])
    return {
        float(f[top]): extent(f, size >= math.sqrt(0.5) * size[top], top),
        float(f[bottom]): extent(f, size <= half, bottom),
    }


def far_delays(frequency_hz: FloatArray, values: ComplexArray) -> list[float]:
    """Delays that points far from a top or a bottom show, where most points are far, s.

    A line of few points in a long sweep is a small part of what `complex_line` has to describe: a
    wide line can stand for a delay, and the narrow one is not seen.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit.
    """
    found = []
    for eta, width in tops_and_bottoms(frequency_hz, values).items():
        far = np.abs(frequency_hz - eta) > NEAR * width
        if 2 * int(np.sum(far)) > frequency_hz.size:
            found.append(mean_delay(frequency_hz[far], values[far])[0])
    return found


def _closer(f: FloatArray, s: ComplexArray, delay_s: float) -> float:
    """The delay near by that leaves least, s."""
    best, span = delay_s, float(np.ptp(f))
    for closer in range(1, CLOSER + 1):
        near = best + np.arange(-4, 5) / (PER_SPAN * span * 4.0**closer)
        best = float(near[int(np.argmin([_line(f, s, float(tau)).left for tau in near]))])
    return best


def _no_line(f: FloatArray, value: complex, delay_s: float) -> ComplexLine:
    middle = 0.5 * float(f[0] + f[-1])
    return ComplexLine(
        eta_hz=middle, width_hz=float("nan"), delay_s=delay_s, misfit=1.0, left=0.0, top=value
    )


def mean_delay(frequency_hz: FloatArray, values: ComplexArray) -> tuple[float, float]:
    """Delay by the mean turn between neighbours, s, and the span without gaps, Hz.

    A resonance changes it by one over that span at most.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit.
    """
    f, s = frequency_hz, values
    steps = np.diff(f)
    near = steps <= 1.5 * float(np.median(steps))
    turn = np.angle(np.sum((s[1:] * np.conj(s[:-1]))[near]))
    return float(-turn / (2.0 * np.pi * np.mean(steps[near]))), float(np.sum(steps[near]))


def rational(
    x: FloatArray, values: ComplexArray, poles: int, above: int
) -> tuple[ComplexArray, ComplexArray]:
    """Coefficients a (above,) and b (poles,) of a rational function, lowest power first.

    Args:
        x: from -1 to 1, shape (n,).
        values: shape (n,), of order one.
        poles: number of poles, p.
        above: number of coefficients of the numerator.
    """
    powers = x[:, None] ** np.arange(max(above, poles + 1))
    below = powers[:, 1 : poles + 1]
    columns = np.concatenate([powers[:, :above] + 0j, -below * values[:, None]], axis=1)
    weights, found = np.ones_like(x), np.zeros(above + poles, dtype=complex)
    for _ in range(ROUNDS):
        found = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)[0]
        weights = 1.0 / np.maximum(np.abs(1.0 + below @ found[above:]), 1e-12)
    return found[:above], found[above:]


def poles(frequency_hz: FloatArray, values: ComplexArray, count: int) -> list[tuple[float, float]]:
    """Frequencies and full widths of so many poles on a complex constant, Hz, seen ones first.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit, the delay of a cable taken off.
        count: number of poles.
    """
    middle, half = (
        0.5 * float(frequency_hz[0] + frequency_hz[-1]),
        0.5 * float(np.ptp(frequency_hz)),
    )
    x = (frequency_hz - middle) / half
    _, below = rational(x, values / np.max(np.abs(values)), count, count + 1)
    found = [p for p in np.roots([*below[::-1], 1.0]) if np.isfinite(p)]
    found.sort(key=lambda p: (abs(p.real) > 1.0, p.real))
    return [(middle + half * float(p.real), 2.0 * half * abs(float(p.imag))) for p in found]


def _line(f: FloatArray, s: ComplexArray, delay_s: float) -> ComplexLine:
    middle, half = 0.5 * float(f[0] + f[-1]), 0.5 * float(f[-1] - f[0])
    x = (f - middle) / half
    z = s * np.exp(2j * np.pi * (f - middle) * delay_s)
    (top, slope), (bottom,) = rational(x, z, 1, 2)
    rms = float(np.sqrt(np.mean(np.abs((top + slope * x) / (1.0 + bottom * x) - z) ** 2)))
    spread = float(np.sqrt(np.mean(np.abs(z - np.mean(z)) ** 2)))
    pole = middle - half / bottom if bottom != 0.0 else complex(middle, np.inf)
    resonant = (pole.real - middle) / half
    return ComplexLine(
        top=complex((top + slope * resonant) / (1.0 + bottom * resonant)),
        eta_hz=float(pole.real),
        width_hz=2.0 * float(pole.imag),
        delay_s=delay_s,
        misfit=rms / max(spread, 1e-300),
        left=rms,
    )
