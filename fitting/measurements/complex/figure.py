"""Figure of a complex sweep: both quadratures, measured and simulated, and what the fit leaves."""

from __future__ import annotations

import numpy as np

from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.figure import OF_LARGEST, Axis, Figure, compared, residual_points
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
    sigma = np.full(f.size, curve.sigma) if curve.sigma > 0.0 else None
    panels = [
        compared(
            (x, Axis(f"quadrature {name}", unit)),
            f,
            part(curve.y),
            part(before),
            part(after),
            sigma,
        )
        for name, part in (("X", np.real), ("Y", np.imag))
    ]
    left = 100.0 * (after - curve.y) / curve.largest
    rest = residual_points((x, OF_LARGEST), f, (("X", left.real), ("Y", left.imag)))
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
