"""One level of Algorithm 2 by scipy's interior point: min misfit(r(x)) + nu/2 |x|^2 in the box.

A sum of absolute values is no smooth function. With slacks it is a smooth problem,

    min_{x, s}  sum s + nu/2 |x|^2        -s <= r(x) <= s,   lower <= x <= upper,

which `trust-constr` is made for. The rows enter by their Jacobian alone, one for each iterate: a
quasi-Newton matrix of the constraints, started at one, holds the iterates where they are along a
valley in which the rows hardly bend (five levels of the published series ended where they began).
Whether a level is minimised is measured by a second solver, `least_squares` with the loss
sqrt(r^2 + eps^2).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import BFGS, Bounds, NonlinearConstraint, least_squares, minimize
from scipy.sparse import block_array, csr_array, diags_array, eye_array

from fitting.fit.objective import Evaluator, Nu, j_reg, total
from fitting.text.arrays import FloatArray

#: First barrier parameter, in units of J (of one where J is more): that of scipy.
BARRIER = 0.1
#: Iterates of a level. On the published series and on both shipped ones forty leave at most 3e-4 of
#: J; three hundred cost four times the evaluations.
ITERATIONS = 40
#: Evaluations, without those of Jacobians, that the second solver may take.
SECOND_EVALUATIONS = 5
#: Half width of the second solver's rounded corner |r| -> sqrt(r^2 + eps^2), as a share of the mean
#: |r|: J is off by a thousandth of that where a row vanishes, and by nothing elsewhere.
CORNER = 1e-3
#: Distance from a bound at which every solve starts, as a share of the box (at most in units of x).
INSIDE_SHARE = 1e-3


@dataclass(frozen=True, kw_only=True)
class Solve:
    """End of one level: lowest iterate `x` (n,), J there, and how the solver ended.

    `optimality` is the largest component of the Lagrangian's gradient at the last iterate,
    `converged` whether a tolerance of the solver was met (else its limit of iterates).
    """

    x: FloatArray
    value: float
    optimality: float
    converged: bool
    message: str
    iterations: int


def inside(x: FloatArray, lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Move x strictly into the box: an interior-point method that starts on a bound stalls.

    Args:
        x: search vector, shape (n,).
        lower: bounds of the box, shape (n,).
        upper: likewise.
    """
    margin = INSIDE_SHARE * np.minimum(upper - lower, 1.0)
    moved: FloatArray = np.clip(x, lower + margin, upper - margin)
    return moved


def solve(
    evaluator: Evaluator,
    start: FloatArray,
    nu: Nu,
    misfit: str,
    *,
    iterations: int = ITERATIONS,
    curved: bool = False,
) -> Solve:
    """Minimise misfit + J_reg from one start, never to worse than the start.

    All tolerances are scipy's own, and so is the first barrier parameter of a J of one.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        misfit: "slack" or "absolute" (sum of absolute values), or "squares".
        iterations: at most.
        curved: whether the rows' second derivatives are estimated (BFGS), for the last digits of a
            minimum that no corner of the rows holds.

    Raises:
        FmuFailure: the model failed at the start, or next to an iterate.

    Source: R. Byrd, M. Hribar and J. Nocedal, "An interior point algorithm for large-scale
    nonlinear programming", SIAM J. Optim. 9 (1999) 877; the paper's Algorithm 2, line 3.
    """
    n, x0 = start.size, inside(start, evaluator.lower, evaluator.upper)
    lowest: list[Any] = [start, total(evaluator.point(start), nu, misfit)]

    def follow(y: FloatArray, state: Any) -> bool:
        x = np.array(y[:n])
        value = total(evaluator.point(x), nu, misfit)
        if value < lowest[1]:
            lowest[:] = [x, value]
        return False

    barrier = BARRIER * min(float(lowest[1]), 1.0)
    if misfit == "squares":
        problem = _squares_problem(evaluator, x0, nu)
    else:
        problem = _slack_problem(evaluator, x0, nu, barrier, curved=curved)
    with warnings.catch_warnings():
        # scipy says what its quasi-Newton update and its projections fall back to
        warnings.filterwarnings("ignore", message="delta_grad == 0.0", category=UserWarning)
        warnings.filterwarnings("ignore", message="Singular Jacobian matrix", category=UserWarning)
        options = {
            "maxiter": iterations,
            "initial_barrier_parameter": barrier,
            "initial_barrier_tolerance": barrier,
        }
        end = minimize(method="trust-constr", callback=follow, options=options, **problem)
    return Solve(
        x=lowest[0],
        value=float(lowest[1]),
        optimality=float(end.optimality),
        converged=end.status in (1, 2),
        message=str(end.message).rstrip("."),
        iterations=int(end.nit),
    )


def second_value(evaluator: Evaluator, start: FloatArray, nu: Nu, misfit: str) -> float:
    """Least J that another solver, `least_squares`, comes by from a point; at most J there.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        misfit: "slack" or "absolute" (sum of absolute values), or "squares".

    Raises:
        FmuFailure: the model failed at the start, or next to an iterate.
    """
    here = evaluator.point(start)
    m, tikhonov = here.residuals.size, np.sqrt(np.broadcast_to(nu, start.shape))
    corner = max(CORNER * here.j_fit / m, 1e-150) if misfit != "squares" else math.inf
    values = [total(here, nu, misfit)]
    weights = np.sqrt(2.0 * here.row_weights) if misfit == "squares" else np.ones(m)

    def rows(x: FloatArray) -> FloatArray:
        point = evaluator.trial(np.array(x))
        values.append(total(point, nu, misfit))
        return np.concatenate([weights * point.residuals, tikhonov * x])

    def slopes(x: FloatArray) -> FloatArray:
        return np.vstack(
            [
                weights[:, None] * evaluator.jacobian(np.array(x), is_central=False),
                np.diag(tikhonov),
            ]
        )

    def loss(z: FloatArray) -> FloatArray:
        """rho(r^2), its two derivatives: |r| of the data, x^2 of the Tikhonov rows."""
        rho = np.stack([z, np.ones(z.size), np.zeros(z.size)])
        if math.isfinite(corner):
            square = z[:m] + corner**2
            rho[:, :m] = 2.0 * square**0.5, square**-0.5, -0.5 * square**-1.5
        return rho

    least_squares(
        rows,
        inside(start, evaluator.lower, evaluator.upper),
        slopes,
        bounds=(evaluator.lower, evaluator.upper),
        loss=loss,
        x_scale=np.minimum(evaluator.upper - evaluator.lower, 1.0),
        max_nfev=SECOND_EVALUATIONS,
    )
    return min(values)


def _slack_problem(
    evaluator: Evaluator, x0: FloatArray, nu: Nu, barrier: float, *, curved: bool
) -> dict[str, Any]:
    n, rows = x0.size, np.abs(evaluator.point(x0).residuals)
    m, minus = rows.size, -eye_array(rows.size)
    of_objective = diags_array(np.concatenate([np.broadcast_to(nu, (n,)), np.zeros(m)]))
    straight = csr_array((n + m, n + m))

    def bands(y: FloatArray) -> FloatArray:
        r, s = evaluator.trial(np.array(y[:n])).residuals, y[n:]
        return np.concatenate([r - s, -r - s])

    def band_slopes(y: FloatArray) -> Any:
        matrix = csr_array(evaluator.jacobian(np.array(y[:n]), is_central=False))
        return block_array([[matrix, minus], [-matrix, minus]], format="csr")

    hessian = BFGS() if curved else lambda y, v: straight
    free = np.full(m, np.inf)
    lower, upper = (np.concatenate(e) for e in ((evaluator.lower, -free), (evaluator.upper, free)))
    return {
        "fun": lambda y: float(np.sum(y[n:])) + j_reg(y[:n], nu),
        "x0": np.concatenate([x0, rows + barrier]),
        "jac": lambda y: np.concatenate([nu * y[:n], np.ones(m)]),
        "hess": lambda y: of_objective,
        "constraints": [NonlinearConstraint(bands, -np.inf, 0.0, jac=band_slopes, hess=hessian)],
        # the FMU may refuse what lies outside the box, so no trial may leave it
        "bounds": Bounds(lower, upper, keep_feasible=np.arange(n + m) < n),
    }


def _squares_problem(evaluator: Evaluator, x0: FloatArray, nu: Nu) -> dict[str, Any]:
    """A smooth sum: gradient and Gauss and Newton's second derivatives."""

    def gradient(x: FloatArray) -> FloatArray:
        point = evaluator.point(np.array(x))
        weighted = 2.0 * point.row_weights * point.residuals
        return np.asarray(evaluator.jacobian(np.array(x), is_central=False).T @ weighted + nu * x)

    def hessian(x: FloatArray) -> FloatArray:
        matrix = evaluator.jacobian(np.array(x), is_central=False)
        weighted = (2.0 * evaluator.point(np.array(x)).row_weights)[:, None] * matrix
        return np.asarray(matrix.T @ weighted + np.diag(np.broadcast_to(nu, x.shape)))

    return {
        "fun": lambda x: total(evaluator.trial(np.array(x)), nu, "squares"),
        "x0": x0,
        "jac": gradient,
        "hess": hessian,
        "bounds": Bounds(evaluator.lower, evaluator.upper, keep_feasible=True),
    }
