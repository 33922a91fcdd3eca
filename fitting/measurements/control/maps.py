"""Maps of a control sweep: measured, simulated, what is left, and the branches of the model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz, listed, unit_text

if TYPE_CHECKING:  # the sweep draws itself by these
    from fitting.measurements.control.sweep import ControlSweep

#: Texts along a map of numbered spectra.
MOST_TICKS = 10
#: Letters of a value there, from which a small one is written with a power of ten.
MOST_LETTERS, SMALL = 4, 0.01


@dataclass(frozen=True)
class ControlMaps:
    """Measured amplitudes of a control sweep beside ``fitted`` ones (rows,), over its control."""

    sweep: ControlSweep
    fitted: FloatArray

    @cached_property
    def control(self) -> str:
        """The control that the maps are drawn over: the first that differs."""
        spectra = self.sweep.spectra
        for name in spectra[0].settings:
            if len({s.settings.get(name) for s in spectra}) > 1:
                return name
        return next(iter(spectra[0].settings))

    @cached_property
    def numbered(self) -> bool:
        """Whether the maps go by the number of the spectrum: several share a value of a control."""
        values = [s.settings.get(self.control) for s in self.sweep.spectra]
        return len(set(values)) < len(values)

    @cached_property
    def _told(self) -> tuple[str, ...]:
        """The controls that tell numbered spectra apart for a reader: those whose values repeat.

        Of the others each spectrum has its own value, as of the time.
        """
        spectra = self.sweep.spectra
        counts = {n: len({s.settings.get(n) for s in spectra}) for n in spectra[0].settings}
        return tuple(n for n, count in counts.items() if 1 < count < len(spectra))

    @property
    def over(self) -> str:
        """What the maps are drawn over."""
        return listed(self._told) if self.numbered else self.control

    @property
    def _all_over(self) -> str:
        return listed((*(self._told if self.numbered else (self.control,)), "drive frequency"))

    @cached_property
    def _axis(self) -> Axis:
        """The control; of numbered spectra a text for each, or for some where there are many."""
        if not self.numbered:
            return Axis(self.control, self._unit)
        units = [unit_text(self.sweep.units.get(name, "")) for name in self._told]
        heads = [f"{n} ({u})" if u else n for n, u in zip(self._told, units, strict=True)]
        spectra = self.sweep.spectra
        every = math.ceil(len(spectra) / MOST_TICKS)
        ticks = tuple(
            (at, "\n".join(_written(s.settings.get(name)) for name in self._told))
            for at, s in list(zip(self._at, spectra, strict=True))[::every]
        )
        return Axis(" above ".join(heads), ticks=ticks)

    @property
    def _unit(self) -> str:
        return "" if self.numbered else self.sweep.units.get(self.control, "")

    @cached_property
    def _at(self) -> list[float]:
        spectra = self.sweep.spectra
        if self.numbered:
            return [float(k) for k in range(1, len(spectra) + 1)]
        return [float(s.settings[self.control]) for s in spectra]

    @cached_property
    def _x(self) -> FloatArray:
        pairs = zip(self._at, self.sweep.spectra, strict=True)
        return np.concatenate([np.full(s.y.size, value) for value, s in pairs])

    @cached_property
    def _f(self) -> FloatArray:
        return np.concatenate([s.u_hz for s in self.sweep.spectra])

    @cached_property
    def branches(self) -> list[tuple[float, FloatArray]]:
        """Control and frequencies (Hz) of the maxima of the model's curve, for each spectrum."""
        found = []
        for value, s, mine in zip(self._at, self.sweep.spectra, self.sweep.slices, strict=True):
            a = self.fitted[mine] / s.level
            top = np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:])) + 1
            found.append((value, np.array([_vertex(s.u_hz, a, int(k)) for k in top])))
        return found

    @property
    def gap(self) -> str:
        """Words for the closest approach of two maxima of the model, empty where there is none."""
        apart = [(float(np.min(np.diff(f))), at) for at, f in self.branches if f.size > 1]
        if not apart:
            return ""
        least, at = min(apart)
        where = f"{self.over} = {f'{at:.4g} {self._unit}'.strip()}"
        if self.numbered:
            where = f"spectrum {at:.0f} ({self.sweep.spectra[round(at) - 1].label})"
        return f" The model's maxima come closest at {where}, {hertz(least, digits=4)} apart."

    @property
    def _order(self) -> str:
        """How spectra follow each other, where no control orders them."""
        return ", in the order of the data" if self.numbered else ""

    def _panel(self, title: str, z: FloatArray, axis: Axis, *further: Layer) -> Panel:
        drawn = Layer(Role.MEASURED, Form.MAP, self._x, self._f, z=z)
        return Panel(
            x=self._axis,
            y=Axis("frequency", "Hz"),
            z=axis,
            layers=(drawn, *further),
            title=title,
        )

    @property
    def figure(self) -> Figure:
        """Three maps: measured, with the model's branches; simulated; residuals."""
        sweep = self.sweep
        amplitudes = Axis("amplitude", "" if sweep.unit == "1" else sweep.unit)
        maps = sweep.measured, self.fitted
        if sweep.logarithmic:  # as the laboratory has them, and as they are fitted
            amplitudes = Axis("amplitude", "dB" if sweep.unit == "1" else f"dB({sweep.unit})")
            maps = _decibels(sweep.measured), _decibels(self.fitted)
        pairs = [(at, f) for at, found in self.branches for f in found]
        lines = Layer(
            Role.START,
            Form.POINTS,
            np.array([at for at, _ in pairs]),
            np.array([f for _, f in pairs]),
            label="maxima of the fitted model",
        )
        known = bool(np.all(sweep.sigma > 0.0))
        size = sweep.sigma * sweep.sizes if known else 0.01 * sweep.sizes
        rest = (sweep.seen_as(self.fitted) - sweep.measured) / size
        unit = "σ" if known else "% of maximum"
        if sweep.logarithmic:
            rest, unit = _decibels(self.fitted / sweep.measured), "dB"
        most = float(np.max(np.abs(rest), initial=0.0)) or 1.0
        rests = Axis("simulated - measured", unit, low=-most, high=most)
        spectra = len(sweep.spectra)
        return Figure(
            name="control_sweep",
            title=f"Response over {self._all_over}",
            caption=(
                f"Amplitudes of {spectra} spectra over {self.over}{self._order}, measured, "
                f"simulated with the fitted parameters, and what is left.{self.gap}"
            ),
            alt=f"Maps of {spectra} spectra over {self.over}: measured, simulated, difference.",
            rows=(
                (
                    self._panel("measured", maps[0], amplitudes, lines),
                    self._panel("simulated, fitted parameters", maps[1], amplitudes, lines),
                ),
                (self._panel("difference", rest, rests),),
            ),
            series=sweep.series,
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


def _decibels(a: FloatArray) -> FloatArray:
    return np.asarray(20.0 * np.log10(a))


def _vertex(f: FloatArray, a: FloatArray, k: int) -> float:
    """Place of the maximum of the parabola through three points about the k-th."""
    poly = np.polynomial.Polynomial.fit(f[k - 1 : k + 2], a[k - 1 : k + 2], 2)
    place = float(np.real(poly.deriv().roots()[0]))
    return float(np.clip(place, f[k - 1], f[k + 1]))
