"""Figure of one resonance: data, fit, and what the fit leaves."""

from __future__ import annotations

import numpy as np

from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.resonance.line import Line
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz, number, quantity


def line_figure(line: Line) -> Figure:
    """Amplitude, phase if there is one, and residuals over frequency.

    Args:
        line: as it was fitted.
    """
    f = np.array(line.points.frequency_hz)
    x = Axis("frequency f", "Hz")
    rows = [(panel,) for panel in (_amplitude(line, f, x), *_phase(line, f, x), _rest(line, f, x))]
    words = (
        f"f = {quantity(line.frequency.value, line.frequency.std, 'Hz')}, width "
        f"{quantity(line.width.value, line.width.std, 'Hz')}"
    )
    return Figure(
        name="line",
        title=f"One resonance: {words}",
        caption=(
            f"{f.size} points with the fitted line ({line.wiring}) and what the fit leaves of "
            f"them, {number(100.0 * line.residual, 2)} % of the line (rms). {words}."
        ),
        alt=f"Resonance near {hertz(line.frequency.value)} with its fit. {words}.",
        rows=tuple(rows),
    )


def _amplitude(line: Line, f: FloatArray, x: Axis) -> Panel:
    measured, fitted = (np.abs(values) for values in line.points.arrays())
    return Panel(
        x=x,
        y=Axis("amplitude", "" if line.unit == "1" else line.unit),
        layers=(
            Layer(Role.MEASURED, Form.POINTS, f, measured, label="measured"),
            Layer(Role.SIMULATED, Form.CURVE, f, fitted, label="fitted line"),
        ),
        marked=(line.frequency.value,),
    )


def _phase(line: Line, f: FloatArray, x: Axis) -> tuple[Panel, ...]:
    """Unwrapped phases of the fit, and measured ones within half a turn of them."""
    if not line.is_complex:
        return ()
    measured, fitted = line.points.arrays()
    phase = np.unwrap(np.angle(fitted))
    near = phase + np.angle(measured * np.conj(fitted))
    return (
        Panel(
            x=x,
            y=Axis("phase", "°"),
            layers=(
                Layer(Role.MEASURED, Form.POINTS, f, np.rad2deg(near), label="measured"),
                Layer(Role.SIMULATED, Form.CURVE, f, np.rad2deg(phase), label="fitted line"),
            ),
            marked=(line.frequency.value,),
            height=0.7,
        ),
    )


def _rest(line: Line, f: FloatArray, x: Axis) -> Panel:
    measured, fitted = line.points.arrays()
    left = 100.0 * (measured - fitted) / line.amplitude.value
    parts = [(Role.MEASURED, left.real, "measured minus fitted")]
    if line.is_complex:
        parts = [
            (Role.MEASURED, left.real, "residual of X"),
            (Role.OTHER, left.imag, "residual of Y"),
        ]
    return Panel(
        x=x,
        y=Axis("residual", "% of line"),
        layers=tuple(Layer(role, Form.POINTS, f, part, label=text) for role, part, text in parts),
        level=0.0,
        marked=(line.frequency.value,),
        height=0.5,
    )
