"""Figure of a demodulated trace: its amplitude and detuning, and what the fit leaves of it."""

from __future__ import annotations

import numpy as np

from fitting.measurements.demodulated.record import DemodulatedRecord
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
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

    def panel(axis: Axis, shown: tuple[FloatArray, FloatArray, FloatArray]) -> Panel:
        kinds = (
            (Role.MEASURED, Form.POINTS, "measured"),
            (Role.START, Form.CURVE, "model, start parameters"),
            (Role.SIMULATED, Form.CURVE, "model, fitted parameters"),
        )
        layers = tuple(
            Layer(role, form, t, values[every], label=label)
            for (role, form, label), values in zip(kinds, shown, strict=True)
        )
        return Panel(x=x, y=axis, layers=layers)

    floor = LOWEST * trace.largest
    sizes = tuple(np.maximum(np.abs(v), floor) for v in (trace.y, before, after))
    rows = [(panel(Axis("amplitude", unit, log=True), (sizes[0], sizes[1], sizes[2])),)]
    if not trace.is_amplitude:
        turned = tuple(np.real(v) for v in (trace.y, before, after))
        rows.append((panel(Axis("quadrature X", unit), (turned[0], turned[1], turned[2])),))
    left = trace.rows_of(after - trace.y)
    parts = [left] if trace.is_amplitude else list(np.split(left, 2))
    names = ("",) if trace.is_amplitude else ("X", "Y")
    roles = (Role.SIMULATED, Role.OTHER)
    rest = Panel(
        x=x,
        y=Axis("minus measured", "% of largest"),
        layers=tuple(
            Layer(role, Form.POINTS, t, 100.0 * part[every], label=name)
            for role, part, name in zip(roles, parts, names, strict=False)
        ),
        level=0.0,
        height=0.5,
    )
    rms = number(100.0 * float(np.sqrt(np.mean(left**2))), 2)
    said = f" {trace.label}" if trace.label else ""
    what = "amplitudes" if trace.is_amplitude else "phasors"
    return Figure(
        name=f"demodulated{f'_{trace.label}' if trace.label else ''}".replace("/", "_"),
        title=f"Demodulated trace{said}: measured and simulated",
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
