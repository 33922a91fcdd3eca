"""Maps of complex sweeps over a control: moduli measured and simulated, and what the fit leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from fitting.measurements.control.maps import ControlMaps, MappedSpectrum
from fitting.measurements.figure import Axis, Figure
from fitting.measurements.measurement import Values

if TYPE_CHECKING:  # the sweeps draw themselves by these
    from fitting.measurements.complex.sweep import ComplexSweep


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
