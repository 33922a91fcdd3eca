"""A line in one form: what is next to it, fitted to a sweep, with the errors of its numbers.

| name | amplitudes | complex values |
|---|---|---|
| transmission | a abs(g) | a g |
| offset, sloped | a abs(g) + c, + c' x | a g + b + b' x (sloped) |
| fano | abs(a g + b), b complex | a g + b |
| floor, rice | a abs(g) with noise, of which powers or amplitudes were averaged | |
| single | a abs(g) with noise in every single reading (`fitting.lines.rice`) | |
| squared, squared_offset | a abs(g)^2, + c: a column that is a power | |
| tail | abs(a g + c g'), g' outside of the points | a g + c g' in every form |
| duffing, duffing_offset | a abs(h), + c | a h, + b |

A notch and a reflection are fano: only the meaning of a and b differs (`fitting.lines.dip`).
Values are divided by the largest one before they are fitted.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fitting.lines.lorentzian import mode_response
from fitting.lines.names import FORM_OF, MIN_SWEEP_POINTS
from fitting.lines.record import (
    FormFit,
    LineNumber,
    Matrix,
    Numbers,
    SecondLine,
    Slopes,
    TriedForm,
    number_of_line,
)
from fitting.lines.rice import fit_readings
from fitting.lines.solve import Array, Fit, fit_model, folded
from fitting.lines.starts import Start, amplitude_starts, point_noise
from fitting.lines.sweep_model import (
    MEAN,
    PLAIN,
    POWER,
    AmplitudeSweep,
    ComplexSweep,
    Place,
    Shapes,
)
from fitting.signal.student import ratio95
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many

#: Spans that a width may have at most.
WIDEST = 3.0
#: Bends, in half widths, and phases of a second line of amplitudes, from which fits start.
BENDS = (0.3, -0.3, 1.2, -1.2)
TURNS = (0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)
#: Starts from which a fit with several minima is made.
TRIES = 3
#: The smallest number with all its digits.
TINY = float(np.finfo(float).tiny)
#: Chi square by which a second solution may be worse that is listed next to the best one.
ALLOWED = 9.0


@dataclass(frozen=True, kw_only=True)
class Form:
    """What is fitted.

    Attributes:
        name: see the table above.
        background: of complex values 1 a constant, 2 a slope, too; the same added to amplitudes.
        phased: whether amplitudes have a complex constant below them.
        detector: what noise does to amplitudes, see `fitting.lines.sweep_model`.
        single: whether every amplitude is a single reading in noise.
        bent: whether the frequency follows the amplitude.
        delayed: whether the delay of a cable is fitted, too.
        further: how many lines, among the points or beyond them, are fitted with the first.
        tails: lines beyond complex points, at known places.
        pull: of a line beyond the points: widths, and factor e^pull on the width, by which it may
            be elsewhere; 0: it may be anywhere.
    """

    name: str
    background: int = 0
    phased: bool = False
    detector: str = PLAIN
    single: bool = False
    bent: bool = False
    delayed: bool = False
    further: int = 0
    tails: tuple[Place, ...] = ()
    pull: float = 0.0

    @property
    def terms(self) -> frozenset[str]:
        """What is there besides a Lorentzian: a form with more terms has it as a special case."""
        parts = {
            "constant": self.background > 0,
            "slope": self.background > 1,
            "phase": self.phased,
            self.detector: self.detector != PLAIN,
            "readings": self.single,
            "bend": self.bent,
            "delay": self.delayed,
            "second": self.further > 0,
        }
        return frozenset(name for name, there in parts.items() if there)


AMPLITUDE_FORMS = {
    form.name: form
    for form in (
        Form(name="transmission"),
        Form(name="single", single=True),
        Form(name="offset", background=1),
        Form(name="sloped", background=2),
        Form(name="floor", detector=POWER),
        Form(name="rice", detector=MEAN),
        Form(name="fano", phased=True),
        Form(name="duffing", bent=True),
        Form(name="duffing_offset", bent=True, background=1),
    )
}
COMPLEX_FORMS = {
    form.name: form
    for form in (
        Form(name="transmission"),
        Form(name="fano", background=1),
        Form(name="sloped", background=2),
        Form(name="duffing", bent=True),
        Form(name="duffing_offset", bent=True, background=1),
    )
}


@dataclass(frozen=True, kw_only=True, eq=False)
class LineFit(FormFit):
    """A form as fitted to a sweep.

    Its amplitude is that at the eigenfrequency, in the unit of the values; of two with the same
    curve the lower one. Correlations are those of frequency, width and amplitude, (3, 3).

    Attributes:
        form: what was fitted.
        mirrored: the other amplitude; None where there is none.
        background: the constant, of a slope its value at the eigenfrequency, of noise its root mean
            square, of single readings the noise of each quadrature.
        slope: what a slope changes by with every Hz.
        bend: shift of the top from the frequency of small amplitudes, Hz; None of a Lorentzian.
        delay: of the cable, s; None where it was not fitted.
        message: how the fit ended.
        coefficients: of complex values a, b and b' over the largest value.
        covariance: of frequency and width, Hz, and of both parts of each of the coefficients.
        rivals: other forms that describe the values nearly as well, which the errors include.
        rivals_widening: factor on the errors for them, on frequency or width.
        forms: every form that was tried, the one that is taken first.
    """

    form: Form
    mirrored: LineNumber | None = None
    background: complex = 0j
    slope: float = 0.0
    bend: LineNumber | None = None
    delay: LineNumber | None = None
    message: str
    coefficients: ComplexArray = field(default_factory=lambda: np.empty(0, dtype=complex))
    covariance: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    rivals: tuple[str, ...] = ()
    rivals_widening: float = 1.0
    forms: tuple[TriedForm, ...] = ()


def fit_form(
    frequency_hz: FloatArray,
    values: FloatArray | ComplexArray,
    form: Form,
    starts: Sequence[Start] = (),
    *,
    weights: FloatArray | None = None,
    source: str = "sweep",
) -> LineFit:
    """A form fitted to a sweep.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values with phases as Re[values exp(i 2 pi f t)], (n,).
        form: what is fitted.
        starts: where the fit may begin; none of amplitudes: from their largest and least point.
        weights: relative ones of the values, one over their standard deviation, (n,).
        source: of the data, for errors.

    Raises:
        BadInput: too few points, no resonance among them, or one that they do not determine.
    """
    largest = float(np.max(np.abs(values)))
    top = largest if largest > 0.0 else 1.0
    y = np.asarray(values / top, dtype=complex if np.iscomplexobj(values) else float)
    fitted = _Fitted(frequency_hz, y, form, top, source, weights)
    try:
        return fitted.line(starts)
    except (ValueError, np.linalg.LinAlgError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"{source}: {form.name}: {error}") from error


def fit_resonance(
    frequency_hz: FloatArray,
    amplitude: FloatArray,
    *,
    background: str = "none",
    source: str = "sweep",
) -> LineFit:
    """One damped mode fitted to amplitudes, with what a campaign declares next to it.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
        background: one of `fitting.lines.names.FORM_OF`.
        source: of the data, for errors.

    Raises:
        BadInput: too few points, no resonance within the sweep, or one that is not determined.
    """
    if background not in FORM_OF:
        raise ValueError(f"background {background!r}, wanted one of {tuple(FORM_OF)}")
    form = AMPLITUDE_FORMS[FORM_OF[background]]
    return fit_form(frequency_hz, amplitude, form, source=source)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Values over the largest one, and what is fitted to them."""

    f: FloatArray
    y: Array
    form: Form
    top: float
    source: str
    weights: FloatArray | None

    def line(self, starts: Sequence[Start]) -> LineFit:
        """The form from the best of some starts, with its numbers and their errors."""
        f, form, top, is_complex = self.f, self.form, self.top, np.iscomplexobj(self.y)
        if is_complex:
            starts = [start for start in starts if form.delayed or start.delay_s == 0.0]
        elif not starts:
            starts = amplitude_starts(f, self.y.real, form.phased)
        model = self._model(starts[0])
        fit, likely = self._fit(model, starts)
        shapes, first = model.shapes, model.count
        places = shapes.places(fit.x)
        self._check(fit, places)
        if isinstance(model, AmplitudeSweep) and (form.phased or form.further):
            fit = folded(model, self.y, fit, self.weights)
        numbers = Numbers(fit)

        # heights, with the slopes of their moduli by both parts of complex ones, and by what
        # further lines of amplitudes have over the first
        if isinstance(model, ComplexSweep):
            # none is quite zero, where a modulus has no slopes
            heights = [complex(height) or TINY for height in fit.coefficients[: len(places)]]
            along = [
                [(first + 2 * k, top * h.real / abs(h)), (first + 2 * k + 1, top * h.imag / abs(h))]
                for k, h in enumerate(heights)
            ]
        else:
            height = float(fit.coefficients[0])
            shares = [share or TINY for share in model.heights(fit.x)[: form.further]]
            heights, along = [height, *(height * r for r in shares)], [[(first, top)]]
            for at, r in zip(range(shapes.count, first, 2), shares, strict=False):
                parts = [(at, r.real / abs(r)), (at + 1, r.imag / abs(r))]
                along.append([(first, top * abs(r)), *((k, top * height * s) for k, s in parts)])
        amplitudes = [
            numbers.number("amplitude", top * abs(h), by)
            for h, by in zip(heights, along, strict=True)
        ]
        lines = []
        for k, (start, (eta, width)) in enumerate(zip(shapes.starts, places, strict=True)):
            unit = np.eye(2, fit.unknowns, 2 * k)
            lines.append(numbers.line(eta, width, [start.width_hz * unit[0], width * unit[1]]))
        others = []
        for line, h, amplitude in list(zip(lines, heights, amplitudes, strict=True))[1:]:
            share, phase = cmath.polar(h / heights[0])
            others.append(SecondLine(**line, share=share, amplitude=amplitude, phase_rad=phase))

        size = top * abs(heights[0])
        rms = top * float(np.sqrt(np.mean(np.abs(self.y - fit.curve) ** 2)))
        bend = None
        if form.bent:
            k, half = 2 * len(places), 0.5 * places[0].width_hz
            shift = half * float(fit.x[k])
            bend = numbers.number("bend", shift, [(k, half), (1, shift)], "Hz")
        made = LineFit(
            **lines[0],
            name=form.name,
            form=form,
            amplitude=amplitudes[0],
            bend=bend,
            others=tuple(others),
            rms_residual=rms / size if size > 0.0 else math.inf,
            correl=_correl(numbers, along[0]),
            curve=top * fit.curve,
            message=fit.message,
            structure=numbers.structure,
            dof=numbers.dof,
            unknowns=fit.unknowns,
            squares=fit.squares,
            likely_squares=likely,
        )
        if isinstance(model, ComplexSweep):
            return self._with_dip(made, numbers, model)
        made = replace(made, **self._background(fit, model, places[0]))
        if (form.phased or form.further) and not made.amplitude.std < made.amplitude.value:
            raise BadInput(
                f"{self.source}: {form.name}: the points do not determine how high its line is"
            )
        if form.detector != PLAIN and made.background.real < 0.0:
            raise BadInput(f"{self.source}: the noise next to its line would have a negative power")
        if form.phased:
            return self._mirrored(made, fit, model, numbers)
        return self._with_second(made, fit, model, numbers) if form.further == 1 else made

    def _model(self, start: Start) -> ComplexSweep | AmplitudeSweep:
        form, f = self.form, self.f
        shapes = Shapes(frequency_hz=f, starts=self._places(start), bent=form.bent)
        if np.iscomplexobj(self.y):
            tails = [mode_response(f, t.frequency_hz, t.width_hz) for t in form.tails]
            delay = start.delay_s if form.delayed else None
            return ComplexSweep(
                shapes=shapes, background=form.background, delay_s=delay, tails=tails
            )
        return AmplitudeSweep(
            shapes=shapes, phased=form.phased, detector=form.detector, added=form.background
        )

    def _places(self, start: Start) -> list[Place]:
        others = [place for place, _ in start.others[: self.form.further]]
        return [Place(start.frequency_hz, start.width_hz), *others]

    def _fit(
        self, model: ComplexSweep | AmplitudeSweep, starts: Sequence[Start]
    ) -> tuple[Fit, float]:
        """The best fit from some starts, and the squares with which normal noise is as likely."""
        form, least = self.form, MIN_SWEEP_POINTS
        if isinstance(model, AmplitudeSweep):
            least = max(least, model.count + 2 + form.background)
        if self.f.size < least:
            raise BadInput(
                f"{self.source}: {how_many(self.f.size, 'point is', 'points are')} too few for a "
                f"resonance fit; wanted at least {least}"
            )
        x_starts = [x for start in starts for x in self._x_of(model, start, starts[0])]
        if form.single and isinstance(model, AmplitudeSweep):
            return fit_readings(model, self.y.real, x_starts)
        tries = TRIES if form.bent or form.phased else TRIES + 1 if form.further else 1
        pull = self._pull(model.count)
        fit = fit_model(model, self.y, x_starts, weights=self.weights, pull=pull, tries=tries)
        return fit, fit.squares

    def _pull(self, count: int) -> FloatArray | None:
        """Weights of the rows that keep a line beyond the points near to where it was observed."""
        if not self.form.pull:
            return None
        weights = np.zeros(count)
        weights[2:4] = max(point_noise(self.y.real), 1e-6) / self.form.pull
        return weights

    def _x_of(
        self, model: ComplexSweep | AmplitudeSweep, start: Start, first: Start
    ) -> list[FloatArray]:
        """Where x starts: at every bend, and every phase of the last line, that is tried."""
        made, shapes, own = [], model.shapes, 2 * len(model.shapes.starts)
        bends: Sequence[float] = (0.0,)
        if shapes.bent:
            bends = BENDS if math.isnan(start.bend) else (start.bend,)
        for bend in bends:
            x = np.zeros(model.count)
            x[:own] = shapes.at(self._places(start))
            if shapes.bent:
                x[own] = bend
                if math.isnan(start.bend):  # the top is where the start is
                    x[0] -= 0.5 * bend * start.width_hz / shapes.starts[0].width_hz
            made.append(x)
        if isinstance(model, ComplexSweep):
            for x in made if self.form.delayed else ():
                x[-1] = (start.delay_s - first.delay_s) * float(np.ptp(self.f))
            return made
        for x in made:
            if model.is_noisy:
                low = float(np.min(self.y.real)) ** 2
                x[-1] = low / max(1.0 - low, 0.01)
            if model.phased:
                x[-2:] = start.background.real, start.background.imag
        if not self.form.further:
            return made
        rotated = []
        heights = [height for _, height in start.others]
        for turn in TURNS:  # of the last line, which is the new one
            turns = np.array([*heights[:-1], heights[-1] * cmath.rect(1.0, turn)])
            for x in made:
                other = x.copy()
                parts = np.stack([turns.real, turns.imag], axis=1).ravel()
                other[shapes.count : shapes.count + parts.size] = parts
                rotated.append(other)
        return rotated

    def _check(self, fit: Fit, places: Sequence[Place]) -> None:
        """Refuse a fit that is no line of these points."""
        f, place, source = self.f, places[0], self.source
        inside = f[0] <= place.frequency_hz <= f[-1]
        if not (fit.converged and inside and place.width_hz < WIDEST * float(np.ptp(f))):
            raise BadInput(
                f"{source}: no resonance between {f[0]:.10g} and {f[-1]:.10g} Hz "
                f"(the fit ended at {place.frequency_hz:.10g} Hz, width {place.width_hz:.4g} Hz: "
                f"{fit.message})"
            )
        if not np.all(np.isfinite(fit.inverse[:2, :2])):
            raise BadInput(
                f"{source}: the sweep does not determine its line near "
                f"{place.frequency_hz:.10g} Hz, width {place.width_hz:.4g} Hz (a grid too coarse "
                "for it, or at the rounding of the frequencies)"
            )
        if self.form.pull and f[0] <= places[1].frequency_hz <= f[-1]:
            raise BadInput(
                f"{source}: another line, at {hertz(places[1].frequency_hz)}, is among the points"
            )
        if not np.iscomplexobj(self.y) and fit.coefficients[0] < 0.0:
            raise BadInput(f"{source}: {self.form.name}: its line would have a negative height")

    def _with_dip(self, line: LineFit, numbers: Numbers, model: ComplexSweep) -> LineFit:
        """The line with its delay, and with height and background without those of other lines."""
        fit, first, further = numbers.fit, model.count, len(line.others)
        delay = None
        if self.form.delayed:
            slope = [(first - 1, 1.0 / float(np.ptp(self.f)))]
            delay = numbers.number("delay", model.delay(fit.x), slope, "s")
        chosen = [0, *range(1 + further, 1 + further + self.form.background)]
        at = [0, 1, *(first + 2 * k + part for k in chosen for part in (0, 1))]
        scales = np.ones(len(at))
        scales[:2] = model.shapes.starts[0].width_hz, line.width.value
        return replace(
            line,
            delay=delay,
            coefficients=np.asarray(fit.coefficients[chosen], dtype=complex),
            covariance=np.outer(scales, scales) * numbers.covariance[np.ix_(at, at)],
        )

    def _background(self, fit: Fit, model: AmplitudeSweep, place: Place) -> dict[str, Any]:
        """Constant and slope in the unit of the amplitudes."""
        height, added = float(fit.coefficients[0]), fit.coefficients[1:]
        if self.form.single:
            return {"background": self.top * float(fit.coefficients[1])}
        if model.is_noisy:
            power = float(fit.x[-1])
            return {"background": self.top * height * math.copysign(math.sqrt(abs(power)), power)}
        if not added.size:
            return {}
        slope = 2.0 * self.top * float(added[1]) / float(np.ptp(self.f)) if added.size > 1 else 0.0
        middle = 0.5 * float(self.f[0] + self.f[-1])
        constant = self.top * float(added[0]) + slope * (place.frequency_hz - middle)
        return {"background": constant, "slope": slope}

    def _mirrored(
        self, line: LineFit, fit: Fit, model: AmplitudeSweep, numbers: Numbers
    ) -> LineFit:
        """Both amplitudes that have the curve of a line on a complex constant, the lower first.

            |a g + b| = |a' g + b'|        a' = -a + 2 i b*,  b' = -b*        where g = -i/(1 + i x)

        At low Q that holds only about: where the points distinguish them, the fitted one is first.
        """
        height = float(fit.coefficients[0])
        beta = model.heights(fit.x)[-1]
        over = -1.0 + 2j * beta.conjugate()
        size = max(abs(over), np.finfo(float).tiny)
        turn, k = over.conjugate() / size, model.count
        slopes = [
            (k, size),
            (k - 2, -2.0 * height * turn.imag),
            (k - 1, 2.0 * height * turn.real),
        ]
        slopes = [(at, self.top * slope) for at, slope in slopes]
        mirrored = numbers.number("amplitude", self.top * height * size, slopes)
        there = -beta.conjugate() * turn / size
        x = np.array([*fit.x[:-2], there.real, there.imag])
        curve = model.columns(x).values[:, 0] * height * size
        weights = 1.0 if self.weights is None else self.weights
        worse = float(np.sum((weights * (curve - self.y)) ** 2)) - fit.squares
        own = replace(line, background=self.top * height * beta, mirrored=mirrored)
        if not (size < 1.0 and worse < numbers.variance):
            return own
        return replace(
            own,
            amplitude=mirrored,
            correl=_correl(numbers, slopes),
            background=self.top * height * size * there,
            rms_residual=line.rms_residual / size,
            mirrored=line.amplitude,
        )

    def _with_second(
        self, line: LineFit, fit: Fit, model: AmplitudeSweep, numbers: Numbers
    ) -> LineFit:
        """The line with the other pair of heights that has about the curve of both lines."""
        height = float(fit.coefficients[0])
        start = _flipped(self.f, fit, model)
        other = fit_model(
            model, self.y, [start], weights=self.weights, pull=self._pull(model.count)
        )
        chance = other.converged and other.squares - fit.squares < ALLOWED * numbers.variance
        if not chance or other.coefficients[0] <= 0.0:
            return line
        size = float(other.coefficients[0])
        std = line.amplitude.std * size / height
        again = number_of_line("amplitude", self.top * size, std, "", half=ratio95(numbers.dof))
        second = replace(line.others[0], mirrored=abs(model.heights(other.x)[0]))
        return replace(line, mirrored=again, others=(second,))


def _correl(numbers: Numbers, slopes: Slopes) -> Matrix:
    """Correlations of frequency and width with each other and an amplitude of such slopes."""
    place = np.eye(2, numbers.fit.unknowns)  # their units do not matter
    return numbers.correl([*place, numbers.gradient(slopes)])


def _flipped(f: FloatArray, fit: Fit, model: AmplitudeSweep) -> FloatArray:
    """Where the fit of the other heights begins: the numerator's zero on the other side.

    Both lines over one denominator have a numerator with a zero z near them, and f - z has the
    modulus of f - z* at every real f.
    """
    (eta, width), (eta2, width2) = (
        (place.frequency_hz, place.width_hz) for place in model.shapes.places(fit.x)
    )
    share = model.heights(fit.x)[0]
    one, two = width * eta, share * width2 * eta2
    zeros = np.roots(
        [-(one + two), 1j * (one * width2 + two * width), one * eta2**2 + two * eta**2]
    )
    if not zeros.size:
        return fit.x
    zero = zeros[int(np.argmax(zeros.real))]
    lines = np.stack([mode_response(f, eta, width), mode_response(f, eta2, width2)], 1)
    rotated = lines @ np.array([1.0, share]) * (f - np.conj(zero)) / (f - zero)
    height, other = np.linalg.lstsq(lines, rotated, rcond=None)[0]
    x, at = fit.x.copy(), model.shapes.count
    ratio = other / height if height else share
    x[at : at + 2] = ratio.real, ratio.imag
    return x
