"""One resonance of a trace: every form that may stand beside it, fitted, and the best one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from fitting.campaign.instruments import own_estimates
from fitting.measurements.complex.curve import WIDTHS_FOR_DELAY
from fitting.resonance.clipped import Clipped, without_clipped
from fitting.resonance.complaints import (
    check_one,
    check_overlap,
    complain_of_ends,
    complain_of_flank,
    faults_of,
    not_one,
    outside,
)
from fitting.resonance.dip_reading import NOTCH, REFLECTION, DipReading, dip_readings
from fitting.resonance.form import (
    AMPLITUDE_FORMS,
    FANO,
    FORMS,
    SLOPED,
    TRANSMISSION,
    ComplexForm,
    FittedForm,
    begin_of,
    fit_amplitudes,
    fit_complex,
    guesses,
)
from fitting.resonance.form_choice import (
    AS_GOOD,
    criteria_of,
    with_tail,
    without_doubtful_constant,
    without_doubtful_delay,
    without_doubtful_slope,
)
from fitting.resonance.further_lines import (
    FurtherLine,
    further_lines,
)
from fitting.resonance.rival_forms import Covered, covered
from fitting.resonance.second_line import fits_with_second, second_place
from fitting.resonance.spikes import Spike, spikes_in, without_spikes
from fitting.resonance.trace import Trace
from fitting.resonance.two_lines import as_two, two_lines
from fitting.signal.peaks import (
    FLOOR,
    MIN_SWEEP_POINTS,
    OFFSET,
    RICE,
    SINGLE,
    TAIL,
    SecondLine,
)
from fitting.signal.student import ratio95
from fitting.signal.sweep_faults import SweepFault
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, listed

#: Height of a second line over that of the first one up to which the first is the one meant.
WEAK = 0.3
#: Forms of amplitudes alone.
AMPLITUDES_ALONE = (OFFSET, FLOOR, RICE, SINGLE, TAIL)
#: What may be asked for: forms, and those of their readings that are no form of their own.
WIRINGS = (TRANSMISSION, NOTCH, REFLECTION, FANO, SLOPED, *AMPLITUDES_ALONE)
#: Widths, and logarithm of a factor on the width, by which another line may not be where a point
#: outside is largest, or where it is only supposed.
SEEN_ROOM, UNSEEN_ROOM = 1.0, 3.0


@dataclass(frozen=True, kw_only=True)
class LineForm:
    """A form of the line and what it gives; NaN where it could not be fitted (``message``).

    Attributes:
        name: "transmission", "fano" or "sloped"; of amplitudes "offset", "floor", "rice",
            "single" or "tail", too.
        delayed: whether the delay of a cable is fitted, too.
        second: whether a second line among the points is fitted, too.
        criterion: Akaike's, over the least of all forms; 10 is plainly worse.
        residual: root mean square of what is left, over the line's amplitude.
        message: why it could not be fitted.
    """

    name: str
    delayed: bool
    frequency_hz: float
    frequency_std_hz: float
    width_hz: float
    width_std_hz: float
    q: float
    q_std: float
    residual: float
    criterion: float
    message: str = ""
    second: bool = False


@dataclass(frozen=True, kw_only=True)
class LinePoints:
    """What was measured and what was fitted, (n,) each; imaginary parts are empty without phases.

    Phases are counted as Re[value exp(i 2 pi f t)]: they fall over a resonance.
    """

    frequency_hz: tuple[float, ...]
    measured: tuple[float, ...]
    fitted: tuple[float, ...]
    measured_imaginary: tuple[float, ...] = ()
    fitted_imaginary: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Line:
    """One resonance of a measured response.

    Errors (``_std``) are half of the interval that holds the truth in 68 of 100 such sweeps, the
    others (``_ci95``) in 95. Both are Student's, as the noise is known from the residuals alone.

    Attributes:
        source: the file, or "arrays".
        frequency_hz: eigenfrequency, Hz.
        width_hz: full width at half of the power, Hz.
        q: their ratio.
        amplitude: of the line alone at its eigenfrequency, in ``unit``.
        amplitude_mirrored: the other amplitude that amplitudes beside a complex constant or a tail
            do not tell from it, in ``unit``, and its error; NaN in other forms, and where they do.
        beside: the constant of "offset", "floor" and "rice", in ``unit``, of "sloped" amplitudes
            its value at ``frequency_hz``, of "single" the noise of either quadrature of a reading;
            zero in other forms.
        beside_slope: what that of "sloped" amplitudes changes by, ``unit`` for every Hz.
        wiring: the form that was taken, see ``forms``; or the wiring that was asked for.
        asked: whether it was asked for, and not found.
        delay_s: of the cable, s, and its error; NaN where none was found.
        residual: root mean square of what is left, over ``amplitude``.
        freedom: degrees of freedom of the noise.
        independent_points: how many independent and equal points the points are worth.
        widening: factor on the errors for residuals that are no noise of one size; else 1.
        structure_p: probability that white noise leaves such residuals.
        sizes_p: probability that noise of one size leaves such residuals.
        rivals: other forms of amplitudes that describe the points nearly as well, for which the
            errors hold, too.
        rivals_widening: factor on the errors for them, on frequency or width; else 1.
        forms: every form that was tried, the one that was taken first.
        readings: where the line is a dip, what it means in each wiring.
        faults: what makes the points no damped line.
        second: a weaker line among the points, fitted beside this one; None without.
        further_hz: where points outside of the chosen range show another line, Hz.
        instrument: the instrument's own estimates, "frequency_hz" and "q", as far as it says.
        spikes: single points far off their neighbours, which were left out.
        clipped: a top that the instrument cut off, which was left out; None where none was.
        turned: whether the file counts phases the other way, as Re[value exp(-i 2 pi f t)].
        said: how the file was read, in sentences.
        points: what was measured and fitted.
    """

    source: str
    frequency_hz: float
    frequency_std_hz: float
    frequency_ci95_hz: tuple[float, float]
    width_hz: float
    width_std_hz: float
    width_ci95_hz: tuple[float, float]
    q: float
    q_std: float
    q_ci95: tuple[float, float]
    amplitude: float
    amplitude_std: float
    amplitude_mirrored: float
    amplitude_mirrored_std: float
    beside: float
    beside_slope: float
    unit: str
    wiring: str
    asked: bool
    delay_s: float
    delay_std_s: float
    residual: float
    freedom: float
    independent_points: float
    widening: float
    structure_p: float
    sizes_p: float
    rivals: tuple[str, ...]
    rivals_widening: float
    forms: tuple[LineForm, ...]
    readings: tuple[DipReading, ...]
    faults: tuple[SweepFault, ...]
    second: SecondLine | None
    further_hz: tuple[float, ...]
    instrument: Mapping[str, float]
    spikes: tuple[Spike, ...]
    turned: bool
    said: tuple[str, ...]
    points: LinePoints = field(repr=False)
    clipped: Clipped | None = None

    @property
    def ratio95(self) -> float:
        """The half of a 95 % interval over that of a 68 % one."""
        return ratio95(self.freedom)

    @property
    def is_complex(self) -> bool:
        """Whether phases were measured."""
        return bool(self.points.measured_imaginary)


def line_of(trace: Trace, wiring: str = "") -> Line:
    """The resonance of a trace.

    Args:
        trace: what was measured.
        wiring: one of `WIRINGS`; empty: the forms are compared.

    Raises:
        BadInput: no resonance, one that the ends of the sweep cut off, two of them, too few points,
            or a wiring that amplitudes do not tell.
    """
    if wiring and wiring not in WIRINGS:
        raise BadInput(f"wiring: found {wiring!r}, wanted one of {', '.join(WIRINGS)}")
    if wiring in AMPLITUDES_ALONE and trace.is_complex:
        raise BadInput(f"wiring: {wiring} wants amplitudes alone, and {trace.source} has phases")
    spikes = spikes_in(trace)
    try:
        rest, clipped = without_clipped(without_spikes(trace, spikes))
        return replace(_line_of(_turned(rest), wiring, spikes), clipped=clipped)
    except BadInput as error:
        if trace.read:
            error.args = tuple(f"{text} (read: {trace.read})" for text in error.args)
        if spikes:
            left = listed(f"{s.place} at {hertz(s.frequency_hz, digits=8)}" for s in spikes)
            error.args = tuple(
                f"{text} (left out as single points far off their neighbours: {left})"
                for text in error.args
            )
        raise


def _line_of(trace: Trace, wiring: str, spikes: Sequence[Spike]) -> Line:
    further = further_lines(trace)
    asked = FANO if wiring in (NOTCH, REFLECTION) else wiring
    found, failed = _fitted(trace, further, asked)
    criteria = criteria_of(found, trace.rows)
    order = [int(k) for k in np.argsort(criteria, kind="stable")]
    if further and not asked:
        order = with_tail(found, criteria, order)
    if not trace.is_complex:
        order = without_doubtful_slope(found, criteria, order)
    order = without_doubtful_constant(found, criteria, order)
    order.sort(key=lambda k: bool(asked) and found[k].name != asked)
    order = without_doubtful_delay(found, criteria, order, asked)
    best = found[order[0]]
    if asked and best.name != asked:
        raise BadInput(next(form.message for form in failed if form.name == asked))
    both = _with_second(trace, [found[k] for k in order], further, asked)
    if both:
        found, criteria, order = _second_first(trace, found, both)
        best = found[order[0]]
    check_one(trace, best, further, {form.name: form.message for form in failed})
    check_overlap(trace, best, found)
    same = bool(asked) or trace.is_complex
    wider = Covered(best, (), 1.0) if same else covered(found, criteria, order[0])
    best = wider.form
    return Line(
        source=trace.source,
        frequency_hz=best.frequency_hz,
        frequency_std_hz=best.frequency_std_hz,
        frequency_ci95_hz=_interval(best.frequency_hz, best.frequency_std_hz, best.freedom),
        width_hz=best.width_hz,
        width_std_hz=best.width_std_hz,
        width_ci95_hz=_interval(best.width_hz, best.width_std_hz, best.freedom),
        q=best.q,
        q_std=best.q_std,
        q_ci95=_interval(best.q, best.q_std, best.freedom),
        amplitude=best.amplitude,
        amplitude_std=best.amplitude_std,
        amplitude_mirrored=best.mirrored,
        amplitude_mirrored_std=best.mirrored_std,
        beside=best.beside,
        beside_slope=best.slope,
        unit=trace.unit,
        wiring=wiring or best.name,
        asked=bool(wiring),
        delay_s=best.delay_s,
        delay_std_s=best.delay_std_s,
        residual=best.residual,
        freedom=best.freedom,
        independent_points=best.structure.points / (2.0 if trace.is_complex else 1.0),
        widening=best.structure.widening,
        structure_p=best.structure.p_value,
        sizes_p=best.structure.sizes_p,
        rivals=wider.rivals,
        rivals_widening=wider.factor,
        forms=(*(_numbers(found[k], criteria[k] - np.min(criteria)) for k in order), *failed),
        readings=dip_readings(trace, best, wiring),
        faults=faults_of(trace, best),
        second=best.second,
        further_hz=tuple(line.frequency_hz for line in further),
        instrument=own_estimates(trace.notes),
        spikes=tuple(spikes),
        turned=trace.turned,
        said=trace.said,
        points=_points(trace, best),
    )


def _with_second(
    trace: Trace, forms: Sequence[FittedForm], further: Sequence[FurtherLine], asked: str
) -> list[FittedForm]:
    """Forms with a second line among the points, where one is seen that is far lower.

    Raises:
        TwoResonances: it is about as high as the first one: nobody knows which is wanted.
    """
    best = forms[0]
    two = two_lines(trace, best)
    if two is not None and (two.overlap or two.share > WEAK):
        raise not_one(trace, two)
    place = None if best.name == TAIL else second_place(trace, best)
    if place is None:
        return []
    tails = [(line.frequency_hz, line.width_hz) for line in further]
    both = fits_with_second(trace, forms, place, asked, tails)
    for form in both[:1]:
        lines = as_two(form.frequency_hz, form.width_hz, form.second)
        if lines is not None and lines.share > WEAK:
            raise not_one(trace, lines)
    return both


def _second_first(
    trace: Trace, found: Sequence[FittedForm], both: Sequence[FittedForm]
) -> tuple[list[FittedForm], FloatArray, list[int]]:
    """All forms, those of two lines first, their criteria, and the order they are taken in."""
    forms = [*both, *found]
    criteria = criteria_of(forms, trace.rows)
    order = [int(k) for k in np.argsort(criteria, kind="stable")]
    pair = [k for k in order if k < len(both)]
    if not trace.is_complex:
        pair = without_doubtful_slope(forms, criteria, pair)
    near = [k for k in pair if criteria[k] - criteria[pair[0]] < AS_GOOD]
    simple = min(near, key=lambda k: forms[k].unknowns)
    pair = [simple, *(k for k in pair if k != simple)]
    return forms, criteria, [*pair, *(k for k in order if k >= len(both))]


def _interval(value: float, error: float, freedom: float) -> tuple[float, float]:
    """The 95 % interval about a value with half of its 68 % interval."""
    half = error * ratio95(freedom)
    return value - half, value + half


def _points(trace: Trace, best: FittedForm) -> LinePoints:
    f, y, curve = trace.frequency_hz, trace.values, best.curve
    points = LinePoints(
        frequency_hz=tuple(f.tolist()),
        measured=tuple(y.real.tolist()),
        fitted=tuple(curve.real.tolist()),
    )
    if not trace.is_complex:
        return points
    return replace(
        points,
        measured_imaginary=tuple(y.imag.tolist()),
        fitted_imaginary=tuple(curve.imag.tolist()),
    )


def _turned(trace: Trace) -> Trace:
    """The trace with phases that fall over the resonance, as they are counted here."""
    if not trace.is_complex or trace.values.size < MIN_SWEEP_POINTS:
        return trace
    f, y = trace.frequency_hz, np.asarray(trace.values, dtype=complex)
    here, there = (begin_of(f, each, FANO, guesses(f, each))[1] for each in (y, np.conj(y)))
    if here <= there:
        return trace
    words = "The file counts phases the other way, rising over the resonance: they were turned."
    return replace(trace, values=np.conj(y), turned=True, said=(*trace.said, words))


def _fitted(
    trace: Trace, further: Sequence[FurtherLine], asked: str
) -> tuple[list[FittedForm], list[LineForm]]:
    """Every form, as it was fitted; those that could not be."""
    found: list[FittedForm] = []
    unresolved: list[FittedForm] = []
    failed: list[LineForm] = []

    def tried(tries: Sequence[_Try]) -> None:
        for (name, delayed), fit in tries:
            try:
                form = fit()
            except BadInput as error:
                failed.append(_failure(name, delayed, str(error)))
                continue
            (unresolved if delayed and not _resolves_delay(trace, form) else found).append(form)

    tried(_tries(trace, further))
    if not trace.is_complex:
        noisy = any(form.structure.order == 0 for form in found)
        if further or asked == TAIL or not noisy:
            tried([_tail(trace, further)])
    if not (found or unresolved):
        complain_of_flank(trace, further, math.inf)
        complain_of_ends(trace)
        if trace.is_complex or trace.values.size < MIN_SWEEP_POINTS:
            raise BadInput(failed[0].message)
        ends = hertz(*trace.frequency_hz[[0, -1]], digits=8, joined=" and ")
        raise BadInput(
            f"{trace.source}: shows no resonance between {ends}: no form of a line can be fitted"
        )
    return found or unresolved, failed


#: Name of a form, whether a delay is fitted, too, and its fit.
_Try = tuple[tuple[str, bool], Callable[[], FittedForm]]


def _tail(trace: Trace, further: Sequence[FurtherLine]) -> _Try:
    """The fit of a line beside the tail of another one, seen or beyond the ends."""
    others = [(line.frequency_hz, line.width_hz) for line in outside(trace, further)]
    room = SEEN_ROOM if further else UNSEEN_ROOM

    def fit() -> FittedForm:
        f, a = trace.frequency_hz, trace.amplitude
        return fit_amplitudes(f, a, TAIL, trace.source, others, room)

    return (TAIL, False), fit


def _tries(trace: Trace, further: Sequence[FurtherLine]) -> list[_Try]:
    f, source = trace.frequency_hz, trace.source
    if not trace.is_complex:
        a = trace.amplitude
        names = [name for name in AMPLITUDE_FORMS if name != TAIL]
        return [((n, False), partial(fit_amplitudes, f, a, n, source)) for n in names]
    if f.size < MIN_SWEEP_POINTS:
        raise BadInput(
            f"{source}: {f.size} points are too few for a resonance fit; wanted at least "
            f"{MIN_SWEEP_POINTS}"
        )
    y = np.asarray(trace.values, dtype=complex)
    begin = guesses(f, y)
    tails = [(line.frequency_hz, line.width_hz) for line in further]
    forms = [
        ComplexForm(name=name, delayed=delayed, tails_hz=tails)
        for delayed in (False, True)
        for name in FORMS
    ]
    return [
        ((form.name, form.delayed), partial(fit_complex, f, y, form, begin, source))
        for form in forms
    ]


def _resolves_delay(trace: Trace, delayed: FittedForm) -> bool:
    """Whether the sweep is so long that a delay is not just the phase of the line itself.

    Its own width counts: without the delay, no form need find the line of a long cable.
    """
    return delayed.width_hz * WIDTHS_FOR_DELAY < float(np.ptp(trace.frequency_hz))


def _numbers(form: FittedForm, criterion: float) -> LineForm:
    return LineForm(
        name=form.name,
        delayed=not math.isnan(form.delay_s),
        frequency_hz=form.frequency_hz,
        frequency_std_hz=form.frequency_std_hz,
        width_hz=form.width_hz,
        width_std_hz=form.width_std_hz,
        q=form.q,
        q_std=form.q_std,
        residual=form.residual,
        criterion=float(criterion),
        second=form.second is not None,
    )


def _failure(name: str, delayed: bool, message: str) -> LineForm:
    nan = math.nan
    return LineForm(
        name=name,
        delayed=delayed,
        frequency_hz=nan,
        frequency_std_hz=nan,
        width_hz=nan,
        width_std_hz=nan,
        q=nan,
        q_std=nan,
        residual=nan,
        criterion=nan,
        message=message,
    )
