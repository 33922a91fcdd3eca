"""Likelihood and posterior of residual rows, as functions that other programs may take.

    ln L(p) = -1/2 r^T V^-1 r - 1/2 ln det(2 pi V)        V = diag(sigma^2) + U U^T

r are the residual rows at p, sigma their standard deviations, U the error that rows share through a
scale which the sweep gives. V does not depend on p. Where the noise of m rows is not known it has
one size for all of them, which is integrated out with the prior 1/sigma (Jeffreys):

    ln L(p) = ln Gamma(nu/2) - ln 2 - nu/2 ln(pi S)        S = r^T r, nu = m - s

s the unknowns that these rows are solved for inside: Student's t of what is fitted, no Gaussian.

Source: G. Box and G. Tiao, Bayesian Inference in Statistical Analysis (1973), section 2.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln

from fitting.campaign.parameters import Parameter
from fitting.fit.covariance import RowCovariance
from fitting.fit.noise import shared
from fitting.measurements.dataset import Dataset
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import BadInput

#: Residuals in all below this are none.
TINY = 1e-150


@dataclass(frozen=True)
class Density:
    """The densities of rows (k, m) of some data, at k places of the parameters.

    Residuals that are correlated constrain the parameters less: errors about a place are wider by
    1/sqrt(share) where S counts from ``least``, that of the place, as least + share (S - least).
    """

    parameters: tuple[Parameter, ...]
    data: Dataset
    share: float = 1.0
    least: float = 0.0

    @cached_property
    def known(self) -> BoolArray:
        """Whether the noise of each row is known, (m,)."""
        return np.asarray(self.data.sigma > 0.0)

    @cached_property
    def dof(self) -> float:
        """nu of the module; 0 where all noise is known.

        Raises:
            BadInput: too few rows of unknown noise.
        """
        missing = int(np.sum(~self.known))
        if not missing:
            return 0.0
        free = missing - self.data.solved_of(known=False)
        if free < len(self.parameters) + 1:
            raise BadInput(
                f"problem: the noise of {missing} of {self.known.size} rows is not known, and "
                "these are too few to estimate it; wanted sigmas_v, or noise with a relative or "
                "absolute part"
            )
        return float(free)

    @cached_property
    def noise(self) -> RowCovariance:
        """V of the rows of known noise, with the error of the scale as the data have it.

        Raises:
            BadInput: rows of unknown noise share the error of a scale.
        """
        data, known = self.data, self.known
        common = shared(data, np.zeros(known.size))
        for m, place in zip(data.measurements, data.slices, strict=True):
            if m.scaling.from_rows and not np.any(known[place]):
                common[place] = 0.0  # its scale is solved for inside these rows
        if np.any(common[~known]):
            raise BadInput(
                f"problem: the noise of {int(np.sum(~known))} of {known.size} rows is not known, "
                "and they share the error of a scale; wanted sigmas_v, noise with a relative or "
                'absolute part, or scale = "free"'
            )
        return RowCovariance(data.sigma[known], common[known])

    def squares(self, rows: FloatArray) -> FloatArray:
        """S (k,) of the module, widened.

        Args:
            rows: all rows, (k, m).
        """
        plain = np.sum(rows[:, ~self.known] ** 2, axis=1)
        widened = self.least + self.share * (plain - self.least)
        return np.asarray(np.maximum(widened, TINY**2))

    def logl(self, rows: FloatArray) -> FloatArray:
        """ln L, (k,).

        Args:
            rows: (k, m).
        """
        white = self.noise.whitened(rows[:, self.known].T)
        size = self.noise.size * math.log(2.0 * math.pi) + self.noise.log_determinant
        total = -0.5 * (np.sum(white**2, axis=0) + size)
        if self.dof > 0.0:
            total += gammaln(0.5 * self.dof) - math.log(2.0)
            total -= 0.5 * self.dof * np.log(math.pi * self.squares(rows))
        return np.asarray(total)

    def logprior(self, places: FloatArray) -> FloatArray:
        """ln of the prior, (k,): uniform within the bounds, or a parameter's own Gaussian.

        Args:
            places: parameters within their bounds, (k, n).
        """
        total = np.zeros(len(places))
        for column, q in zip(places.T, self.parameters, strict=True):
            if q.prior_sigma is None:
                total -= math.log(q.upper - q.lower)
                continue
            total -= 0.5 * ((column - q.reference) / q.prior_sigma) ** 2
            total -= math.log(q.prior_sigma * math.sqrt(2.0 * math.pi))
        return total

    def white(
        self, place: FloatArray, rows: FloatArray, jac: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Rows of unit variance and their derivatives, Gaussian priors among them.

        Args:
            place: the parameters, (n,).
            rows: there, (m,).
            jac: their derivatives, (m, n).
        """
        known, noise = self.known, self.noise
        priors = [(i, q) for i, q in enumerate(self.parameters) if q.prior_sigma]
        sigmas = np.array([q.prior_sigma for _, q in priors])
        off = np.array([place[i] - q.reference for i, q in priors])
        unit = np.eye(place.size)[[i for i, _ in priors]]
        scatter = 1.0
        if self.dof > 0.0:
            squares = float(self.squares(rows[None])[0])
            scatter = math.sqrt(squares / (self.dof * self.share))
        white = np.concatenate([noise.whitened(rows[known]), rows[~known] / scatter, off / sigmas])
        slopes = [noise.whitened(jac[known]), jac[~known] / scatter, unit / sigmas[:, None]]
        return white, np.vstack(slopes)
