"""Figure of a noise spectrum: the density with its line, and what the fit leaves."""

from __future__ import annotations

import numpy as np

from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.resonance.noise_line import NoiseLine
from fitting.text.notation import number, quantity

#: Points up to which all are drawn; of more every so many.
DRAWN = 20_000


def noise_line_figure(found: NoiseLine) -> Figure:
    """The density on a logarithmic axis, and residuals as shares of the fit.

    Args:
        found: as it was fitted.
    """
    points = found.points
    every = -(-len(points.frequency_hz) // DRAWN)
    f, measured, fitted = (
        np.array(values)[::every]
        for values in (points.frequency_hz, points.measured, points.fitted)
    )
    words = (
        f"f = {quantity(found.frequency.value, found.frequency.std, 'Hz')}, "
        f"width {quantity(found.width.value, found.width.std, 'Hz')}"
    )
    some = "" if every == 1 else f" (every {every}th is drawn)"
    unit = "relative" if found.unit == "1" else f"{found.unit}²/Hz"
    x = Axis("frequency f", "Hz")
    density = Panel(
        x=x,
        y=Axis("density", unit, log=True),
        layers=(
            Layer(Role.MEASURED, Form.POINTS, f, measured, label="measured"),
            Layer(Role.SIMULATED, Form.CURVE, f, fitted, label="fitted line and floor"),
        ),
    )
    rest = Panel(
        x=x,
        y=Axis("residual", "% of the fit"),
        layers=(
            Layer(
                Role.MEASURED,
                Form.POINTS,
                f,
                100.0 * (measured / fitted - 1.0),
                label="measured minus fitted",
            ),
        ),
        level=0.0,
        height=0.5,
    )
    return Figure(
        name="line",
        title=f"Noise spectrum: {words}",
        caption=(
            f"{len(points.frequency_hz)} points{some} with the fitted line on a white floor, and "
            f"what the fit leaves of them as shares of itself: they scatter as averages of "
            f"{number(found.averages, 2)} periodograms. {words}."
        ),
        alt=f"Noise spectrum with its fit. {words}.",
        rows=((density,), (rest,)),
    )
