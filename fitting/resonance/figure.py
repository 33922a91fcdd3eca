"""Figures of one resonance, of a sweep, a ringdown or a noise spectrum: data, fit, residuals."""

from __future__ import annotations

import math

import numpy as np

from fitting.lines.decay_record import SAMPLES
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.resonance.line import Line
from fitting.resonance.noise_line import NoiseLine
from fitting.resonance.record import MeasuredLine
from fitting.resonance.ringdown import Ringdown
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.notation import hertz, number, prefixed, quantity, with_error

#: Points of a ringdown and of a noise spectrum up to which all are drawn; of more every so many.
DRAWN = 20_000


def figure_of(result: MeasuredLine) -> Figure:
    """The figure of a result.

    Args:
        result: as it was fitted.
    """
    if isinstance(result, Ringdown):
        return _ringdown_figure(result)
    if isinstance(result, NoiseLine):
        return _noise_figure(result)
    assert isinstance(result, Line)  # noqa: S101 - there is no fourth kind
    return _line_figure(result)


def _line_figure(line: Line) -> Figure:
    """Amplitude, phase if there is one, and residuals over frequency."""
    f = np.array(line.points.frequency_hz)
    x, marked = Axis("frequency f", "Hz"), (line.frequency.value,)
    measured, fitted = line.points.arrays()
    unit = "" if line.unit == "1" else line.unit
    layers = _layers(f, np.abs(measured), np.abs(fitted))
    panels = [Panel(x=x, y=Axis("amplitude", unit), layers=layers, marked=marked)]
    if line.is_complex:  # unwrapped phases of the fit, and measured ones within half a turn of them
        phase = np.unwrap(np.angle(fitted))
        near = phase + np.angle(measured * np.conj(fitted))
        layers = _layers(f, np.rad2deg(near), np.rad2deg(phase))
        y = Axis("phase", "°")
        panels.append(Panel(x=x, y=y, layers=layers, marked=marked, height=0.7))
    left = 100.0 * (measured - fitted) / line.amplitude.value
    panels.append(_residuals(x, f, left, "% of line", "measured minus fitted", marked))
    words = _words(line)
    return Figure(
        name="line",
        title=f"One resonance: {words}",
        caption=(
            f"{f.size} points with the fitted line ({line.wiring}) and what the fit leaves of "
            f"them, {number(100.0 * line.rms_residual, 2)} % of the line (rms). {words}."
        ),
        alt=f"Resonance near {hertz(line.frequency.value)} with its fit. {words}.",
        rows=tuple((panel,) for panel in panels),
    )


def _ringdown_figure(result: Ringdown) -> Figure:
    """Sizes on a logarithmic axis, where a decay is straight, and residuals over time."""
    every = -(-len(result.points.time_s) // DRAWN)
    t = np.array(result.points.time_s)[::every]
    measured, fitted = (values[::every] for values in result.points.arrays())
    short, decay = _words(result), result.decay_time
    factor, unit = prefixed(decay.value, "s")
    words = f"{short}, decay time {with_error(decay.value / factor, decay.std / factor, unit)}"
    some = "" if every == 1 else f" (every {every}th is drawn)"
    samples = result.kind == SAMPLES
    sizes, curve = (np.asarray(v.real if samples else np.abs(v)) for v in (measured, fitted))
    # a decay goes on falling below what was recorded in its noise
    low = None
    if not samples and np.any(sizes):
        low = 0.3 * float(np.quantile(sizes[sizes > 0.0], 0.01))
    unit = "" if result.unit == "1" else result.unit
    x = Axis("time t", "s")
    y = Axis("recorded" if samples else "amplitude", unit, log=not samples, low=low)
    left = 100.0 * (measured - fitted) / result.amplitude.value
    return Figure(
        name="line",
        title=f"Ringdown: {short}",
        caption=(
            f"{len(result.points.time_s)} samples{some} with the fitted decay ({result.form}) and "
            f"what the fit leaves of them, {number(100.0 * result.rms_residual, 2)} % of the "
            f"amplitude at the first sample (rms). {words}."
        ),
        alt=f"Ringdown with its fit. {words}.",
        rows=(
            (Panel(x=x, y=y, layers=_layers(t, sizes, curve, "recorded", "fitted decay")),),
            (_residuals(x, t, left, "% of A", "recorded minus fitted"),),
        ),
    )


def _noise_figure(result: NoiseLine) -> Figure:
    """The density on a logarithmic axis, and residuals as shares of the fit."""
    points = result.points
    every = -(-len(points.frequency_hz) // DRAWN)
    f, measured, fitted = (
        np.array(values)[::every]
        for values in (points.frequency_hz, points.measured, points.fitted)
    )
    words = _words(result)
    some = "" if every == 1 else f" (every {every}th is drawn)"
    unit = "relative" if result.unit == "1" else f"{result.unit}²/Hz"
    x, y = Axis("frequency f", "Hz"), Axis("density", unit, log=True)
    layers = _layers(f, measured, fitted, curve="fitted line and floor")
    left = 100.0 * (measured / fitted - 1.0)
    return Figure(
        name="line",
        title=f"Noise spectrum: {words}",
        caption=(
            f"{len(points.frequency_hz)} points{some} with the fitted line on a white floor, and "
            f"what the fit leaves of them as shares of itself: they scatter as averages of "
            f"{number(result.averages, 2)} periodograms. {words}."
        ),
        alt=f"Noise spectrum with its fit. {words}.",
        rows=(
            (Panel(x=x, y=y, layers=layers),),
            (_residuals(x, f, left, "% of the fit", "measured minus fitted"),),
        ),
    )


def _words(result: MeasuredLine) -> str:
    """Frequency, where it is known, and width."""
    f, width = (quantity(each.value, each.std, "Hz") for each in (result.frequency, result.width))
    return f"f = {f}, width {width}" if math.isfinite(result.frequency.value) else f"width {width}"


def _layers(
    places: FloatArray,
    measured: FloatArray,
    fitted: FloatArray,
    points: str = "measured",
    curve: str = "fitted line",
) -> tuple[Layer, Layer]:
    """Measured points and the fitted curve, with their labels."""
    return (
        Layer(Role.MEASURED, Form.POINTS, places, measured, label=points),
        Layer(Role.SIMULATED, Form.CURVE, places, fitted, label=curve),
    )


def _residuals(
    x: Axis,
    places: FloatArray,
    left: FloatArray | ComplexArray,
    unit: str,
    label: str,
    marked: tuple[float, ...] = (),
) -> Panel:
    """Residuals about zero; of complex ones both parts."""
    layers = [Layer(Role.MEASURED, Form.POINTS, places, left.real, label=label)]
    if np.iscomplexobj(left):
        layers = [
            Layer(Role.MEASURED, Form.POINTS, places, left.real, label="residual of X"),
            Layer(Role.OTHER, Form.POINTS, places, left.imag, label="residual of Y"),
        ]
    y = Axis("residual", unit)
    return Panel(x=x, y=y, layers=tuple(layers), level=0.0, marked=marked, height=0.5)
