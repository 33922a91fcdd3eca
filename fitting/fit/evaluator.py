"""What a solver sees of an objective: values and Jacobians, remembered and counted.

The objective itself stays a record; this is the one place that keeps the last points, so that a
solver that asks twice for the same x does not simulate twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from fitting.campaign.parameters import search_bounds
from fitting.fit.differences import forward
from fitting.fit.objective import Nu, Objective, Point, evaluate_many, j_reg, jacobian_of, stencil
from fitting.text.arrays import FloatArray

Kept = TypeVar("Kept")

#: Points and Jacobians kept; a solver goes back by one or two iterates at most.
REMEMBERED = 8


@dataclass(frozen=True)
class Counts:
    """Objective evaluations in all (inside Jacobians too), Jacobians, simulation runs."""

    evaluations: int = 0
    jacobians: int = 0
    runs: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.evaluations + other.evaluations,
            self.jacobians + other.jacobians,
            self.runs + other.runs,
        )


class Evaluator:
    """Memory and counter in front of one objective; x outside the box is a programming error."""

    def __init__(self, objective: Objective) -> None:
        self.objective = objective
        self.lower, self.upper = search_bounds(objective.parameters)
        self.counts = Counts()
        self._points: dict[bytes, Point] = {}
        self._jacobians: dict[bytes, FloatArray] = {}
        self._slopes: dict[bytes, FloatArray] = {}

    def point(self, x: FloatArray) -> Point:
        """The point at x, simulated at most once while it is remembered.

        Args:
            x: search vector (n,).
        """
        return self._remembered(self._points, x, lambda: self.points([x])[0])

    def points(self, xs: Sequence[FloatArray], *, whole: bool = False) -> list[Point]:
        """Points at several search vectors, in one batch.

        Args:
            xs: search vectors, (n,) each.
            whole: with predictions of everything that was measured.
        """
        points = evaluate_many(self.objective, xs, whole=whole) if xs else []
        self.counts += Counts(evaluations=len(xs), runs=sum(point.runs for point in points))
        if whole:
            self._points.update((point.x.tobytes(), point) for point in points)
        return points

    def jacobian(self, x: FloatArray) -> FloatArray:
        """dr/dx at x by central differences, shape (n_rows, n), one batch.

        Args:
            x: search vector (n,).
        """

        def quotients() -> FloatArray:
            around = stencil(self.objective, x)
            self.counts += Counts(jacobians=1)
            return jacobian_of(around, self.points(around.nodes))

        return self._remembered(self._jacobians, x, quotients)

    def slopes(self, x: FloatArray) -> FloatArray:
        """dr/dx at x by forward differences, shape (n_rows, n): half the evaluations, to solve by.

        Args:
            x: search vector (n,).
        """

        def quotients() -> FloatArray:
            here, around = self.point(x), forward(x, self.objective.steps, self.upper)
            self.counts += Counts(jacobians=1)
            return jacobian_of(around, [here, *self.points(around.nodes[1:])])

        return self._remembered(self._slopes, x, quotients)

    @staticmethod
    def _remembered(memory: dict[bytes, Kept], x: FloatArray, evaluate: Callable[[], Kept]) -> Kept:
        """What the memory holds for x, else evaluated; of more than a few the oldest goes."""
        key = x.tobytes()
        if key not in memory:
            value = evaluate()
            if len(memory) >= REMEMBERED:
                memory.pop(next(iter(memory)))
            memory[key] = value
        return memory[key]


def total(point: Point, nu: Nu, misfit: str) -> float:
    """What is minimised at one point: misfit + J_reg.

    Args:
        point: residual rows at a search vector.
        nu: weight of the Tikhonov term, one number or (n,).
        misfit: "slack" or "absolute" (sum of absolute values), or "squares".
    """
    misfit_here = point.squares if misfit == "squares" else point.j_fit
    return misfit_here + j_reg(point.x, nu)
