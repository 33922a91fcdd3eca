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
    range without data; `is_periodic`: it comes back to itself there. `reach`: by how many sigma the
    simulation's own error may move it, at most; `freedom`: degrees of freedom of its noise.
    """

    name: str
    index: int
    output: int
    best: float
    sigma: float
    slope: FloatArray
    low: float
    high: float
    is_periodic: bool = False
    reach: float = 0.0
    freedom: float = math.inf

    @property
    def width(self) -> float:
        """Range without data."""
        return self.high - self.low

    def of(self, sample: Sample, periods: FloatArray) -> float:
        """Its value at a point; of a parameter that is periodic, the image nearest to the best.

        Args:
            sample: with outputs, if it is one.
            periods: of the parameters in x, infinite without one, (n,).
        """
        if self.index < 0:
            return float(sample.outputs[self.output]) if sample.outputs.size else math.nan
        value, period = float(sample.x[self.index]), float(periods[self.index])
        if math.isfinite(period):
            value -= period * round((value - self.best) / period)
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

    def key(self, side: int) -> Key:
        """Of one of its sides; outputs may have the name of a parameter."""
        return self.index, self.output, side

    def constraint(self, target: float, step: float) -> Constraint:
        """What holds it at a target that is a step away."""
        if self.index >= 0:
            return Constraint(target=target, index=self.index)
        weight = HOLD / max(abs(step), 1e-12 * self.width)
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


Sides = tuple[Side, Side]
#: A side of a quantity: its index, its output, 0 below or 1 above.
Key = tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
class Scans:
    """Both sides of every quantity around one optimum, and all points that fit (`shared`)."""

    optimum: Optimum
    quantities: tuple[Quantity, ...]
    sides: Mapping[str, Sides]
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
    covariance = data_covariance(optimum)
    made = []
    for i, slope in enumerate(np.eye(here.x.size)):
        best, half = float(here.x[i]), 0.5 * float(likelihood.periods[i])
        is_periodic = math.isfinite(half)
        made.append(
            Quantity(
                name=likelihood.parameters[i].name,
                index=i,
                output=-1,
                best=best,
                sigma=math.sqrt(covariance[i, i]),
                slope=slope,
                low=best - half if is_periodic else float(likelihood.lower[i]),
                high=best + half if is_periodic else float(likelihood.upper[i]),
                is_periodic=is_periodic,
                reach=_reach(optimum, covariance, slope),
                freedom=optimum.freedom_along(slope, covariance),
            )
        )
    for k, name in enumerate(likelihood.names):
        best, slope = float(here.sample.outputs[k]), here.outward[k]
        if not math.isfinite(best) or not ranges[name].high > ranges[name].low:
            continue
        low, high = min(ranges[name].low, best), max(ranges[name].high, best)
        sigma = high - low  # at the edge of where it has a value, until it is tried
        if np.all(np.isfinite(slope)):
            sigma = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
        made.append(
            Quantity(
                name=name,
                index=-1,
                output=k,
                best=best,
                sigma=max(sigma, 1e-12 * (high - low)),
                slope=slope,
                low=low,
                high=high,
                reach=_reach(optimum, covariance, slope),
                freedom=optimum.freedom_along(slope, covariance),
            )
        )
    return tuple(made)


def _reach(optimum: Optimum, covariance: FloatArray, slope: FloatArray) -> float:
    """By how many standard deviations the simulation's own error may move a value, at most.

    |g C J^T V^-1/2 B|_1/sqrt(g C g); along a slope that is not known, sum_j |V^-1/2 B_j|.
    """
    likelihood = optimum.likelihood
    if not likelihood.bounded.columns:
        return 0.0
    errors = WhitenedErrors(likelihood.bounded, likelihood.noise.times(likelihood.inflation))
    if not np.all(np.isfinite(slope)):
        return errors.reach
    variance = float(slope @ covariance @ slope)
    if not variance > 0.0:
        return 0.0
    pull = optimum.expansion.matrix[: likelihood.data_rows] @ (covariance @ slope)
    return errors.moved(pull) / math.sqrt(variance)
