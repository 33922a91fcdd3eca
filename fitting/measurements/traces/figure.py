"""Figure of a trace: measured and simulated, what the fit leaves, and how that hangs together."""

from __future__ import annotations

import numpy as np

from fitting.measurements.figure import (
    OF_LARGEST,
    Axis,
    Figure,
    Form,
    Layer,
    Panel,
    Role,
    compared,
    residual_points,
)
from fitting.measurements.traces.record import REST, TraceRecord
from fitting.measurements.traces.time_record import FOUND
from fitting.text.arrays import FloatArray
from fitting.text.notation import number

#: Points that are drawn of a layer, at most: the first and last of equal stretches.
DRAWN = 4000
#: Lags of the autocorrelation that is drawn, at most.
LAGS = 60


def trace_figure(
    trace: TraceRecord, before: FloatArray, after: FloatArray, series: str = ""
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
    t, y = trace.t[every], trace.y[every]
    sigma = np.full(t.size, trace.sigma) if trace.sigma > 0.0 else None
    shown = compared((x, Axis("output", unit)), t, y, before[every], after[every], sigma)
    left = after - trace.y
    rest = residual_points((x, OF_LARGEST), t, [("", (100.0 * left / trace.largest)[every])])
    rms = number(100.0 * float(np.sqrt(np.mean(left**2))) / trace.largest, 2)
    count = trace.y.size
    which = f"{count} samples" if every.step == 1 else f"One of {every.step} of {count} samples"
    stated = f" {trace.label}" if trace.label else ""
    return Figure(
        name=f"trace{f'_{trace.label}' if trace.label else ''}".replace("/", "_"),
        title=f"Trace{stated}: measured and simulated",
        caption=(
            f"{which} with the model before and after the fit; {_input(trace)}; {_start(trace)}. "
            f"Below: what the fit leaves, {rms} % of the largest distance from the mean (rms), and "
            "its autocorrelation, with the band that holds 95 % of it where it is white."
        ),
        alt=f"A trace of {trace.y.size} samples with the fitted model; residual {rms} % rms.",
        rows=((shown,), (rest,), (together(left),)),
        series=series,
    )


def together(left: FloatArray) -> Panel:
    """Autocorrelation of residuals over lag, and where 95 % of white ones stay.

    Args:
        left: residuals, (n,).
    """
    lags = np.arange(1, min(LAGS, left.size // 4) + 1)
    centred = left - np.mean(left)
    power = float(centred @ centred) or 1.0
    r = np.array([float(centred[k:] @ centred[:-k]) / power for k in lags])
    white = 1.96 / np.sqrt(left.size)
    bounds = np.full(lags.size, white)
    lag = lags.astype(float)
    return Panel(
        x=Axis("lag", "samples"),
        y=Axis("autocorrelation", low=min(-1.2 * white, 1.1 * float(r.min())), high=None),
        layers=(
            Layer(Role.SIMULATED, Form.STEMS, lag, r),
            Layer(Role.OTHER, Form.CURVE, lag, bounds, label="95 % of white ones"),
            Layer(Role.OTHER, Form.CURVE, lag, -bounds),
        ),
        level=0.0,
        height=0.5,
    )


def _input(trace: TraceRecord) -> str:
    if len(trace.waveforms) > 1:
        return "; ".join(f"{name}: {wave.words}" for name, wave in trace.waveforms.items())
    return next((wave.words for wave in trace.waveforms.values()), "no input")


def _start(trace: TraceRecord) -> str:
    if trace.start == REST:
        return "the FMU begins with its start values"
    first = "the first sample"
    if trace.begin == FOUND:
        first = f"{trace.t[0]:.6g} s, where the free decay was found to begin"
    return f"its state at {first}, {trace.states} numbers, is solved for"
