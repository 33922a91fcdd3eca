"""Few sweeps at values of a control, each as a line: measured, fitted, and what is left of it."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from fitting.measurements.control.maps import ControlMaps, MappedSpectrum
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz, how_many

#: Sweeps up to which each has a panel of its own; more of them are maps.
MOST_LINES = 3
#: Points of the fitted curve.
FINE = 1001


def lines_figure(maps: ControlMaps) -> Figure:
    """A panel for each sweep, points on the fitted curve, with the difference below it.

    Maxima of the fitted curve are marked, and their distance is told.

    Args:
        maps: the sweeps as maps would show them.
    """
    curves = [_smooth(s) for s in maps.spectra]
    result = list(zip(maps.spectra, curves, map(_maxima, curves), strict=True))
    stated = "; ".join(f"{s.label}: {_apart(peaks)}" for s, _, peaks in result if peaks.size > 1)
    count = how_many(len(result), "sweep")
    return Figure(
        name=maps.name,
        title="Response at each setting",
        caption=(
            f"{maps.what} of {count}: measured points, the fitted model as a curve, and the "
            "difference (simulated − measured) below."
            + (f" Maxima of the fitted curve are marked: {stated}." if stated else "")
        ),
        alt=f"Lines of {count}: measured points on the fitted curve, and residuals.",
        rows=(
            tuple(_line(maps, s, curve, peaks) for s, curve, peaks in result),
            tuple(_left(maps, s) for s in maps.spectra),
        ),
        series=maps.series,
    )


def _smooth(s: MappedSpectrum) -> tuple[FloatArray, FloatArray]:
    """The fitted curve between the points as well, by a cubic spline: frequencies and values."""
    between = np.linspace(s.frequency_hz[0], s.frequency_hz[-1], FINE)
    f = np.unique(np.concatenate([s.frequency_hz, between]))
    return f, np.asarray(CubicSpline(s.frequency_hz, s.fitted)(f))


def _maxima(curve: tuple[FloatArray, FloatArray]) -> FloatArray:
    f, a = curve
    return np.asarray(f[1:-1][(a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:])])


def _line(
    maps: ControlMaps,
    s: MappedSpectrum,
    curve: tuple[FloatArray, FloatArray],
    peaks: FloatArray,
) -> Panel:
    measured = Layer(Role.MEASURED, Form.POINTS, s.frequency_hz, s.measured, label="measured")
    fitted = Layer(Role.SIMULATED, Form.CURVE, *curve, label="fitted")
    return Panel(
        x=Axis("frequency", "Hz"),
        y=maps.amplitude,
        layers=(measured, fitted),
        title=s.label,
        notes=(_apart(peaks),) if peaks.size > 1 else (),
        marked=tuple(map(float, peaks)) if peaks.size > 1 else (),
    )


def _left(maps: ControlMaps, s: MappedSpectrum) -> Panel:
    left = Layer(Role.MEASURED, Form.POINTS, s.frequency_hz, s.left)
    most = 1.15 * float(maps.rest.high or 1.0)
    rest = Axis("difference", maps.rest.unit, low=-most, high=most)
    return Panel(x=Axis("frequency", "Hz"), y=rest, layers=(left,), level=0.0, height=0.45)


def _apart(peaks: FloatArray) -> str:
    """How far the outermost maxima are apart, in words."""
    return f"{hertz(float(np.ptp(peaks)), digits=3)} apart"
