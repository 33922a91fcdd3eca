"""The linearised problem of the sum of absolute values: optimality test, and a finish by its steps.

    min_d  sum |r + J d| + nu x.d      |d_i| <= radius,  x + d in the box

is a linear program. The decrease it promises is a measure of optimality that holds for the kinked
misfit: zero exactly at stationary points. Following its steps is a solver of its own (Fletcher's
trust region for composite functions, with second-order correction): it finishes what the interior
point leaves, and stands in as referee for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import block_array, csr_array, eye_array

from fitting.fit.objective import Nu
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.gauss_newton import Finish, newton_decrement
from fitting.text.arrays import FloatArray

#: Radius, in units of the search vector, within which a decrease counts against optimality.
TEST_RADIUS = 1.0
#: Second-order corrections tried before the radius is cut.
CORRECTIONS = 3
SMALLEST_RADIUS = 1e-9
#: Share of the promise of a unit below which a step creeps.
CREEP = 0.01
#: From so many rows on the simplex takes longer than an interior point with its crossover.
SIMPLEX_ROWS = 10_000
#: From so many rows on the bands of the slacks are sparse.
MANY_ROWS = 100


def linear_step(
    rows: FloatArray,
    jacobian: FloatArray,
    slope: FloatArray,
    room: tuple[FloatArray, FloatArray],
    radius: float,
) -> FloatArray:
    """Step d that minimises sum |rows + J d| + slope.d within the radius and the room, shape (n,).

    Args:
        rows: r, shape (m,).
        jacobian: dr/dx, shape (m, n).
        slope: gradient of the smooth part, shape (n,).
        room: lower - x and upper - x, shape (n,) each.
        radius: largest change of one variable, in units of x.

    Raises:
        ArithmeticError: the solver gave no answer (a matrix that is not finite, for one).
    """
    size = float(np.max(np.abs(rows)))
    reach = radius * float(np.max(np.abs(jacobian)))
    for share in (1e-6, 1e-3, 1.0):  # a smaller share is sharper, a larger one better conditioned
        step = _scaled_step(rows, jacobian, slope, room, radius, max(size, share * reach, 1e-300))
        if step is not None:
            return step
    raise ArithmeticError("the linear program of a step has no answer")


def _scaled_step(
    rows: FloatArray,
    jacobian: FloatArray,
    slope: FloatArray,
    room: tuple[FloatArray, FloatArray],
    radius: float,
    size: float,
) -> FloatArray | None:
    """`linear_step` with rows over `size` and d over `radius`: its tolerances are absolute.

    Solved is the dual, of which the multipliers of the equations are d:
    max_y,p,q  r.y + l.p - u.q  with  J^T y + slope = p - q,  |y_i| <= 1,  p, q >= 0.
    It has n equations where the primal has 2 m inequalities.
    """
    m, n = jacobian.shape
    lower, upper = np.maximum(-1.0, room[0] / radius), np.minimum(1.0, room[1] / radius)
    signs, rest = np.tile([-1.0, 1.0], (m, 1)), np.tile([0.0, np.inf], (2 * n, 1))
    answer = linprog(
        np.concatenate([-rows / size, -lower, upper]),
        A_eq=_equations(jacobian.T * (radius / size)),
        b_eq=-slope * (radius / size),
        bounds=np.concatenate([signs, rest]),
        method="highs-ds" if m < SIMPLEX_ROWS else "highs-ipm",
        options={
            "presolve": False,  # looks for what a program like this does not have, for minutes
            "primal_feasibility_tolerance": 1e-9,
            "dual_feasibility_tolerance": 1e-9,
        },
    )
    if answer.x is None or not np.all(np.isfinite(answer.eqlin.marginals)):
        return None
    step: FloatArray = np.clip(radius * answer.eqlin.marginals, *room)
    return step


def _equations(matrix: FloatArray) -> Any:
    """[J^T, -I, I] of J^T, shape (n, m + 2 n); sparse where there are many rows."""
    n, m = matrix.shape
    if m < MANY_ROWS:
        return np.hstack([matrix, -np.eye(n), np.eye(n)])
    identity = eye_array(n, format="csr")
    return block_array([[csr_array(matrix), -identity, identity]], format="csr")


def with_slacks(matrix: FloatArray) -> Any:
    """[[J, -I], [-J, -I]] of -s <= J x <= s, shape (2 m, n + m); sparse where there are many rows.

    Dense, a thousand experiments would make it a hundred megabytes of zeros.

    Args:
        matrix: J, shape (m, n).
    """
    m = matrix.shape[0]
    if m < MANY_ROWS:
        return np.block([[matrix, -np.eye(m)], [-matrix, -np.eye(m)]])
    j, identity = csr_array(matrix), eye_array(m, format="csr")
    return block_array([[j, -identity], [-j, -identity]], format="csr")


def promised_decrease(evaluator: Evaluator, x: FloatArray, nu: Nu, misfit: str) -> float:
    """Optimality: the decrease of J that the linearised problem promises within one unit of x.

    For "squares" the linearised rows make a quadratic, and the promise is its Newton decrement
    g.H^-1 g/2 over the variables that are not held by a bound. One Jacobian of r.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        misfit: one of `evaluator.MISFITS`.

    Raises:
        ArithmeticError: see `linear_step`.
    """
    if misfit == "squares":
        return newton_decrement(evaluator, x, nu)
    rows, matrix = evaluator.point(x).residuals, evaluator.jacobian(x)
    room = (np.minimum(evaluator.lower - x, 0.0), np.maximum(evaluator.upper - x, 0.0))
    slope = np.asarray(nu * x)
    step = linear_step(rows, matrix, slope, room, TEST_RADIUS)
    return _promise(rows, matrix, slope, step)


def _promise(rows: FloatArray, matrix: FloatArray, slope: FloatArray, step: FloatArray) -> float:
    after = np.sum(np.abs(rows + matrix @ step)) + np.dot(slope, step)
    return max(float(np.sum(np.abs(rows)) - after), 0.0)


@dataclass(frozen=True, kw_only=True)
class Pace:
    """How long linearised steps are followed.

    `steps` at most; `farthest` the largest change of one variable in a step, in units of x;
    `creeping` steps in a row are enough that lower J by a hundredth of what a unit promises, or by
    no more than the tolerance; None: never.
    """

    steps: int = 40
    farthest: float = TEST_RADIUS
    creeping: int | None = None


def follow(
    evaluator: Evaluator,
    start: FloatArray,
    nu: Nu,
    tolerance: float,
    pace: Pace = Pace(),
) -> Finish:
    """Lower sum |r| + J_reg by linearised steps until no step promises more than the tolerance.

    A step along a curved valley raises the stiff rows by its square; re-solving with
    c = r(x + d) - J d in place of r takes that back without a new Jacobian, which is what lets the
    radius grow where the data leave a direction free.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        tolerance: promised decrease of J that is no longer worth a step.
        pace: how many steps, and how far they go.

    Source: R. Fletcher, "A model algorithm for composite nondifferentiable optimization problems"
    and "Second order corrections for non-differentiable optimization" (1982).
    """
    x, radius = np.array(start, dtype=float), 0.1
    taken, crept, promise = 0, 0, float("inf")
    try:
        while taken <= pace.steps:
            promise = promised_decrease(evaluator, x, nu, "slack")
            if promise <= tolerance:
                return Finish(
                    x=x,
                    optimality=promise,
                    steps=taken,
                    message="no linearised step promises a decrease",
                )
            if taken == pace.steps:
                break
            if crept == pace.creeping:
                return Finish(
                    x=x,
                    optimality=promise,
                    steps=taken,
                    message="the steps lower J by less than they promise",
                )
            moved, radius = _one_step(evaluator, x, nu, radius, pace.farthest)
            if moved is None:
                return Finish(
                    x=x,
                    optimality=promise,
                    steps=taken,
                    message="the steps became too short to lower J",
                )
            gain = _value(evaluator, x, nu) - _value(evaluator, moved, nu)
            x, taken, crept = (
                moved,
                taken + 1,
                0 if gain > max(tolerance, CREEP * promise) else crept + 1,
            )
    except ArithmeticError as error:
        return Finish(x=x, optimality=promise, steps=taken, message=str(error))
    return Finish(
        x=x,
        optimality=promise,
        steps=taken,
        message=f"{pace.steps} linearised steps were not enough",
    )


def _value(evaluator: Evaluator, x: FloatArray, nu: Nu) -> float:
    return total(evaluator.point(x), nu, "slack")


def _one_step(
    evaluator: Evaluator, x: FloatArray, nu: Nu, radius: float, farthest: float
) -> tuple[FloatArray | None, float]:
    """The next accepted x with the radius for the step after it; None where none is found."""
    rows, matrix = evaluator.point(x).residuals, evaluator.jacobian(x)
    room = (np.minimum(evaluator.lower - x, 0.0), np.maximum(evaluator.upper - x, 0.0))
    slope = np.asarray(nu * x)
    here = total(evaluator.point(x), nu, "slack")
    while radius > SMALLEST_RADIUS:
        step = linear_step(rows, matrix, slope, room, radius)
        promise = _promise(rows, matrix, slope, step)
        best, gain = x, 0.0
        for corrections in range(CORRECTIONS + 1):
            trial = np.clip(x + step, evaluator.lower, evaluator.upper)
            point = evaluator.point(trial)
            if here - total(point, nu, "slack") > gain:
                best, gain = trial, here - total(point, nu, "slack")
            if gain > 0.5 * promise or corrections == CORRECTIONS:
                break
            step = linear_step(point.residuals - matrix @ step, matrix, slope, room, radius)
        if gain > 0.1 * promise:
            grow = 1.0 if gain <= 0.5 * promise else (3.0 if corrections <= 1 else 1.5)
            return best, min(farthest, grow * radius)
        radius *= 0.25
    return None, radius
