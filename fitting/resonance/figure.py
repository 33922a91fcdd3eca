"""Figures of one resonance, of a sweep, a ringdown or a noise spectrum: data, fit, residuals."""

from __future__ import annotations

import numpy as np

from fitting.lines.line import Line
from fitting.lines.noise_spectrum import NoiseLine
from fitting.lines.record import MeasuredLine
from fitting.lines.ringdown import Ringdown
from fitting.lines.trace import SAMPLES
from fitting.measurements.figure import (
    Axis,
    Figure,
    Form,
    Layer,
    Panel,
    Role,
    root_mean_square,
    worded,
)
from fitting.text.arrays import ComplexArray, FloatArray

#: Points of a ringdown and of a noise spectrum up to which all are drawn; of more every so many.
DRAWN = 20_000


def figure_of(result: MeasuredLine) -> Figure:
    """The figure of a result: data with the fit, phases of a sweep if there are any, residuals.

    Args:
        result: as it was fitted.
    """
    every = -(-len(result.points.place) // DRAWN)
    places = np.array(result.points.place)[::every]
    measured, fitted = (np.asarray(values[::every]) for values in result.points.arrays())
    unit = "" if result.unit == "1" else result.unit
    further: list[Panel] = []
    marked: tuple[float, ...] = ()
    left: FloatArray | ComplexArray
    if isinstance(result, Line):
        x, marked = Axis("frequency f", "Hz"), (result.frequency.value,)
        y = Axis("amplitude", unit)
        layers = _layers(places, np.abs(measured), np.abs(fitted))
        if result.is_complex:  # phases of the fit unwrapped, measured ones within half a turn
            phase = np.unwrap(np.angle(fitted))
            near = phase + np.angle(measured * np.conj(fitted))
            both = _layers(places, np.rad2deg(near), np.rad2deg(phase))
            axis = Axis("phase", "°")
            further = [Panel(x=x, y=axis, layers=both, marked=marked, height=0.7)]
        kind, share, label = "line", "% of line", "measured minus fitted"
        left = np.asarray(100.0 * (measured - fitted) / result.amplitude.value)
    elif isinstance(result, Ringdown):
        samples = result.kind == SAMPLES
        sizes, curve = (np.asarray(v.real if samples else np.abs(v)) for v in (measured, fitted))
        # a decay goes on falling below what was recorded in its noise
        low = None
        if not samples and np.any(sizes):
            low = 0.3 * float(np.quantile(sizes[sizes > 0.0], 0.01))
        x = Axis("time t", "s")
        y = Axis("recorded" if samples else "amplitude", unit, log=not samples, low=low)
        layers = _layers(places, sizes, curve, "recorded", "fitted decay")
        kind, share, label = "ringdown", "% of A", "recorded minus fitted"
        left = np.asarray(100.0 * (measured - fitted) / result.amplitude.value)
    else:
        assert isinstance(result, NoiseLine)  # noqa: S101 - there is no fourth kind
        unit = "relative" if result.unit == "1" else f"{result.unit}²/Hz"
        x, y = Axis("frequency f", "Hz"), Axis("density", unit, log=True)
        layers = _layers(places, measured.real, fitted.real, curve="fitted line and floor")
        kind, share, label = "noise_line", "% of the fit", "measured minus fitted"
        left = np.asarray(100.0 * (measured.real / fitted.real - 1.0))
    panels = [Panel(x=x, y=y, layers=layers, marked=marked), *further]
    panels.append(_residuals(x, places, left, share, label, marked))
    rows = [[panel] for panel in panels]
    return worded(kind, rows, name="line", result=result, every=every)


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
            Layer(Role.SIMULATED, Form.POINTS, places, left.real, label="residual of X"),
            Layer(Role.OTHER, Form.POINTS, places, left.imag, label="residual of Y"),
        ]
    return Panel(
        x=x,
        y=Axis("residual", unit),
        layers=tuple(layers),
        level=0.0,
        rms=root_mean_square([layer.y for layer in layers]),
        marked=marked,
        height=0.5,
    )
