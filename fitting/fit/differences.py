"""First derivatives by differences of finite size: where to evaluate, and the quotient.

    df/dx_i = (f(a_i) - f(b_i))/(a_i - b_i)_i

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
class Stencil:
    """Points of difference quotients along every axis.

    `nodes` are search vectors (n,); `pairs` has for each axis the places in `nodes` of the two
    points that differ along it, the minuend first.
    """

    nodes: tuple[FloatArray, ...]
    pairs: tuple[tuple[int, int], ...]

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
        for i, (above, below) in enumerate(self.pairs):
            span = self.nodes[above][i] - self.nodes[below][i]
            one, other = np.asarray(values[above]), np.asarray(values[below])
            columns.append(difference(one, other) / span)
        return np.stack(columns, axis=-1)

    def between(self, axis: int, above: FloatArray, below: FloatArray) -> Stencil:
        """The stencil whose quotient along one axis is taken between two other points.

        Args:
            axis: place in the search vector.
            above: search vector, shape (n,).
            below: another that differs along the axis, shape (n,).
        """
        nodes, pairs = list(self.nodes), list(self.pairs)
        nodes += [above, below]
        pairs[axis] = (len(nodes) - 2, len(nodes) - 1)
        return replace(self, nodes=tuple(nodes), pairs=tuple(pairs))

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
    """Central differences about x, cut at the box: 2n nodes, above and below in turn.

    The error is that of the step squared; next to a bound, where one side is cut, of the step.

    Args:
        x: search vector, shape (n,).
        steps: half the distance of the nodes along each axis, in units of x, (n,) or one for all.
        lower: bounds of the box, shape (n,).
        upper: likewise.
    """
    nodes = []
    for i, step in enumerate(np.broadcast_to(steps, x.shape)):
        for sign in (1.0, -1.0):
            moved = np.array(x, dtype=float)
            moved[i] = min(max(x[i] + sign * step, lower[i]), upper[i])
            nodes.append(moved)
    return Stencil(tuple(nodes), tuple((2 * i, 2 * i + 1) for i in range(x.size)))


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
    return Stencil(tuple(nodes), tuple((i + 1, 0) for i in range(x.size)))
