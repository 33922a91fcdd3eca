"""The finish of a sum of squares: damped Gauss-Newton steps in the box.

The interior point stays a barrier's width from what it looks for; near the minimum a few steps of
the linearised rows, damped where they do not pay, get there to the last digits.
"""

from __future__ import annotations

import numpy as np

from fitting.fit.evaluator import Evaluator, total
from fitting.fit.linear_program import Finish, promised_decrease
from fitting.fit.objective import Nu
from fitting.text.arrays import FloatArray

#: Longest step in one variable, in units of the search vector.
LONGEST = 0.5
#: First and largest damping, relative to the curvature of each variable.
GENTLE, STIFFEST = 1e-9, 1e6


def finish_squares(
    evaluator: Evaluator, start: FloatArray, nu: Nu, tolerance: float, *, steps: int = 30
) -> Finish:
    """Lower the misfit "squares" + J_reg until no step promises more than the tolerance.

    Source: J. More, "The Levenberg-Marquardt algorithm: implementation and theory" (1978); bounds
    by projection, a variable that pushes against its bound is left out of the step.
    """
    x, damping = np.array(start, dtype=float), GENTLE
    promise = promised_decrease(evaluator, x, nu, "squares")
    for taken in range(steps):
        if promise <= tolerance:
            return Finish(x, promise, taken, "no linearised step promises a decrease")
        moved, damping = _one_step(evaluator, x, nu, damping)
        if moved is None:
            return Finish(x, promise, taken, "the steps became too short to lower J")
        x = moved
        promise = promised_decrease(evaluator, x, nu, "squares")
    return Finish(x, promise, steps, f"{steps} linearised steps were not enough")


def _one_step(
    evaluator: Evaluator, x: FloatArray, nu: Nu, damping: float
) -> tuple[FloatArray | None, float]:
    point, matrix = evaluator.point(x), evaluator.jacobian(x)
    here = total(point, nu, "squares")
    slope = np.asarray(nu * x) + 2.0 * matrix.T @ (point.row_weights * point.residuals)
    hessian = 2.0 * matrix.T @ (point.row_weights[:, np.newaxis] * matrix)
    hessian += np.diag(np.broadcast_to(nu, x.shape))
    held = ((x <= evaluator.lower) & (slope > 0.0)) | ((x >= evaluator.upper) & (slope < 0.0))
    free = np.flatnonzero(~held)
    curvature = np.diag(np.maximum(np.diag(hessian)[free], np.finfo(float).tiny))
    while damping <= STIFFEST and free.size:
        step = np.linalg.lstsq(
            hessian[np.ix_(free, free)] + damping * curvature, -slope[free], rcond=None
        )[0]
        if float(np.max(np.abs(step))) > LONGEST:  # the rows are straight for so long only
            damping *= 10.0
            continue
        trial = x.copy()
        trial[free] = np.clip(x[free] + step, evaluator.lower[free], evaluator.upper[free])
        if total(evaluator.point(trial), nu, "squares") < here:
            return trial, max(0.1 * damping, GENTLE)
        damping *= 10.0
    return None, damping
