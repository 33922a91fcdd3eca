"""Secants in place of slopes that vanish by symmetry.

Where the response does not change with the sign of a variable about some plane (an angle of two
coupled modes about its symmetric values), its column of dr/dx vanishes on that plane: a linearised
covariance takes the other variables for independent of it. Steps of finite size see what
derivatives do not.
"""

from __future__ import annotations

import numpy as np

from fitting.fit.solver.evaluator import Evaluator
from fitting.text.arrays import FloatArray

#: Step off a plane of symmetry, as a share of the box (at most in units of x).
STRIDE = 0.1
#: Mean change of a row over such a step below which a column counts as vanished.
FLAT = 1e-6


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
    strides = STRIDE * np.minimum(evaluator.upper - evaluator.lower, 1.0)
    flat = np.flatnonzero(np.mean(np.abs(matrix), axis=0) * strides <= FLAT)
    changed, points = matrix.copy(), {}
    rows = evaluator.point(x).residuals
    for i in map(int, flat):
        for step in (strides[i], -strides[i]):
            moved = x.copy()
            moved[i] = np.clip(x[i] + step, evaluator.lower[i], evaluator.upper[i])
            if abs(moved[i] - x[i]) <= 0.5 * abs(step):
                continue  # no room on that side
            column = (evaluator.point(moved).residuals - rows) / (moved[i] - x[i])
            if np.linalg.norm(column) > np.linalg.norm(changed[:, i]):
                changed[:, i], points[i] = column, moved
    return changed, points
