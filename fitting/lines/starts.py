"""Where the fit of a line may start: tops, bottoms, and linear least squares of poles.

    S(u) exp(i 2 pi u tau) = (a0 + a1 x + a2 x^2 ...)/(1 + b1 x + ... + bp x^p)

Its p poles are damped modes, eta + i w/2 for responses that count phases as exp(+i 2 pi u t), each
observed through a complex gain of its own: with p coefficients above nothing is next to them, with
p + 1 a complex constant. x is (u - u0)/half the span, u0 the middle of the sweep, tau a cable's
delay.

Source: C. Sanathanan and J. Koerner, IEEE Trans. Autom. Control 8 (1963) 56.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.lorentzian import mode_response
from fitting.lines.sweep_model import Place
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
OVER_GAPS = 8
#: Widths about a top or a bottom of which a line is guessed.
NEAR = 4.0
#: Median of the modulus of a normal deviate, and deviation of a second difference of noise.
NORMAL_MEDIAN, SECOND_DIFFERENCE = 0.6745, math.sqrt(6.0)
#: Points about a top or a bottom of which a line is guessed, at least.
LEAST_NEAR = 8
#: Starts of complex values that are passed on, of those with and without a delay.
PROMISING = 4


@dataclass(frozen=True)
class Start:
    """Where a fit may begin.

    Attributes:
        frequency_hz: of the line, Hz.
        width_hz: its FWHM, Hz.
        delay_s: of the cable, s.
        background: a complex constant over the line's height.
        others: further lines, each with its complex height over that of the first.
        bend: of a Duffing line, half widths; NaN: several are tried.
    """

    frequency_hz: float
    width_hz: float
    delay_s: float = 0.0
    background: complex = 0j
    others: tuple[tuple[Place, complex], ...] = ()
    bend: float = math.nan


def point_noise(values: FloatArray) -> float:
    """Standard deviation of a point, from the median of second differences, unit of the points.

    Args:
        values: along a smooth curve, shape (n,).
    """
    differences = np.abs(np.diff(values, 2))
    return float(np.median(differences)) / NORMAL_MEDIAN / SECOND_DIFFERENCE


def amplitude_starts(
    frequency_hz: FloatArray, amplitude: FloatArray, phased: bool = False
) -> list[Start]:
    """Crest and the width of the region above 1/sqrt(2) of it; of phased forms the dip, too.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
        phased: whether a line may take away from a background.
    """
    f, a = frequency_hz, amplitude
    spacing, top, bottom = float(np.median(np.diff(f))), int(np.argmax(a)), int(np.argmin(a))
    high = f[a >= a[top] / math.sqrt(2.0)]
    crest = Start(float(f[top]), max(float(high[-1] - high[0]), spacing))
    if not phased:
        return [crest]
    plateau = float(np.median(np.sort(a)[-5:]))
    low = f[a <= math.sqrt(0.5 * (float(a[bottom]) ** 2 + plateau**2))]
    depth = max(1.0 - float(a[bottom]) / max(plateau, np.finfo(float).tiny), 0.01)
    # g is -i at the eigenfrequency: what it is taken from
    width = max(float(low[-1] - low[0]), spacing) if low.size else spacing
    return [crest, Start(float(f[bottom]), width, background=1j / depth)]


def complex_starts(frequency_hz: FloatArray, values: ComplexArray) -> list[Start]:
    """Where fits to complex values may begin, the most promising ones.

    Every place and width of a top, a bottom, and of a line by linear least squares, behind every
    delay, are judged by what a line on a constant leaves.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
    """
    f = frequency_hz
    span, spacing = float(np.ptp(f)), float(np.median(np.diff(f)))
    widths = tops_and_bottoms(f, values)
    delays = dict.fromkeys((0.0, complex_line(f, values, None).delay_s, *far_delays(f, values)))
    places = [(eta, part * width) for eta, width in widths.items() for part in (0.5, 1.0, 2.0)]
    near = [np.abs(f - eta) <= NEAR * width for eta, width in widths.items()]
    parts = [np.full(f.size, True), *(n for n in near if LEAST_NEAR <= int(np.sum(n)) < f.size)]
    for delay in delays:  # lines of all points, and of those about a top and a bottom
        lines = [complex_line(f[part], values[part], delay) for part in parts]
        places += [(line.eta_hz, abs(line.width_hz)) for line in lines]
    starts = [
        Start(float(np.clip(eta, f[0], f[-1])), float(np.clip(width, spacing, span)), delay)
        for eta, width in places
        if math.isfinite(eta) and math.isfinite(width)
        for delay in delays
    ]
    squares = {start: squares_of(f, values, start) for start in starts}
    ranked = sorted(squares, key=squares.__getitem__)
    plain = [start for start in ranked if start.delay_s == 0.0][:PROMISING]
    return [*plain, *[start for start in ranked if start.delay_s != 0.0][:PROMISING]]


def squares_of(frequency_hz: FloatArray, values: ComplexArray, start: Start) -> float:
    """Sum of squares over the largest value that a line on a constant leaves at a start.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
        start: of the line and the delay.
    """
    f = frequency_hz
    turn = np.exp(2j * np.pi * (f - 0.5 * (f[0] + f[-1])) * start.delay_s)
    y = values / np.max(np.abs(values)) * turn
    line = mode_response(f, start.frequency_hz, start.width_hz)
    basis, _ = np.linalg.qr(np.stack([line, np.ones_like(line)], axis=1))
    left = y - basis @ (basis.conj().T @ y)
    return float(np.sum(left.real**2 + left.imag**2))


def bent_starts(frequency_hz: FloatArray, amplitude: FloatArray) -> list[Start]:
    """Duffing lines through the top and two points of either flank, as far as these are there.

    At a share s of the top's power x = b s -+ sqrt(1/s - 1), b and x in half widths: the distances
    from s = 1 to 1/2 and from 1/2 to 1/4 on the flank that leans are B/2 + W and
    B/4 + (sqrt(3) - 1) W, W half a width and B = b W.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
    """
    f, power = frequency_hz, (amplitude / float(np.max(amplitude))) ** 2
    top, made = int(np.argmax(power)), []
    for sign, flank in ((1.0, np.arange(top, -1, -1)), (-1.0, np.arange(top, f.size))):
        below = [int(np.argmax(power[flank] < share)) for share in (0.5, 0.25)]
        if 0 in below or below[0] == below[1]:
            continue
        half, quarter = (
            float(np.interp(share, power[flank[[k, k - 1]]], f[flank[[k, k - 1]]]))
            for share, k in zip((0.5, 0.25), below, strict=True)
        )
        first, second = abs(float(f[top]) - half), abs(half - quarter)
        width = (2.0 * second - first) / (2.0 * math.sqrt(3.0) - 3.0)
        if width > 0.0 and first > width:
            shift = 2.0 * (first - width)
            made.append(Start(float(f[top]) - sign * shift, 2.0 * width, bend=sign * shift / width))
    return made


@dataclass(frozen=True, kw_only=True)
class ComplexLine:
    """A mode in complex data: `eta_hz` and full width `width_hz`, behind a delay `delay_s`.

    The width is negative where phases are counted as exp(-i 2 pi u t). `left` is the residual,
    root mean square over the largest modulus, `misfit` over that of the data about their mean;
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
        return ComplexLine(
            eta_hz=0.5 * float(frequency_hz[0] + frequency_hz[-1]),
            width_hz=math.nan,
            delay_s=delay_s or 0.0,
            misfit=1.0,
            left=0.0,
            top=complex(values[0]),
        )
    f, s = frequency_hz, values / largest
    if delay_s is not None:
        line = _line(f, s, delay_s)
        return replace(line, top=line.top * largest)
    span = float(np.ptp(f))
    guess, measured_hz = mean_delay(f, s)
    tried = int(TRIED * min(max(1.0, span / measured_hz), MOST))
    steps = np.arange(-tried, tried + 1) / (PER_SPAN * span)
    misfits = [_line(f, s, guess + step).left for step in steps]
    # over a gap a turn more fits nearly as well: which one is decided close by alone
    order = np.argsort(misfits)[: OVER_GAPS if tried > TRIED else 1]
    ends = []
    for end in (*(guess + float(steps[k]) for k in order), *far_delays(f, s)):
        for closer in range(1, CLOSER + 1):
            near = end + np.arange(-4, 5) / (PER_SPAN * span * 4.0**closer)
            end = float(near[int(np.argmin([_line(f, s, float(tau)).left for tau in near]))])
        ends.append(end)
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
    wide line can look like a delay, and the narrow one is missed.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit.
    """
    delays = []
    for eta, width in tops_and_bottoms(frequency_hz, values).items():
        far = np.abs(frequency_hz - eta) > NEAR * width
        if 2 * int(np.sum(far)) > frequency_hz.size:
            delays.append(mean_delay(frequency_hz[far], values[far])[0])
    return delays


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
    weights, solved = np.ones_like(x), np.zeros(above + poles, dtype=complex)
    for _ in range(ROUNDS):
        solved = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)[0]
        weights = 1.0 / np.maximum(np.abs(1.0 + below @ solved[above:]), 1e-12)
    return solved[:above], solved[above:]


def poles(frequency_hz: FloatArray, values: ComplexArray, count: int) -> list[tuple[float, float]]:
    """Frequencies and full widths of poles on a complex constant, Hz, those among the points first.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit, the delay of a cable taken off.
        count: number of poles.
    """
    f = frequency_hz
    middle, half = 0.5 * float(f[0] + f[-1]), 0.5 * float(np.ptp(f))
    _, below = rational((f - middle) / half, values / np.max(np.abs(values)), count, count + 1)
    roots = [p for p in np.roots([*below[::-1], 1.0]) if np.isfinite(p)]
    roots.sort(key=lambda p: (abs(p.real) > 1.0, p.real))
    return [(middle + half * float(p.real), 2.0 * half * abs(float(p.imag))) for p in roots]


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
