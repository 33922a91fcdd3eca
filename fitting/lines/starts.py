"""Where the fit of a line may begin: tops, bottoms, and linear least squares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.lines.poles import (
    NEAR,
    ComplexLine,
    complex_line,
    far_delays,
    tops_and_bottoms,
)
from fitting.lines.sweep_model import Place
from fitting.signal.peaks import mode_response
from fitting.text.arrays import ComplexArray, FloatArray

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
    for delay in delays:
        places += [(line.eta_hz, abs(line.width_hz)) for line in _lines(f, values, widths, delay)]
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


def _lines(
    f: FloatArray, values: ComplexArray, widths: Mapping[float, float], delay_s: float
) -> list[ComplexLine]:
    """Lines by linear least squares: of all points, and of those about a top and a bottom."""
    lines = [complex_line(f, values, delay_s)]
    for eta, width in widths.items():
        near = np.abs(f - eta) <= NEAR * width
        if LEAST_NEAR <= int(np.sum(near)) < f.size:
            lines.append(complex_line(f[near], values[near], delay_s))
    return lines


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
