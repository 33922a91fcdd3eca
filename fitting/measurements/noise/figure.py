"""Figure of a noise spectrum: measured and simulated density, and the signed deviances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import gammaincinv

from fitting.measurements.figure import (
    Axis,
    Figure,
    Form,
    Layer,
    Role,
    compared,
    residual_points,
)
from fitting.measurements.noise.record import NoiseRecord
from fitting.text.arrays import FloatArray
from fitting.text.notation import number

#: Share of the points that the band about the model holds.
INSIDE = 0.95
#: Points that are drawn of a layer, at most.
DRAWN = 4000


def noise_figure(
    spectrum: NoiseRecord, before: FloatArray, after: FloatArray, series: str = ""
) -> Figure:
    """A spectrum with the model and the band that holds 95 % of the points; signed deviances below.

    Args:
        spectrum: as measured.
        before: as simulated with the start parameters, (n,), in the spectrum's unit.
        after: with the fitted ones.
        series: name of the series.
    """
    every = slice(None, None, -(-spectrum.seen_hz.size // DRAWN))
    u, x = spectrum.seen_hz[every], Axis("frequency", "Hz")
    tails = 0.5 * (1.0 - INSIDE)
    low, high = gammaincinv(spectrum.count, [tails, 1.0 - tails]) / spectrum.count
    y = Axis("density" if spectrum.unit == "1" else f"density ({spectrum.unit}²/Hz)", log=True)
    band = "95 % of the points, if the model is right"
    shown = compared((x, y), u, spectrum.y[every], before[every], after[every])
    bounds = (
        Layer(Role.OTHER, Form.CURVE, u, low * after[every], label=band),
        Layer(Role.OTHER, Form.CURVE, u, high * after[every]),
    )
    shown = replace(shown, layers=(*shown.layers, *bounds))
    rows = spectrum.residuals(after)
    rest = residual_points((x, Axis("signed root of deviance")), u, [("", rows[every])])
    share = float(np.mean((spectrum.y >= low * after) & (spectrum.y <= high * after)))
    stated = f" {spectrum.label}" if spectrum.label else ""
    inside = f"{number(100.0 * share, 3)} % of the points lie within the band"
    return Figure(
        name=f"noise{f'_{spectrum.label}' if spectrum.label else ''}".replace("/", "_"),
        title=f"Noise spectrum{stated}: measured and simulated",
        caption=(
            f"{spectrum.seen_hz.size} points of {_averages(spectrum)} with the "
            f"model before and after the fit; {inside} that holds "
            "95 % of them if the model is right. Below: the signed roots of their deviances."
        ),
        alt=f"A noise spectrum of {spectrum.seen_hz.size} points with the fitted model; {inside}.",
        rows=((shown,), (rest,)),
        series=series,
    )


def _averages(spectrum: NoiseRecord) -> str:
    if spectrum.averages is None:
        return f"about {number(spectrum.count, 2)} averages, by their scatter,"
    return f"{number(spectrum.averages, 4)} averages"
