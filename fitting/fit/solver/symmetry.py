"""Points that are stationary by symmetry alone, where linearised tests see nothing.

Where the response does not change with the sign of a variable about some plane (an angle of two
coupled modes about its symmetric values), its column of dr/dx vanishes on that plane: a maximum of
J passes every linearised test of optimality, and a linearised covariance takes the other variables
for independent of it. Steps of finite size see what derivatives do not.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fitting.fit.solver.evaluator import Evaluator
from fitting.text.arrays import FloatArray

#: Step off a plane of symmetry, as a share of the box (at most in units of x).
STRIDE = 0.1
#: Mean change of a row over such a step below which a column counts as vanished.
FLAT = 1e-6


def _strides(evaluator: Evaluator) -> FloatArray:
    return STRIDE * np.minimum(evaluator.upper - evaluator.lower, 1.0)


def flat_columns(evaluator: Evaluator, x: FloatArray) -> list[int]:
    """Variables that move no row at x to first order, over a step of finite size.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
    """
    change = np.mean(np.abs(evaluator.jacobian(x)), axis=0) * _strides(evaluator)
    return [int(i) for i in np.flatnonzero(change <= FLAT)]


def _neighbours(evaluator: Evaluator, x: FloatArray, i: int) -> list[FloatArray]:
    """One step to either side within the box; a side without room is left out."""
    trials = []
    for step in (_strides(evaluator)[i], -_strides(evaluator)[i]):
        moved = x.copy()
        moved[i] = np.clip(x[i] + step, evaluator.lower[i], evaluator.upper[i])
        if abs(moved[i] - x[i]) > 0.5 * abs(step):
            trials.append(moved)
    return trials


def off_symmetry(
    evaluator: Evaluator, x: FloatArray, value: Callable[[FloatArray], float], least: float
) -> FloatArray | None:
    """The lowest point below `least`, a step beside x along a flat column; None if there is none.

    Args:
        evaluator: of the objective.
        x: shape (n,).
        value: what is minimised.
        least: what a point must be below to be worth going there.
    """
    best = None
    for i in flat_columns(evaluator, x):
        for moved in _neighbours(evaluator, x, i):
            here = value(moved)
            if here < least:
                best, least = moved, here
    return best


def secants(
    evaluator: Evaluator, x: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """dr/dx with finite differences in place of flat columns where these see more, (m, n).

    The second result gives for each such column the point that the difference was taken to.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        matrix: dr/dx there, shape (m, n).
    """
    changed, points = matrix.copy(), {}
    rows = evaluator.point(x).residuals
    for i in flat_columns(evaluator, x):
        for moved in _neighbours(evaluator, x, i):
            column = (evaluator.point(moved).residuals - rows) / (moved[i] - x[i])
            if np.linalg.norm(column) > np.linalg.norm(changed[:, i]):
                changed[:, i], points[i] = column, moved
    return changed, points
