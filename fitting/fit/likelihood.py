"""Likelihood of the data at any parameters: whitened rows whose sum of squares is chi square.

    chi^2(x) = r^T V^-1 r / k^2 + sum_j (x_j/tau_j)^2        V = diag(sigma^2) + U U^T

r are the relative residuals, U columns of errors that all rows share (the scale chi), k the factor
by which residuals beyond the noise widen it, tau_j the Gaussian prior of a parameter that has one.
The Tikhonov term of Algorithm 2 is no knowledge and takes no part. Nothing is looked for beyond the
bounds of the campaign: intervals are conditional on them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

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
from fitting.fit.objective import Objective, Point, answered_apart, evaluate_many
from fitting.fit.outputs import output_means_beyond, runs_of_outputs
from fitting.text.arrays import FloatArray
from fitting.text.errors import NoScale

#: Points of the box at which a model may fail before it has answered at any: then the failure is
#: passed on. Of a model that answers somewhere they are no bad input: a box may lie for the most
#: part where coupled modes have no motion.
MOST_FAILURES = 12
#: Share of a curve's power that is one standard deviation where curves are compared by such shares.
SHARE = 0.01
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


@dataclass(frozen=True)
class Space:
    """Where a search moves, (n,) each: `steps` of differences, bounds, `widths`, and `periods`.

    A parameter that goes round has infinite bounds, every other one an infinite period.
    """

    steps: FloatArray
    lower: FloatArray
    upper: FloatArray
    widths: FloatArray
    periods: FloatArray


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
    noise is known. With `by_shares` curves over frequency are compared by where their power is
    (`ResidualCurve.power_shares`): no likelihood, but without the minima at which a line is
    next to another.
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
    by_shares: bool = False

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
    def space(self) -> Space:
        """Where searches move."""
        steps = self.objective.steps
        return Space(steps, self.lower, self.upper, self.widths, self.periods)

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
        dataset = self.objective.data
        pairs = zip(dataset.measurements, dataset.slices, strict=True) if self.by_shares else ()
        for m, at in pairs:
            for curve in () if m.line_width_hz is None else m.residual_curves(point.residuals[at]):
                if curve.model.size:
                    shares = curve.power_shares / SHARE
                    data[at][curve.rows] = 0.0  # complex values have two rows and one share
                    data[at][curve.rows[: shares.size]] = shares
        return np.concatenate([data, (point.x - self.prior_shift) * self.inverse_prior_sigma])

    def folded(self, x: FloatArray) -> FloatArray:
        """The same system inside the limits: parameters that go round brought back, the rest cut.

        Args:
            x: search vector, shape (n,).
        """
        lower, upper = search_bounds(self.parameters)
        out = np.isfinite(self.periods) & ((x < lower) | (x > upper))
        inside = np.where(out, lower + np.mod(x - lower, self.periods), x)
        return np.asarray(np.clip(inside, self.lower, self.upper))

    @property
    def declared(self) -> tuple[FloatArray, FloatArray]:
        """What the model itself allows, in x: lower and upper limits, (n,) each."""
        reference = np.array([p.reference for p in self.parameters])
        scale = np.array([p.scale for p in self.parameters])
        least = np.array([p.least for p in self.parameters])
        most = np.array([p.most for p in self.parameters])
        return (least - reference) / scale, (most - reference) / scale


def likelihood_of(objective: Objective, noise: RowNoise, names: Sequence[str] = ()) -> Likelihood:
    """Likelihood without inflation; noise that is not known is estimated from the residuals.

    Args:
        objective: response, parameters and data.
        noise: of the rows.
        names: derived outputs that are evaluated.
    """
    lower, upper = search_bounds(objective.parameters)
    own = [(p.period or np.inf) / p.scale for p in objective.parameters]
    turns = np.isfinite(own) & (upper - lower >= np.array(own) * (1.0 - ROUNDING))
    return Likelihood(
        objective=objective,
        noise=RowCovariance(np.maximum(noise.sigma, SMALLEST_SIGMA), noise.common),
        inverse_prior_sigma=inverse_priors(objective.parameters),
        shift=np.zeros(noise.sigma.size),
        lower=np.where(turns, -np.inf, lower),
        upper=np.where(turns, np.inf, upper),
        periods=np.where(turns, own, np.inf),
        names=tuple(names),
        bounded=noise.bounded,
        scatter=noise.scatter,
    )


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
    `progress` receives what was spent when a stage begins and before every batch; `cuts` counts how
    often the limit was met, `failures` points of the box at which the model failed, in the words of
    the first `failure`.
    """

    def __init__(
        self,
        likelihood: Likelihood,
        limit: float = math.inf,
        progress: Callable[[Spent], None] = lambda spent: None,
    ) -> None:
        self.likelihood = likelihood
        self.limit = limit
        self._progress = progress
        self._stage, self._before = "", 0
        self.evaluations = self.derived = self.runs = self.failures = self.answered = 0
        self.failure = ""
        self.cuts = 0

    @property
    def space(self) -> Space:
        """Where searches move."""
        return self.likelihood.space

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
            FmuFailure: the model failed at a dozen points and has answered at none.
        """
        wanted = sum(len(request.xs) for request in requests if request.rows)
        each = self.spent / self.evaluations if self.evaluations else 1.0
        if wanted and self.spent + wanted * each > self.limit:
            self.cuts += 1
            raise Exhausted
        fold, none = self.likelihood.folded, itertools.repeat(np.empty(0))
        xs = [fold(x) for request in requests if request.rows for x in request.xs]
        both = [request for request in requests if request.rows and request.outputs]
        read = {fold(x).tobytes() for request in both for x in request.xs}
        ask = partial(self._evaluated, read=read if self.likelihood.names else set())
        rows = iter(answered_apart(ask, xs, self._failed) if xs else [])
        outputs = iter(self._outputs([fold(x) for r in requests if r.outputs for x in r.xs]))
        samples = []
        for request in requests:
            mine = rows if request.rows else none, outputs if request.outputs else none
            samples.append([Sample(x, next(mine[0]), next(mine[1])) for x in request.xs])
        return samples

    @contextmanager
    def limited(self, limit: float = math.inf) -> Iterator[None]:
        """With another limit for as long as the context lasts; none for what a result rests on.

        Args:
            limit: simulation runs, about, at most.
        """
        own, self.limit = self.limit, limit
        try:
            yield
        finally:
            self.limit = own

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

    def _evaluated(self, xs: Sequence[FloatArray], read: Collection[bytes]) -> list[FloatArray]:
        self.evaluations += len(xs)
        self._tell()
        places = [k for k, x in enumerate(xs) if x.tobytes() in read]
        points = evaluate_many(self.likelihood.objective, xs, read=places)
        self.answered += len(points)
        self.runs += sum(point.runs for point in points)
        return [self.likelihood.rows(point) for point in points]

    def _failed(self, x: FloatArray, failure: Exception) -> FloatArray:
        # a model that answers with nothing fits infinitely badly there, and has not failed
        is_failure = in_box(self.likelihood.parameters, x) and not isinstance(failure, NoScale)
        if is_failure and not self.answered and self.failures >= MOST_FAILURES:
            raise failure
        if is_failure:
            self.failures, self.failure = self.failures + 1, self.failure or str(failure)
        return np.full(self.likelihood.data_rows + x.size, np.nan)

    def _outputs(self, xs: Sequence[FloatArray]) -> list[FloatArray]:
        names = self.likelihood.names
        if not xs or not names:
            return [np.empty(0) for _ in xs]
        self.derived += len(xs)
        response = self.likelihood.objective.response
        before = runs_of_outputs(response)
        try:
            means = output_means_beyond(response, self.likelihood.parameters, xs, names)
        finally:
            self.runs += runs_of_outputs(response) - before
        return list(np.stack([means[name] for name in names], axis=1))

    def one(self, x: FloatArray) -> Sample:
        """Rows and outputs at one search vector.

        Args:
            x: search vector, shape (n,).
        """
        return self([Request((x,))])[0][0]
