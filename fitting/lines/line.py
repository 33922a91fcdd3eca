"""One resonance of a trace: what is left out of it, its line, and what contradicts that."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.dip import NOTCH, REFLECTION, DipReading, dip_readings
from fitting.lines.excluded import (
    Clipped,
    Spike,
    further_lines,
    spikes_in,
    without_clipped,
    without_spikes,
)
from fitting.lines.faults import Fault, SweepFault, sweep_faults
from fitting.lines.names import MIN_SWEEP_POINTS, SQUARED, TRANSMISSION
from fitting.lines.record import LineNumber, MeasuredLine, SecondLine, common_fields
from fitting.lines.several import TwoResonances
from fitting.lines.sweep import SweepSearch, is_reversed
from fitting.lines.trace import Trace
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, note
from fitting.text.notation import hertz, listed

#: What may be requested of any values, and of amplitudes alone.
ANY = ("transmission", NOTCH, REFLECTION, "fano", "sloped", "duffing", "duffing_offset")
AMPLITUDES_ALONE = ("offset", "floor", "rice", "single", "tail")
WIRINGS = (*ANY, *AMPLITUDES_ALONE)


@dataclass(frozen=True, kw_only=True)
class Line(MeasuredLine):
    """One resonance of a measured response.

    Attributes:
        amplitude: of the line alone at its eigenfrequency, in ``unit``.
        mirrored: the other amplitude that fits as well, with a complex constant or tail; else None.
        bend: shift of the top by nonlinearity, Hz; None of a linear line.
        background: constant of "offset", "floor", "rice" and "squared_offset", in ``unit``; of
            "sloped" at the eigenfrequency; of "single" the noise of a quadrature; else zero.
        slope: of "sloped" amplitudes, ``unit`` per Hz.
        wiring: the requested or chosen form.
        is_requested: whether it was requested.
        delay: of the cable, s; None: not fitted.
        rivals: other forms that fit nearly as well, included in the errors.
        rivals_widening: factor on the errors for them; else 1.
        readings: of a dip, in each wiring.
        faults: deviations from a damped line.
        further_hz: lines outside of the chosen range, Hz.
        others: further requested lines.
        spikes: excluded single points.
        clipped: excluded top; None: none.
        phases_reversed: whether the file has phases of Re[value exp(-i 2 pi f t)].
    """

    amplitude: LineNumber
    mirrored: LineNumber | None
    bend: LineNumber | None
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
    others: tuple[SecondLine, ...] = ()


def line_of(
    trace: Trace, wiring: str = "", *, delayed: bool | None = None, count: int | None = 1
) -> Line:
    """The resonance of a trace, or several that are fitted together.

    Args:
        trace: what was measured.
        wiring: one of `WIRINGS`; empty: the forms are compared.
        delayed: whether the delay of a cable is fitted; None: if that describes the points better.
        count: number of lines; None: as many as the points show.

    Raises:
        BadInput: no resonance, one that the ends of the sweep cut off, two of them, too few points,
            or a wiring that amplitudes do not show.
    """
    if wiring and wiring not in WIRINGS:
        raise BadInput(f"wiring: found {wiring!r}, wanted one of {', '.join(WIRINGS)}")
    if wiring in AMPLITUDES_ALONE and trace.is_complex:
        raise BadInput(f"wiring: {wiring} wants amplitudes alone, and {trace.source} has phases")
    if delayed and not trace.is_complex:
        raise BadInput(f"delay: wants phases, and {trace.source} has amplitudes alone")
    spikes = spikes_in(trace)
    try:
        rest, clipped = without_clipped(without_spikes(trace, spikes))
        rest = _as_falling(rest)
        elsewhere = further_lines(rest)
        form = "fano" if wiring in (NOTCH, REFLECTION) else wiring
        search = SweepSearch(rest.frequency_hz, rest.values, form, elsewhere, rest.source, delayed)
        best = search.fit() if count == 1 else search.fit_several(count)
    except BadInput as error:
        if isinstance(error, TwoResonances):
            error.phases_reversed = rest.phases_reversed
        notes = f" (read: {trace.read})" if trace.read else ""
        if spikes:
            left = listed(f"{s.place} at {hertz(s.frequency_hz, digits=8)}" for s in spikes)
            notes += f" (left out as single points far off their neighbours: {left})"
        error.args = tuple(f"{text}{notes}" for text in error.args)
        raise

    def in_unit(number: LineNumber | None) -> LineNumber | None:
        return None if number is None else replace(number, unit=trace.unit)

    # what makes amplitudes no damped line, where the best form leaves more than noise
    faults: tuple[SweepFault, ...] = ()
    if best.name in SQUARED:
        plain = next((t.width.value for t in best.forms if t.name == TRANSMISSION), math.nan)
        power = SweepFault(
            fault=Fault.POWER,
            size=2.0,
            std=0.0,
            frequency_hz=math.nan,
            width_hz=(plain, best.width.value),
            p_value=0.0,
        )
        faults = (power,)
    linear = not (rest.is_complex or best.second is not None or best.form.bent)
    if linear and (best.name == "transmission" or best.structure.order > 0):
        listed_faults = sweep_faults(rest.frequency_hz, rest.amplitude)
        faults = tuple(f for f in listed_faults if f.fault is not Fault.BACKGROUND)
    return Line(
        **common_fields(rest, best, best, frequency_hz=rest.frequency_hz),
        amplitude=replace(best.amplitude, unit=trace.unit),
        mirrored=in_unit(best.mirrored),
        bend=best.bend,
        background=best.background.real if best.name != "fano" else 0.0,
        slope=best.slope,
        wiring=wiring or best.name,
        is_requested=bool(wiring),
        delay=best.delay,
        rms_residual=best.rms_residual,
        rivals=best.rivals,
        rivals_widening=best.rivals_widening,
        forms=best.forms,
        readings=dip_readings(rest.frequency_hz, best, wiring),
        faults=faults,
        second=best.second,
        others=tuple(replace(o, amplitude=in_unit(o.amplitude)) for o in best.others),
        further_hz=tuple(place.frequency_hz for place in elsewhere),
        instrument=rest.instrument,
        spikes=spikes,
        phases_reversed=rest.phases_reversed,
        clipped=clipped,
        chisqr=best.squares * rest.top**2,
    )


def _as_falling(trace: Trace) -> Trace:
    """The trace with phases that fall over the resonance, as they are counted here."""
    y = np.asarray(trace.values, dtype=complex)
    if not trace.is_complex or y.size < MIN_SWEEP_POINTS or not is_reversed(trace.frequency_hz, y):
        return trace
    reading = (*trace.reading, note(Kind.phases_reversed))
    return replace(trace, values=np.conj(y), phases_reversed=True, reading=reading)
