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

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from fitting.lines.choice import gain_p
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.lines.solve import Columns, Fit, fit_model
from fitting.lines.starts import amplitude_starts
from fitting.lines.sweep_model import AmplitudeSweep, Place, Shapes
from fitting.signal.residual_tests import STRUCTURED, white_noise_p
from fitting.text.arrays import FloatArray
from fitting.text.finding import Finding, Kind

#: A fault is listed where noise alone would look as bad less often than this.
LISTED_P = 1e-4
#: Equal largest points that noise does not make.
CLIPPED_POINTS = 3
#: Widths between two lines, and of the second over the first, from which these are fitted.
APART, LIKE = (-6.0, -2.0, -0.6, 0.6, 2.0, 6.0), (1.0, 6.0, 0.15)
#: Width of the second line over the first at least: one point off is no second line.
NARROWEST = 0.125
#: Residuals below this share of the top are rounding: nothing can be wrong.
ROUNDING = 1e-6
#: Largest logarithm of a power.
MOST_POWER = 5.0
#: Spans that a width may have at most.
WIDEST = 3.0


class Fault(Enum):
    """What is wrong with a sweep."""

    POWER = "power"
    SATURATION = "saturation"
    CLIPPING = "clipping"
    OUTLIER = "outlier"
    BACKGROUND = "background"


@dataclass(frozen=True, kw_only=True)
class SweepFault:
    """One fault: its number with standard deviation, where it is, and what it does to the width.

    `size` is k of a power, the share that is missing at the top of a saturated line (of the law
    that fits best: another may fit as well with another size and width) or above the clipped
    points, the distance of an outlier over the top of the line, or that of a background.
    `width_hz` is the full width without and with the fault taken into account. `p_value` is the
    probability that noise alone gains as much. `two_lines` says whether two lines that overlap
    leave noise, too.
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


class Bent(NamedTuple):
    """What a fault makes of the sizes u of a line, with its derivatives by u and by its number."""

    values: FloatArray
    by_size: FloatArray
    by_number: FloatArray


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
    return Bent(values, k * values / safe, k * values * np.log(safe))


def _softly(u: FloatArray, x: float) -> Bent:
    return Bent(u * (1.0 - x * u**2), 1.0 - 3.0 * x * u**2, -(u**3))


def _up_to_a_limit(u: FloatArray, x: float) -> Bent:
    t = x if abs(x) > 1e-9 else 1e-9
    bent, rise = np.tanh(u * t), 1.0 / np.cosh(np.minimum(np.abs(u * t), 300.0)) ** 2
    return Bent(bent / t, rise, (u * t * rise - bent) / t**2)


def _missing(x: float) -> tuple[float, float]:
    t = max(abs(x), 1e-12)
    share = math.tanh(t) / t
    return 1.0 - share, math.copysign((share - 1.0 / math.cosh(min(t, 300.0)) ** 2) / t, x)


def _exponent(x: float) -> tuple[float, float]:
    k = math.exp(min(x, MOST_POWER))
    return k, k


def _of_a_power(line: FloatArray, exponent: float) -> FloatArray:
    """d(a^k) = k a^(k - 1) da, over that at the top, where a^k is one."""
    return np.asarray(np.maximum(line, ROUNDING) ** (1.0 - 1.0 / exponent))


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
        bent = self.law.law(sizes.values[:, 0].real, float(x[2]))
        slopes = [bent.by_size * slope[:, 0] for slope in sizes.slopes]
        return Columns(bent.values[:, None], np.stack([*slopes, bent.by_number])[:, :, None])


@dataclass(frozen=True, eq=False)
class _Line:
    """A line as fitted, with a fault or without one: the fault's size and its derivatives by x."""

    fit: Fit
    place: Place
    fault: Fault = Fault.OUTLIER
    size: float = 0.0
    gradient: Sequence[float] = ()
    noise: FloatArray | None = None

    @property
    def height(self) -> float:
        return abs(float(self.fit.coefficients[0]))

    @property
    def is_noise(self) -> bool:
        """Whether residuals are white, as they are or over what the fault makes of equal noise."""
        left = self.fit.residuals
        alike = left if self.noise is None else left / self.noise
        return max(white_noise_p(left), white_noise_p(alike)) >= STRUCTURED

    @property
    def std(self) -> float:
        """Standard error of the size."""
        slopes = np.zeros(self.fit.unknowns)
        slopes[2 : 2 + len(self.gradient)] = self.gradient
        variance = float(slopes @ self.fit.inverse @ slopes) * self.fit.squares / self.fit.dof
        return math.sqrt(max(0.0, variance))


class _Sweep:
    """The sweep over its largest amplitude."""

    def __init__(self, frequency_hz: FloatArray, shape: FloatArray) -> None:
        self.f, self.a = frequency_hz, shape
        crest = amplitude_starts(frequency_hz, shape)[0]
        self.start = Place(crest.frequency_hz, crest.width_hz)
        self.model = AmplitudeSweep(shapes=Shapes(frequency_hz=frequency_hz, starts=[self.start]))

    def plain(self) -> _Line | None:
        """The line alone; None where the sweep shows none."""
        return self.checked(fit_model(self.model, self.a, [np.zeros(2)]))

    def checked(self, fit: Fit) -> _Line | None:
        place = self.model.shapes.places(fit.x)[0]
        inside = self.f[0] <= place.frequency_hz <= self.f[-1]
        narrow = place.width_hz < WIDEST * float(np.ptp(self.f))
        return _Line(fit, place) if fit.converged and inside and narrow else None

    def lines(self) -> list[_Line]:
        """Every fault that is a number of the curve, fitted."""
        made = []
        for law in LAWS:
            with contextlib.suppress(ValueError, np.linalg.LinAlgError):
                start = np.array([0.0, 0.0, law.start])
                line = self.checked(fit_model(_LawModel(self.model, law), self.a, [start]))
                if line is not None:
                    size, slope = law.size(float(line.fit.x[2]))
                    noise = law.noise(np.abs(line.fit.curve), size)
                    made.append(
                        replace(line, fault=law.fault, size=size, gradient=[slope], noise=noise)
                    )
        with contextlib.suppress(ValueError, np.linalg.LinAlgError):
            phased = replace(self.model, phased=True)
            line = self.checked(fit_model(phased, self.a, [np.array([0.0, 0.0, 0.01, 0.01])]))
            if line is not None:
                real, imaginary = line.fit.x[2:]
                size = max(math.hypot(real, imaginary), 1e-300)
                slopes = [real / size, imaginary / size]
                made.append(replace(line, fault=Fault.BACKGROUND, size=size, gradient=slopes))
        return made

    def without(self, k: int) -> _Sweep:
        """The sweep without one point."""
        return _Sweep(np.delete(self.f, k), np.delete(self.a, k))


def two_lines_p(frequency_hz: FloatArray, shape: FloatArray, plain: _Line) -> float:
    """Probability that noise gains as much as a second line; one where its residuals are no noise.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        shape: amplitudes over the largest one, shape (n,).
        plain: one line, as fitted.
    """
    f, first = frequency_hz, plain.place
    places = [
        Place(first.frequency_hz + apart * first.width_hz, like * first.width_hz)
        for apart in APART
        for like in LIKE
    ]
    model = AmplitudeSweep(shapes=Shapes(frequency_hz=f, starts=[first, places[0]]))
    starts = [np.array([*model.shapes.at([first, place]), 0.1, 0.1]) for place in places]
    try:
        fit = fit_model(model, shape, starts, tries=6)
    except (ValueError, np.linalg.LinAlgError):
        return 1.0
    second, span = model.shapes.places(fit.x)[1], float(np.ptp(f))
    near = f[0] - span <= second.frequency_hz <= f[-1] + span
    near = near and second.width_hz > NARROWEST * first.width_hz
    if not near or white_noise_p(fit.residuals) < STRUCTURED:
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
    top = float(np.max(amplitude_v, initial=0.0))
    if amplitude_v.size < MIN_SWEEP_POINTS + 3 or not top > 0.0:
        return ()
    sweep = _Sweep(frequency_hz, amplitude_v / top)
    plain = sweep.plain()
    if plain is None:
        return ()
    clipped = _clipping(sweep, plain)
    if clipped is not None:
        return (clipped,)
    if math.sqrt(plain.fit.squares / amplitude_v.size) < ROUNDING:
        return ()
    found = [fault for fault in _faults(sweep, plain) if fault.p_value < LISTED_P]
    if not found:
        return ()
    as_good = max(1e3 * min(fault.p_value for fault in found), 1e-300)
    two_lines = two_lines_p(sweep.f, sweep.a, plain) < LISTED_P
    return tuple(replace(f, two_lines=two_lines) for f in found if f.p_value <= as_good)


def _faults(sweep: _Sweep, plain: _Line) -> list[SweepFault]:
    """Every fault that leaves noise; of two laws of one fault the better one."""
    best: dict[Fault, _Line] = {}
    for line in sorted(sweep.lines(), key=lambda each: -each.fit.squares):
        # a top that is too high is no saturation, and what is no larger than its error nothing
        if line.is_noise and line.size > line.std:
            best[line.fault] = line
    made = []
    for line in best.values():
        more, dof = len(line.gradient), sweep.a.size - 3 - len(line.gradient)
        made.append(
            SweepFault(
                fault=line.fault,
                size=line.size,
                std=line.std,
                frequency_hz=math.nan,
                width_hz=(plain.place.width_hz, line.place.width_hz),
                p_value=gain_p(plain.fit.squares, line.fit.squares, more, dof),
            )
        )
    outlier = _outlier(sweep, plain)
    return made if outlier is None else [*made, outlier]


def _outlier(sweep: _Sweep, plain: _Line) -> SweepFault | None:
    """The point whose absence leaves least, if its residuals are noise of one size.

    Where noise grows with the amplitude some point is off by chance.
    """
    farthest = [int(k) for k in np.argsort(-np.abs(plain.fit.residuals))[:3]]
    lines = [(k, sweep.without(k).plain()) for k in farthest]
    left = [(k, line) for k, line in lines if line is not None and line.is_noise]
    if not left:
        return None
    k, line = min(left, key=lambda each: each[1].fit.squares)
    if line.fit.structure.is_unequal:
        return None
    dof, at = sweep.a.size - 4, float(sweep.f[k])
    there = AmplitudeSweep(
        shapes=Shapes(frequency_hz=np.array([at, at + 1.0]), starts=[line.place])
    )
    expected = line.height * float(there.columns(np.zeros(2)).values[0, 0])
    return SweepFault(
        fault=Fault.OUTLIER,
        size=(float(sweep.a[k]) - expected) / line.height,
        std=math.sqrt(line.fit.squares / dof) / line.height,
        frequency_hz=at,
        width_hz=(plain.place.width_hz, line.place.width_hz),
        p_value=min(1.0, sweep.a.size * gain_p(plain.fit.squares, line.fit.squares, 1, dof)),
    )


def _clipping(sweep: _Sweep, plain: _Line) -> SweepFault | None:
    """Equal largest points, and the line of the others."""
    flat = sweep.a >= float(np.max(sweep.a)) * (1.0 - 1e-12)
    count = int(np.sum(flat))
    if count < CLIPPED_POINTS or sweep.a.size - count < MIN_SWEEP_POINTS:
        return None
    line = _Sweep(sweep.f[~flat], sweep.a[~flat]).plain()
    if line is None or line.height <= 1.0:
        return None
    variance = float(line.fit.inverse[2, 2]) * line.fit.squares / line.fit.dof
    return SweepFault(
        fault=Fault.CLIPPING,
        size=1.0 - 1.0 / line.height,
        std=math.sqrt(variance) / line.height**2,
        frequency_hz=float(np.mean(sweep.f[flat])),
        width_hz=(plain.place.width_hz, line.place.width_hz),
        p_value=0.0,
    )
