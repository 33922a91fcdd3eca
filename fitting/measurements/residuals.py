"""Residuals of a measurement: along an axis with their common mistakes, and the noise of a datum.

By that noise the accuracy of a simulation is chosen where none is named.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import ComplexArray, FloatArray, IntArray, both_parts
from fitting.text.finding import Kind


@dataclass(frozen=True, eq=False, kw_only=True)
class ResidualCurve:
    """Rows of a measurement that follow each other along an axis.

    Args:
        rows: which, in the order of the axis, counted from the first row of the measurement, (k,).
        axis: where they are, Hz or s; complex values have every place twice, (k,).
        share: factor from each row to a share of the curve's largest amplitude, (k,).
        centre: mean of the rows of a right model.
        name: of the curve; empty: the only one of its measurement.
        columns: derivatives of the rows by one number that is not fitted, (k,), by the kind of
            mistake: a gain, an offset, a shift of the axis, a level of noise.
        first_order: kinds of mistakes that move the rows so to first order alone, however large
            they are: what is left where one is put right is no noise then.
        model: what the model has there, real or complex, in the unit of `measured`; empty but for
            curves over frequency.
        measured: what was measured there.
    """

    rows: IntArray
    share: FloatArray
    axis: FloatArray = field(default_factory=lambda: np.empty(0))
    centre: float = 0.0
    name: str = ""
    columns: Mapping[Kind, FloatArray] = field(default_factory=dict)
    first_order: frozenset[Kind] = frozenset()
    model: FloatArray | ComplexArray = field(default_factory=lambda: np.empty(0))
    measured: FloatArray | ComplexArray = field(default_factory=lambda: np.empty(0))

    @property
    def power_shares(self) -> FloatArray:
        """Share of the power up to each frequency, of the model less that of the data, (n,).

        sum_{j<=i} |S_j|^2/sum_j |S_j|^2. Where lines do not overlap, their rows do not determine
        the direction of a step; these grow with the distance. No scale and no phase enters.

        Source: S. Kolouri et al., "Optimal mass transport", IEEE Signal Process. Mag. 34 (2017) 43.
        """
        running = [np.cumsum(np.abs(values) ** 2) for values in (self.model, self.measured)]
        model, measured = (total / max(float(total[-1]), 1e-300) for total in running)
        return np.asarray(model - measured)

    @property
    def course(self) -> FloatArray:
        """What its rows follow where the axis moves, but for a constant, (k,).

        A gain moves rows by the model itself, or, where they are logarithms of it, all alike.
        """
        course = self.columns.get(Kind.gain)
        if course is not None and np.ptp(course) > 0.0:
            return course
        steep, result = self.columns[Kind.shift], np.zeros(self.axis.size)
        for part in self._parts:
            mean = 0.5 * (steep[part][1:] + steep[part][:-1])
            result[part][1:] = np.cumsum(mean * np.diff(self.axis[part]))
        return result

    def moved(self, values: FloatArray, shift: float) -> FloatArray:
        """Values at places that are larger by a shift; beyond the ends those of the ends.

        Args:
            values: of all rows, shape (k,) or (k, n).
            shift: in the unit of the axis.
        """
        result = np.array(values, dtype=float)
        for part in self._parts:
            axis, table = self.axis[part], result[part].reshape(self.axis[part].size, -1)
            columns = [np.interp(axis + shift, axis, column) for column in table.T]
            result[part] = np.reshape(np.transpose(columns), result[part].shape)
        return result

    @property
    def _parts(self) -> list[slice]:
        """Rows along which the axis rises: those of real and of imaginary parts."""
        ends = [0, *(np.flatnonzero(np.diff(self.axis) < 0.0) + 1), self.axis.size]
        return [slice(int(a), int(b)) for a, b in pairwise(ends)]


def mistakes(
    axis: FloatArray, values: npt.NDArray[np.float64] | ComplexArray, slope: float | FloatArray
) -> dict[Kind, FloatArray]:
    """Derivatives of rows by a gain, an offset and a shift: slope S, slope, slope dS/d axis.

    Args:
        axis: of the curve, shape (k,), any unit.
        values: S, what the model has there, shape (k,), any unit.
        slope: of the rows in the values, one number or (k,).
    """
    if values.size < 2:
        return {}
    with np.errstate(divide="ignore", invalid="ignore"):  # two points of one frequency
        steep = np.nan_to_num(np.gradient(values, axis), nan=0.0, posinf=0.0, neginf=0.0)
    columns = {
        Kind.gain: values * slope,
        Kind.offset: np.ones_like(values) * slope,
        Kind.shift: steep * slope,
    }
    if np.iscomplexobj(values):
        complex_ = {kind: np.asarray(column, dtype=complex) for kind, column in columns.items()}
        return {kind: both_parts(column) for kind, column in complex_.items()}
    return {kind: np.asarray(column, dtype=float) for kind, column in columns.items()}


#: Of the noise of a datum, what its simulation may be off by where no accuracy is requested.
PART = 0.1
#: That accuracy at least and at most.
LEAST, MOST = 1e-9, 1e-2
#: Values from which noise is estimated, at least.
FEWEST = 16


def accuracy_for(noises: Iterable[float]) -> float | None:
    """The relative accuracy for data of such noise; None: nothing is known of any.

        a = min(max(0.1 min sigma/|y|, 1e-9), 1e-2)

    Args:
        noises: relative standard deviations of data; zero where unknown.
    """
    known = [noise for noise in noises if 0.0 < noise < math.inf]
    return float(np.clip(PART * min(known), LEAST, MOST)) if known else None


def least_noise(sigma: FloatArray, sizes: FloatArray) -> float:
    """The smallest noise of a datum over its size; zero where none is known.

    Args:
        sigma: standard deviations of rows, (n,); zero where unknown.
        sizes: of the same rows, (n,), or empty; where zero, rows are relative already.
    """
    known = sigma > 0.0
    if not np.any(known):
        return 0.0
    whole = np.abs(sizes) if sizes.shape == sigma.shape else np.ones(sigma.shape)
    return float(np.min(sigma[known] / np.where(whole > 0.0, whole, 1.0)[known]))


def white_noise(y: npt.NDArray[np.float64] | npt.NDArray[np.complex128]) -> float:
    """Standard deviation of the noise in values, from the upper half of their spectrum.

    A signal that the values resolve is in the lower half. |F|^2 of white noise is exponentially
    distributed with the mean sigma^2 sum(w^2) under a window w, and ln 2 of that is its median.

    Args:
        y: values (n,), real or complex.

    Returns:
        In the unit of y, of real and imaginary part each where they are complex; zero for fewer
        than 16 values.
    """
    if y.size < FEWEST:
        return 0.0
    window = np.blackman(y.size + 2)[1:-1]
    spectrum = np.abs(np.fft.fft((y - np.mean(y)) * window)) ** 2
    high = spectrum[y.size // 4 : y.size - y.size // 4]
    parts = 2.0 if np.iscomplexobj(y) else 1.0
    return float(np.sqrt(np.median(high) / (math.log(2.0) * parts * np.sum(window**2))))
