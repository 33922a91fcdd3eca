"""A line in one form, fitted to a trace: what stands beside the resonance, and what that leaves.

    S(f) = e (a g(f) + b + b' x)        x = (f - f0)/half the span,  f0 the middle of the sweep
    e    = exp(-i 2 pi (f - f0) tau)    g of `fitting.signal.peaks.mode_response`

``transmission`` is the line alone (b = b' = 0), ``fano`` has the constant b beside it, ``sloped``
the slope b', too. Of amplitudes |S| is known, and b' and tau are not looked for; but what knows no
phase may be added to them: ``offset`` is |a g| + c (a detector's zero), ``sloped`` of amplitudes
|a g| + c + c' x (a zero that drifts, or changes with frequency), ``floor`` is
sqrt(|a g|^2 + c^2) (noise of which powers were averaged), ``rice`` the mean amplitude with the same
noise, ``single`` has that noise in every point, a single reading, as Rice's distribution says, and
``tail`` is |a g + c g'|, g' of another line outside of the points. With phases the tails
c g' e of lines that are seen outside of the points stand in every form. A notch and a
reflection are curves of the form ``fano``: only what a and b mean is different there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.measurements.complex.gain import SharedGain, Solved
from fitting.measurements.complex.wiring import Wiring
from fitting.signal.complex_line import (
    NEAR,
    ComplexLine,
    complex_line,
    far_delays,
    tops_and_bottoms,
)
from fitting.signal.least_squares import minimise_squares
from fitting.signal.line_record import (
    LineNumber,
    SecondLine,
    fields_of,
    line_numbers,
    number_of_line,
)
from fitting.signal.peaks import (
    BESIDE_WORDS,
    FLOOR,
    MIN_SWEEP_POINTS,
    OFFSET,
    RICE,
    SINGLE,
    SLOPE,
    TAIL,
    UNKNOWNS,
    Resonance,
    fit_beside_second,
    fit_beside_tail,
    fit_resonance,
    mode_response,
)
from fitting.signal.residual_tests import TOGETHER, residual_structure
from fitting.signal.single_readings import fit_single_readings
from fitting.signal.student import ROOT_68, ratio95, reach
from fitting.text.arrays import ComplexArray, FloatArray, both_parts
from fitting.text.errors import BadInput

TRANSMISSION, FANO, SLOPED = FORMS = ("transmission", "fano", "sloped")
#: Of amplitudes, and what each is called where amplitudes are fitted.
AMPLITUDE_FORMS = {
    TRANSMISSION: "none",
    SINGLE: SINGLE,
    OFFSET: OFFSET,
    SLOPED: SLOPE,
    FLOOR: FLOOR,
    RICE: RICE,
    FANO: "complex",
    TAIL: TAIL,
}
#: What stands beside the line in each form of amplitudes, in words, and in those of complex values.
WORDS_BESIDE = {
    form: BESIDE_WORDS[name] for form, name in AMPLITUDE_FORMS.items() if name != "none"
}
WORDS_BESIDE_COMPLEX = {**WORDS_BESIDE, SLOPED: BESIDE_WORDS["complex slope"]}
#: Unknowns of a second line.
MORE_OF_SECOND = 4
#: Of the scaled unknowns, for derivatives: half of the digits of their second differences.
STEP = 1e-5
_BACKGROUNDS = {TRANSMISSION: "none", FANO: "constant", SLOPED: "slope"}


@dataclass(frozen=True, kw_only=True)
class FittedForm(Resonance):
    """A form of the line as fitted, to amplitudes or to complex values.

    ``background`` is the constant c of amplitudes, of ``sloped`` at the eigenfrequency, of
    ``single`` the noise of both quadratures each; zero in other forms.

    Attributes:
        name: one of `FORMS`, or of `AMPLITUDE_FORMS`.
        delay: of the cable, s; None where it was not fitted.
        unknowns: real numbers that were fitted.
        squares: sum of the squared residuals over the largest value.
        likely_squares: those with which normal noise of one size is as likely, by which forms are
            compared: ``squares`` but where the noise is Rice's.
        coefficients: a, b and b' over the largest value, as many as there are; of amplitudes none.
        covariance: of frequency and width, Hz, of the delay over 1/span if it was fitted, and of
            both parts of each coefficient, scaled as the errors; of amplitudes none.
        second: a weaker line among the points that was fitted with it.
    """

    name: str
    delay: LineNumber | None = None
    unknowns: int
    squares: float
    likely_squares: float
    coefficients: ComplexArray = field(default_factory=lambda: np.empty(0, dtype=complex))
    covariance: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    second: SecondLine | None = None


def fit_amplitudes(
    frequency_hz: FloatArray,
    amplitude: FloatArray,
    name: str,
    source: str,
    others: Sequence[tuple[float, float]] = (),
    room: float = 1.0,
) -> FittedForm:
    """A form fitted to amplitudes.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
        name: of the form, one of `AMPLITUDE_FORMS`.
        source: of the data, for complaints.
        others: where the line of a tail may be, Hz, and how wide, Hz.
        room: how far that may be off, see `fit_beside_tail`.

    Raises:
        BadInput: too few points, no resonance among them, or one that they do not determine.
    """
    likely_squares = None
    if name == SINGLE:
        readings = fit_single_readings(frequency_hz, amplitude, source=source)
        line, likely_squares = readings.resonance, readings.squares
        if line.structure.order > 0:
            raise BadInput(
                f"{source}: is no line of single readings: the residuals, which would be noise of "
                f"its own in each, {TOGETHER}"
            )
    elif name == FANO:
        line = _peak_or_dip(frequency_hz, amplitude, source)
    elif name == TAIL:
        line = fit_beside_tail(frequency_hz, amplitude, others, room=room, source=source)
    else:
        background = AMPLITUDE_FORMS[name]
        line = fit_resonance(frequency_hz, amplitude, background=background, source=source)
    if name in (FANO, TAIL) and not line.amplitude.std < line.amplitude.value:
        raise BadInput(
            f"{source}: the points do not determine how high its line is above {WORDS_BESIDE[name]}"
        )
    if name in (FLOOR, RICE) and line.background.real < 0.0:
        raise BadInput(f"{source}: the noise next to its line would have a negative power")
    return _of_amplitudes(name, line, amplitude, likely_squares)


def fit_amplitudes_with_second(
    frequency_hz: FloatArray,
    amplitude: FloatArray,
    best: FittedForm,
    name: str,
    second: SecondLine,
    source: str,
) -> FittedForm:
    """A form fitted to amplitudes with a second line among the points.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
        best: form of the first line alone, where the fit begins.
        name: of the form, one of `AMPLITUDE_FORMS` but those with phases.
        second: where that of the second one begins.
        source: of the data, for complaints.

    Raises:
        BadInput: too few points, or lines that the points do not hold.
    """
    first, other = fit_beside_second(
        frequency_hz,
        amplitude,
        (best.frequency.value, best.width.value),
        (second.frequency.value, second.width.value, second.height),
        background=AMPLITUDE_FORMS[name],
        source=source,
    )
    form = _of_amplitudes(name, first, amplitude, None)
    return replace(form, unknowns=form.unknowns + MORE_OF_SECOND, second=other)


def _of_amplitudes(
    name: str, line: Resonance, amplitude: FloatArray, likely_squares: float | None
) -> FittedForm:
    left = (line.curve - amplitude) / float(np.max(amplitude))
    squares = float(left @ left)
    parts = fields_of(line, Resonance)
    parts["background"] = 0j if name == FANO else complex(line.background.real)
    return FittedForm(
        **parts,
        name=name,
        unknowns=UNKNOWNS[AMPLITUDE_FORMS[name]],
        squares=squares,
        likely_squares=squares if likely_squares is None else likely_squares,
    )


def _peak_or_dip(frequency_hz: FloatArray, amplitude: FloatArray, source: str) -> Resonance:
    """The line on a complex constant that leaves least, begun at the top and at the bottom."""
    fits: list[Resonance] = []
    complaints = []
    for dip in (False, True):
        try:
            fits.append(
                fit_resonance(frequency_hz, amplitude, background="complex", dip=dip, source=source)
            )
        except BadInput as error:
            complaints.append(error)
    if not fits:
        raise complaints[0]
    return min(fits, key=lambda each: float(np.sum((each.curve - amplitude) ** 2)))


@dataclass(frozen=True)
class Guess:
    """Where a fit may begin: frequency and width of the line, Hz, and delay, s."""

    frequency_hz: float
    width_hz: float
    delay_s: float


def guesses(frequency_hz: FloatArray, values: ComplexArray) -> list[Guess]:
    """Where fits to complex values may begin: tops, bottoms, and linear least squares.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
    """
    f = frequency_hz
    span, spacing = float(np.ptp(f)), float(np.median(np.diff(f)))
    whole = complex_line(f, values, None)
    widths = tops_and_bottoms(f, values)
    delays = dict.fromkeys((0.0, whole.delay_s, *far_delays(f, values)))
    places = [(eta, part * width) for eta, width in widths.items() for part in (0.5, 1.0, 2.0)]
    for delay in delays:
        places += [(line.eta_hz, abs(line.width_hz)) for line in _lines(f, values, widths, delay)]
    return [
        Guess(float(np.clip(eta, f[0], f[-1])), float(np.clip(width, spacing, span)), delay)
        for eta, width in places
        if math.isfinite(eta) and math.isfinite(width)
        for delay in delays
    ]


def _lines(
    f: FloatArray, values: ComplexArray, widths: Mapping[float, float], delay_s: float
) -> list[ComplexLine]:
    """Lines by linear least squares: of all points, and of those about a top and a bottom."""
    lines = [complex_line(f, values, delay_s)]
    for eta, width in widths.items():
        near = np.abs(f - eta) <= NEAR * width
        if MIN_SWEEP_POINTS <= int(np.sum(near)) < f.size:
            lines.append(complex_line(f[near], values[near], delay_s))
    return lines


def begin_of(
    frequency_hz: FloatArray, values: ComplexArray, name: str, begin: Sequence[Guess]
) -> tuple[Guess, float]:
    """The guess with which a form leaves least, and the squares that it leaves.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
        name: of the form.
        begin: guesses to choose from, one at least.
    """
    wiring = Wiring(background=_BACKGROUNDS[name])
    middle = 0.5 * float(frequency_hz[0] + frequency_hz[-1])
    y = values / float(np.max(np.abs(values)))
    tried = []
    for guess in begin:
        response = mode_response(frequency_hz, guess.frequency_hz, guess.width_hz)
        design = wiring.design(frequency_hz, response, guess.delay_s, middle)
        left = SharedGain((0,)).solve([design], [y], [1.0])[0].values - y
        tried.append((float(np.sum(np.abs(left) ** 2)), guess))
    squares, best = min(tried, key=lambda each: each[0])
    return best, squares


@dataclass(frozen=True, kw_only=True)
class ComplexForm:
    """A form of complex values.

    Attributes:
        name: one of `FORMS`.
        delayed: whether the delay of a cable is fitted, too.
        tails_hz: frequency and full width of other lines, outside of the points, Hz.
        second_hz: where a second line among the points begins, and how wide, Hz; None: there is
            none.
    """

    name: str
    delayed: bool
    tails_hz: Sequence[tuple[float, float]] = ()
    second_hz: tuple[float, float] | None = None


def fit_complex(
    frequency_hz: FloatArray,
    values: ComplexArray,
    form: ComplexForm,
    begin: Sequence[Guess],
    source: str,
) -> FittedForm:
    """A form fitted to complex values; what enters linearly is solved inside.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit, phases as Re[values exp(i 2 pi f t)].
        form: what stands beside the line.
        begin: where the fit may begin, see `guesses`.
        source: of the data, for complaints.

    Raises:
        BadInput: no resonance among the points, or one that they do not determine.
    """
    usable = [guess for guess in begin if form.delayed or guess.delay_s == 0.0]
    guess, _ = begin_of(frequency_hz, values, form.name, usable)
    return _ComplexFit(frequency_hz, values, form, guess).minimised(source)


class _ComplexFit:
    """Shift of the line and logarithm of its width, over guesses, and the delay over 1/span.

    Where there is a second line, its shift and logarithm of the width come last.
    """

    def __init__(
        self,
        frequency_hz: FloatArray,
        values: ComplexArray,
        form: ComplexForm,
        guess: Guess,
    ) -> None:
        self.f, self.form, self.delayed = frequency_hz, form, form.delayed
        self.wiring = Wiring(background=_BACKGROUNDS[form.name])
        self.tails = [mode_response(frequency_hz, *tail) for tail in form.tails_hz]
        self.top = float(np.max(np.abs(values)))
        self.y = values / self.top
        self.span, self.middle = float(np.ptp(self.f)), 0.5 * float(self.f[0] + self.f[-1])
        self.eta0, self.width0, self.delay0 = guess.frequency_hz, guess.width_hz, guess.delay_s

    def line(self, x: FloatArray) -> tuple[float, float, float]:
        """Eigenfrequency and width, Hz, and delay, s."""
        width = self.width0 * math.exp(min(float(x[1]), 50.0))
        delay = self.delay0 + float(x[2]) / self.span if self.delayed else self.delay0
        return self.eta0 + self.width0 * float(x[0]), width, delay

    def second(self, x: FloatArray) -> list[tuple[float, float]]:
        """Eigenfrequency and width of the second line, Hz; none without one."""
        if self.form.second_hz is None:
            return []
        eta, width = self.form.second_hz
        return [(eta + width * float(x[-2]), width * math.exp(min(float(x[-1]), 50.0)))]

    def design(self, x: FloatArray) -> ComplexArray:
        """Columns e g, e and x e, as many as the form has, and e g' of every other line: (n, k)."""
        eta, width, delay = self.line(x)
        response = mode_response(self.f, eta, width)
        own = self.wiring.design(self.f, response, delay, self.middle)
        alone = Wiring()
        others = [*self.tails, *(mode_response(self.f, *line) for line in self.second(x))]
        tails = [alone.design(self.f, tail, delay, self.middle) for tail in others]
        return np.concatenate([own, *tails], axis=1)

    def solved(self, x: FloatArray) -> Solved:
        """The best coefficients at x."""
        return SharedGain((0,)).solve([self.design(x)], [self.y], [1.0])[0]

    def residuals(self, x: FloatArray) -> FloatArray:
        """Real, then imaginary parts over the largest modulus, (2 n,)."""
        return both_parts(self.solved(x).values - self.y)

    def minimised(self, source: str) -> FittedForm:
        """The form at its least sum of squares."""
        own = 3 if self.delayed else 2
        begin = np.zeros(own if self.form.second_hz is None else own + 2)
        fit = minimise_squares(self.residuals, begin)
        eta, width, delay = self.line(fit.values)
        inside = self.f[0] <= eta <= self.f[-1] and width < 3.0 * self.span
        slopes = self.slopes(fit.values)
        covariance = _inverse(slopes)
        if not (fit.converged and inside and np.all(np.isfinite(covariance))):
            raise BadInput(
                f"{source}: no resonance between {self.f[0]:.10g} and {self.f[-1]:.10g} Hz "
                f"(the fit ended at {eta:.10g} Hz, width {width:.4g} Hz)"
            )
        structure = residual_structure(fit.residuals, slopes)
        squares = float(fit.residuals @ fit.residuals)
        freedom = max(1, fit.residuals.size - slopes.shape[1])
        dof = freedom / structure.widening**2
        spread = structure.widening**2 * squares / freedom * covariance
        scales = np.ones(slopes.shape[1])
        scales[:2] = self.width0, width
        spread = reach(ROOT_68, dof) ** 2 * np.outer(scales, scales) * spread
        solved = self.solved(fit.values)
        gain = complex(solved.coefficients[0])
        along = np.zeros(slopes.shape[1])
        along[fit.values.size : fit.values.size + 2] = gain.real / abs(gain), gain.imag / abs(gain)
        quality = np.zeros(slopes.shape[1])
        quality[:2] = 1.0 / eta, -1.0 / width
        std, half = np.sqrt(np.diag(spread)[:3]), ratio95(dof)
        delayed = number_of_line("delay", delay, float(std[-1]) / self.span, "s", half=half)
        # covariances but those of other lines
        kept = [*range(own), *range(begin.size, begin.size + 2 * self.wiring.columns)]
        return FittedForm(
            **line_numbers(
                (eta, float(std[0])),
                (width, float(std[1])),
                (eta / width, eta / width * math.sqrt(max(0.0, float(quality @ spread @ quality)))),
                dof,
            ),
            amplitude=number_of_line(
                "amplitude",
                self.top * abs(gain),
                self.top * math.sqrt(float(along @ spread @ along)),
                "",
                half=half,
            ),
            background=0j,
            residual=math.sqrt(squares / self.y.size) / abs(gain),
            correlation=math.nan,
            curve=self.top * solved.values,
            message=fit.message,
            structure=structure,
            dof=dof,
            name=self.form.name,
            delay=delayed if self.delayed else None,
            unknowns=slopes.shape[1],
            squares=squares,
            likely_squares=squares,
            coefficients=solved.coefficients[: self.wiring.columns],
            covariance=spread[np.ix_(kept, kept)],
            second=self.second_line(fit.values, solved),
        )

    def second_line(self, x: FloatArray, solved: Solved) -> SecondLine | None:
        """The second line as it was fitted.

        Args:
            x: at the minimum.
            solved: coefficients there.
        """
        for eta, width in self.second(x):
            height = complex(solved.coefficients[-1] / solved.coefficients[0])
            return SecondLine.at(eta, width, height)
        return None

    def slopes(self, x: FloatArray) -> FloatArray:
        """Derivatives of the residuals by x and by both parts of all coefficients."""
        solved = self.solved(x)
        columns = []
        for step in STEP * np.eye(x.size):
            ends = [self.design(x + h) @ solved.coefficients for h in (step, -step)]
            columns.append(both_parts(ends[0] - ends[1]) / (2.0 * STEP))
        gain = SharedGain((0,)).columns({0: solved})
        return np.stack([*columns, *(both_parts(column[0]) for column in gain)], axis=1)


def _inverse(slopes: FloatArray) -> FloatArray:
    """(J^T J)^-1 (n, n) of slopes J (m, n); infinite where they do not see a direction."""
    sizes = np.linalg.norm(slopes, axis=0)
    _, singular, rows = np.linalg.svd(
        slopes / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False
    )
    if singular[-1] <= singular[0] * np.finfo(float).eps * max(slopes.shape):
        return np.full((sizes.size, sizes.size), np.inf)
    weighted = rows / singular[:, None]
    return np.asarray(weighted.T @ weighted / np.outer(sizes, sizes))
