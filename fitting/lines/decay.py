"""Free decays over time: shape, terms, and where their fits start.

    z(t) = q^(-1/2) exp(-pi w t + 2 pi i (f t + s ln(q)/(2 pi v)))
    q = 1 + 2 pi v T          T = (1 - exp(-2 pi w t))/(2 pi w)

solves z' = (-pi (w + v |z|^2) + 2 pi i (f + s |z|^2)) z from z = 1: w is the FWHM of small
amplitudes, and at the first sample v comes on top of it and the frequency is moved by s, as that of
a Duffing oscillator is. Without v the turns by s are s T.

    samples      y = Re sum_k c_k z_k + c            c real
    phasors      y =    sum_k c_k z_k + c            c complex, frequencies from the reference
    amplitudes   R = a |z| + c                       or its mean in Rice's noise, without c

The c_k and c are linear.

Source: A. Nayfeh and D. Mook, Nonlinear Oscillations (1979), sections 2.2 and 3.2, by averaging.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitting.lines.lorentzian import Response
from fitting.lines.solve import Array, Columns, Fit, fit_model
from fitting.lines.trace import AMPLITUDES, PHASORS, SAMPLES
from fitting.text.arrays import ComplexArray, FloatArray

#: Widths over one over the record beyond which exponentials overflow.
WIDEST = 200.0
#: Size below which a ratio of differences is its series, and least q, beyond which the law has no
#: solution.
SMALL, LEAST = 1e-4, 1e-12
#: Fewest turns of a line of samples over the record.
FEWEST = 2.0
#: Widths over one over the record with which a line starts.
WIDTHS = np.exp([-1.0, 0.0, 1.0, 2.0, 3.5, 5.0])
#: Samples from which a moved line is looked for, at most, as means of neighbours.
MOST = 2048
#: Shifts of the frequency over the FWHM that are tried, and FWHM over that of a line without.
SHIFTS = np.concatenate([-np.arange(0.5, 40.5, 0.5), np.arange(0.5, 40.5, 0.5)])
MOVED_WIDTHS = (0.6, 1.0, 1.6)
#: Share of the FWHM of an exponential that is left, and extra widths over it, that are tried.
LEFT, EXTRA = 0.5, (0.5, 2.0, 8.0)
#: Starts from which such a line is fitted.
TRIES = 2


def decay(
    t: FloatArray, turns: float, width: float, shift: float = 0.0, extra: float = 0.0
) -> Response:
    """z with its derivatives by f, w, s and v, (4, n).

    Args:
        t: times over the length of the record, from zero, (n,).
        turns: f, turns over the record.
        width: w, over one over the record; negative of what grows.
        shift: s, turns over the record.
        extra: v, over one over the record.
    """
    width = float(np.clip(width, -WIDEST, WIDEST))
    rate = 2.0 * math.pi * width
    if abs(rate) < SMALL:
        at = rate * t
        passed = t * (1.0 - at / 2.0 + at**2 / 6.0)
        by_width = 2.0 * math.pi * t**2 * (-0.5 + at / 3.0 - at**2 / 8.0)
    else:
        passed = -np.expm1(-rate * t) / rate
        by_width = (t * np.exp(-rate * t) - passed) / width
    grown = 2.0 * math.pi * extra * passed
    q = np.maximum(1.0 + grown, LEAST)
    if abs(2.0 * math.pi * extra) < SMALL:
        moved = passed * (1.0 - grown / 2.0 + grown**2 / 3.0)
        by_extra = 2.0 * math.pi * passed**2 * (-0.5 + 2.0 * grown / 3.0 - 0.75 * grown**2)
    else:
        moved = np.log(q) / (2.0 * math.pi * extra)
        by_extra = (passed / q - moved) / extra
    rotated = np.exp(-math.pi * width * t + 2j * math.pi * (turns * t + shift * moved))
    z = np.asarray(rotated / np.sqrt(q), dtype=complex)
    slopes = (
        2j * math.pi * t,
        -math.pi * t + (-math.pi * extra + 2j * math.pi * shift) * by_width / q,
        2j * math.pi * moved,
        -math.pi * passed / q + 2j * math.pi * shift * by_extra,
    )
    return Response(z, np.stack([np.asarray(slope * z, dtype=complex) for slope in slopes]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Decays:
    """Decaying lines; x: turns and width of each over the record, then shift and extra width.

    Amplitudes have no turns. Shift and extra width are those of the first line.

    Attributes:
        samples: of the record.
        kind: what was recorded, see `fitting.lines.trace.KINDS`.
        lines: how many.
        constant: whether there is one.
        moves: whether the frequency follows the amplitude.
        damps: whether the damping follows the amplitude.
    """

    samples: int
    kind: str
    lines: int = 1
    constant: bool = True
    moves: bool = False
    damps: bool = False

    @property
    def each(self) -> int:
        """Unknowns of a line that do not enter linearly."""
        return 1 if self.kind == AMPLITUDES else 2

    @property
    def count(self) -> int:
        """Unknowns that do not enter linearly."""
        return self.each * self.lines + self.moves + self.damps

    @cached_property
    def t(self) -> FloatArray:
        """Times over the length of the record, (n,)."""
        return np.arange(self.samples) / self.samples

    def at(self, x: FloatArray, k: int) -> tuple[float, float, float, float]:
        """Turns, width, shift and extra width of a line at x."""
        place = x[self.each * k : self.each * (k + 1)]
        turns = 0.0 if self.kind == AMPLITUDES else float(place[0])
        law = iter(x[self.each * self.lines :]) if k == 0 else iter(())
        shift = float(next(law)) if self.moves and k == 0 else 0.0
        extra = float(next(law)) if self.damps and k == 0 else 0.0
        return turns, float(place[-1]), shift, extra

    def waves(self, x: FloatArray) -> list[Response]:
        """Every z with its derivatives by all of x, (count, n)."""
        made = []
        for k in range(self.lines):
            wave = decay(self.t, *self.at(x, k))
            slopes = np.zeros((self.count, self.samples), dtype=complex)
            place = wave.slopes[2 - self.each : 2]
            slopes[self.each * k : self.each * (k + 1)] = place
            if k == 0:
                slopes[self.each * self.lines :] = wave.slopes[2:][[self.moves, self.damps]]
            made.append(Response(wave.values, slopes))
        return made

    def columns(self, x: FloatArray) -> Columns:
        """Columns z_k, of samples both parts of it, and 1."""
        waves = self.waves(x)
        if self.kind == SAMPLES:
            waves = [Response(f * v, f * s) for v, s in waves for f in (1.0, 1j)]
        if self.constant:
            one = np.ones(self.samples, dtype=complex)
            waves.append(Response(one, np.zeros((self.count, self.samples), dtype=complex)))
        values = np.stack([wave.values for wave in waves], axis=1)
        slopes = np.stack([wave.slopes for wave in waves], axis=2)
        if self.kind == PHASORS:
            return Columns(values, slopes)
        return Columns(values.real, slopes.real)


def fit_decays(model: Decays, values: Array, near: Fit | None = None) -> Fit:
    """The lines that leave least; each further one starts where the others leave most.

    Args:
        model: without shift and extra width.
        values: of the record over the largest one, (n,).
        near: a fit of fewer lines with which it starts; None: none.

    Raises:
        ValueError: fewer values than unknowns, or a line of samples that hardly oscillates.
    """
    x, fit = np.empty(0) if near is None else near.x, near
    for lines in range(1 + x.size // model.each, model.lines + 1):
        part = replace(model, lines=lines)
        if fit is not None:
            rest = values - fit.curve
        else:  # a constant has no place among lines of samples, which oscillate about it
            rest = values - np.mean(values) if model.kind == SAMPLES else values
        starts = []
        for width in WIDTHS:
            turns: list[float] = []
            if model.kind != AMPLITUDES:  # where the spectrum of the residuals is highest
                under = np.exp(-np.pi * float(width) * model.t)
                turns = [_highest(rest * under, is_real=model.kind == SAMPLES)[0]]
            starts.append(np.array([*x, *turns, float(width)]))
        fit = fit_model(part, values, starts)
        x = fit.x
    if fit is None:
        raise ValueError("no line")
    if model.kind == SAMPLES and np.any(np.abs(x[::2]) < FEWEST):
        raise ValueError("a line that hardly oscillates")
    return fit


def _highest(values: Array, *, is_real: bool) -> tuple[float, float]:
    """Turns over the record where the spectrum of values (n,) is highest, and how high."""
    size = 2 * values.size
    sizes = np.abs(np.fft.fft(values, size))
    if is_real:  # its other half is that of the conjugate, which turns backwards
        sizes[: int(2 * FEWEST)] = 0.0
        sizes = sizes[: values.size + 1]
    at = int(np.argmax(sizes))
    return 0.5 * (at if at <= values.size else at - size), float(sizes[at])


def fit_law(model: Decays, values: Array, near: Fit) -> Fit:
    """A line of which frequency or damping follow the amplitude.

    Args:
        model: one line that moves, or damps, or both.
        values: of the record over the largest one, (n,).
        near: the fit of one line that does neither, or moves.
    """
    x = near.x
    starts = [x]
    if model.moves and x.size == model.each:
        starts = [np.append(x, 0.0), _moved(model, values, x)]
    if model.damps:
        width = model.each - 1
        starts = [
            np.array([*x[:width], LEFT * x[width], *x[width + 1 :], extra * x[width]])
            for x in starts
            for extra in EXTRA
        ]
    return fit_model(model, values, starts, tries=TRIES)


def _moved(model: Decays, values: Array, place: FloatArray) -> FloatArray:
    """Turns, width and shift whose undoing makes the spectrum highest."""
    each = -(-values.size // MOST)
    count = values.size // each
    t = model.t[: count * each]
    rotated = (values - np.mean(values))[: count * each] * np.exp(-2j * np.pi * float(place[0]) * t)
    slow: ComplexArray = rotated.reshape(count, each).mean(axis=1)
    t = t.reshape(count, each).mean(axis=1)
    best = -np.inf, np.append(place, 0.0)
    for width in np.abs(place[1]) * np.array(MOVED_WIDTHS):
        passed = -np.expm1(-2.0 * np.pi * width * t) / (2.0 * np.pi * width)
        under = np.exp(-np.pi * width * t)
        under = under / np.linalg.norm(under)
        for shift in width * SHIFTS:
            back = slow * under * np.exp(-2j * np.pi * shift * passed)
            turns, height = _highest(back, is_real=False)
            if height > best[0]:
                best = height, np.array([float(place[0]) + turns, width, shift])
    return best[1]
