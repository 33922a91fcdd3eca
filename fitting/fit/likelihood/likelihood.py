"""Likelihood of the data at any parameters: whitened rows whose sum of squares is chi square.

    chi^2(x) = r^T V^-1 r / k^2 + sum_j (x_j/tau_j)^2        V = diag(sigma^2) + U U^T

r are the relative residuals, U columns of errors that all rows share (the scale chi), k the factor
by which residuals beyond the noise widen it, tau_j the Gaussian prior of a parameter that has one.
The Tikhonov term of Algorithm 2 is no knowledge and takes no part; the box is a hard limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds
from fitting.fit.likelihood.lockstep import Exhausted, Request, Sample
from fitting.fit.linearisation import SMALLEST_SIGMA
from fitting.fit.objective import Objective, Point, evaluate_many
from fitting.fit.outputs import output_means
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer

#: Points at which a model may fail before the failure is passed on.
MOST_FAILURES = 12


@dataclass(frozen=True, kw_only=True)
class Likelihood:
    """Whitened rows of an objective, with the box in which they are looked at.

    `whitening` (m, m) turns residuals into rows of unit variance, inflation included;
    `inverse_prior_sigma` (n,) is 1/tau, zero without a prior; `shift` (m,) is subtracted
    from the residuals (a synthetic data set of the bootstrap). `periods` (n,) hold the
    period of a parameter that can go round inside its box, else infinity: such a parameter has no
    bounds here. `names` of the outputs.
    """

    objective: Objective
    whitening: FloatArray
    inverse_prior_sigma: FloatArray
    shift: FloatArray
    lower: FloatArray
    upper: FloatArray
    periods: FloatArray
    names: tuple[str, ...]
    inflation: float = 1.0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The fitted parameters."""
        return self.objective.parameters

    @property
    def widths(self) -> FloatArray:
        """Width of the box in x, (n,), at most a period."""
        lower, upper = search_bounds(self.parameters)
        return np.asarray(np.minimum(upper - lower, self.periods))

    @property
    def row_sigma(self) -> FloatArray:
        """Standard deviation of every residual row, what it shares with others included, (m,)."""
        root = np.linalg.inv(self.whitening) / self.inflation
        return np.asarray(np.sqrt(np.sum(root**2, axis=1)))

    def rows(self, point: Point) -> FloatArray:
        """Rows of data and priors whose sum of squares is chi square, shape (m + n,).

        Args:
            point: evaluated, with residuals of shape (m,).
        """
        data = self.whitening @ (point.residuals - self.shift)
        return np.concatenate([data, point.x * self.inverse_prior_sigma])

    def folded(self, x: FloatArray) -> FloatArray:
        """The same system inside the box: parameters that go round brought back, the rest cut.

        Args:
            x: search vector, shape (n,).
        """
        lower, upper = search_bounds(self.parameters)
        inside = np.array(x, dtype=float)
        out = np.isfinite(self.periods) & ((x < lower) | (x > upper))
        inside[out] = lower[out] + np.mod(x[out] - lower[out], self.periods[out])
        return np.asarray(np.clip(inside, lower, upper))


def likelihood_of(
    objective: Objective, sigma: FloatArray, common: FloatArray, names: Sequence[str] = ()
) -> Likelihood:
    """Likelihood without inflation from the relative noise of the rows.

    Args:
        objective: response, parameters and data.
        sigma: relative standard deviations of the rows, shape (m,), all positive.
        common: columns of relative errors shared by the rows, shape (m, k).
        names: derived outputs that are looked at.
    """
    variance = np.diag(np.maximum(sigma, SMALLEST_SIGMA) ** 2) + common @ common.T
    lower, upper = search_bounds(objective.parameters)
    periods = np.full(lower.size, np.inf)
    inverse_prior_sigma = np.zeros(lower.size)
    for i, parameter in enumerate(objective.parameters):
        if parameter.period is not None:
            period = parameter.period / parameter.scale
            if upper[i] - lower[i] >= period * (1.0 - 1e-9):
                periods[i] = period
        prior = parameter.prior_sigma
        if prior is not None:
            inverse_prior_sigma[i] = parameter.scale / prior
    bound = np.isinf(periods)
    return Likelihood(
        objective=objective,
        whitening=np.linalg.inv(np.linalg.cholesky(variance)),
        inverse_prior_sigma=inverse_prior_sigma,
        shift=np.zeros(sigma.size),
        lower=np.where(bound, lower, -np.inf),
        upper=np.where(bound, upper, np.inf),
        periods=periods,
        names=tuple(names),
    )


class LikelihoodEvaluator:
    """Evaluates a likelihood in batches and counts; at most `limit` evaluations."""

    def __init__(self, likelihood: Likelihood, limit: int = 10**9) -> None:
        self.likelihood = likelihood
        self.limit = limit
        self.evaluations = self.derived = self.runs = self.failures = 0

    def __call__(self, requests: Sequence[Request]) -> list[list[Sample]]:
        """Samples for the requests of a round, in one batch.

        Raises:
            Exhausted: the limit is reached.
            FmuFailure: the model failed at more points than can be left out.
        """
        wanted = sum(len(request.xs) for request in requests if request.rows)
        if self.evaluations + wanted > self.limit:
            raise Exhausted
        fold = self.likelihood.folded
        rows = iter(self._rows([fold(x) for r in requests if r.rows for x in r.xs]))
        outputs = iter(self._outputs([fold(x) for r in requests if r.outputs for x in r.xs]))
        nothing = np.empty(0)
        return [
            [
                Sample(
                    x,
                    next(rows) if request.rows else nothing,
                    next(outputs) if request.outputs else nothing,
                )
                for x in request.xs
            ]
            for request in requests
        ]

    def _rows(self, xs: Sequence[FloatArray]) -> list[FloatArray]:
        if not xs:
            return []
        self.evaluations += len(xs)
        try:
            points = evaluate_many(self.likelihood.objective, xs)
        except NoAnswer:
            raise
        except FmuFailure:
            if len(xs) == 1 and self.failures >= MOST_FAILURES:
                raise
            if len(xs) == 1:
                self.failures += 1
                size = self.likelihood.whitening.shape[0] + xs[0].size
                return [np.full(size, np.nan)]
            half = len(xs) // 2
            return [*self._rows(xs[:half]), *self._rows(xs[half:])]
        self.runs += sum(point.runs for point in points)
        return [self.likelihood.rows(point) for point in points]

    def _outputs(self, xs: Sequence[FloatArray]) -> list[FloatArray]:
        names = self.likelihood.names
        if not xs or not names:
            return [np.empty(0) for _ in xs]
        self.derived += len(xs)
        objective = self.likelihood.objective
        means = output_means(objective.response, objective.parameters, xs)
        return list(np.stack([means[name] for name in names], axis=1))

    def one(self, x: FloatArray) -> Sample:
        """Rows and outputs at one search vector.

        Args:
            x: search vector, shape (n,).
        """
        return self([Request((x,))])[0][0]
