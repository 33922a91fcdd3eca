"""What may be wrong with a sweep of amplitudes that ought to be one damped line.

Four faults that a line fitted blindly turns into a wrong width, each as one more number:

    power       L = A |g|^k                 decibels of the wrong kind: k = 2 or 1/2
    saturation  L = A |g| (1 - s |g|^2)     a detector, or a resonator, that gives way at the top,
                L = A tanh(|g| t)/t         softly, or up to a limit
    clipping    the largest points are equal
    outlier     one point is off the line of the others

and a complex background. A fault is listed where its number is far from none and its residuals are
noise; where no model leaves noise nothing is listed: the sweep may show more than one line. Two
lines that overlap look like many a fault: where they fit as well, that is stated with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from fitting.lines.choice import BY_CHANCE, gain_p
from fitting.lines.form import WIDEST
from fitting.lines.lorentzian import mode_response
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.lines.solve import Columns, Fit, fit_model
from fitting.lines.starts import amplitude_starts
from fitting.lines.sweep_model import AmplitudeSweep, Place, Shapes
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, STRUCTURED, white_noise_p
from fitting.text.arrays import FloatArray
from fitting.text.finding import Finding, Kind

#: Equal largest points that noise does not make.
CLIPPED_POINTS = 3
#: Widths between two lines, and of the second over the first, from which these are fitted.
APART, LIKE = (-6.0, -2.0, -0.6, 0.6, 2.0, 6.0), (1.0, 6.0, 0.15)
#: Width of the second line over the first at least: one point off is no second line.
NARROWEST = 0.125
#: Largest logarithm of a power.
MOST_POWER = 5.0


class Fault(Enum):
    """What is wrong with a sweep."""

    POWER = "power"
    SATURATION = "saturation"
    CLIPPING = "clipping"
    OUTLIER = "outlier"
    BACKGROUND = "background"


@dataclass(frozen=True, kw_only=True)
class SweepFault:
    """One fault of a sweep.

    `size`, with `std`: exponent k of a power, missing share of a saturated top (of the law that
    fits best) or above clipped points, distance of an outlier or background over the top.
    `width_hz`: FWHM without and with the fault; `p_value` of noise alone; `two_lines`: whether two
    overlapping lines leave only noise, too.
    """

    fault: Fault
    size: float
    std: float
    frequency_hz: float
    width_hz: tuple[float, float]
    p_value: float
    two_lines: bool = False


#: Kinds of findings on a sweep that is no line.
FAULTS = {
    Fault.POWER: Kind.sweep_power,
    Fault.SATURATION: Kind.sweep_saturated,
    Fault.CLIPPING: Kind.sweep_clipped,
    Fault.OUTLIER: Kind.sweep_outlier,
    Fault.BACKGROUND: Kind.sweep_background,
}


def fault_finding(fault: SweepFault, subject: str = "", *, gives_scale: bool = False) -> Finding:
    """What makes a sweep no damped line, as a finding.

    Args:
        fault: of the sweep.
        subject: name of its campaign, where there are several.
        gives_scale: whether the scale of peaks rests on the faulty top.
    """
    plain_hz, corrected_hz = fault.width_hz
    numbers = {
        "size": fault.size,
        "std": fault.std,
        "width_hz": plain_hz,
        "corrected_width_hz": corrected_hz,
        "two_lines": float(fault.two_lines),
        "gives_scale": float(gives_scale),
    }
    if not math.isnan(fault.frequency_hz):
        numbers["frequency_hz"] = fault.frequency_hz
    kind = FAULTS[fault.fault]
    return Finding(kind=kind, severity="warning", subject=subject, numbers=numbers)


#: What a fault makes of the sizes u of a line, with its derivatives by u and by its number, (n,).
Bent: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Law:
    """A fault as a law of the sizes |g|, with a number x.

    ``size`` is what is listed of x, with its derivative; ``noise`` what the fault makes of noise of
    one size, from the curve and the size.
    """

    fault: Fault
    law: Callable[[FloatArray, float], Bent]
    start: float
    size: Callable[[float], tuple[float, float]]
    noise: Callable[[FloatArray, float], FloatArray] = lambda line, _: np.ones(line.size)


def _power(u: FloatArray, x: float) -> Bent:
    k = math.exp(min(x, MOST_POWER))
    safe = np.maximum(u, np.finfo(float).tiny)
    values = safe**k
    return values, k * values / safe, k * values * np.log(safe)


def _softly(u: FloatArray, x: float) -> Bent:
    return u * (1.0 - x * u**2), 1.0 - 3.0 * x * u**2, -(u**3)


def _up_to_a_limit(u: FloatArray, x: float) -> Bent:
    t = x if abs(x) > 1e-9 else 1e-9
    bent, rise = np.tanh(u * t), 1.0 / np.cosh(np.minimum(np.abs(u * t), 300.0)) ** 2
    return bent / t, rise, (u * t * rise - bent) / t**2


def _missing(x: float) -> tuple[float, float]:
    t = max(abs(x), 1e-12)
    share = math.tanh(t) / t
    return 1.0 - share, math.copysign((share - 1.0 / math.cosh(min(t, 300.0)) ** 2) / t, x)


def _exponent(x: float) -> tuple[float, float]:
    k = math.exp(min(x, MOST_POWER))
    return k, k


def _of_a_power(line: FloatArray, exponent: float) -> FloatArray:
    """d(a^k) = k a^(k - 1) da, over that at the top, where a^k is one."""
    return np.asarray(np.maximum(line, SMALLEST_RESIDUAL) ** (1.0 - 1.0 / exponent))


LAWS = (
    Law(Fault.POWER, _power, 0.0, _exponent, _of_a_power),
    # beyond 1/3 the curve has two tops: begun on the near side, where a detector begins
    Law(Fault.SATURATION, _softly, 0.05, lambda x: (x, 1.0)),
    Law(Fault.SATURATION, _softly, 0.3, lambda x: (x, 1.0)),
    Law(Fault.SATURATION, _up_to_a_limit, 0.5, _missing),
)


@dataclass(frozen=True, eq=False)
class _LawModel:
    """A line behind a law; x: the line, then the number of the law."""

    line: AmplitudeSweep
    law: Law

    def columns(self, x: FloatArray) -> Columns:
        sizes = self.line.columns(x[:2])
        values, by_size, by_number = self.law.law(sizes.values[:, 0].real, float(x[2]))
        slopes = [by_size * slope[:, 0] for slope in sizes.slopes]
        return Columns(values[:, None], np.stack([*slopes, by_number])[:, :, None])


class _Line(NamedTuple):
    """A line as fitted, with a fault or without one: the fault's size with its error."""

    fit: Fit
    place: Place
    size: float
    std: float
    is_noise: bool

    @property
    def height(self) -> float:
        return abs(float(self.fit.coefficients[0]))


def _line(
    f: FloatArray, a: FloatArray, law: Law | None = None, start: Sequence[float] = ()
) -> _Line | None:
    """The line of amplitudes behind a law, or on a complex background, from a start of its number.

    None where no line is among the points.
    """
    crest = amplitude_starts(f, a)[0]
    shapes = Shapes(frequency_hz=f, starts=[Place(crest.frequency_hz, crest.width_hz)])
    model = AmplitudeSweep(shapes=shapes, phased=len(start) == 2)
    try:
        whole = model if law is None else _LawModel(model, law)
        fit = fit_model(whole, a, [np.array([0.0, 0.0, *start])])
    except (ValueError, np.linalg.LinAlgError):
        return None
    place = shapes.places(fit.x)[0]
    inside = f[0] <= place.frequency_hz <= f[-1]
    if not (fit.converged and inside and place.width_hz < WIDEST * float(np.ptp(f))):
        return None
    size, gradient, left = 0.0, np.zeros(fit.unknowns), fit.residuals
    p = white_noise_p(left)
    if law is not None:
        size, gradient[2] = law.size(float(fit.x[2]))
        p = max(p, white_noise_p(left / law.noise(np.abs(fit.curve), size)))
    elif len(start) == 2:
        size = max(math.hypot(*fit.x[2:]), 1e-300)
        gradient[2:4] = fit.x[2:] / size
    at = np.flatnonzero(gradient)
    with np.errstate(invalid="ignore"):  # infinite where the points do not determine the number
        variance = float(gradient[at] @ fit.inverse[np.ix_(at, at)] @ gradient[at])
    std = math.sqrt(max(0.0, variance) * fit.squares / fit.dof)
    return _Line(fit, place, size, std, p >= STRUCTURED)


def two_lines_p(frequency_hz: FloatArray, shape: FloatArray, plain: _Line) -> float:
    """Probability that noise gains as much as a second line; one where its residuals are no noise.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        shape: amplitudes over the largest one, shape (n,).
        plain: one line, as fitted.
    """
    f, (eta, width) = frequency_hz, plain.place
    places = [Place(eta + apart * width, like * width) for apart in APART for like in LIKE]
    model = AmplitudeSweep(shapes=Shapes(frequency_hz=f, starts=[plain.place, places[0]]))
    starts = [np.array([*model.shapes.at([plain.place, place]), 0.1, 0.1]) for place in places]
    try:
        fit = fit_model(model, shape, starts, tries=6)
    except (ValueError, np.linalg.LinAlgError):
        return 1.0
    second, span = model.shapes.places(fit.x)[1], float(np.ptp(f))
    near = f[0] - span <= second.frequency_hz <= f[-1] + span
    if not (near and second.width_hz > NARROWEST * width):
        return 1.0
    if white_noise_p(fit.residuals) < STRUCTURED:
        return 1.0
    return gain_p(plain.fit.squares, fit.squares, 4, shape.size - 7)


def sweep_faults(frequency_hz: FloatArray, amplitude_v: FloatArray) -> tuple[SweepFault, ...]:
    """The fault that explains a sweep which one damped line does not; none where none does.

    Several are listed where each leaves noise and none is better by more than a factor of 1000 in
    probability.

    Args:
        frequency_hz: rising, shape (n,).
        amplitude_v: shape (n,), any unit.

    Source: N. Draper and H. Smith, Applied Regression Analysis, for the extra sum of squares and
    for the largest studentised residual with Bonferroni's bound.
    """
    f, top, count = frequency_hz, float(np.max(amplitude_v, initial=0.0)), amplitude_v.size
    if count < MIN_SWEEP_POINTS + 3 or not top > 0.0:
        return ()
    a = amplitude_v / top
    plain = _line(f, a)
    if plain is None:
        return ()

    def fault(kind: Fault, line: _Line, p_value: float, **own: float) -> SweepFault:
        widths = plain.place.width_hz, line.place.width_hz
        numbers: dict[str, Any] = {"size": line.size, "std": line.std, "frequency_hz": math.nan}
        numbers |= own
        return SweepFault(fault=kind, width_hz=widths, p_value=p_value, **numbers)

    # equal largest points need no test: noise makes none
    flat = a >= 1.0 - 1e-12
    if CLIPPED_POINTS <= np.sum(flat) <= count - MIN_SWEEP_POINTS:
        rest = _line(f[~flat], a[~flat])
        if rest is not None and rest.height > 1.0:
            size, fit = 1.0 - 1.0 / rest.height, rest.fit
            std = math.sqrt(float(fit.inverse[2, 2]) * fit.squares / fit.dof) / rest.height**2
            at = float(np.mean(f[flat]))
            return (fault(Fault.CLIPPING, rest, 0.0, size=size, std=std, frequency_hz=at),)
    squares = plain.fit.squares
    if math.sqrt(squares / count) < SMALLEST_RESIDUAL:
        return ()

    # faults that are numbers of the curve; of two laws of one fault the better one
    tried = [(law.fault, _line(f, a, law, [law.start])) for law in LAWS]
    tried.append((Fault.BACKGROUND, _line(f, a, None, (0.01, 0.01))))
    best: dict[Fault, _Line] = {}
    for kind, line in tried:
        # a top that is too high is no saturation, and what is no larger than its error nothing
        if line is None or not (line.is_noise and line.size > line.std):
            continue
        if kind not in best or line.fit.squares < best[kind].fit.squares:
            best[kind] = line
    listed = []
    for kind, line in best.items():
        more = line.fit.unknowns - 3
        p_value = gain_p(squares, line.fit.squares, more, count - 3 - more)
        listed.append(fault(kind, line, p_value))

    # the point whose absence leaves least, if residuals are then noise of one size: where noise
    # grows with the amplitude some point is off by chance
    farthest = [int(k) for k in np.argsort(-np.abs(plain.fit.residuals))[:3]]
    lines = [(k, _line(np.delete(f, k), np.delete(a, k))) for k in farthest]
    left = [(line.fit.squares, k, line) for k, line in lines if line is not None and line.is_noise]
    if left:
        _, k, line = min(left, key=lambda each: each[0])
        at, dof = float(f[k]), count - 4
        size = (float(a[k]) / line.height) - abs(mode_response(f[k : k + 1], *line.place)[0])
        std = math.sqrt(line.fit.squares / dof) / line.height
        p_value = min(1.0, count * gain_p(squares, line.fit.squares, 1, dof))
        if not line.fit.structure.is_unequal:
            outlier = fault(Fault.OUTLIER, line, p_value, size=size, std=std, frequency_hz=at)
            listed.append(outlier)

    listed = [each for each in listed if each.p_value < BY_CHANCE]
    if not listed:
        return ()
    as_good = max(1e3 * min(each.p_value for each in listed), 1e-300)
    two_lines = two_lines_p(f, a, plain) < BY_CHANCE
    return tuple(replace(each, two_lines=two_lines) for each in listed if each.p_value <= as_good)
