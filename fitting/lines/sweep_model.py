"""The response over frequency as shapes and terms: what is fitted to a sweep.

    complex      S = e (sum_k a_k g_k + b + b' x)                    a, b, b' complex
    amplitudes   R = a D(|g + sum_k r_k g_k + beta|) + c + c' x      a, c, c' real

    e = exp(-i 2 pi (f - f0) tau)     x = (f - f0)/half the span     f0 the middle of the sweep

g is a Lorentzian or a Duffing line (`fitting.lines.lorentzian`, `fitting.lines.duffing`), r_k the
complex height of another line over that of the first, beta a complex background over a. D is what
a detector makes of it: |h|; sqrt(|h|^2 + v) where noise powers were averaged, v that of the noise
over a^2; the mean of |h + noise| with the same noise; or the power |h|^2. All but g, r, beta, v and
tau is linear.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fitting.lines.duffing import duffing
from fitting.lines.lorentzian import Response, lorentzian
from fitting.lines.solve import Columns
from fitting.signal.roughness import rician
from fitting.text.arrays import ComplexArray, FloatArray

#: Largest logarithm of a factor on a width.
MOST = 40.0
#: Detectors: none, powers averaged, amplitudes averaged, and one that shows the power itself.
PLAIN, POWER, MEAN, SQUARE = "plain", "power", "mean", "square"


class Place(NamedTuple):
    """Where a line is: frequency and FWHM, Hz; of a start, or of a result."""

    frequency_hz: float
    width_hz: float


def along(frequency_hz: FloatArray) -> FloatArray:
    """From -1 at the first frequency to 1 at the last one, shape (n,).

    Args:
        frequency_hz: frequencies (n,), Hz.
    """
    first, last = float(frequency_hz[0]), float(frequency_hz[-1])
    return np.asarray((2.0 * frequency_hz - first - last) / max(last - first, math.ulp(last)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Shapes:
    """Lines at unknown places: x has, for each, shift over the start's width and log width over it.

    Attributes:
        frequency_hz: rising, shape (n,), Hz.
        starts: where each line begins.
        bent: whether the first line is a Duffing oscillator's; its bend comes last, in half widths.
    """

    frequency_hz: FloatArray
    starts: Sequence[Place]
    bent: bool = False

    @property
    def count(self) -> int:
        """Unknowns of the lines."""
        return 2 * len(self.starts) + self.bent

    def places(self, x: FloatArray) -> list[Place]:
        """Where the lines are at x."""
        return [
            Place(
                start.frequency_hz + start.width_hz * float(x[2 * k]),
                start.width_hz * math.exp(float(np.clip(x[2 * k + 1], -MOST, MOST))),
            )
            for k, start in enumerate(self.starts)
        ]

    def at(self, places: Sequence[Place]) -> FloatArray:
        """The x of the lines at some places."""
        return np.array(
            [
                part
                for start, place in zip(self.starts, places, strict=True)
                for part in (
                    (place.frequency_hz - start.frequency_hz) / start.width_hz,
                    math.log(place.width_hz / start.width_hz),
                )
            ]
        )

    def responses(self, x: FloatArray) -> list[Response]:
        """Every line with its derivatives by all unknowns of the lines, (count, n)."""
        made = []
        for k, place in enumerate(self.places(x)):
            at = place.frequency_hz, place.width_hz
            if k == 0 and self.bent:
                bend = float(x[2 * len(self.starts)])
                line = duffing(self.frequency_hz, *at, bend)
            else:
                line = lorentzian(self.frequency_hz, *at)
            slopes = np.zeros((self.count, self.frequency_hz.size), dtype=complex)
            slopes[2 * k] = line.slopes[0] * self.starts[k].width_hz
            slopes[2 * k + 1] = line.slopes[1]
            if line.slopes.shape[0] > 2:
                slopes[-1] = line.slopes[2]
            made.append(Response(line.values, slopes))
        return made


@dataclass(frozen=True, kw_only=True, eq=False)
class ComplexSweep:
    """Complex values; x: the lines, then the delay over one over the span, if it is fitted.

    Attributes:
        shapes: the lines; each has a complex height of its own.
        background: 0 none, 1 a complex constant, 2 a slope, too.
        delay_s: where the delay begins; None: there is none.
        tails: lines elsewhere whose places are known, (n,) each.
    """

    shapes: Shapes
    background: int = 0
    delay_s: float | None = None
    tails: Sequence[ComplexArray] = ()

    @property
    def count(self) -> int:
        """Unknowns that do not enter linearly."""
        return self.shapes.count + (self.delay_s is not None)

    def delay(self, x: FloatArray) -> float:
        """Delay at x, s; NaN where there is none."""
        if self.delay_s is None:
            return math.nan
        return self.delay_s + float(x[-1]) / float(np.ptp(self.shapes.frequency_hz))

    def columns(self, x: FloatArray) -> Columns:
        """Columns e g_k, e, x e, and e times each tail."""
        f = self.shapes.frequency_hz
        lines = self.shapes.responses(x) if self.shapes.starts else []
        run = along(f)
        fixed = [np.ones_like(run), run][: self.background] + list(self.tails)
        values = np.stack([*(line.values for line in lines), *fixed], axis=1).astype(complex)
        slopes = np.zeros((self.count, *values.shape), dtype=complex)
        for k, line in enumerate(lines):
            slopes[: self.shapes.count, :, k] = line.slopes
        if self.delay_s is not None:
            half = 0.5 * float(np.ptp(f))
            turn = np.exp(-2j * np.pi * half * run * self.delay(x))[:, None]
            values, slopes = values * turn, slopes * turn
            slopes[-1] = values * (-1j * np.pi * run)[:, None]  # 2 pi (f - f0)/span = pi run
        return Columns(values, slopes)


@dataclass(frozen=True, kw_only=True, eq=False)
class AmplitudeSweep:
    """Amplitudes; x: the lines, both parts of r of each further line, of beta, and v.

    Attributes:
        shapes: the lines.
        phased: whether a complex background beta is there.
        detector: `PLAIN`, `POWER`, `MEAN` or `SQUARE`.
        added: 0 nothing, 1 a constant, 2 a slope, too.
    """

    shapes: Shapes
    phased: bool = False
    detector: str = PLAIN
    added: int = 0
    _run: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_run", along(self.shapes.frequency_hz))

    @property
    def count(self) -> int:
        """Unknowns that do not enter linearly."""
        further = 2 * (len(self.shapes.starts) - 1)
        return self.shapes.count + further + 2 * self.phased + self.is_noisy

    @property
    def is_noisy(self) -> bool:
        """Whether the power of a noise is an unknown."""
        return self.detector in (POWER, MEAN)

    def heights(self, x: FloatArray) -> list[complex]:
        """Complex heights over that of the first line: of each further one, then of beta."""
        first = self.shapes.count
        count = len(self.shapes.starts) - 1 + self.phased
        return [complex(x[first + 2 * k], x[first + 2 * k + 1]) for k in range(count)]

    def columns(self, x: FloatArray) -> Columns:
        """Columns D, 1, x."""
        lines = self.shapes.responses(x)
        wave = lines[0].values
        slopes = np.zeros((self.count, wave.size), dtype=complex)
        own = self.shapes.count
        slopes[:own] = lines[0].slopes
        ones = np.ones_like(wave)
        others = [
            *lines[1:],
            *([Response(ones, np.zeros((own, wave.size), dtype=complex))] * self.phased),
        ]
        for k, (height, other) in enumerate(zip(self.heights(x), others, strict=True)):
            wave = wave + height * other.values
            slopes[:own] += height * other.slopes
            slopes[own + 2 * k] = other.values
            slopes[own + 2 * k + 1] = 1j * other.values
        size = np.abs(wave)
        safe = np.maximum(size, np.finfo(float).tiny)
        by_x = (np.conj(wave) * slopes).real / safe
        if self.detector == SQUARE:
            size, by_x = size**2, 2.0 * size * by_x
        elif self.is_noisy:
            size, by_x = _detected(size, by_x, float(x[-1]), self.detector)
        values = np.stack([size, np.ones_like(size), self._run][: 1 + self.added], axis=1)
        moved = np.zeros((self.count, *values.shape))
        moved[:, :, 0] = by_x
        return Columns(values, moved)


def _detected(
    size: FloatArray, slopes: FloatArray, power: float, detector: str
) -> tuple[FloatArray, FloatArray]:
    """Detected amplitudes (n,) in noise of a power, and their slopes (q, n), the last by it."""
    slopes = slopes.copy()
    if detector == POWER:
        detected = np.sqrt(np.maximum(size**2 + power, np.finfo(float).tiny))
        slopes *= size / detected
        slopes[-1] = 0.5 / detected
        return detected, slopes
    sigma = math.sqrt(0.5 * max(abs(power), 1e-18))
    mean, slope, rise = rician(size, sigma)
    slopes *= slope
    slopes[-1] = math.copysign(0.5, power) * rise  # sigma^2 is half of it
    return mean, slopes
