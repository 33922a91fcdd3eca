"""The density of noise with lines as shapes and terms.

    own        S = sum_k a_k |g_k|^2 + b          modes with forces of their own, as heat has them
    together   S = a |g_1 + r g_2|^2 + b          modes under one force, r of either sign
    coupled    S = -a c Im chi(f)/f + b           coupled modes in heat, of which the first is seen

    chi = D_2/(D_1 D_2 - K^2)     D_k = f_k^2 - f^2 + i f w_k     c = f_1^2 w_1     K = 2 f_0 k

g of `fitting.lines.lorentzian`, f_0 the mean of all f. Heights a and the white floor b are linear.
Coupled modes have lines at the roots of D_1 D_2 = K^2; without k they are the first of own ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.lines.solve import Columns
from fitting.lines.sweep_model import Place, Shapes
from fitting.text.arrays import FloatArray

#: How modes may be moved: each by itself, both by one force, or by heat with a coupling.
OWN, TOGETHER, COUPLED = "own", "together", "coupled"


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseSpectrum:
    """Lines in noise; x: the lines as in `Shapes`, then r, or k over the first start's width.

    Attributes:
        frequency_hz: rising, shape (n,), Hz.
        starts: where each line, of coupled modes each mode, begins.
        kind: `OWN`, `TOGETHER` or `COUPLED`.
    """

    frequency_hz: FloatArray
    starts: Sequence[Place]
    kind: str = OWN

    @property
    def shapes(self) -> Shapes:
        """The lines, or modes."""
        return Shapes(frequency_hz=self.frequency_hz, starts=self.starts)

    @property
    def count(self) -> int:
        """Unknowns that do not enter linearly."""
        return self.shapes.count + (self.kind != OWN)

    def columns(self, x: FloatArray) -> Columns:
        """The lines, and 1."""
        parts = [self._in_heat(x)] if self.kind == COUPLED else self._powers(x)
        one = np.ones_like(self.frequency_hz)
        values = np.stack([*(value for value, _ in parts), one], axis=1)
        slopes = np.zeros((self.count, *values.shape))
        for k, (_, slope) in enumerate(parts):
            slopes[:, :, k] = slope
        return Columns(values, slopes)

    def _powers(self, x: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """|h|^2 of each wave h with its slopes, (count, n)."""
        waves = [(g.values, g.slopes) for g in self.shapes.responses(x[: self.shapes.count])]
        if self.kind == TOGETHER:
            (one, of_one), (two, of_two) = waves
            r = float(x[self.shapes.count])
            waves = [(one + r * two, np.concatenate([of_one + r * of_two, two[None]]))]
        return [(np.abs(h) ** 2, 2.0 * (np.conj(h) * slopes).real) for h, slopes in waves]

    def coupling(self, x: FloatArray) -> tuple[float, float]:
        """K at x, Hz^2, and its derivative by k."""
        by_k = 2.0 * float(np.mean(self.frequency_hz)) * self.starts[0].width_hz
        return by_k * float(x[self.shapes.count]), by_k

    def _in_heat(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Of coupled modes, one in size where the first is by itself, with its slopes."""
        f, (one, two) = self.frequency_hz, self.shapes.places(x[:4])
        k, by_k = self.coupling(x)
        d1, d2 = (
            (p.frequency_hz - f) * (p.frequency_hz + f) + 1j * f * p.width_hz for p in (one, two)
        )
        whole = d1 * d2 - k**2
        chi = d2 / whole
        by_1, by_2, by_k2 = -(chi**2), -((k / whole) ** 2), d2 / whole**2
        scales = [start.width_hz for start in self.starts]
        by_x = [
            by_1 * 2.0 * one.frequency_hz * scales[0],
            by_1 * 1j * f * one.width_hz,
            by_2 * 2.0 * two.frequency_hz * scales[1],
            by_2 * 1j * f * two.width_hz,
            by_k2 * 2.0 * k * by_k,
        ]
        size = one.frequency_hz**2 * one.width_hz
        value = -size * chi.imag / f
        slopes = np.stack([-size * slope.imag / f for slope in by_x])
        slopes[0] += value * 2.0 * scales[0] / one.frequency_hz
        slopes[1] += value
        return np.asarray(value), slopes

    def lines(self, x: FloatArray) -> list[tuple[Place, FloatArray]]:
        """Frequency and FWHM of each line with their derivatives by x, (2, count)."""
        made = []
        places, scales = self.shapes.places(x[: self.shapes.count]), self.starts
        if self.kind != COUPLED:
            for j, (place, start) in enumerate(zip(places, scales, strict=True)):
                slopes = np.zeros((2, self.count))
                slopes[0, 2 * j], slopes[1, 2 * j + 1] = start.width_hz, place.width_hz
                made.append((place, slopes))
            return made
        (f1, w1), (f2, w2) = ((p.frequency_hz, p.width_hz) for p in places)
        k, by_k = self.coupling(x)
        whole = np.polymul([-1.0, 1j * w1, f1**2], [-1.0, 1j * w2, f2**2])
        whole[-1] -= k**2
        # a root p moves by -dF/dx over dF/dp, F = D_1 D_2 - K^2
        for p in sorted(np.roots(whole), key=lambda root: float(root.real))[-2:]:
            d1, d2 = f1**2 - p**2 + 1j * p * w1, f2**2 - p**2 + 1j * p * w2
            by_x = np.array(
                [
                    2.0 * f1 * d2 * scales[0].width_hz,
                    1j * p * w1 * d2,
                    2.0 * f2 * d1 * scales[1].width_hz,
                    1j * p * w2 * d1,
                    -2.0 * k * by_k,
                ]
            )
            moved = -by_x / ((1j * w1 - 2.0 * p) * d2 + (1j * w2 - 2.0 * p) * d1)
            size = float(abs(p))
            slopes = np.stack([(np.conj(p) * moved).real / size, 2.0 * moved.imag])
            made.append((Place(size, 2.0 * float(p.imag)), slopes))
        return made
