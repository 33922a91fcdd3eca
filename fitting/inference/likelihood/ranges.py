"""What a derived output could be without any data: its range over the box of the parameters.

Points of the box find where it is small and large, a compass search from the best of them goes on
to the extremes: along every axis that the output depends on, by half the step where none helps. Of
a long series the search reads some of the places, evenly between all; its ends are read at all.

Source: T. Kolda, R. Lewis and V. Torczon, "Optimization by direct search", SIAM Review 45 (2003).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds
from fitting.fit.outputs import output_means, output_means_beyond
from fitting.measurements.measurement import PlacedResponse, Response
from fitting.text.arrays import BoolArray, FloatArray, IntArray

#: Seeded points of the box, and the most points of a grid over it, which holds its corners.
BOX_SAMPLES, BOX_GRID = 64, 256
#: The last step of the search, as a share of the box; rounds at most.
LAST_STEP, ROUNDS = 2e-4, 60
#: Places of a series at which a search reads outputs, at most about.
MOST_PLACES = 32


@dataclass(frozen=True, kw_only=True)
class OutputRange:
    """Least and greatest mean of an output over the box, and where, (n,) each; NaN if it has none.

    `depends` (n,) tells which parameters move it at all.
    """

    low: float
    high: float
    x_low: FloatArray
    x_high: FloatArray
    depends: BoolArray


@dataclass
class _Climb:
    """One search: the output, its sign (up or down), where it stands, its axes, its step."""

    name: str
    sign: float
    x: FloatArray
    value: float
    axes: IntArray
    step: float = 0.1

    def nodes(self, lower: FloatArray, upper: FloatArray) -> list[FloatArray]:
        nodes = []
        for i in self.axes:
            for side in (1.0, -1.0):
                moved = self.x.copy()
                moved[i] += side * self.step * (upper[i] - lower[i])
                nodes.append(np.clip(moved, lower, upper))
        return nodes

    def update(self, nodes: Sequence[FloatArray], values: FloatArray) -> None:
        """Go to the best node, or halve the step."""
        ranked = np.where(np.isfinite(values), self.sign * values, -np.inf)
        best = int(np.argmax(ranked)) if ranked.size else 0
        if ranked.size and ranked[best] > self.sign * self.value:
            self.x, self.value = nodes[best], float(values[best])
        else:
            self.step *= 0.5


def output_ranges(
    response: Response,
    parameters: Sequence[Parameter],
    seed: int,
    known: Sequence[FloatArray],
    room: tuple[FloatArray, FloatArray] | None = None,
) -> dict[str, OutputRange]:
    """Range of the mean of every derived output over the box, or another room, by name.

    Values of one experiment, such as drift offsets, stay where the first known point has them: what
    the sample did on the way is no freedom of the model.

    Args:
        response: the model.
        parameters: with their boxes.
        seed: of the points to begin with.
        known: search vectors to look at besides, the solution first.
        room: lower and upper limits in x, shape (n,) each; None: the box.

    Raises:
        FmuFailure: the model failed in the box.
    """
    lower, upper = search_bounds(parameters) if room is None else room
    own = np.array([not p.experiments for p in parameters])
    spread = box_points(lower[own], upper[own], seed)
    samples = np.tile(known[0], (len(spread), 1))
    samples[:, own] = spread
    points = [*known, *samples]
    names = tuple(output_means(response, parameters, points[:1]))
    some = response.read_at(MOST_PLACES) if isinstance(response, PlacedResponse) else response

    known_means: dict[bytes, list[float]] = {}

    def read(xs: Sequence[FloatArray]) -> dict[str, FloatArray]:
        # searches of several outputs meet in the same corners, and a run gives all of them
        new = {x.tobytes(): x for x in xs if x.tobytes() not in known_means}
        if new:
            means = output_means_beyond(some, parameters, list(new.values()), names)
            for k, key in enumerate(new):
                known_means[key] = [float(means[name][k]) for name in names]
        table = np.array([known_means[x.tobytes()] for x in xs]).reshape(len(xs), len(names))
        return {name: table[:, k] for k, name in enumerate(names)}

    table, depends = read(points), _dependence(read, parameters, points[-3:], (lower, upper))
    climbs = [
        climb
        for name, values in table.items()
        for climb in _from_best(name, points, values, np.flatnonzero(depends[name]))
    ]
    for _ in range(ROUNDS):
        going = [c for c in climbs if c.step > LAST_STEP and c.axes.size]
        if not going:
            break
        nodes = [c.nodes(lower, upper) for c in going]
        answers = read([x for each in nodes for x in each])
        at = 0
        for climb, each in zip(going, nodes, strict=True):
            climb.update(each, answers[climb.name][at : at + len(each)])
            at += len(each)
    ends = [known[0], *(climb.x for climb in climbs)]
    whole = output_means_beyond(response, parameters, ends, names)
    return {name: _range_of(name, climbs, ends, whole[name], depends[name]) for name in table}


def _from_best(
    name: str, points: Sequence[FloatArray], values: FloatArray, axes: IntArray
) -> list[_Climb]:
    """Searches of an output from where it is least and greatest; none where it has no value."""
    if not np.any(np.isfinite(values)):
        return []
    climbs = []
    for sign in (-1.0, 1.0):
        best = int(np.argmax(np.where(np.isfinite(values), sign * values, -np.inf)))
        climbs.append(_Climb(name, sign, points[best], float(values[best]), axes))
    return climbs


def _range_of(
    name: str,
    climbs: Sequence[_Climb],
    ends: Sequence[FloatArray],
    values: FloatArray,
    depends: BoolArray,
) -> OutputRange:
    """The range of an output whose searches ended there; the first end is that of none."""
    mine = [0, *(1 + k for k, climb in enumerate(climbs) if climb.name == name)]
    mine = [k for k in mine if np.isfinite(values[k])] if len(mine) > 1 else []
    if not mine:
        nothing = np.full(depends.size, np.nan)
        return OutputRange(low=np.nan, high=np.nan, x_low=nothing, x_high=nothing, depends=depends)
    backward = mine[::-1]  # the first known point only where it lies beyond the ends
    low = min(backward, key=lambda k: float(values[k]))
    high = max(backward, key=lambda k: float(values[k]))
    return OutputRange(
        low=float(values[low]),
        high=float(values[high]),
        x_low=ends[low],
        x_high=ends[high],
        depends=depends,
    )


def box_points(lower: FloatArray, upper: FloatArray, seed: int) -> FloatArray:
    """Points of the box, shape (m, n): a grid with its corners, where that is small, and seeded.

    Args:
        lower: bounds of the box, shape (n,).
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
    read: Callable[[Sequence[FloatArray]], dict[str, FloatArray]],
    parameters: Sequence[Parameter],
    bases: Sequence[FloatArray],
    room: tuple[FloatArray, FloatArray],
) -> dict[str, BoolArray]:
    """Which parameters move an output, seen by steps from a few seeded points; (n,) by name.

    Those of single experiments, which stay where they are, count as if they did not.
    """
    lower, upper = room
    own = np.flatnonzero([not p.experiments for p in parameters])
    nodes = []
    for base in bases:
        nodes.append(base)
        for i in own:
            for share in (0.31, 0.87):
                moved = base.copy()
                moved[i] = lower[i] + share * (upper[i] - lower[i])
                nodes.append(moved)
    found = {}
    for name, values in read(nodes).items():
        rows = values.reshape(len(bases), 1 + 2 * own.size)
        found[name] = np.zeros(lower.size, dtype=bool)
        for k, i in enumerate(own):
            for column in (1 + 2 * k, 2 + 2 * k):
                found[name][i] |= np.any(_differ(rows[:, 0], rows[:, column]))
    return found


def _differ(one: FloatArray, other: FloatArray) -> BoolArray:
    """Whether two values differ beyond rounding; one that exists differs from one that does not."""
    both = np.isfinite(one) & np.isfinite(other)
    apart = np.abs(one - other) > 1e-12 * (np.abs(one) + np.abs(other))
    return np.asarray(np.where(both, apart, np.isfinite(one) != np.isfinite(other)))
