"""The last digits of sum |r| where its minimum is no corner: along the kink, with curvature.

Linearised steps come to a corner, where as many rows vanish as there are variables, in a few steps.
Where fewer do, J is smooth on the surface on which they vanish, and its minimum there is that of a
curve: steps without curvature leap from side to side of a narrow valley and creep along it. There

    min_y  J(x(y), y)      r_A(x(y), y) = 0,   lower <= y <= upper

is smooth: the vanishing rows A are solved for as many variables x, the others y are those of a
quasi-Newton method, which learns the curvature of the valley from the gradients along it.

Source: R. Fletcher and E. Sainz de la Maza, "Nonlinear programming and nonsmooth optimization by
successive linear programming", Math. Programming 43 (1989) 235; J. Abadie and J. Carpentier's
generalized reduced gradient (1969). The quasi-Newton method is Kraft's SLSQP, as in scipy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import qr
from scipy.optimize import minimize

from fitting.fit.objective import Nu
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.gauss_newton import Finish
from fitting.fit.solver.linear_program import Pace, follow
from fitting.text.arrays import FloatArray, IntArray

#: Curved steps in all, and turns of them, each followed by straight ones: how many of these, how
#: far one may go, how many may creep. Along a valley that the data leave open J falls by less than
#: a step may be off elsewhere, over hundreds of units of x: steps are as long as they go.
CURVED, TURNS = 100, 3
STRAIGHT = Pace(steps=20, farthest=1000.0, creeping=3)
#: Rows below this share of the mean |r| vanish; columns and rows below it in each other's span.
VANISHING, DEPENDENT = 1e-6, 1e-9
#: Share of J that is one in the quasi-Newton method, and the change that ends it.
UNIT, LEAST_CHANGE = 1e-6, 1e-7
#: Newton steps to a surface where rows vanish, and their misfit there, in that unit.
RETURNS, RETURNED = 6, 1e-4


def follow_valley(evaluator: Evaluator, start: FloatArray, nu: Nu, tolerance: float) -> Finish:
    """Lower sum |r| + J_reg by curved steps, from where straight ones crept.

    Never higher than the start.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        tolerance: promised decrease of J that is no longer worth a step.

    Raises:
        FmuFailure: the model failed at a point inside the box.
    """
    x, here, curved = start, total(evaluator.point(start), nu, "slack"), 0
    end = Finish(x=start, optimality=float("inf"), steps=0, message="nothing was tried")
    for _ in range(TURNS):
        x, taken = along_kinks(evaluator, end.x, nu, CURVED - curved)
        curved += taken
        end = follow(evaluator, x, nu, tolerance, STRAIGHT)
        before, here = here, total(evaluator.point(end.x), nu, "slack")
        if end.optimality <= tolerance or not here < before or curved >= CURVED:
            break
    return replace(end, steps=curved, message=f"{curved} steps along a kink: {end.message}")


def along_kinks(
    evaluator: Evaluator, start: FloatArray, nu: Nu, steps: int
) -> tuple[FloatArray, int]:
    """The lowest point of sum |r| + J_reg along the surface on which rows vanish; steps taken.

    Never higher than the start, which it is where that is a corner.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        steps: at most.
    """
    surface = _Surface(evaluator, start, nu)
    if not surface.free.size:
        return start, 0
    room = zip(evaluator.lower[surface.free], evaluator.upper[surface.free], strict=True)
    answer = minimize(
        surface.value,
        start[surface.free],
        jac=surface.slope,
        bounds=list(room),
        method="SLSQP",
        options={"maxiter": steps, "ftol": LEAST_CHANGE},
    )
    return surface.lowest, int(answer.nit)


class _Surface:
    """Where the rows vanish that vanish at the start, as a function of the free variables.

    `lowest` is the lowest point that was seen, on its way to the surface or there.
    """

    def __init__(self, evaluator: Evaluator, start: FloatArray, nu: Nu) -> None:
        self.evaluator, self.nu = evaluator, nu
        self.lowest, self._least = start, total(evaluator.point(start), nu, "slack")
        self._unit = UNIT * self._least
        self._rows, self._solved = _vanishing(evaluator, start)
        self.free = np.setdiff1d(np.arange(start.size), self._solved)
        self._places: dict[bytes, FloatArray] = {}
        self._expand(start)

    def value(self, y: FloatArray) -> float:
        """J over its unit, where the rows vanish."""
        return total(self.evaluator.point(self._at(y)), self.nu, "slack") / self._unit

    def slope(self, y: FloatArray) -> FloatArray:
        """Its gradient, by multipliers of the rows that vanish."""
        x = self._at(y)
        matrix = self._expand(x)
        signs = np.sign(self.evaluator.point(x).residuals)
        signs[self._rows] = 0.0
        whole = matrix.T @ signs + self.nu * x
        reduced = whole[self.free] + whole[self._solved] @ self._tangent
        return np.asarray(reduced / self._unit)

    def _expand(self, x: FloatArray) -> FloatArray:
        """Linearise the rows at a point from which further ones are begun; the matrix (m, n)."""
        matrix = self.evaluator.jacobian(x)
        mine = matrix[self._rows]
        self._from, self._back = x, np.linalg.pinv(mine[:, self._solved])
        self._tangent = -self._back @ mine[:, self.free]
        return matrix

    def _at(self, y: FloatArray) -> FloatArray:
        """The point of the surface, (n,), or next to it where the box or a fold is in the way."""
        key = y.tobytes()
        if key not in self._places:
            self._places[key] = self._returned(y)
        return self._places[key]

    def _returned(self, y: FloatArray) -> FloatArray:
        lower, upper = self.evaluator.lower, self.evaluator.upper
        x = self._from.copy()
        x[self.free] = y
        x[self._solved] += self._tangent @ (y - self._from[self.free])
        for _ in range(RETURNS):
            x = np.clip(x, lower, upper)
            point = self.evaluator.point(x)
            here = total(point, self.nu, "slack")
            if here < self._least:
                self.lowest, self._least = x, here
            left = point.residuals[self._rows]
            if not float(np.sum(np.abs(left))) > RETURNED * self._unit:
                break
            x = x.copy()
            x[self._solved] -= self._back @ left
        return point.x


def _vanishing(evaluator: Evaluator, x: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows that vanish at x, none in the others' span, and as many variables to solve them for.

    Variables in the middle of the box come before those at its bounds.
    """
    rows, matrix = np.abs(evaluator.point(x).residuals), evaluator.jacobian(x)
    mine = np.flatnonzero(rows <= VANISHING * np.mean(rows))
    inside = (x > evaluator.lower) & (x < evaluator.upper)
    seen = matrix[mine] * np.where(inside, 1.0, DEPENDENT**0.5)
    if not mine.size:
        return mine, mine
    _, triangle, order = qr(seen.T, mode="economic", pivoting=True)
    heights = np.abs(np.diag(triangle))
    kept = order[: np.count_nonzero(heights > DEPENDENT * heights[0])]
    if not kept.size:
        return kept, kept
    columns = qr(seen[kept], mode="r", pivoting=True)[1]
    return mine[kept], np.sort(columns[: kept.size])
