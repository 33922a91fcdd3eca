"""First derivatives by differences of finite size: where to evaluate, and the quotient.

    df/dx_i = (f(a_i) - f(b_i))/(a_i - b_i)_i

Where one side has no room, two quotients to the other side are extrapolated to none.

A stencil says at which points a function of the search vector is wanted, so that all of them go to
the model in one batch, and makes the derivatives from what comes back, be that residual rows or
derived outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class Quotient:
    """Of the values at two nodes, by their places, the minuend first; `weight` in a derivative."""

    above: int
    below: int
    weight: float = 1.0


@dataclass(frozen=True)
class Stencil:
    """Points of difference quotients along every axis.

    `nodes` are search vectors (n,); `along` has for each axis the quotients whose weighted sum is
    the derivative, each of two nodes that differ along it.
    """

    nodes: tuple[FloatArray, ...]
    along: tuple[tuple[Quotient, ...], ...]

    def quotients(
        self,
        values: Sequence[npt.ArrayLike],
        difference: Callable[[FloatArray, FloatArray], FloatArray] = np.subtract,
    ) -> FloatArray:
        """Derivatives, the axis last: (m, n) of rows (m,), (n,) of numbers.

        Args:
            values: of the function at every node, in their order, numbers or arrays of one shape.
            difference: of two values, e.g. of their logarithms.
        """
        # an output may be infinite, as Q without damping is: NaN says that it has no slope there
        with np.errstate(invalid="ignore"):
            columns = [self._quotient(values, axis, difference) for axis in range(len(self.along))]
        return np.stack(columns, axis=-1)

    def _quotient(
        self,
        values: Sequence[npt.ArrayLike],
        axis: int,
        difference: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> FloatArray:
        """The derivative along one axis."""
        of_parts = [
            part.weight
            * difference(np.asarray(values[part.above]), np.asarray(values[part.below]))
            / (self.nodes[part.above][axis] - self.nodes[part.below][axis])
            for part in self.along[axis]
        ]
        return np.asarray(sum(of_parts[1:], of_parts[0]))

    def between(self, axis: int, above: FloatArray, below: FloatArray) -> Stencil:
        """The stencil whose quotient along one axis is taken between two other points.

        Args:
            axis: place in the search vector.
            above: search vector, shape (n,).
            below: another that differs along the axis, shape (n,).
        """
        nodes, along = list(self.nodes), list(self.along)
        nodes += [above, below]
        along[axis] = (Quotient(len(nodes) - 2, len(nodes) - 1),)
        return replace(self, nodes=tuple(nodes), along=tuple(along))

    def turned(self, axes: Sequence[int]) -> Stencil:
        """The stencil of `forward` with the steps along some axes taken the other way.

        Args:
            axes: places in the search vector.
        """
        nodes = list(self.nodes)
        for axis in axes:
            nodes[axis + 1] = 2.0 * nodes[0] - nodes[axis + 1]
        return replace(self, nodes=tuple(nodes))


def central(x: FloatArray, steps: npt.ArrayLike, lower: FloatArray, upper: FloatArray) -> Stencil:
    """Central differences about x; inward where the box has no room for a step to both sides.

    (f(x + h) - f(x - h))/(2 h), two nodes along an axis, above and below in turn. Where a side has
    no room the quotient is taken from x to h and to 2 h on the other side, 2 q(h) - q(2 h), which
    are three nodes. The error is that of the step squared either way.

    Args:
        x: search vector, shape (n,).
        steps: half the distance of the nodes along each axis, in units of x, (n,) or one for all.
        lower: bounds of the box, shape (n,).
        upper: likewise.
    """
    nodes: list[FloatArray] = []
    along = []
    for i, step in enumerate(np.broadcast_to(steps, x.shape)):
        shifts, parts = _shifts(float(step), float(lower[i] - x[i]), float(upper[i] - x[i]))
        first = len(nodes)
        for shift in shifts:
            moved = np.array(x, dtype=float)
            moved[i] = min(max(x[i] + shift, lower[i]), upper[i])
            nodes.append(moved)
        along.append(tuple(Quotient(first + a, first + b, weight) for a, b, weight in parts))
    return Stencil(tuple(nodes), tuple(along))


def _shifts(
    step: float, down: float, up: float
) -> tuple[tuple[float, ...], tuple[tuple[int, int, float], ...]]:
    """Where nodes stand along one axis, and their quotients: places of both nodes, weight.

    `down` and `up` is the room in the box, at most zero and at least zero.
    """
    if min(up, -down) >= step or max(up, -down) < 2.0 * step:
        return (step, -step), ((0, 1, 1.0),)
    inward = step if up > -down else -step
    return (0.0, inward, 2.0 * inward), ((1, 0, 2.0), (2, 0, -1.0))


def forward(x: FloatArray, steps: npt.ArrayLike, upper: FloatArray) -> Stencil:
    """Forward differences, inward where the box ends: n + 1 nodes, x itself the first.

    The error is that of the step: enough to descend by, and half the evaluations.

    Args:
        x: search vector, shape (n,).
        steps: distance of the nodes along each axis, in units of x, (n,) or one for all.
        upper: bounds of the box, shape (n,), infinite where there is none.
    """
    nodes = [x]
    for i, step in enumerate(np.broadcast_to(steps, x.shape)):
        moved = np.array(x, dtype=float)
        moved[i] += step if x[i] + step <= upper[i] else -step
        nodes.append(moved)
    return Stencil(tuple(nodes), tuple((Quotient(i + 1, 0),) for i in range(x.size)))
