"""First derivatives by differences of finite size: where to evaluate, and the quotient.

    df/dx_i = (f(a_i) - f(b_i))/(a_i - b_i)_i

Where one side has no room, two quotients to the other side are extrapolated to none.

A stencil says at which points a function of the search vector is wanted, so that all of them go to
the model in one batch, and makes the derivatives from what comes back, be that residual rows or
derived outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import FloatArray

#: Of the values at two nodes, by their places, the minuend first; and its weight in a derivative.
Quotient = tuple[int, int, float]


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
        columns = []
        # an output may be infinite, as Q without damping is: NaN says that it has no slope there
        with np.errstate(invalid="ignore"):
            for axis, parts in enumerate(self.along):
                quotients = [
                    weight
                    * difference(np.asarray(values[above]), np.asarray(values[below]))
                    / (self.nodes[above][axis] - self.nodes[below][axis])
                    for above, below, weight in parts
                ]
                columns.append(sum(quotients[1:], quotients[0]))
        return np.stack(columns, axis=-1)

    def between(self, axis: int, above: FloatArray, below: FloatArray) -> Stencil:
        """The stencil whose quotient along one axis is taken between two other points.

        Args:
            axis: place in the search vector.
            above: search vector, shape (n,).
            below: another that differs along the axis, shape (n,).
        """
        count, along = len(self.nodes), list(self.along)
        along[axis] = ((count, count + 1, 1.0),)
        return Stencil((*self.nodes, above, below), tuple(along))

    def turned(self, axes: Sequence[int]) -> Stencil:
        """The stencil of `forward` with the steps along some axes taken the other way.

        Args:
            axes: places in the search vector.
        """
        nodes = list(self.nodes)
        for axis in axes:
            nodes[axis + 1] = 2.0 * nodes[0] - nodes[axis + 1]
        return Stencil(tuple(nodes), self.along)


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
    along: list[tuple[Quotient, ...]] = []
    for i, step in enumerate(np.broadcast_to(steps, x.shape)):
        down, up, first = x[i] - lower[i], upper[i] - x[i], len(nodes)
        if min(up, down) >= step or max(up, down) < 2.0 * step:
            shifts, parts = [step, -step], [(first, first + 1, 1.0)]
        else:
            inward = step if up > down else -step
            shifts = [0.0, inward, 2.0 * inward]
            parts = [(first + 1, first, 2.0), (first + 2, first, -1.0)]
        for shift in shifts:
            moved = np.array(x, dtype=float)
            moved[i] = min(max(x[i] + shift, lower[i]), upper[i])
            nodes.append(moved)
        along.append(tuple(parts))
    return Stencil(tuple(nodes), tuple(along))


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
    return Stencil(tuple(nodes), tuple(((i + 1, 0, 1.0),) for i in range(x.size)))
