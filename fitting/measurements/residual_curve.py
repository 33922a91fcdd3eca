"""Residuals of a measurement along an axis, and how they would change with a common mistake."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import ComplexArray, FloatArray, IntArray, both_parts
from fitting.text.finding import Kind

Values = FloatArray | ComplexArray


@dataclass(frozen=True, eq=False, kw_only=True)
class ResidualCurve:
    """Rows of a measurement that follow each other along an axis.

    Args:
        rows: which, in the order of the axis, counted from the first row of the measurement, (k,).
        axis: where they are, Hz or s; complex values have every place twice, (k,).
        share: factor from each row to a share of the curve's largest amplitude, (k,).
        centre: mean of the rows of a right model.
        name: of the curve; empty: the only one of its measurement.
        columns: derivatives of the rows by one number that nobody fits, (k,), by the kind of
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
    model: Values = field(default_factory=lambda: np.empty(0))
    measured: Values = field(default_factory=lambda: np.empty(0))

    @property
    def power_shares(self) -> FloatArray:
        """Share of the power up to each frequency, of the model less that of the data, (n,).

        sum_{j<=i} |S_j|^2/sum_j |S_j|^2. Where lines lie beside each other their rows do not tell
        which way to go; these grow with the distance. No scale and no phase enters.

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
