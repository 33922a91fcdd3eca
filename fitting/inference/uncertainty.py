"""The linearised covariance as assembly still asks for it: see `fitting.fit.linearisation`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH
from fitting.fit.linearisation import Linearisation, linearise
from fitting.fit.linearisation import in_words as in_words
from fitting.fit.linearisation import row_sigmas as row_sigmas
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class Covariance:
    """A linearisation with the widening of its sweep."""

    linearisation: Linearisation
    widening: float = 1.0

    @property
    def total(self) -> FloatArray:
        """Covariance in the search vector, (n, n)."""
        return self.linearisation.covariance

    @property
    def inflation(self) -> float:
        """Factor on the given sigmas that the residuals ask for."""
        return self.linearisation.inflation

    def of(self, gradient: FloatArray) -> tuple[float, float]:
        """(standard deviation, shrinkage) of a value with this gradient in x, (n,)."""
        return self.linearisation.of(gradient)


def covariance(
    matrix: FloatArray,
    residuals: FloatArray,
    sigmas: FloatArray,
    widths: FloatArray,
    nu: float,
    scale_sigma: float = 0.0,
    swept: slice = slice(0, 0),
    widening: float = 1.0,
    common: FloatArray | None = None,
) -> Covariance:
    """Linearised covariance at a solution; `fitting.fit.linearisation.linearise` says the same."""
    sigma = row_sigmas(sigmas, residuals)
    if common is None:
        common = np.full((sigma.size, 1), scale_sigma)
    shared = common @ common.T
    wider = sigma.copy()
    wider[swept] *= widening
    prior = 1.0 / np.sqrt((UNIFORM_WIDTH / widths) ** 2 + nu)
    noise, weighed = (np.diag(each**2) + shared for each in (sigma, wider))
    return Covariance(linearise(residuals, matrix, noise, prior, weighed), widening)
