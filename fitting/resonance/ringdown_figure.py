"""Figure of a ringdown: the record with its decay, and what the fit leaves."""

from __future__ import annotations

import math

import numpy as np

from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.resonance.decay_record import SAMPLES
from fitting.resonance.ringdown import Ringdown
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.notation import number, prefixed, quantity, with_error

#: Samples up to which all are drawn; of more every so many.
DRAWN = 20_000


def ringdown_figure(found: Ringdown) -> Figure:
    """Sizes on a logarithmic axis, where a decay is straight, and residuals over time.

    Args:
        found: as it was fitted.
    """
    every = -(-len(found.points.time_s) // DRAWN)
    t = np.array(found.points.time_s)[::every]
    measured, fitted = (values[::every] for values in found.points.arrays())
    x = Axis("time t", "s")
    frequency = quantity(found.frequency.value, found.frequency.std, "Hz")
    short = f"f = {frequency}, " if math.isfinite(found.frequency.value) else ""
    short += f"width {quantity(found.width.value, found.width.std, 'Hz')}"
    factor, unit = prefixed(found.decay_time.value, "s")
    time = with_error(found.decay_time.value / factor, found.decay_time.std / factor, unit)
    words = f"{short}, decay time {time}"
    some = "" if every == 1 else f" (every {every}th is drawn)"
    return Figure(
        name="line",
        title=f"Ringdown: {short}",
        caption=(
            f"{len(found.points.time_s)} samples{some} with the fitted decay ({found.form}) and "
            f"what the fit leaves of them, {number(100.0 * found.residual, 2)} % of the amplitude "
            f"at the first sample (rms). {words}."
        ),
        alt=f"Ringdown with its fit. {words}.",
        rows=((_record(found, t, measured, fitted, x),), (_rest(found, t, measured, fitted, x),)),
    )


def _record(
    found: Ringdown,
    t: FloatArray,
    measured: FloatArray | ComplexArray,
    fitted: FloatArray | ComplexArray,
    x: Axis,
) -> Panel:
    """The samples as they are; of demodulated values their sizes, on a logarithmic axis."""
    unit, samples = "" if found.unit == "1" else found.unit, found.kind == SAMPLES
    sizes = (np.asarray(v.real if samples else np.abs(v)) for v in (measured, fitted))
    seen, curve = sizes
    # a decay goes on falling below what was recorded in its noise
    low = None if samples or not np.any(seen) else 0.3 * float(np.quantile(seen[seen > 0.0], 0.01))
    return Panel(
        x=x,
        y=Axis("recorded" if samples else "amplitude", unit, log=not samples, low=low),
        layers=(
            Layer(Role.MEASURED, Form.POINTS, t, seen, label="recorded"),
            Layer(Role.SIMULATED, Form.CURVE, t, curve, label="fitted decay"),
        ),
    )


def _rest(
    found: Ringdown,
    t: FloatArray,
    measured: FloatArray | ComplexArray,
    fitted: FloatArray | ComplexArray,
    x: Axis,
) -> Panel:
    left = 100.0 * (measured - fitted) / found.amplitude.value
    parts = [(Role.MEASURED, left.real, "recorded minus fitted")]
    if found.is_complex:
        parts = [
            (Role.MEASURED, left.real, "residual of X"),
            (Role.OTHER, left.imag, "residual of Y"),
        ]
    return Panel(
        x=x,
        y=Axis("residual", "% of A"),
        layers=tuple(Layer(role, Form.POINTS, t, part, label=text) for role, part, text in parts),
        level=0.0,
        height=0.5,
    )
