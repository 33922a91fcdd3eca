"""One resonance of a trace: every form that may stand beside it, fitted, and the best one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from fitting.resonance.record import MeasuredLine, Points
from fitting.resonance.rival_forms import Covered, covered
from fitting.resonance.second_line import fits_with_second, second_place
from fitting.resonance.spikes import Spike, spikes_in, without_spikes
from fitting.resonance.trace import Trace
from fitting.resonance.two_lines import as_two, two_lines
from fitting.signal.line_record import LineNumber, LineValues, TriedForm, fields_of, no_line
from fitting.signal.peaks import (
    FLOOR,
    MIN_SWEEP_POINTS,
    OFFSET,
    RICE,
    SINGLE,
    TAIL,
)
from fitting.signal.sweep_faults import SweepFault
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, note
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
class Line(MeasuredLine):
    """One resonance of a measured response.

    Attributes:
        amplitude: of the line alone at its eigenfrequency, in ``unit``.
        mirrored: the other amplitude that amplitudes with a complex constant or a tail do not
            distinguish from it; None in other forms, and where they do.
        background: the constant of "offset", "floor" and "rice", in ``unit``, of "sloped"
            amplitudes its value at the eigenfrequency, of "single" the noise of either quadrature
            of a reading; zero in other forms.
        slope: what that of "sloped" amplitudes changes by, ``unit`` for every Hz.
        wiring: the form that was taken, see ``forms``; or the wiring that was requested.
        is_requested: whether it was requested, and not the result of a comparison.
        delay: of the cable, s; None where it was not fitted.
        rivals: other forms of amplitudes that describe the points nearly as well, for which the
            errors hold, too.
        rivals_widening: factor on the errors for them, on frequency or width; else 1.
        readings: where the line is a dip, what it means in each wiring.
        faults: what makes the points no damped line.
        further_hz: where points outside of the chosen range show another line, Hz.
        spikes: single points far off their neighbours, which were left out.
        clipped: a top that the instrument cut off, which was left out; None where none was.
        phases_reversed: whether the file counts phases as Re[value exp(-i 2 pi f t)].
    """

    amplitude: LineNumber
    mirrored: LineNumber | None
    background: float
    slope: float
    wiring: str
    is_requested: bool
    delay: LineNumber | None
    rivals: tuple[str, ...]
    rivals_widening: float
    readings: tuple[DipReading, ...]
    faults: tuple[SweepFault, ...]
    further_hz: tuple[float, ...]
    spikes: tuple[Spike, ...]
    phases_reversed: bool
    clipped: Clipped | None = None


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
        return replace(_line_of(_as_falling(rest), wiring, spikes), clipped=clipped)
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
    requested = FANO if wiring in (NOTCH, REFLECTION) else wiring
    fitted, failed = _fitted(trace, further, requested)
    criteria = criteria_of(fitted, trace.rows)
    order = [int(k) for k in np.argsort(criteria, kind="stable")]
    if further and not requested:
        order = with_tail(fitted, criteria, order)
    if not trace.is_complex:
        order = without_doubtful_slope(fitted, criteria, order)
    order = without_doubtful_constant(fitted, criteria, order)
    order.sort(key=lambda k: bool(requested) and fitted[k].name != requested)
    order = without_doubtful_delay(fitted, criteria, order, requested)
    best = fitted[order[0]]
    if requested and best.name != requested:
        raise BadInput(next(form.message for form in failed if form.name == requested))
    both = _with_second(trace, [fitted[k] for k in order], further, requested)
    if both:
        fitted, criteria, order = _second_first(trace, fitted, both)
        best = fitted[order[0]]
    check_one(trace, best, further, {form.name: form.message for form in failed})
    check_overlap(trace, best, fitted)
    same = bool(requested) or trace.is_complex
    wider = Covered(best, (), 1.0) if same else covered(fitted, criteria, order[0])
    best = wider.form
    # of complex values both parts are rows: their points are worth half of them
    structure = best.structure
    structure = replace(structure, points=structure.points / (2.0 if trace.is_complex else 1.0))
    return Line(
        **fields_of(best, LineValues),
        source=trace.source,
        unit=trace.unit,
        amplitude=replace(best.amplitude, unit=trace.unit),
        mirrored=None if best.mirrored is None else replace(best.mirrored, unit=trace.unit),
        background=best.background.real,
        slope=best.slope,
        wiring=wiring or best.name,
        is_requested=bool(wiring),
        delay=best.delay,
        residual=best.residual,
        dof=best.dof,
        structure=structure,
        rivals=wider.rivals,
        rivals_widening=wider.factor,
        forms=(*(_tried(fitted[k], criteria[k] - np.min(criteria)) for k in order), *failed),
        readings=dip_readings(trace, best, wiring),
        faults=faults_of(trace, best),
        second=best.second,
        further_hz=tuple(line.frequency_hz for line in further),
        instrument=own_estimates(trace.notes),
        spikes=tuple(spikes),
        phases_reversed=trace.phases_reversed,
        reading=trace.reading,
        points=Points.of(trace.values, best.curve, frequency_hz=trace.frequency_hz),
    )


def _with_second(
    trace: Trace, forms: Sequence[FittedForm], further: Sequence[FurtherLine], requested: str
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
    both = fits_with_second(trace, forms, place, requested, tails)
    for form in both[:1]:
        lines = as_two(form, form.second)
        if lines is not None and lines.share > WEAK:
            raise not_one(trace, lines)
    return both


def _second_first(
    trace: Trace, single: Sequence[FittedForm], both: Sequence[FittedForm]
) -> tuple[list[FittedForm], FloatArray, list[int]]:
    """All forms, those of two lines first, their criteria, and the order they are taken in."""
    forms = [*both, *single]
    criteria = criteria_of(forms, trace.rows)
    order = [int(k) for k in np.argsort(criteria, kind="stable")]
    pair = [k for k in order if k < len(both)]
    if not trace.is_complex:
        pair = without_doubtful_slope(forms, criteria, pair)
    near = [k for k in pair if criteria[k] - criteria[pair[0]] < AS_GOOD]
    simple = min(near, key=lambda k: forms[k].unknowns)
    pair = [simple, *(k for k in pair if k != simple)]
    return forms, criteria, [*pair, *(k for k in order if k >= len(both))]


def _as_falling(trace: Trace) -> Trace:
    """The trace with phases that fall over the resonance, as they are counted here."""
    if not trace.is_complex or trace.values.size < MIN_SWEEP_POINTS:
        return trace
    f, y = trace.frequency_hz, np.asarray(trace.values, dtype=complex)
    here, there = (begin_of(f, each, FANO, guesses(f, each))[1] for each in (y, np.conj(y)))
    if here <= there:
        return trace
    reading = (*trace.reading, note(Kind.phases_reversed))
    return replace(trace, values=np.conj(y), phases_reversed=True, reading=reading)


def _fitted(
    trace: Trace, further: Sequence[FurtherLine], requested: str
) -> tuple[list[FittedForm], list[TriedForm]]:
    """Every form, as it was fitted; those that could not be."""
    resolved: list[FittedForm] = []
    unresolved: list[FittedForm] = []
    failed: list[TriedForm] = []

    def attempt(tries: Sequence[_Try]) -> None:
        for (name, delayed), fit in tries:
            try:
                form = fit()
            except BadInput as error:
                message = str(error)
                failed.append(TriedForm(**no_line(), name=name, delayed=delayed, message=message))
                continue
            (unresolved if delayed and not _resolves_delay(trace, form) else resolved).append(form)

    attempt(_tries(trace, further))
    if not trace.is_complex:
        noisy = any(form.structure.order == 0 for form in resolved)
        if further or requested == TAIL or not noisy:
            attempt([_tail(trace, further)])
    if not (resolved or unresolved):
        complain_of_flank(trace, further, math.inf)
        complain_of_ends(trace)
        if trace.is_complex or trace.values.size < MIN_SWEEP_POINTS:
            raise BadInput(failed[0].message)
        ends = hertz(*trace.frequency_hz[[0, -1]], digits=8, joined=" and ")
        raise BadInput(
            f"{trace.source}: shows no resonance between {ends}: no form of a line can be fitted"
        )
    return resolved or unresolved, failed


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
    return delayed.width.value * WIDTHS_FOR_DELAY < float(np.ptp(trace.frequency_hz))


def _tried(form: FittedForm, criterion: float) -> TriedForm:
    return TriedForm(
        **fields_of(form, LineValues),
        name=form.name,
        delayed=form.delay is not None,
        residual=form.residual,
        criterion=float(criterion),
        structure=form.structure,
        second=form.second is not None,
    )
