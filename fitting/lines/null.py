"""What a sweep without a resonance looks like: models that a line has to be better than.

straight    b + b' x                                 of amplitudes, or complex
delay       b e                                      a cable, e as in `fitting.lines.sweep_model`
pole        c/(1 + i f/fc) + b, with and without e   a low-pass or high-pass filter
flank       |a g| with its eigenfrequency beyond the ends, of amplitudes
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fitting.lines.solve import Columns, Fit, fit_model
from fitting.lines.sweep_model import AmplitudeSweep, ComplexSweep, Place, Shapes, along
from fitting.text.arrays import ComplexArray, FloatArray

#: Share of the span by which a flank's line begins beyond an end, and its width.
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
    delay: ComplexSweep | None

    def columns(self, x: FloatArray) -> Columns:
        ratio = 1j * self.f / (self.corner_hz * math.exp(float(np.clip(x[0], -40.0, 40.0))))
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
class _PoleSize:
    """The modulus of a low-pass or of a high-pass; x: logarithm of the corner over the start."""

    f: FloatArray
    corner_hz: float
    high: bool

    def columns(self, x: FloatArray) -> Columns:
        ratio = self.f / (self.corner_hz * math.exp(float(np.clip(x[0], -40.0, 40.0))))
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
        delays_s: where the delay of a cable may begin, s.
        elsewhere: where lines beyond the ends are observed.
        weights: relative ones of the values, (n,).
    """
    y = values / float(np.max(np.abs(values)))
    if np.iscomplexobj(y):
        return list(_complex(frequency_hz, np.asarray(y, dtype=complex), delays_s, weights))
    return list(_amplitudes(frequency_hz, np.asarray(y, dtype=float), elsewhere, weights))


def _complex(
    f: FloatArray, y: ComplexArray, delays_s: Sequence[float], weights: FloatArray | None
) -> Iterator[Null]:
    nothing = Shapes(frequency_hz=f, starts=[])
    straight = fit_model(
        ComplexSweep(shapes=nothing, background=2), y, [np.zeros(0)], weights=weights
    )
    yield Null(NullKind.STRAIGHT, straight.squares, straight.unknowns)
    delays = list(dict.fromkeys([0.0, *delays_s]))
    with contextlib.suppress(ValueError, np.linalg.LinAlgError):
        model = ComplexSweep(shapes=nothing, background=1, delay_s=0.0)
        starts = [np.array([delay * float(np.ptp(f))]) for delay in delays]
        fit = fit_model(model, y, starts, weights=weights)
        yield Null(NullKind.DELAY, fit.squares, fit.unknowns)
    corners = np.linspace(-2.0, 2.0, 9)
    corner = math.sqrt(float(f[0]) * float(f[-1]))
    for delay in (None, ComplexSweep(shapes=nothing, background=1, delay_s=0.0)):
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            starts = [
                np.array([c] if delay is None else [c, at * float(np.ptp(f))])
                for c in corners
                for at in ([0.0] if delay is None else delays)
            ]
            pole = _Pole(f, corner, delay)
            fit = fit_model(pole, y, starts, weights=weights)
            place = Place(corner * math.exp(float(np.clip(fit.x[0], -40.0, 40.0))), math.nan)
            yield Null(NullKind.POLE, fit.squares, fit.unknowns, place)


def _amplitudes(
    f: FloatArray, y: FloatArray, elsewhere: Sequence[Place], weights: FloatArray | None
) -> Iterator[Null]:
    w = np.ones_like(f) if weights is None else weights
    design = np.stack([w, w * along(f)], axis=1)
    left = w * y - design @ np.linalg.lstsq(design, w * y, rcond=None)[0]
    yield Null(NullKind.STRAIGHT, float(left @ left), 2)
    corner = math.sqrt(float(f[0]) * float(f[-1]))
    for high in (False, True):
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            starts = [np.array([c]) for c in np.linspace(-2.0, 2.0, 5)]
            fit = fit_model(_PoleSize(f, corner, high), y, starts, weights=weights)
            place = Place(corner * math.exp(float(np.clip(fit.x[0], -40.0, 40.0))), math.nan)
            yield Null(NullKind.POLE, fit.squares, fit.unknowns, place)
    for place in elsewhere or beyond_ends(f):
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            model = AmplitudeSweep(shapes=Shapes(frequency_hz=f, starts=[place]))
            fit = fit_model(model, y, [np.zeros(2)], weights=weights)
            end = model.shapes.places(fit.x)[0]
            if not f[0] < end.frequency_hz < f[-1] and _is_height(fit):
                yield Null(NullKind.FLANK, fit.squares, fit.unknowns, end)


def _is_height(fit: Fit) -> bool:
    return bool(fit.coefficients[0] > 0.0)


def beyond_ends(frequency_hz: FloatArray) -> list[Place]:
    """Where a line may be of which nothing is known: right beyond either end.

    Args:
        frequency_hz: of the points, rising, shape (n,), Hz.
    """
    width = BEYOND * float(np.ptp(frequency_hz))
    ends = float(frequency_hz[0]) - width, float(frequency_hz[-1]) + width
    return [Place(end, width) for end in ends]
