"""Figures of complex sweeps: quadratures, or maps of moduli over a control, and the residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fitting.measurements.complex.curve import ComplexCurve
from fitting.measurements.control.maps import ControlMaps, MappedSpectrum
from fitting.measurements.figure import OF_LARGEST, Axis, Figure, compared, residual_points
from fitting.measurements.measurement import Values
from fitting.text.notation import number

if TYPE_CHECKING:  # the sweeps draw themselves by these
    from fitting.measurements.complex.sweep import ComplexSweep


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
    stated = f" {curve.label}" if curve.label else ""
    return Figure(
        name=name,
        title=f"Complex sweep{stated}: measured and simulated",
        caption=(
            f"Both quadratures at {f.size} frequencies with the model before and after the fit; "
            f"wiring: {curve.wiring.kind}, background: {curve.wiring.background}. Below: what the "
            f"fit leaves, {rms} % of the largest value in each quadrature (rms)."
        ),
        alt=f"X and Y at {f.size} frequencies with the fitted model; residual {rms} % rms.",
        rows=((panels[0],), (panels[1],), (rest,)),
        series=series,
    )


def complex_maps(sweeps: ComplexSweep, fitted: Sequence[Values]) -> Figure:
    """Moduli of all sweeps over the control, and the modulus of what is left of both quadratures.

    Where something passes the resonance by its lines are no maxima, and none are marked.

    Args:
        sweeps: as measured.
        fitted: as simulated with the fitted parameters, (n,) each, in their unit.
    """
    curves = sweeps.records
    known = all(c.sigma > 0.0 for c in curves)
    bare = all(c.wiring.columns == 1 for c in curves)
    spectra = tuple(
        MappedSpectrum(
            label=c.label,
            settings=c.settings,
            frequency_hz=c.u_hz,
            measured=np.abs(c.y),
            fitted=np.abs(s),
            left=np.abs(s - c.y) / (c.sigma if known else 0.01 * c.largest),
            response=np.abs(s) if bare else np.empty(0),
        )
        for c, s in zip(curves, fitted, strict=True)
    )
    unit = curves[0].unit
    most = max(float(np.max(s.left)) for s in spectra) or 1.0
    return ControlMaps(
        spectra=spectra,
        units=sweeps.units,
        amplitude=Axis("modulus", "" if unit == "1" else unit),
        rest=Axis("|simulated - measured|", "σ" if known else "% of largest", low=0.0, high=most),
        name="complex_control_sweep",
        what="Moduli",
        series=sweeps.series,
    ).figure
