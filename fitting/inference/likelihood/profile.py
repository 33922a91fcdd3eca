"""Profiles of values: what is scanned, its points, and what closes its sides."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH, spans_decades
from fitting.fit.covariance import WhitenedErrors
from fitting.fit.levenberg import Constraint, Expansion
from fitting.fit.likelihood import Sample
from fitting.fit.linearisation import Linearisation
from fitting.fit.optimum import Optimum
from fitting.inference.likelihood.ranges import OutputRange
from fitting.text.arrays import FloatArray

#: Width of the prior that keeps a covariance finite, in those of the bounds.
WIDER = 10.0
#: Weight of the row that holds an output, over the step: it misses its target by next to nothing.
HOLD = 30.0
#: Share of the way to the end of a range that is next to it, of a parameter and of an output, which
#: may have an extreme there.
AT_END, AT_EXTREME = 1e-3, 0.02


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A parameter (`index`) or an output whose interval is wanted, in x or in the output's unit.

    `best` at the most likely point, `sigma` linearised; `slope` d value/dx (n,); `low`, `high` its
    range without data; `period` in x, by which it comes back to itself, else infinite. `reach`: by
    how many sigma the simulation's own error may move it, at most; `freedom`: degrees of freedom of
    its noise.
    """

    name: str
    index: int
    output: int
    best: float
    sigma: float
    slope: FloatArray
    low: float
    high: float
    period: float = math.inf
    reach: float = 0.0
    freedom: float = math.inf

    @property
    def is_periodic(self) -> bool:
        """Whether it comes back to itself."""
        return math.isfinite(self.period)

    def of(self, sample: Sample) -> float:
        """Its value at a point; of a parameter that is periodic, the image nearest to the best.

        Args:
            sample: with outputs, if it is one.
        """
        if self.index < 0:
            return float(sample.outputs[self.output]) if sample.outputs.size else math.nan
        value = float(sample.x[self.index])
        if self.is_periodic:
            value -= self.period * round((value - self.best) / self.period)
        return value

    def is_at_end(self, side: int, value: float) -> bool:
        """Whether a value is as good as at an end of the range; in ratios where it spans decades.

        Args:
            side: 0 below, 1 above.
            value: in x or in the output's unit.
        """
        limit = (self.low, self.high)[side]
        if self.index >= 0:
            return abs(value - limit) <= AT_END * abs(limit - self.best)
        if spans_decades(self.low, self.high) and min(value, self.best) > 0.0:
            return abs(math.log(value / limit)) <= AT_EXTREME * abs(math.log(limit / self.best))
        return abs(value - limit) <= AT_EXTREME * abs(limit - self.best)

    def constraint(self, target: float, step: float) -> Constraint:
        """What holds it at a target that is a step away."""
        if self.index >= 0:
            return Constraint(target=target, index=self.index)
        weight = HOLD / max(abs(step), 1e-12 * (self.high - self.low))
        return Constraint(target=target, output=self.output, weight=weight)


@dataclass(frozen=True, kw_only=True)
class ScanPoint:
    """A point of a profile: value, Dchi^2, and the point with its slopes if they are known."""

    value: float
    delta: float
    at: Expansion

    @property
    def root(self) -> float:
        """sqrt(Dchi^2), zero where it is a little better than the optimum."""
        return math.sqrt(max(0.0, self.delta))

    @property
    def x(self) -> FloatArray:
        """The search vector."""
        return self.at.x

    @property
    def outputs(self) -> FloatArray:
        """Derived outputs there; empty where they were not read."""
        return self.at.sample.outputs


@dataclass(frozen=True, kw_only=True)
class Side:
    """One side of a profile: its points outward, what closed it, and where.

    `closed` is "data", "prior", "bound", "periodic", "failed" or "budget"; `end68` and `end95` are
    crossings, or the end of the range; `own95` the first crossing, where the valley of the most
    likely point ends; `active` are other parameters whose bounds are active there.
    """

    points: tuple[ScanPoint, ...]
    closed: str
    end68: float
    end95: float
    own95: float
    active: tuple[int, ...] = ()
    is_verified: bool = False


@dataclass(frozen=True, kw_only=True)
class Scans:
    """Both sides of every quantity around one optimum, and all points that fit (`shared`)."""

    optimum: Optimum
    quantities: tuple[Quantity, ...]
    sides: Mapping[str, tuple[Side, Side]]
    minima: tuple[ScanPoint, ...]
    shared: tuple[ScanPoint, ...]
    ranges: Mapping[str, OutputRange] = field(default_factory=dict)


def data_covariance(optimum: Optimum, *, stated: bool = False) -> FloatArray:
    """(J^T J + P)^-1 with a uniform prior far wider than the bounds, (n, n): never infinite.

    Args:
        optimum: where it is linearised.
        stated: whether the noise is taken as stated, not widened.
    """
    at, likelihood = optimum.expansion, optimum.likelihood
    matrix = at.matrix.copy()
    if stated:
        matrix[: likelihood.data_rows] *= likelihood.inflation
    prior = WIDER * likelihood.widths / UNIFORM_WIDTH
    return Linearisation(rows=at.sample.rows, matrix=matrix, prior=prior).covariance


def quantities(optimum: Optimum, ranges: Mapping[str, OutputRange]) -> tuple[Quantity, ...]:
    """Every parameter, and every output that has a value at the optimum and a range.

    Args:
        optimum: the most likely point and its likelihood.
        ranges: of the outputs without data, by name.
    """
    likelihood, here = optimum.likelihood, optimum.expansion
    covariance, made = data_covariance(optimum), []
    noise = likelihood.noise.times(likelihood.inflation)
    bounded = WhitenedErrors(likelihood.bounded, noise) if likelihood.bounded.columns else None

    def add(name: str, index: int, output: int, slope: FloatArray, **place: float) -> None:
        low, high, sigma, reach = place["low"], place["high"], math.nan, 0.0
        if np.all(np.isfinite(slope)):
            sigma = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
        else:  # at the edge of where it has a value, until it is tried
            sigma = high - low
        # by how many sigma the simulation's own error may move it: |g C J^T V^-1/2 B|_1/sigma, and
        # along a slope that is not known sum_j |V^-1/2 B_j|
        if bounded is not None and not np.all(np.isfinite(slope)):
            reach = bounded.reach
        elif bounded is not None and sigma > 0.0:
            pull = here.matrix[: likelihood.data_rows] @ (covariance @ slope)
            reach = bounded.moved(pull) / sigma
        made.append(
            Quantity(
                name=name,
                index=index,
                output=output,
                sigma=max(sigma, 1e-12 * (high - low)),
                slope=slope,
                reach=reach,
                freedom=optimum.freedom_along(slope, covariance),
                **place,
            )
        )

    for i, p in enumerate(likelihood.parameters):
        best, period = float(here.x[i]), float(likelihood.periods[i])
        low, high = float(likelihood.lower[i]), float(likelihood.upper[i])
        if math.isfinite(period):
            low, high = best - 0.5 * period, best + 0.5 * period
        axis = np.eye(here.x.size)[i]
        add(p.name, i, -1, axis, best=best, low=low, high=high, period=period)
    for k, name in enumerate(likelihood.names):
        best, range_ = float(here.sample.outputs[k]), ranges[name]
        is_parameter = any(name == q.name for q in made)  # then that is what is scanned
        if math.isfinite(best) and range_.high > range_.low and not is_parameter:
            low, high = min(range_.low, best), max(range_.high, best)
            add(name, -1, k, here.outward[k], best=best, low=low, high=high)
    return tuple(made)
