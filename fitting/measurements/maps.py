"""Figures of a control sweep: maps of measured, simulated and remaining values, or a line for each.

Maps show the branches of the model; few sweeps are drawn as lines.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from fitting.measurements.figure import (
    Axis,
    Figure,
    Form,
    Layer,
    Panel,
    Role,
    root_mean_square,
    worded,
)
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.notation import hertz, listed, unit_text

#: Texts along a map of numbered spectra.
MOST_TICKS = 10
#: Letters of a value there, from which a small one is written with a power of ten.
MOST_LETTERS, SMALL = 4, 0.01


@dataclass(frozen=True, kw_only=True)
class MappedSpectrum:
    """A column of the maps: frequencies (n,), Hz, at one value of the controls, `measured` (n,).

    `fitted` (n,) likewise, `left` (n,) what the fit leaves, each in the unit of its axis; where
    `response` (n,), the model's under a constant drive, has its maxima its branches are marked:
    of no points there are none.
    """

    label: str
    settings: Mapping[str, Scalar]
    frequency_hz: FloatArray
    measured: FloatArray
    fitted: FloatArray
    left: FloatArray
    response: FloatArray


@dataclass(frozen=True, kw_only=True)
class ControlMaps:
    """Maps of spectra over their control, with the `units` by name.

    `amplitude` and `rest` are the axes of colours; `what` is drawn, in words.
    """

    spectra: tuple[MappedSpectrum, ...]
    units: Mapping[str, str]
    amplitude: Axis
    rest: Axis
    name: str = "control_sweep"
    what: str = "Amplitudes"
    series: str = ""

    @cached_property
    def control(self) -> str:
        """The control that the maps are drawn over: the first that differs."""
        spectra = self.spectra
        for name in spectra[0].settings:
            if len({s.settings.get(name) for s in spectra}) > 1:
                return name
        return next(iter(spectra[0].settings))

    @cached_property
    def numbered(self) -> bool:
        """Whether the maps go by the number of the spectrum: several share a value of a control."""
        values = [s.settings.get(self.control) for s in self.spectra]
        return len(set(values)) < len(values)

    @cached_property
    def _label_controls(self) -> tuple[str, ...]:
        """The controls that label numbered spectra: those whose values repeat.

        Of the others each spectrum has its own value, as of the time.
        """
        spectra = self.spectra
        counts = {n: len({s.settings.get(n) for s in spectra}) for n in spectra[0].settings}
        return tuple(n for n, count in counts.items() if 1 < count < len(spectra))

    @property
    def over(self) -> str:
        """What the maps are drawn over."""
        return listed(self._label_controls) if self.numbered else self.control

    @property
    def _unit(self) -> str:
        return "" if self.numbered else self.units.get(self.control, "")

    @cached_property
    def _at(self) -> list[float]:
        """Where each spectrum is drawn: at the value of the control, or at its number."""
        if self.numbered:
            return [float(k) for k in range(1, len(self.spectra) + 1)]
        return [float(s.settings[self.control]) for s in self.spectra]

    @property
    def _axis(self) -> Axis:
        """The control; of numbered spectra a text for each, or for some where there are many."""
        if not self.numbered:
            return Axis(self.control, self._unit)
        units = [unit_text(self.units.get(name, "")) for name in self._label_controls]
        heads = [f"{n} ({u})" if u else n for n, u in zip(self._label_controls, units, strict=True)]
        every = math.ceil(len(self.spectra) / MOST_TICKS)
        ticks = tuple(
            (at, "\n".join(_written(s.settings.get(name)) for name in self._label_controls))
            for at, s in list(zip(self._at, self.spectra, strict=True))[::every]
        )
        return Axis(" above ".join(heads), ticks=ticks)

    @cached_property
    def branches(self) -> list[tuple[float, FloatArray]]:
        """Control and frequencies (Hz) of the maxima of the model's curve, for each spectrum.

        Each is the maximum of the parabola through the three points about it.
        """
        result = []
        for value, s in zip(self._at, self.spectra, strict=True):
            f, a, places = s.frequency_hz, s.response, []
            for k in np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:])):
                poly = np.polynomial.Polynomial.fit(f[k : k + 3], a[k : k + 3], 2)
                top_hz = float(np.real(poly.deriv().roots()[0]))
                places.append(float(np.clip(top_hz, f[k], f[k + 2])))
            result.append((value, np.array(places)))
        return result

    @property
    def closest(self) -> list[tuple[float, str]]:
        """Closest approach of maxima of the model, Hz and where; behind it that of each neighbours.

        Neighbours, from the lowest up, where there are three maxima or more.
        """
        apart = [(float(np.min(np.diff(f))), at) for at, f in self.branches if f.size > 1]
        if not apart:
            return []
        closest, most = [min(apart)], max(f.size for _, f in self.branches)
        full = [(np.diff(f), at) for at, f in self.branches if f.size == most]
        for k in range(most - 1 if most > 2 else 0):
            closest.append(min((float(gaps[k]), at) for gaps, at in full))
        return [(gap_hz, self._place(at)) for gap_hz, at in closest]

    def _place(self, at: float) -> str:
        """A value of the control, or a numbered spectrum, in words."""
        if self.numbered:
            return f"spectrum {at:.0f} ({self.spectra[round(at) - 1].label})"
        return f"{self.over} = {f'{at:.4g} {self._unit}'.strip()}"

    @property
    def figure(self) -> Figure:
        """Three maps: measured, with the model's branches; simulated; residuals."""
        pairs = [(at, f) for at, result in self.branches for f in result]
        x, y = np.array(pairs).reshape(-1, 2).T
        lines = Layer(Role.START, Form.POINTS, x, y, label="maxima of the fitted model")
        marks = (lines,) if pairs else ()
        sizes = [s.frequency_hz.size for s in self.spectra]
        at, f = np.repeat(self._at, sizes), np.concatenate([s.frequency_hz for s in self.spectra])

        def panel(title: str, name: str, axis: Axis, *further: Layer) -> Panel:
            z = np.concatenate([getattr(s, name) for s in self.spectra])
            drawn = Layer(Role.MEASURED, Form.MAP, at, f, z=z)
            y_axis = Axis("frequency", "Hz")
            return Panel(x=self._axis, y=y_axis, z=axis, layers=(drawn, *further), title=title)

        controls = self._label_controls if self.numbered else (self.control,)
        rows = (
            (
                panel("measured", "measured", self.amplitude, *marks),
                panel("simulated, fitted parameters", "fitted", self.amplitude, *marks),
            ),
            (panel("difference", "left", self.rest),),
        )
        return worded(
            "maps", rows, name=self.name, series=self.series, maps=self, controls=controls
        )


def _written(value: object) -> str:
    """A value of a control in few letters, as −250 and 3e−4."""
    if not isinstance(value, float):
        return str(value)
    text = f"{value:g}"
    if len(text) > MOST_LETTERS and 0.0 < abs(value) < SMALL:
        digits, _, power = f"{value:.2e}".partition("e")
        text = f"{float(digits):g}e{int(power)}"
    return text.replace("-", "−")


#: Sweeps up to which each has a panel of its own; more of them are maps.
MOST_LINES = 3
#: Points of the fitted curve.
FINE = 1001


def lines_figure(maps: ControlMaps) -> Figure:
    """A panel for each sweep, points on the fitted curve, with the difference below it.

    Maxima of the fitted curve are marked, and their distance is printed.

    Args:
        maps: the sweeps as maps would show them.
    """
    above, below, stated = [], [], []
    most = 1.15 * float(maps.rest.high or 1.0)
    rest = Axis("difference", maps.rest.unit, low=-most, high=most)
    x = Axis("frequency", "Hz")
    rms = 1.0 if rest.unit == "σ" else root_mean_square([s.left for s in maps.spectra])
    for s in maps.spectra:
        # the fitted curve between the points as well, by a cubic spline
        between = np.linspace(s.frequency_hz[0], s.frequency_hz[-1], FINE)
        f = np.unique(np.concatenate([s.frequency_hz, between]))
        a = np.asarray(CubicSpline(s.frequency_hz, s.fitted)(f))
        peaks = f[1:-1][(a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:])]
        several = peaks.size > 1
        apart = f"{hertz(float(np.ptp(peaks)), digits=3)} apart" if several else ""
        stated += [f"{s.label}: {apart}"] if several else []
        above.append(
            Panel(
                x=x,
                y=maps.amplitude,
                layers=(
                    Layer(Role.MEASURED, Form.POINTS, s.frequency_hz, s.measured, label="measured"),
                    Layer(Role.SIMULATED, Form.CURVE, f, a, label="fitted"),
                ),
                title=s.label,
                notes=(apart,) if several else (),
                marked=tuple(map(float, peaks)) if several else (),
            )
        )
        left = Layer(Role.MEASURED, Form.POINTS, s.frequency_hz, s.left)
        below.append(Panel(x=x, y=rest, layers=(left,), level=0.0, rms=rms, height=0.45))
    rows = (above, below)
    return worded("map_lines", rows, name=maps.name, series=maps.series, maps=maps, marked=stated)
