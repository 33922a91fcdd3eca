"""Plots of frequency responses: measured, fitted and simulated, and what is left between them."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from fitting.report.plot.axes import GREY, MEASURED, SIMULATED, axes_of, ink, plain_ticks
from fitting.result.result import SweepCurves
from fitting.signal.peaks import Resonance
from fitting.text.notation import prefixed, scaling_for, with_error


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
    axes = axes_of(ax)
    along = scaling_for(curves.frequency_hz, "Hz")
    factor, shown = prefixed(max(curves.measured_v), unit)
    f = [along(value) for value in curves.frequency_hz]
    axes.plot(
        f,
        np.array(curves.measured_v) / factor,
        "o",
        color=MEASURED,
        markersize=3.2,
        label="laboratory",
    )
    axes.plot(
        f,
        np.array(curves.initial_v) / factor,
        color=GREY,
        linestyle=":",
        linewidth=1.5,
        label="simulated × χ, start parameters",
    )
    if resonance is not None:
        axes.plot(f, resonance.curve / factor, color=ink(), linewidth=1.0, label="resonance fit")
        axes.text(
            0.985,
            0.96,
            "\n".join(["resonance fit:", *resonance_words(resonance)]),
            ha="right",
            va="top",
            transform=axes.transAxes,
            fontsize="small",
            linespacing=1.5,
        )
    axes.plot(
        f,
        np.array(curves.final_v) / factor,
        color=SIMULATED,
        linestyle=(0, (5, 2)),
        linewidth=1.8,
        label="simulated × χ, fitted parameters",
    )
    axes.set_xlabel(along.label("drive frequency f"))
    axes.set_ylabel(f"amplitude ({shown})" if shown else "amplitude")
    axes.set_ylim(0.0, 1.08 * max(*curves.measured_v, *curves.final_v) / factor)
    plain_ticks(axes, x=8)
    return axes


def response_residuals(
    curves: SweepCurves, *, resonance: Resonance | None = None, ax: Axes | None = None
) -> Axes:
    """Draw simulated minus measured amplitudes over drive frequency, in % of the largest measured.

    Args:
        curves: the sweep of a result, Hz and V peak.
        resonance: one damped mode fitted to the same points; what it leaves is drawn too.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    along = scaling_for(curves.frequency_hz, "Hz")
    f = [along(value) for value in curves.frequency_hz]
    measured = np.array(curves.measured_v)
    percent_of_top = 100.0 / float(np.max(measured))
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    if resonance is not None:
        axes.plot(
            f,
            percent_of_top * (resonance.curve - measured),
            color=ink(),
            linewidth=0.9,
            label="resonance fit",
        )
    axes.plot(
        f,
        percent_of_top * (np.array(curves.final_v) - measured),
        color=SIMULATED,
        marker="o",
        markersize=2.6,
        linestyle="none",
        label="simulated",
    )
    axes.set_xlabel(along.label("drive frequency f"))
    axes.set_ylabel("minus laboratory\n(% of maximum)")
    plain_ticks(axes, x=8, y=4)
    return axes


def resonance_words(resonance: Resonance) -> list[str]:
    """Eigenfrequency, full width and Q of a fitted mode, each with its standard deviation.

    Args:
        resonance: fitted to the sweep.
    """
    return [
        f"η = {with_error(resonance.eta_hz, resonance.eta_std_hz, 'Hz')}",
        f"full width = {with_error(resonance.width_hz, resonance.width_std_hz, 'Hz')}",
        f"Q = {with_error(resonance.q, resonance.q_std)}",
    ]
