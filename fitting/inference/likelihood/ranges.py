"""What a derived output could be without any data: its range over the box of the parameters.

Points of the box find where it is small and large, a compass search from the best of them goes on
to the extremes: along every axis that the output depends on, by half the step where none helps.

Source: T. Kolda, R. Lewis and V. Torczon, "Optimization by direct search", SIAM Review 45 (2003).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds
from fitting.fit.outputs import output_means, output_means_beyond
from fitting.measurements.measurement import Response
from fitting.text.arrays import BoolArray, FloatArray

#: Seeded points of the box, and the most points of a grid over it, which holds its corners.
BOX_SAMPLES, BOX_GRID = 64, 256
#: The last step of the search, as a share of the box; rounds at most.
LAST_STEP, ROUNDS = 2e-4, 60


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


@dataclass(kw_only=True)
class _Climb:
    """One search: the output, its sign (up or down), where it stands, its step."""

    name: str
    sign: float
    x: FloatArray
    value: float
    step: float
    axes: list[int] = field(default_factory=list)

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

    def read(xs: Sequence[FloatArray]) -> dict[str, FloatArray]:
        return output_means_beyond(response, parameters, xs, names)

    table = read(points)
    ranges: dict[str, OutputRange] = {}
    climbs: list[_Climb] = []
    depends = _dependence(read, parameters, points[-3:], (lower, upper))
    for name, values in table.items():
        for sign in (-1.0, 1.0):
            ranked = np.where(np.isfinite(values), sign * values, -np.inf)
            best = int(np.argmax(ranked))
            if np.isfinite(ranked[best]):
                axes = [int(i) for i in np.flatnonzero(depends[name] & own)]
                climbs.append(
                    _Climb(
                        name=name,
                        sign=sign,
                        x=points[best],
                        value=float(values[best]),
                        step=0.1,
                        axes=axes,
                    )
                )
    for _ in range(ROUNDS):
        going = [c for c in climbs if c.step > LAST_STEP and c.axes]
        if not going:
            break
        nodes = [c.nodes(lower, upper) for c in going]
        answers = read([x for each in nodes for x in each])
        at = 0
        for climb, each in zip(going, nodes, strict=True):
            climb.update(each, answers[climb.name][at : at + len(each)])
            at += len(each)
    found = {(c.name, c.sign): c for c in climbs}
    nothing = np.full(lower.size, np.nan)
    for name in table:
        low, high = found.get((name, -1.0)), found.get((name, 1.0))
        if low is None or high is None:
            ranges[name] = OutputRange(
                low=np.nan, high=np.nan, x_low=nothing, x_high=nothing, depends=depends[name]
            )
        else:
            ranges[name] = OutputRange(
                low=low.value, high=high.value, x_low=low.x, x_high=high.x, depends=depends[name]
            )
    return ranges


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
    """Which parameters move an output, seen by steps from a few seeded points."""
    lower, upper = room
    n = lower.size
    nodes = []
    for base in bases:
        nodes.append(base)
        for i in range(n):
            for share in (0.31, 0.87):
                moved = base.copy()
                moved[i] = lower[i] + share * (upper[i] - lower[i])
                nodes.append(moved)
    found = {}
    for name, values in read(nodes).items():
        rows = values.reshape(len(bases), 1 + 2 * n)
        moves = np.zeros(n, dtype=bool)
        for i in range(n):
            for column in (1 + 2 * i, 2 + 2 * i):
                moves[i] |= np.any(_differ(rows[:, 0], rows[:, column]))
        found[name] = moves & np.array([not p.experiments for p in parameters])
    return found


def _differ(one: FloatArray, other: FloatArray) -> BoolArray:
    """Whether two values differ beyond rounding; one that exists differs from one that does not."""
    both = np.isfinite(one) & np.isfinite(other)
    apart = np.abs(one - other) > 1e-12 * (np.abs(one) + np.abs(other))
    return np.asarray(np.where(both, apart, np.isfinite(one) != np.isfinite(other)))
