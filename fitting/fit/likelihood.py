"""Likelihood of the data at any parameters: whitened rows whose sum of squares is chi square.

    chi^2(x) = r^T V^-1 r / k^2 + sum_j (x_j/tau_j)^2        V = diag(sigma^2) + U U^T

r are the relative residuals, U columns of errors that all rows share (the scale chi), k the factor
by which residuals beyond the noise widen it, tau_j the Gaussian prior of a parameter that has one.
The Tikhonov term of Algorithm 2 is no knowledge and takes no part. Nothing is looked for beyond the
bounds of the campaign: intervals are conditional on them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.campaign.parameters import (
    Parameter,
    in_box,
    inverse_priors,
    search_bounds,
)
from fitting.fit.covariance import BoundedErrors, RowCovariance
from fitting.fit.linearisation import SMALLEST_SIGMA
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, Point, evaluate_many
from fitting.fit.outputs import answered_apart, output_means_beyond, runs_of_outputs
from fitting.measurements.measurement import Response
from fitting.text.arrays import FloatArray
from fitting.text.errors import NoScale

#: Points of the box at which a model may fail, and as many as it has answered at: a box may have a
#: part that the model refuses. Beyond both the failure is passed on.
MOST_FAILURES = 12
#: Relative rounding of a period.
ROUNDING = 1e-9


class Exhausted(Exception):
    """The budget allows no more evaluations."""


@dataclass(frozen=True)
class Request:
    """Search vectors at which rows, outputs or both are wanted."""

    xs: tuple[FloatArray, ...]
    rows: bool = True
    outputs: bool = True


@dataclass(frozen=True)
class Sample:
    """One evaluated search vector: `rows` (m,) whitened, `outputs` (k,); empty if not wanted.

    NaN rows where the model failed; NaN outputs where the model has no value.
    """

    x: FloatArray
    rows: FloatArray
    outputs: FloatArray


@dataclass(frozen=True, kw_only=True)
class Likelihood:
    """Whitened rows of an objective, with the box in which they are looked at.

    `noise` is the covariance V of the rows as it is stated, `inflation` k; `inverse_prior_sigma`
    (n,) is 1/tau, zero without a prior; `shift` (m,) is subtracted from the residuals (a synthetic
    data set of the bootstrap), `prior_shift` (n,) from x in the rows of the priors. `lower`,
    `upper` (n,) are the bounds. `periods` (n,) hold the
    period of a parameter that can go round between them, else infinity: such a parameter has no
    limits here. `names` of the outputs. `bounded` is what the simulation may be off by
    (`fitting.fit.noise`): it takes no part in chi square. `scatter` (m,) is above zero for rows
    whose noise is that of the residuals themselves, see `fitting.fit.noise.RowNoise`; empty: all
    noise is known.
    """

    objective: Objective
    noise: RowCovariance
    inverse_prior_sigma: FloatArray
    shift: FloatArray
    lower: FloatArray
    upper: FloatArray
    periods: FloatArray
    names: tuple[str, ...]
    inflation: float = 1.0
    bounded: BoundedErrors = field(default_factory=BoundedErrors.none)
    scatter: FloatArray = field(default_factory=lambda: np.empty(0))
    prior_shift: FloatArray | float = 0.0

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
    def stated(self) -> Likelihood:
        """The same with the noise as it is stated, not widened."""
        return replace(self, inflation=1.0)

    @property
    def data_rows(self) -> int:
        """Number m of rows of the data; those of the priors follow."""
        return self.noise.size

    def residuals(self, rows: FloatArray) -> FloatArray:
        """Residuals, or changes of them, behind whitened rows of the data, (m,) or (m, n).

        Args:
            rows: as `rows` has them, without those of the priors.
        """
        return self.inflation * self.noise.coloured(rows)

    def rows(self, point: Point) -> FloatArray:
        """Rows of data and priors whose sum of squares is chi square, shape (m + n,).

        Args:
            point: evaluated, with residuals of shape (m,).
        """
        data = self.noise.whitened(point.residuals - self.shift) / self.inflation
        return np.concatenate([data, (point.x - self.prior_shift) * self.inverse_prior_sigma])

    def folded(self, x: FloatArray) -> FloatArray:
        """The same system inside the limits: parameters that go round brought back, the rest cut.

        Args:
            x: search vector, shape (n,).
        """
        if not self._goes_round:
            return np.asarray(np.minimum(np.maximum(x, self.lower), self.upper))
        lower, upper = search_bounds(self.parameters)
        inside = np.array(x, dtype=float)
        out = np.isfinite(self.periods) & ((x < lower) | (x > upper))
        period = self.periods[out]
        inside[out] = lower[out] + np.mod(x[out] - lower[out], period)
        return np.asarray(np.clip(inside, self.lower, self.upper))

    @cached_property
    def _goes_round(self) -> bool:
        """Whether any parameter has a period."""
        return bool(np.any(np.isfinite(self.periods)))

    @property
    def declared(self) -> tuple[FloatArray, FloatArray]:
        """What the model itself allows, in x: lower and upper limits, (n,) each."""
        reference = np.array([p.reference for p in self.parameters])
        scale = np.array([p.scale for p in self.parameters])
        least = np.array([p.least for p in self.parameters])
        most = np.array([p.most for p in self.parameters])
        return (least - reference) / scale, (most - reference) / scale


def likelihood_of(
    objective: Objective,
    sigma: FloatArray,
    common: FloatArray,
    names: Sequence[str] = (),
    bounded: BoundedErrors | None = None,
) -> Likelihood:
    """Likelihood without inflation from the relative noise of the rows.

    Args:
        objective: response, parameters and data.
        sigma: relative standard deviations of the rows, shape (m,), all positive.
        common: columns of relative errors shared by the rows, shape (m, k).
        names: derived outputs that are looked at.
        bounded: what the simulation may be off by; nothing if not given.
    """
    own = np.maximum(sigma, SMALLEST_SIGMA)
    lower, upper = search_bounds(objective.parameters)
    periods = np.full(lower.size, np.inf)
    for i, parameter in enumerate(objective.parameters):
        if parameter.period is not None:
            period = parameter.period / parameter.scale
            if upper[i] - lower[i] >= period * (1.0 - ROUNDING):
                periods[i] = period
    bound = np.isinf(periods)
    return Likelihood(
        objective=objective,
        noise=RowCovariance(own, common),
        inverse_prior_sigma=inverse_priors(objective.parameters),
        shift=np.zeros(sigma.size),
        lower=np.where(bound, lower, -np.inf),
        upper=np.where(bound, upper, np.inf),
        periods=periods,
        names=tuple(names),
        bounded=BoundedErrors.none() if bounded is None else bounded,
    )


def likelihood_with(objective: Objective, noise: RowNoise) -> Likelihood:
    """Likelihood without inflation; what is not known of the noise is told by the residuals.

    Args:
        objective: response, parameters and data.
        noise: of the rows.
    """
    plain = likelihood_of(objective, noise.sigma, noise.common)
    return replace(plain, scatter=noise.scatter)


@dataclass(frozen=True)
class Spent:
    """How far a search is: its `stage` in words, `evaluations` in that, and `before` it began."""

    stage: str
    evaluations: int
    before: int

    @property
    def total(self) -> int:
        """Evaluations of all stages so far."""
        return self.before + self.evaluations


class LikelihoodEvaluator:
    """Evaluates a likelihood in batches and counts; at most about `limit` simulation runs.

    Those in which derived outputs are read count as well. Runs that points of a batch share count
    once; a model that counts none counts evaluations.
    `progress` is told what was spent when a stage begins and before every batch; `cuts` counts how
    often the limit was met.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        limit: int = 10**9,
        progress: Callable[[Spent], None] = lambda spent: None,
    ) -> None:
        self.likelihood = likelihood
        self.limit = limit
        self._progress = progress
        self._stage, self._before = "", 0
        self.evaluations = self.derived = self.runs = self.failures = self.answered = 0
        self.cuts = 0
        self._reading = self._read = 0  # who reads outputs at present, and runs that are counted

    def begin(self, stage: str) -> None:
        """What is evaluated from here on belongs to another stage.

        Args:
            stage: in words.
        """
        self._stage, self._before = stage, self.evaluations
        self._tell()

    def _tell(self) -> None:
        self._progress(Spent(self._stage, self.evaluations - self._before, self._before))

    def __call__(self, requests: Sequence[Request]) -> list[list[Sample]]:
        """Samples for the requests of a round, in one batch.

        Raises:
            Exhausted: the limit is reached.
            FmuFailure: the model failed at more points than can be left out.
        """
        wanted = sum(len(request.xs) for request in requests if request.rows)
        if wanted and self.spent + wanted * self._each > self.limit:
            self.cuts += 1
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

    @contextmanager
    def beyond_limit(self) -> Iterator[None]:
        """Without the limit, for as long as the context lasts: for what a result rests on."""
        limit, self.limit = self.limit, 10**18
        try:
            yield
        finally:
            self.limit = limit

    @contextmanager
    def of(self, likelihood: Likelihood) -> Iterator[None]:
        """Evaluate another likelihood for as long as the context lasts; it is counted alike.

        Args:
            likelihood: of the same parameters.
        """
        own, self.likelihood = self.likelihood, likelihood
        try:
            yield
        finally:
            self.likelihood = own

    @property
    def spent(self) -> int:
        """What counts against the limit so far."""
        return self.runs or self.evaluations

    @property
    def _each(self) -> float:
        """What an evaluation has cost on average."""
        return self.spent / self.evaluations if self.evaluations else 1.0

    def _rows(self, xs: Sequence[FloatArray]) -> list[FloatArray]:
        return answered_apart(self._evaluated, xs, self._failed) if xs else []

    def _evaluated(self, xs: Sequence[FloatArray]) -> list[FloatArray]:
        self.evaluations += len(xs)
        self._tell()
        points = evaluate_many(self.likelihood.objective, xs)
        self.answered += len(points)
        self.runs += sum(point.runs for point in points)
        return [self.likelihood.rows(point) for point in points]

    def _failed(self, x: FloatArray, failure: Exception) -> FloatArray:
        # a model that answers with nothing fits infinitely badly there, and has not failed
        is_failure = in_box(self.likelihood.parameters, x) and not isinstance(failure, NoScale)
        if is_failure and self.failures >= max(MOST_FAILURES, self.answered):
            raise failure
        self.failures += is_failure
        return np.full(self.likelihood.data_rows + x.size, np.nan)

    def _outputs(self, xs: Sequence[FloatArray]) -> list[FloatArray]:
        names = self.likelihood.names
        if not xs or not names:
            return [np.empty(0) for _ in xs]
        self.derived += len(xs)
        with self._counting_outputs(self.likelihood.objective.response) as response:
            means = output_means_beyond(response, self.likelihood.parameters, xs, names)
        return list(np.stack([means[name] for name in names], axis=1))

    @contextmanager
    def _counting_outputs(self, response: Response) -> Iterator[Response]:
        """Runs in which outputs are read count once, whoever else reads meanwhile."""
        if not self._reading:
            self._read = runs_of_outputs(response)
        self._reading += 1
        try:
            yield response
        finally:
            self._reading -= 1
            read = runs_of_outputs(response)
            self.runs += read - self._read
            self._read = read

    def one(self, x: FloatArray) -> Sample:
        """Rows and outputs at one search vector.

        Args:
            x: search vector, shape (n,).
        """
        return self([Request((x,))])[0][0]
