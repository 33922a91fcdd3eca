"""The last digits of J where its valley is narrow and bent: along the floor, with curvature.

Linearised steps come to a corner of sum |r|, or down a straight valley of the squares, in a few
steps. Where a valley is bent they leap from side to side of it and creep. Its floor is smooth:

    min_y  J(x(y), y)      r_A(x(y), y) = 0           rows A that vanish, of sum |r|
                           x(y) = argmin_x J(x, y)    of the squares
    lower <= y <= upper

As many variables x as hold the floor are solved for, the others y are those of a quasi-Newton
method, which learns the curvature of the floor from the gradients along it.

Source: R. Fletcher and E. Sainz de la Maza, "Nonlinear programming and nonsmooth optimization by
successive linear programming", Math. Programming 43 (1989) 235; J. Abadie and J. Carpentier's
generalized reduced gradient (1969). The quasi-Newton method is Kraft's SLSQP, as in scipy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import numpy as np
from scipy.linalg import qr
from scipy.optimize import minimize

from fitting.fit.objective import Nu
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.gauss_newton import (
    Finish,
    finish_squares,
    squares_model,
    squares_rows,
)
from fitting.fit.solver.linear_program import Pace, follow
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.notation import how_many

#: Curved steps in all, and turns of them, each followed by straight ones: how many of these, how
#: far one may go, how many may creep. Along a valley that the data leave open J falls by less than
#: a step may be off elsewhere, over hundreds of units of x: steps are as long as they go.
CURVED, TURNS = 100, 3
STRAIGHT = Pace(steps=20, farthest=1000.0, creeping=3)
STRAIGHT_SQUARES = 3
#: Rows below this share of the mean |r| vanish; columns and rows below it in each other's span.
VANISHING, DEPENDENT = 1e-6, 1e-9
#: Singular values of the squares, over the largest, below which the floor is level.
LEVEL = 1e-2
#: Length of the first step, in units of x.
FIRST_STEP = 0.1
#: Share of J that is one in the quasi-Newton method, and the change that ends it.
UNIT, LEAST_CHANGE = 1e-6, 1e-7
#: Newton steps to the floor, and the misfit that is left there, in that unit.
RETURNS, RETURNED = 6, 1e-4


def follow_valley(
    evaluator: Evaluator, start: FloatArray, nu: Nu, tolerance: float, misfit: str
) -> Finish:
    """Lower misfit + J_reg by curved steps, from where straight ones crept.

    Never higher than the start.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        tolerance: promised decrease of J that is no longer worth a step.
        misfit: "slack" or "squares".

    Raises:
        FmuFailure: the model failed at a point inside the box.
    """
    x, here, curved = start, total(evaluator.point(start), nu, misfit), 0
    end = Finish(x=start, optimality=float("inf"), steps=0, message="nothing was tried")
    for _ in range(TURNS):
        x, taken = along_floor(evaluator, end.x, nu, CURVED - curved, misfit)
        curved += taken
        if misfit == "squares":
            end = finish_squares(evaluator, x, nu, tolerance, steps=STRAIGHT_SQUARES)
        else:
            end = follow(evaluator, x, nu, tolerance, STRAIGHT)
        before, here = here, total(evaluator.point(end.x), nu, misfit)
        if end.optimality <= tolerance or not here < before or curved >= CURVED:
            break
    return replace(
        end, steps=curved, message=f"{how_many(curved, 'step')} along a valley: {end.message}"
    )


def finish_squares_in_valley(
    evaluator: Evaluator, start: FloatArray, nu: Nu, tolerance: float, *, steps: int = 30
) -> Finish:
    """Lower the misfit "squares" + J_reg by linearised steps, and by curved ones where these creep.

    Args:
        evaluator: of the objective.
        start: search vector, shape (n,), in the box.
        nu: weight of the Tikhonov term, one or (n,).
        tolerance: promised decrease that is no longer worth a step, in units of the misfit.
        steps: linearised ones, at most.

    Raises:
        FmuFailure: the model failed at a point inside the box.
    """
    end = finish_squares(evaluator, start, nu, tolerance, steps=steps)
    if end.optimality <= tolerance:
        return end
    further = follow_valley(evaluator, end.x, nu, tolerance, "squares")
    return replace(further, steps=end.steps + further.steps)


def along_floor(
    evaluator: Evaluator, start: FloatArray, nu: Nu, steps: int, misfit: str = "slack"
) -> tuple[FloatArray, int]:
    """The lowest point of misfit + J_reg along the floor of its valley; steps taken.

    Never higher than the start, which it is where that is a corner.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        steps: at most.
        misfit: "slack" or "squares".
    """
    floor = (_OfSquares if misfit == "squares" else _OfKinks)(evaluator, start, nu)
    if not floor.free.size:
        return start, 0
    # the method knows no curvature at first: its first step is the gradient, in its unit of length
    begun = start[floor.free]
    steepest = float(np.max(np.abs(floor.slope(begun)), initial=0.0))
    unit = np.sqrt(FIRST_STEP / steepest) if steepest > 0.0 else 1.0
    lower, upper = evaluator.lower[floor.free], evaluator.upper[floor.free]
    answer = minimize(
        lambda z: floor.value(begun + unit * z),
        np.zeros(begun.size),
        jac=lambda z: unit * floor.slope(begun + unit * z),
        bounds=list(zip((lower - begun) / unit, (upper - begun) / unit, strict=True)),
        method="SLSQP",
        options={"maxiter": steps, "ftol": LEAST_CHANGE},
    )
    return floor.lowest, int(answer.nit)


class _Floor(ABC):
    """The floor of the valley in which a point lies, as a function of the free variables.

    `lowest` is the lowest point that was seen, on its way to the floor or there.
    """

    misfit: str

    def __init__(self, evaluator: Evaluator, start: FloatArray, nu: Nu) -> None:
        self.evaluator, self.nu = evaluator, nu
        self.lowest, self._least = start, self._j(start)
        self._unit = UNIT * self._least
        self._solved = self._held(start)
        self.free = np.setdiff1d(np.arange(start.size), self._solved)
        self._places: dict[bytes, FloatArray] = {}
        self._expand(start)

    def value(self, y: FloatArray) -> float:
        """J over its unit, on the floor."""
        return self._j(self._at(y)) / self._unit

    def slope(self, y: FloatArray) -> FloatArray:
        """Its gradient along the floor, at which later returns begin."""
        x = self._at(y)
        self._expand(x)
        whole = self._gradient(x)
        reduced = whole[self.free] + whole[self._solved] @ self._tangent
        return np.asarray(reduced / self._unit)

    @abstractmethod
    def _held(self, start: FloatArray) -> IntArray:
        """Variables that are solved for."""

    @abstractmethod
    def _rows(self, x: FloatArray) -> FloatArray:
        """What a return lowers, (k,)."""

    @abstractmethod
    def _matrix(self, x: FloatArray) -> FloatArray:
        """Its derivatives, (k, n)."""

    @abstractmethod
    def _gradient(self, x: FloatArray) -> FloatArray:
        """Of J, (n,), without what rows that vanish pull."""

    @abstractmethod
    def _is_back(self, rows: FloatArray, step: FloatArray) -> bool:
        """Whether a return may end before a step."""

    def _j(self, x: FloatArray) -> float:
        return total(self.evaluator.point(x), self.nu, self.misfit)

    def _expand(self, x: FloatArray) -> None:
        matrix = self._matrix(x)
        self._from, self._stiff = x, matrix[:, self._solved]
        self._back = np.linalg.pinv(self._stiff)
        self._tangent = -self._back @ matrix[:, self.free]

    def _at(self, y: FloatArray) -> FloatArray:
        """The point of the floor, (n,), or next to it where the box or a fold is in the way."""
        key = y.tobytes()
        if key not in self._places:
            self._places[key] = self._returned(y)
        return self._places[key]

    def _returned(self, y: FloatArray) -> FloatArray:
        x = self._from.copy()
        x[self.free] = y
        x[self._solved] += self._tangent @ (y - self._from[self.free])
        for _ in range(RETURNS):
            x = np.clip(x, self.evaluator.lower, self.evaluator.upper)
            here = self._j(x)
            if here < self._least:
                self.lowest, self._least = x, here
            back, rows = x, self._rows(x)
            step = -self._back @ rows
            if self._is_back(rows, step):
                break
            x = x.copy()
            x[self._solved] += step
        return back


class _OfKinks(_Floor):
    """Of sum |r|: where the rows vanish that vanish at the start."""

    misfit = "slack"

    def _held(self, start: FloatArray) -> IntArray:
        self._vanishing, solved = _vanishing(self.evaluator, start)
        return solved

    def _rows(self, x: FloatArray) -> FloatArray:
        return self.evaluator.point(x).residuals[self._vanishing]

    def _matrix(self, x: FloatArray) -> FloatArray:
        return self.evaluator.jacobian(x)[self._vanishing]

    def _gradient(self, x: FloatArray) -> FloatArray:
        signs = np.sign(self.evaluator.point(x).residuals)
        signs[self._vanishing] = 0.0
        return np.asarray(self.evaluator.jacobian(x).T @ signs + self.nu * x)

    def _is_back(self, rows: FloatArray, step: FloatArray) -> bool:
        # NaN ends it, too
        return not float(np.sum(np.abs(rows))) > RETURNED * self._unit


class _OfSquares(_Floor):
    """Of the squares: the least of the variables that the rows hold, the others given."""

    misfit = "squares"

    def _held(self, start: FloatArray) -> IntArray:
        matrix = self._matrix(start)
        stiff = np.linalg.svd(matrix, compute_uv=False)
        count = np.count_nonzero(stiff > LEVEL * stiff[0])
        return np.sort(qr(matrix, mode="r", pivoting=True)[1][:count])

    def _rows(self, x: FloatArray) -> FloatArray:
        return squares_rows(self.evaluator, x, self.nu)

    def _matrix(self, x: FloatArray) -> FloatArray:
        return squares_model(self.evaluator, x, self.nu).matrix

    def _gradient(self, x: FloatArray) -> FloatArray:
        return squares_model(self.evaluator, x, self.nu).slope

    def _is_back(self, rows: FloatArray, step: FloatArray) -> bool:
        along = self._stiff @ step
        return not 0.5 * float(along @ along) > RETURNED * self._unit


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
