"""What a derived output could be without any data: its range within the bounds of the parameters.

Points within the bounds find where it is small and large; a compass search from the best of them
goes on to the extremes: along every axis that the output depends on, by half the step where none
helps. Of a long series the search reads some of the places, evenly between all; its ends are read
at all.

Source: T. Kolda, R. Lewis and V. Torczon, "Optimization by direct search", SIAM Review 45 (2003).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds
from fitting.fit.outputs import output_means, output_means_beyond
from fitting.measurements.measurement import PlacedResponse, Response
from fitting.text.arrays import BoolArray, FloatArray

#: Seeded points within the bounds, and the most points of a grid over them, with their corners.
BOX_SAMPLES, BOX_GRID = 64, 256
#: The first and last step of the search, as a share of the bounds' distance; rounds at most.
FIRST_STEP, LAST_STEP, ROUNDS = 0.1, 2e-4, 60
#: Places of a series at which a search reads outputs, at most about.
MOST_PLACES = 32
#: Relative difference of two values beyond rounding.
ROUNDING = 1e-12

#: Means of the outputs at search vectors, one column each.
Read = Callable[[Sequence[FloatArray]], dict[str, FloatArray]]


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


@dataclass
class _Search:
    """A compass search of one output: up or down by its sign, where it is, its step."""

    name: str
    sign: float
    x: FloatArray
    value: float
    step: float = FIRST_STEP


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
    some = response.read_at(MOST_PLACES) if isinstance(response, PlacedResponse) else response
    remembered: dict[bytes, list[float]] = {}

    def read(xs: Sequence[FloatArray]) -> dict[str, FloatArray]:
        # searches of several outputs meet in the same corners, and a run gives all of them
        new = {x.tobytes(): x for x in xs if x.tobytes() not in remembered}
        if new:
            means = output_means_beyond(some, parameters, list(new.values()), names)
            for k, key in enumerate(new):
                remembered[key] = [float(means[name][k]) for name in names]
        table = np.array([remembered[x.tobytes()] for x in xs]).reshape(len(xs), len(names))
        return {name: table[:, k] for k, name in enumerate(names)}

    table = read(points)
    depends = _dependence(read, parameters, points[-3:])
    searches: list[_Search] = []
    for name, values in table.items():
        for sign in (-1.0, 1.0) if np.any(np.isfinite(values)) else ():
            best = int(np.argmax(np.where(np.isfinite(values), sign * values, -np.inf)))
            searches.append(_Search(name, sign, points[best], float(values[best])))
    _follow(searches, read, depends, (lower, upper))

    # the ends are read at all places; the first known point counts where it lies beyond them
    ends = [*(search.x for search in searches[::-1]), known[0]]
    whole = output_means_beyond(response, parameters, ends, names)
    ranges = {}
    for name in names:
        mine = [k for k, search in enumerate(searches[::-1]) if search.name == name]
        values = whole[name]
        mine = [k for k in (*mine, len(searches)) if np.isfinite(values[k])] if mine else []
        if not mine:
            x_low = x_high = np.full(len(parameters), np.nan)
            low = high = np.nan
        else:
            least, most = mine[np.argmin(values[mine])], mine[np.argmax(values[mine])]
            low, high, x_low, x_high = values[least], values[most], ends[least], ends[most]
        ranges[name] = OutputRange(
            low=float(low), high=float(high), x_low=x_low, x_high=x_high, depends=depends[name]
        )
    return ranges


def _follow(
    searches: Sequence[_Search],
    read: Read,
    depends: dict[str, BoolArray],
    limits: tuple[FloatArray, FloatArray],
) -> None:
    """Carry out all compass searches, each round of theirs in one batch."""
    lower, upper = limits
    for _ in range(ROUNDS):
        active = [s for s in searches if s.step > LAST_STEP and np.any(depends[s.name])]
        if not active:
            return
        nodes: list[list[FloatArray]] = []
        for search in active:
            nodes.append([])
            for i in np.flatnonzero(depends[search.name]):
                for side in (1.0, -1.0):
                    moved = search.x.copy()
                    moved[i] += side * search.step * (upper[i] - lower[i])
                    nodes[-1].append(np.clip(moved, lower, upper))
        table, first = read([x for each in nodes for x in each]), 0
        for search, each in zip(active, nodes, strict=True):
            values = table[search.name][first : first + len(each)]
            first += len(each)
            ranked = np.where(np.isfinite(values), search.sign * values, -np.inf)
            best = int(np.argmax(ranked))
            if ranked[best] > search.sign * search.value:
                search.x, search.value = each[best], float(values[best])
            else:
                search.step *= 0.5


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
    axes = [np.linspace(a, b, levels) for a, b in zip(lower, upper, strict=True)]
    grid = np.stack([axis.ravel() for axis in np.meshgrid(*axes)], axis=1)
    return np.concatenate([grid, seeded])


def _dependence(
    read: Read, parameters: Sequence[Parameter], bases: Sequence[FloatArray]
) -> dict[str, BoolArray]:
    """Which parameters move an output, by steps from a few seeded points; (n,) by name.

    Those of single experiments, which stay where they are, count as if they did not.
    """
    lower, upper = search_bounds(parameters)
    own = np.flatnonzero([not p.experiments for p in parameters])
    nodes = []
    for base in bases:
        nodes.append(base)
        for i in own:
            for share in (0.31, 0.87):
                moved = base.copy()
                moved[i] = lower[i] + share * (upper[i] - lower[i])
                nodes.append(moved)
    depends = {}
    for name, values in read(nodes).items():
        rows = values.reshape(len(bases), 1 + 2 * own.size)
        base, moved = rows[:, :1], rows[:, 1:]
        # a value that exists differs from one that does not
        exist = np.isfinite(base) & np.isfinite(moved)
        apart = np.abs(base - moved) > ROUNDING * (np.abs(base) + np.abs(moved))
        differ = np.where(exist, apart, np.isfinite(base) != np.isfinite(moved))
        depends[name] = np.zeros(lower.size, dtype=bool)
        depends[name][own] = np.any(differ.reshape(len(bases), own.size, 2), axis=(0, 2))
    return depends
