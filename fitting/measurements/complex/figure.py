"""Figure of a complex sweep: both quadratures, measured and simulated, and what the fit leaves."""

from __future__ import annotations

import numpy as np

from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.measurement import Values
from fitting.text.notation import number


def complex_figure(
    curve: ComplexCurve,
    before: Values,
    after: Values,
    series: str = "",
) -> Figure:
    """X and Y over frequency with the model, and residuals of both in % of the largest modulus.

    Args:
        curve: as measured.
        before: as simulated with the start parameters, (n,), in the curve's unit.
        after: with the fitted ones.
        series: name of the series.
    """
    f = curve.u_hz
    x = Axis("drive frequency f", "Hz")
    unit = "" if curve.unit == "1" else curve.unit
    sigma = np.full(f.size, curve.sigma) if curve.sigma > 0.0 else np.empty(0)
    parts = (("X", np.real), ("Y", np.imag))
    panels = [
        Panel(
            x=x,
            y=Axis(f"quadrature {name}", unit),
            layers=(
                Layer(Role.MEASURED, Form.POINTS, f, part(curve.y), label="measured", sigma=sigma),
                Layer(Role.START, Form.CURVE, f, part(before), label="model, start parameters"),
                Layer(Role.SIMULATED, Form.CURVE, f, part(after), label="model, fitted parameters"),
            ),
        )
        for name, part in parts
    ]
    left = 100.0 * (after - curve.y) / curve.largest
    rest = Panel(
        x=x,
        y=Axis("minus measured", "% of largest"),
        layers=(
            Layer(Role.SIMULATED, Form.POINTS, f, left.real, label="X"),
            Layer(Role.OTHER, Form.POINTS, f, left.imag, label="Y"),
        ),
        level=0.0,
        height=0.5,
    )
    rms = number(float(np.sqrt(np.mean(np.abs(left) ** 2) / 2.0)), 2)
    name = f"complex_sweep{f'_{curve.label}' if curve.label else ''}".replace("/", "_")
    said = f" {curve.label}" if curve.label else ""
    return Figure(
        name=name,
        title=f"Complex sweep{said}: measured and simulated",
        caption=(
            f"Both quadratures at {f.size} frequencies with the model before and after the fit; "
            f"wiring: {curve.wiring.kind}, background: {curve.wiring.background}. Below: what the "
            f"fit leaves, {rms} % of the largest value in each quadrature (rms)."
        ),
        alt=f"X and Y at {f.size} frequencies with the fitted model; residual {rms} % rms.",
        rows=((panels[0],), (panels[1],), (rest,)),
        series=series,
    )
