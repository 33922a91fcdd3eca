"""Numbers of a fit with their errors: its covariance, widened for what the residuals show."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from fitting.lines.record import LineNumber, Matrix, number_of_line
from fitting.lines.solve import Fit
from fitting.signal.residual_tests import Structure
from fitting.signal.student import ROOT_68, ratio95, reach
from fitting.text.arrays import FloatArray

#: Slopes of a number by single unknowns: the number of each, and the slope.
Slopes: TypeAlias = Sequence[tuple[int, float]]


class Numbers:
    """Numbers of a fit; their errors are halves of 68 % intervals.

    Attributes:
        fit: of which they are.
        structure: what the order of its residuals shows.
        dof: degrees of freedom of the noise; correlated values count as fewer.
        variance: of a residual.
        covariance: of all unknowns, (unknowns, unknowns).
    """

    def __init__(
        self,
        fit: Fit,
        sigma: float | None = None,
        structure: Structure | None = None,
        variance: float | None = None,
    ) -> None:
        """Numbers of a fit.

        Args:
            fit: of which they are.
            sigma: standard deviation of a residual, if known.
            structure: of the residuals; None: that of all of them.
            variance: of a residual, where it is estimated otherwise than from their squares.
        """
        self.fit = fit
        self.structure = fit.structure if structure is None else structure
        self.dof = math.inf if sigma is not None else fit.dof / self.structure.widening**2
        own = fit.squares / fit.dof if variance is None else variance
        self.variance = own if sigma is None else sigma**2
        widened = self.structure.widening**2 * self.variance * fit.inverse
        self.covariance = reach(ROOT_68, self.dof) ** 2 * widened

    def std(self, gradient: FloatArray) -> float:
        """Half of the 68 % interval of a number with this gradient (unknowns,)."""
        at = np.flatnonzero(gradient)
        part = self.covariance[np.ix_(at, at)]
        size = float(np.max(np.abs(gradient), initial=0.0))  # its square may be no number
        unit = gradient[at] / size if size else gradient[at]
        return size * math.sqrt(max(0.0, float(unit @ part @ unit)))

    def gradient(self, slopes: Slopes) -> FloatArray:
        """Derivatives (unknowns,) of a number with slopes by single unknowns."""
        gradient = np.zeros(self.fit.unknowns)
        for k, slope in slopes:
            gradient[k] += slope
        return gradient

    def std_of(self, slopes: Slopes) -> float:
        """Half of the 68 % interval of such a number."""
        return self.std(self.gradient(slopes))

    def correl(self, numbers: Sequence[FloatArray]) -> Matrix:
        """Correlations of numbers with gradients (unknowns,) each."""
        each = np.array(numbers)
        stds = np.array([self.std(gradient) for gradient in each])
        with np.errstate(all="ignore"):
            unit = each / stds[:, None]
            made = np.clip(unit @ self.covariance @ unit.T, -1.0, 1.0)
        return tuple(tuple(float(v) for v in row) for row in made)

    def number(self, name: str, value: float, slopes: Slopes, unit: str = "") -> LineNumber:
        """A number with its error; slopes by single unknowns."""
        return number_of_line(name, value, self.std_of(slopes), unit, half=ratio95(self.dof))
