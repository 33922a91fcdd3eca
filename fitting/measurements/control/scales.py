"""Scales of spectra: real factors from simulated to measured amplitudes, solved inside.

For the rows i of one scale chi, of all spectra or of a single one, with A simulated and L measured
amplitudes and weights w,

    chi = sum_i w_i A_i L_i / sum_i w_i A_i^2                     amplitudes
    ln chi = sum_i w_i (ln L_i - ln A_i) / sum_i w_i              amplitudes in dB
    chi minimises sum_i w_i (M(chi A_i) - L_i)^2                  magnitudes of noisy quadratures

(variable projection); M is the mean of a magnitude (`fitting.signal.rician`). Unlike complex
gains (`fitting.measurements.complex.gain`) scales are positive, nothing stands beside them, and the
last two enter otherwise than linearly: the one is a mean of logarithms, the other takes steps.

Noise that is told by the scatter about a smooth curve is too large where lines are a few points
wide, and M(0) with it: then it is told by the squares of each spectrum, whose mean is
chi^2 A^2 + 2 s^2, as far as that is less,

    s^2 = sum_i v_i (L_i^2 - chi^2 A_i^2)/(2 sum_i v_i)           v_i = 1/(chi^2 A_i^2 + s^2)

Source: G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.signal.rician import rician
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import NoScale

#: A scale for each spectrum, one for all, or none.
SCALES = ("each", "shared", "none")
#: Steps towards the scale of magnitudes, and the share of itself that it keeps in one at least.
SCALE_STEPS, LEAST_SCALE = 2, 0.1
#: Rounds of weights by the noise that they tell, and the share of the scatter that is left of it.
NOISE_STEPS, LEAST_NOISE = 2, 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectrumScales:
    """What the scales of rows are solved with.

    Args:
        measured: Amplitudes (rows,).
        sizes: What each row is relative to, (rows,), in the unit of the amplitudes.
        sigma: Standard deviation of every row, (rows,), over the sizes; 0: not known.
        quadrature_sigma: Noise that makes magnitudes larger, (rows,), in the unit of the
            amplitudes; 0: none.
        lengths: Numbers of rows of each spectrum, (spectra,), if the squares tell its noise; else
            empty.
        counts: Numbers of rows that share a scale, (scales,), one after another.
        logarithmic: Whether the rows are differences of logarithms.
        output: The FMU's output, which complaints name.
    """

    measured: FloatArray
    sizes: FloatArray
    sigma: FloatArray
    quadrature_sigma: FloatArray
    lengths: IntArray
    counts: IntArray
    logarithmic: bool
    output: str

    def of(self, values: FloatArray) -> FloatArray:
        """Least-squares factors from values to measured amplitudes, (scales,).

        Args:
            values: simulated amplitudes under the drive, (rows,).

        Raises:
            NoScale: the model answers with nothing.
        """
        last = self._remembered.get(0)
        if last is None or last[0] is not values:
            last = self._remembered[0] = (values, self._solved(values))
        return last[1]

    def scaled(self, values: FloatArray) -> FloatArray:
        """Values under the scales of their rows, (rows,).

        Args:
            values: simulated amplitudes under the drive, (rows,).

        Raises:
            NoScale: the model answers with nothing.
        """
        return np.asarray(np.repeat(self.of(values), self.counts) * values)

    def noise_beside(self, scaled: FloatArray) -> FloatArray:
        """Noise of each quadrature beside amplitudes, (rows,), at most as the scatter says.

        Args:
            scaled: simulated amplitudes under the drive and the scale, (rows,).
        """
        most = self.quadrature_sigma
        if not self.lengths.size:
            return most
        first, sigma = np.cumsum(self.lengths) - self.lengths, most
        for _ in range(NOISE_STEPS):
            weights = 1.0 / np.maximum(scaled**2 + sigma**2, np.finfo(float).tiny)
            left = np.add.reduceat(weights * (self.measured**2 - scaled**2), first)
            square = np.repeat(0.5 * left / np.add.reduceat(weights, first), self.lengths)
            sigma = np.sqrt(np.clip(square, (LEAST_NOISE * most) ** 2, most**2))
        return sigma

    @cached_property
    def _remembered(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """The last values and their scales: rows and figures ask for the same, no state."""
        return {}

    @cached_property
    def _starts(self) -> IntArray:
        """First row of every scale, (scales,)."""
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def _weights(self) -> FloatArray:
        """Weights of all rows, (rows,), equal to a factor."""
        if self.logarithmic:
            sigma, unknown = self.sigma, np.ones(self.measured.size)
        else:
            sigma, unknown = self.sigma * self.sizes, self.sizes
        known = np.repeat(np.minimum.reduceat(sigma, self._starts) > 0.0, self.counts)
        return np.where(known, np.where(known, sigma, 1.0), unknown) ** -2

    def _sums(self, rows: FloatArray) -> FloatArray:
        """Sums over the rows of each scale, (scales,)."""
        return np.asarray(np.add.reduceat(rows, self._starts))

    def _solved(self, values: FloatArray) -> FloatArray:
        weights = self._weights
        if self.logarithmic:
            if not np.all(values > 0.0):
                raise NoScale(f"{self.output}: the model answers with zero, which has no logarithm")
            apart = np.log(self.measured) - np.log(values)
            return np.exp(self._sums(weights * apart) / self._sums(weights))
        power = self._sums(weights * values**2)
        if not np.all(power > 0.0):
            raise NoScale(f"{self.output}: the model answers with nothing; wanted a response")
        result = self._sums(weights * values * self.measured) / power
        if np.any(self.quadrature_sigma > 0.0):
            return self._of_magnitudes(values, LEAST_SCALE * result)
        return result

    def _of_magnitudes(self, values: FloatArray, least: FloatArray) -> FloatArray:
        """Scales from what the squares say, whose mean is chi^2 values^2 + 2 sigma^2, by steps.

        They are those of Gauss and Newton; a fixed number of them keeps the rows smooth.
        """
        weights = self._weights
        shape = weights * values**2
        square = self._sums(shape * (self.measured**2 - 2.0 * self.quadrature_sigma**2))
        result = np.sqrt(np.maximum(square / self._sums(shape * values**2), least**2))
        for _ in range(SCALE_STEPS):
            scaled = np.repeat(result, self.counts) * values
            observed = rician(scaled, self.noise_beside(scaled))
            slopes = observed.slope * values
            pull = self._sums(weights * slopes * (self.measured - observed.mean))
            result = np.maximum(result + pull / self._sums(weights * slopes**2), least)
        return result
