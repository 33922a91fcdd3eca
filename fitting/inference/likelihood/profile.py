"""Profiles of values: what is scanned, its points, and what closes its sides.

An output has a range within the bounds of the parameters, which it could have without any data.
Points within the bounds find where it is small and large; a compass search from the best of them
goes on to the extremes: along every axis that the output depends on, by half the step where none
helps. Of a long series the search reads some of the places, evenly between all; its ends are read
at all.

Source: T. Kolda, R. Lewis and V. Torczon, "Optimization by direct search", SIAM Review 45 (2003).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH, Parameter, search_bounds, spans_decades
from fitting.fit.covariance import WhitenedErrors
from fitting.fit.levenberg import Constraint, Expansion
from fitting.fit.likelihood import Sample
from fitting.fit.linearisation import Linearisation
from fitting.fit.optimum import Optimum
from fitting.fit.outputs import output_means, output_means_beyond
from fitting.measurements.measurement import PlacedResponse, Response
from fitting.text.arrays import BoolArray, FloatArray, IntArray

#: Seeded points within the bounds, and the most points of a grid over them, with their corners.
BOX_SAMPLES, BOX_GRID = 64, 256
#: The first and last step of the search, as a share of the bounds' distance; rounds at most.
FIRST_STEP, LAST_STEP, ROUNDS = 0.1, 2e-4, 60
#: Places of a series at which a search reads outputs, at most about.
MOST_PLACES = 32
#: Relative difference of two values beyond rounding.
ROUNDING = 1e-12

#: Means of the outputs at search vectors, a row of all outputs for each.
Read = Callable[[Sequence[FloatArray]], FloatArray]


@dataclass(frozen=True, kw_only=True)
class OutputRange:
    """Least and greatest mean of an output within the bounds, and where, (n,) each; NaN: no value.

    `depends` (n,): which parameters move it at all.
    """

    low: float
    high: float
    x_low: FloatArray
    x_high: FloatArray
    depends: BoolArray


def output_ranges(
    response: Response, parameters: Sequence[Parameter], seed: int, known: Sequence[FloatArray]
) -> dict[str, OutputRange]:
    """Range of the mean of every derived output within the bounds, by name.

    Values of one experiment, such as drift offsets, stay where the first known point has them: what
    the sample did on the way is no freedom of the model.

    Args:
        response: the model.
        parameters: with their bounds.
        seed: of the points to begin with.
        known: search vectors to evaluate besides, the solution first.

    Raises:
        FmuFailure: the model failed within the bounds.
    """
    lower, upper = search_bounds(parameters)
    own = np.array([not p.experiments for p in parameters])
    spread = _points_within(lower[own], upper[own], seed)
    samples = np.tile(known[0], (len(spread), 1))
    samples[:, own] = spread
    points = [*known, *samples]
    names = tuple(output_means(response, parameters, points[:1]))
    if not names:
        return {}
    some = response.read_at(MOST_PLACES) if isinstance(response, PlacedResponse) else response
    remembered: dict[bytes, FloatArray] = {}

    def read(xs: Sequence[FloatArray]) -> FloatArray:
        # searches of several outputs meet in the same corners, and a run gives all of them
        new = {x.tobytes(): x for x in xs if x.tobytes() not in remembered}
        if new:
            means = output_means_beyond(some, parameters, list(new.values()), names)
            remembered.update(zip(new, np.stack(list(means.values()), axis=1), strict=True))
        return np.array([remembered[x.tobytes()] for x in xs]).reshape(len(xs), len(names))

    table = read(points)
    depends = _dependence(read, lower, upper, own, points[-3:])
    outputs, ends = _extreme_points(read, points, table, depends, lower, upper)
    # the ends are read at all places; the first known point counts where it lies beyond them
    outputs, ends = np.append(outputs[::-1], -1), [*reversed(ends), known[0]]
    whole = output_means_beyond(response, parameters, ends, names)
    nowhere = np.full(len(parameters), np.nan)
    ranges = {}
    for k, name in enumerate(names):
        mine = (outputs == k) | ((outputs < 0) & np.any(outputs == k))
        places, values = np.flatnonzero(mine & np.isfinite(whole[name])), whole[name]
        low = high = np.nan
        x_low = x_high = nowhere
        if places.size:
            least = int(places[np.argmin(values[places])])
            most = int(places[np.argmax(values[places])])
            low, high, x_low, x_high = values[least], values[most], ends[least], ends[most]
        ranges[name] = OutputRange(
            low=float(low), high=float(high), x_low=x_low, x_high=x_high, depends=depends[:, k]
        )
    return ranges


def _extreme_points(
    read: Read,
    points: Sequence[FloatArray],
    table: FloatArray,
    depends: BoolArray,
    lower: FloatArray,
    upper: FloatArray,
) -> tuple[IntArray, list[FloatArray]]:
    """Where each output is least, then where it is greatest: their numbers (k,) and the places.

    Compass searches from the best of some points, whose outputs are the rows of the table; each
    round of theirs in one batch.
    """
    outputs = np.repeat(np.flatnonzero(np.any(np.isfinite(table), axis=0)), 2)
    signs = np.tile([-1.0, 1.0], outputs.size // 2)
    heights = np.where(np.isfinite(table[:, outputs]), signs * table[:, outputs], -np.inf)
    best, steps = np.argmax(heights, axis=0), np.full(outputs.size, FIRST_STEP)
    xs, highest = [points[k] for k in best], np.max(heights, axis=0)
    for _ in range(ROUNDS):
        active, nodes = [], list[FloatArray]()
        for k, output in enumerate(outputs):
            axes = np.flatnonzero(depends[:, output])
            if steps[k] <= LAST_STEP or not axes.size:
                continue
            moved = np.repeat(xs[k][np.newaxis], 2 * axes.size, axis=0)
            step = steps[k] * (upper - lower)[axes]
            moved[np.arange(axes.size) * 2, axes] += step
            moved[np.arange(axes.size) * 2 + 1, axes] -= step
            active.append((k, slice(len(nodes), len(nodes) + 2 * axes.size)))
            nodes += list(np.clip(moved, lower, upper))
        if not active:
            break
        table = read(nodes)
        for k, own in active:
            values = table[own, outputs[k]]
            ranked = np.where(np.isfinite(values), signs[k] * values, -np.inf)
            place = int(np.argmax(ranked))
            if ranked[place] > highest[k]:
                xs[k], highest[k] = nodes[own.start + place], ranked[place]
            else:
                steps[k] *= 0.5
    return outputs, xs


def _points_within(lower: FloatArray, upper: FloatArray, seed: int) -> FloatArray:
    """Points within bounds, shape (m, n): a grid with its corners, where that is small, and seeded.

    Args:
        lower: bounds, shape (n,).
        upper: likewise.
        seed: of the points drawn.
    """
    n = len(lower)
    seeded = np.random.default_rng(seed).uniform(lower, upper, (BOX_SAMPLES, n))
    levels = max(k for k in range(1, 10) if k**n <= BOX_GRID)
    if levels < 2:
        return np.asarray(seeded)
    axes = np.linspace(lower, upper, levels).T
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, n)
    return np.concatenate([grid, seeded])


def _dependence(
    read: Read, lower: FloatArray, upper: FloatArray, own: BoolArray, bases: Sequence[FloatArray]
) -> BoolArray:
    """Which parameters move an output, by steps from a few seeded points: (n, outputs).

    Those of single experiments, which are not `own` (n,) and stay where they are, count as if they
    did not.
    """
    nodes = []
    for base in bases:
        nodes.append(base)
        for i in np.flatnonzero(own):
            for share in (0.31, 0.87):
                moved = base.copy()
                moved[i] = lower[i] + share * (upper[i] - lower[i])
                nodes.append(moved)
    table = read(nodes)
    rows = table.reshape(len(bases), 1 + 2 * np.count_nonzero(own), -1)
    here, moved = rows[:, :1], rows[:, 1:]
    # a value that exists differs from one that does not
    exist = np.isfinite(here) & np.isfinite(moved)
    apart = np.abs(here - moved) > ROUNDING * (np.abs(here) + np.abs(moved))
    differ = np.where(exist, apart, np.isfinite(here) != np.isfinite(moved))
    depends = np.zeros((lower.size, table.shape[1]), dtype=bool)
    depends[own] = np.any(differ.reshape(len(bases), -1, 2, table.shape[1]), axis=(0, 2))
    return depends


# --- what is scanned ------------------------------------------------------------------------------

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

    def values(self, points: Sequence[ScanPoint]) -> FloatArray:
        """Its values at points of profiles, (k,).

        Args:
            points: k of them, with outputs, if it is one.
        """
        return np.array([self.of(point.at.sample) for point in points])

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
    covariance, noise = data_covariance(optimum), likelihood.noise.times(likelihood.inflation)
    bounded = WhitenedErrors(likelihood.bounded, noise) if likelihood.bounded.columns else None
    # name, numbers of parameter and output, slope, best value, range and period of each
    wanted: list[tuple[str, int, int, FloatArray, float, float, float, float]] = []
    axes = np.eye(here.x.size)
    for i, p in enumerate(likelihood.parameters):
        best, period = float(here.x[i]), float(likelihood.periods[i])
        low, high = float(likelihood.lower[i]), float(likelihood.upper[i])
        if math.isfinite(period):
            low, high = best - 0.5 * period, best + 0.5 * period
        wanted.append((p.name, i, -1, axes[i], best, low, high, period))
    names = {p.name for p in likelihood.parameters}
    for k, name in enumerate(likelihood.names):
        best, range_ = float(here.sample.outputs[k]), ranges[name]
        # an output that is a parameter is scanned as that
        if math.isfinite(best) and range_.high > range_.low and name not in names:
            low, high = min(range_.low, best), max(range_.high, best)
            wanted.append((name, -1, k, here.outward[k], best, low, high, math.inf))
    made = []
    for name, index, output, slope, best, low, high, period in wanted:
        # at the edge of where it has a value the whole range, until it is tried
        sigma, reach, has_slope = high - low, 0.0, bool(np.all(np.isfinite(slope)))
        if has_slope:
            sigma = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
        # by how many sigma the simulation's own error may move it: |g C J^T V^-1/2 B|_1/sigma, and
        # along a slope that is not known sum_j |V^-1/2 B_j|
        if bounded is not None and not has_slope:
            reach = bounded.reach
        elif bounded is not None and sigma > 0.0:
            pull = here.matrix[: likelihood.data_rows] @ (covariance @ slope)
            reach = bounded.moved(pull) / sigma
        quantity = Quantity(
            name=name,
            index=index,
            output=output,
            best=best,
            sigma=max(sigma, 1e-12 * (high - low)),
            slope=slope,
            low=low,
            high=high,
            period=period,
            reach=reach,
            freedom=optimum.freedom_along(slope, covariance),
        )
        made.append(quantity)
    return tuple(made)
