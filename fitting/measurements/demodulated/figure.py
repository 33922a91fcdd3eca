"""Figure of a demodulated trace: its amplitude and detuning, and what the fit leaves of it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fitting.measurements.demodulated.record import DemodulatedRecord
from fitting.measurements.figure import OF_LARGEST, Axis, Figure, Panel, compared, residual_points
from fitting.measurements.measurement import Values
from fitting.measurements.traces.figure import DRAWN, together
from fitting.measurements.traces.time_record import FOUND
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz, number

#: Amplitudes below this share of the largest are not drawn: the axis is logarithmic.
LOWEST = 1e-9


def demodulated_figure(
    trace: DemodulatedRecord,
    before: Values,
    after: Values,
    series: str = "",
) -> Figure:
    """A trace with the model, its residuals, and their autocorrelation.

    Args:
        trace: as measured.
        before: as simulated with the start parameters, (n,), in the trace's unit.
        after: with the fitted ones.
        series: name of the series.
    """
    x = Axis("time", "s")
    unit = "" if trace.unit == "1" else trace.unit
    every = slice(None, None, -(-trace.t.size // DRAWN))
    t = trace.t[every]

    def panel(axis: Axis, part: Callable[[Values], FloatArray]) -> Panel:
        shown = (part(values)[every] for values in (trace.y, before, after))
        return compared((x, axis), t, *shown)

    floor = LOWEST * trace.largest
    rows = [(panel(Axis("amplitude", unit, log=True), lambda v: np.maximum(np.abs(v), floor)),)]
    if not trace.is_amplitude:
        rows.append((panel(Axis("quadrature X", unit), np.real),))
    left = trace.rows_of(after - trace.y)
    parts = [left] if trace.is_amplitude else list(np.split(left, 2))
    names = ("",) if trace.is_amplitude else ("X", "Y")
    shares = [100.0 * part[every] for part in parts]
    rest = residual_points((x, OF_LARGEST), t, list(zip(names, shares, strict=True)))
    rms = number(100.0 * float(np.sqrt(np.mean(left**2))), 2)
    stated = f" {trace.label}" if trace.label else ""
    what = "amplitudes" if trace.is_amplitude else "phasors"
    return Figure(
        name=f"demodulated{f'_{trace.label}' if trace.label else ''}".replace("/", "_"),
        title=f"Demodulated trace{stated}: measured and simulated",
        caption=(
            f"{trace.y.size} {what} at {hertz(trace.frequency_hz)} with the model before and after "
            f"the fit; {_begin(trace)}. Below: what the fit leaves, {rms} % of the largest value "
            "(rms), and its autocorrelation, with the band that holds 95 % of it where it is white."
        ),
        alt=f"A decay of {trace.y.size} {what} with the fitted model; residual {rms} % rms.",
        rows=(*rows, (rest,), (together(parts[0]),)),
        series=series,
    )


def _begin(trace: DemodulatedRecord) -> str:
    first = "the first sample"
    if trace.begin == FOUND:
        first = f"{trace.t[0]:.6g} s, where the free decay was found to begin"
    many = "its amplitude" if trace.modes == 1 else f"the amplitudes of {trace.modes} modes"
    return f"{many} at {first} {'is' if trace.modes == 1 else 'are'} solved for"
