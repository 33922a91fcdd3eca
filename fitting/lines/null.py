"""What a sweep without a resonance looks like: models that a line has to be better than.

straight    b + b' x                                 of amplitudes, or complex
delay       b e                                      a cable, e as in `fitting.lines.sweep_model`
pole        c/(1 + i f/fc) + b, with and without e   a low-pass or high-pass filter
flank       |a g| with its eigenfrequency beyond the ends, of amplitudes
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fitting.lines.solve import Columns, Model, fit_model
from fitting.lines.sweep_model import AmplitudeSweep, ComplexSweep, Place, Shapes, along
from fitting.text.arrays import ComplexArray, FloatArray

#: Share of the span by which a flank's line starts beyond an end, and its width.
BEYOND = 0.1


class NullKind(Enum):
    """What describes a sweep that shows no resonance."""

    STRAIGHT = "straight line"
    DELAY = "delay"
    POLE = "first-order pole"
    FLANK = "flank of a line beyond an end"


@dataclass(frozen=True)
class Null:
    """A model without a resonance as fitted: squares over the largest value, unknowns, place.

    ``place`` is the line of a flank, or the corner frequency of a pole.
    """

    kind: NullKind
    squares: float
    unknowns: int
    place: Place | None = None


@dataclass(frozen=True, eq=False)
class _Pole:
    """A filter of first order; x: logarithm of the corner over the start, then the delay."""

    f: FloatArray
    corner_hz: float
    delay: ComplexSweep | None = None

    def corner(self, x: FloatArray) -> float:
        return self.corner_hz * math.exp(float(np.clip(x[0], -40.0, 40.0)))

    def columns(self, x: FloatArray) -> Columns:
        ratio = 1j * self.f / self.corner(x)
        pole = 1.0 / (1.0 + ratio)
        slope = ratio * pole**2  # by the logarithm of the corner
        ones = np.ones_like(pole)
        values, slopes = np.stack([pole, ones], 1), np.stack([slope, 0.0 * ones], 1)[None]
        if self.delay is None:
            return Columns(values, slopes)
        turn = self.delay.columns(x[1:])
        by_delay = values * turn.slopes[0]
        return Columns(values * turn.values, np.concatenate([slopes * turn.values, by_delay[None]]))


@dataclass(frozen=True, eq=False)
class _PoleSize(_Pole):
    """The modulus of a low-pass or of a high-pass; x: logarithm of the corner over the start."""

    high: bool = False

    def columns(self, x: FloatArray) -> Columns:
        ratio = self.f / self.corner(x)
        low = 1.0 / np.sqrt(1.0 + ratio**2)
        size = ratio * low if self.high else low
        slope = -size * low**2 if self.high else size * (ratio * low) ** 2
        return Columns(size[:, None], slope[None, :, None])


def null_models(
    frequency_hz: FloatArray,
    values: FloatArray | ComplexArray,
    delays_s: Sequence[float] = (),
    elsewhere: Sequence[Place] = (),
    weights: FloatArray | None = None,
) -> list[Null]:
    """Every model without a resonance, fitted.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes or complex values, shape (n,).
        delays_s: where the delay of a cable may start, s.
        elsewhere: where lines beyond the ends are observed.
        weights: relative ones of the values, (n,).
    """
    f, y = frequency_hz, values / float(np.max(np.abs(values)))
    corner, nulls = math.sqrt(float(f[0]) * float(f[-1])), []

    def attempt(kind: NullKind, model: Model, starts: Sequence[FloatArray]) -> None:
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            fit = fit_model(model, y, starts, weights=weights)
            place = None
            if isinstance(model, _Pole):
                place = Place(model.corner(fit.x), math.nan)
            elif isinstance(model, AmplitudeSweep):
                place = model.shapes.places(fit.x)[0]
                if f[0] < place.frequency_hz < f[-1] or not fit.coefficients[0] > 0.0:
                    return
            nulls.append(Null(kind, fit.squares, fit.unknowns, place))

    if np.iscomplexobj(y):
        nothing, span = Shapes(frequency_hz=f, starts=[]), float(np.ptp(f))
        attempt(NullKind.STRAIGHT, ComplexSweep(shapes=nothing, background=2), [np.zeros(0)])
        delays = list(dict.fromkeys([0.0, *delays_s]))
        cable = ComplexSweep(shapes=nothing, background=1, delay_s=0.0)
        attempt(NullKind.DELAY, cable, [np.array([delay * span]) for delay in delays])
        corners = np.linspace(-2.0, 2.0, 9)
        attempt(NullKind.POLE, _Pole(f, corner), [np.array([c]) for c in corners])
        starts = [np.array([c, delay * span]) for c in corners for delay in delays]
        attempt(NullKind.POLE, _Pole(f, corner, cable), starts)
        return nulls

    w = np.ones_like(f) if weights is None else weights
    design = np.stack([w, w * along(f)], axis=1)
    left = w * y - design @ np.linalg.lstsq(design, w * y, rcond=None)[0]
    nulls.append(Null(NullKind.STRAIGHT, float(left @ left), 2))
    for high in (False, True):
        starts = [np.array([c]) for c in np.linspace(-2.0, 2.0, 5)]
        attempt(NullKind.POLE, _PoleSize(f, corner, high=high), starts)
    for end in elsewhere or beyond_ends(f):
        line = AmplitudeSweep(shapes=Shapes(frequency_hz=f, starts=[end]))
        attempt(NullKind.FLANK, line, [np.zeros(2)])
    return nulls


def beyond_ends(frequency_hz: FloatArray) -> list[Place]:
    """Where a line may be of which nothing is known: right beyond either end.

    Args:
        frequency_hz: of the points, rising, shape (n,), Hz.
    """
    width = BEYOND * float(np.ptp(frequency_hz))
    ends = float(frequency_hz[0]) - width, float(frequency_hz[-1]) + width
    return [Place(end, width) for end in ends]
