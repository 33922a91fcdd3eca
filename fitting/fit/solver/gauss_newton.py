"""The finish of a sum of squares: damped Gauss-Newton steps in the box.

The interior point stays a barrier's width from what it looks for; near the minimum a few steps of
the linearised rows, damped where they do not pay, get there to the last digits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.fit.objective import Nu
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.signal.least_squares import damped_step
from fitting.text.arrays import BoolArray, FloatArray

#: Longest step in one variable, in units of the search vector.
LONGEST = 0.5
#: First and largest damping, relative to the curvature of each variable.
GENTLE, STIFFEST = 1e-9, 1e6
#: Corrections of a step for the bend of the rows, tried before it is damped; the share of its
#: promise from which a step needs none.
CORRECTIONS, PAYS = 3, 0.5
#: Share of its promise below which a step creeps, and how many in a row may.
CREEP, CREEPING = 0.01, 3


@dataclass(frozen=True, kw_only=True)
class Finish:
    """End of a sequence of linearised steps: x, what a further step promises, steps taken."""

    x: FloatArray
    optimality: float
    steps: int
    message: str


@dataclass(frozen=True)
class SquaresModel:
    """Misfit "squares" + J_reg as half a sum of squares about x, to first order.

    `rows` (m + n,) of data and Tikhonov term, `matrix` (m + n, n); `free` (n,) marks variables that
    no bound holds where they are.
    """

    rows: FloatArray
    matrix: FloatArray
    free: BoolArray

    @property
    def slope(self) -> FloatArray:
        """Gradient, (n,)."""
        return self.matrix.T @ self.rows

    @property
    def curvature(self) -> FloatArray:
        """Gauss and Newton's second derivatives, (n, n)."""
        return self.matrix.T @ self.matrix


def squares_model(evaluator: Evaluator, x: FloatArray, nu: Nu) -> SquaresModel:
    """The linearised rows at a point. One Jacobian.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
    """
    root = np.sqrt(2.0 * evaluator.point(x).row_weights)
    tikhonov = np.sqrt(np.broadcast_to(nu, x.shape))
    rows = squares_rows(evaluator, x, nu)
    matrix = np.concatenate([root[:, np.newaxis] * evaluator.jacobian(x), np.diag(tikhonov)])
    slope = matrix.T @ rows
    pushes = ((x <= evaluator.lower) & (slope > 0.0)) | ((x >= evaluator.upper) & (slope < 0.0))
    return SquaresModel(rows, matrix, ~pushes)


def squares_rows(evaluator: Evaluator, x: FloatArray, nu: Nu) -> FloatArray:
    """Rows (m + n,) of which half the sum of squares is the misfit "squares" + J_reg.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
    """
    point, tikhonov = evaluator.point(x), np.sqrt(np.broadcast_to(nu, x.shape))
    return np.concatenate([np.sqrt(2.0 * point.row_weights) * point.residuals, tikhonov * x])


def newton_decrement(evaluator: Evaluator, x: FloatArray, nu: Nu) -> float:
    """The decrease of the misfit "squares" + J_reg that its linearised rows promise.

    g.H^-1 g/2 over the variables that no bound holds, g gradient and H curvature of the quadratic
    that the rows make. One Jacobian.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
    """
    here = squares_model(evaluator, x, nu)
    g, seen = here.slope[here.free], here.matrix[:, here.free]
    return 0.5 * float(g @ np.linalg.lstsq(seen.T @ seen, g, rcond=None)[0])


def finish_squares(
    evaluator: Evaluator, start: FloatArray, nu: Nu, tolerance: float, *, steps: int = 30
) -> Finish:
    """Lower the misfit "squares" + J_reg until no step promises more than the tolerance.

    It ends before where CREEPING steps in a row lowered it by a hundredth of what they promised:
    the valley is bent there, and linearised steps see a small part of it.

    Args:
        evaluator: of the objective.
        start: search vector, shape (n,), in the box.
        nu: weight of the Tikhonov term, one or (n,).
        tolerance: promised decrease that is no longer worth a step, in units of the misfit.
        steps: at most.

    Source: J. More, "The Levenberg-Marquardt algorithm: implementation and theory" (1978); bounds
    by projection, a variable that pushes against its bound is left out of the step.
    """
    x, damping, crept = np.array(start, dtype=float), GENTLE, 0
    promise, here = newton_decrement(evaluator, x, nu), total(evaluator.point(x), nu, "squares")
    for taken in range(steps):
        if promise <= tolerance or crept == CREEPING:
            settled = promise <= tolerance
            said = "no linearised step promises a decrease" if settled else "the steps creep"
            return Finish(x=x, optimality=promise, steps=taken, message=said)
        moved, damping = _one_step(evaluator, x, nu, damping)
        if moved is None:
            return Finish(
                x=x,
                optimality=promise,
                steps=taken,
                message="the steps became too short to lower J",
            )
        before, here = here, total(evaluator.point(moved), nu, "squares")
        crept = crept + 1 if before - here <= CREEP * promise else 0
        x, promise = moved, newton_decrement(evaluator, moved, nu)
    return Finish(
        x=x, optimality=promise, steps=steps, message=f"{steps} linearised steps were not enough"
    )


def _one_step(
    evaluator: Evaluator, x: FloatArray, nu: Nu, damping: float
) -> tuple[FloatArray | None, float]:
    """The next lower x with the damping for the step after it; None where none is found."""
    around = squares_model(evaluator, x, nu)
    free = np.flatnonzero(around.free)
    while damping <= STIFFEST and free.size:
        moved, gain, promise = _best_trial(evaluator, x, nu, around, damping)
        if gain > 0.0:
            pays = gain > PAYS * promise
            return moved, max(0.1 * damping, GENTLE) if pays else damping
        damping *= 10.0
    return None, damping


def _best_trial(
    evaluator: Evaluator, x: FloatArray, nu: Nu, around: SquaresModel, damping: float
) -> tuple[FloatArray, float, float]:
    """The lowest of a damped step and its corrections; what it gains, and what it promised.

    A step along a bent valley raises the stiff rows by its square; solving again with
    c = r(x + d) - J d in place of r takes that back without a new Jacobian.
    """
    here, free = total(evaluator.point(x), nu, "squares"), np.flatnonzero(around.free)
    seen, rows = around.matrix[:, free], around.rows
    scale = np.sqrt(np.maximum(np.sum(seen**2, axis=0), np.finfo(float).tiny))
    best, gain, promise = x, 0.0, 0.0
    for correction in range(CORRECTIONS + 1):
        step = damped_step(seen / scale, rows, damping) / scale
        if float(np.max(np.abs(step))) > LONGEST:  # the rows are straight for so long only
            break
        trial = x.copy()
        trial[free] = np.clip(x[free] + step, evaluator.lower[free], evaluator.upper[free])
        if not correction:
            left = around.rows + seen @ step
            promise = 0.5 * float(around.rows @ around.rows - left @ left)
        here_gain = here - total(evaluator.point(trial), nu, "squares")
        if here_gain > gain:
            best, gain = trial, here_gain
        if gain > PAYS * promise:
            break
        rows = squares_rows(evaluator, trial, nu) - seen @ (trial - x)[free]
    return best, gain, promise
