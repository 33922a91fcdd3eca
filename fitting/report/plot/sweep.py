"""Plots of frequency responses: measured, fitted and simulated, and what is left between them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from fitting.measurements.sweep import ShownResponse, residual_panel, response_panel
from fitting.report.plot.measurement import panel
from fitting.result.result import SweepCurves
from fitting.signal.peaks import Resonance


def frequency_response(
    curves: SweepCurves,
    *,
    resonance: Resonance | None = None,
    unit: str = "V",
    ax: Axes | None = None,
) -> Axes:
    """Draw amplitudes over drive frequency: measured points, simulated curves before and after.

    Args:
        curves: the sweep of a result, Hz and V peak (or `unit`).
        resonance: one damped mode fitted to the same points; its curve and numbers are drawn too.
        unit: of the amplitudes.
        ax: where to draw; pyplot's current axes if not given.
    """
    return panel(response_panel(_arrays(curves, unit), resonance), ax=ax)


def response_residuals(
    curves: SweepCurves, *, resonance: Resonance | None = None, ax: Axes | None = None
) -> Axes:
    """Draw simulated minus measured amplitudes over drive frequency, in % of the largest measured.

    Args:
        curves: the sweep of a result, Hz and V peak.
        resonance: one damped mode fitted to the same points; what it leaves is drawn too.
        ax: where to draw; pyplot's current axes if not given.
    """
    return panel(residual_panel(_arrays(curves, "V"), resonance), ax=ax)


def _arrays(curves: SweepCurves, unit: str) -> ShownResponse:
    return ShownResponse(
        frequency_hz=np.array(curves.frequency_hz),
        measured=np.array(curves.measured_v),
        before=np.array(curves.initial_v),
        after=np.array(curves.final_v),
        unit=unit,
    )
