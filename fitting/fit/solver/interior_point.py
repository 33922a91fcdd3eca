"""One regularised problem of Algorithm 2: min misfit(r(x)) + nu/2 |x|^2 in the box.

nu may be one number or one per variable, where a prior of its own holds it.

"slack" (default) gives the interior-point method the smooth problem

    min_{x, s}  sum s + nu/2 |x|^2      -s <= r(x) <= s,   lower <= x <= upper,

"absolute" hands it the kinked sum |r| as the paper writes it, "squares" the smooth sum of squares.
The solver is scipy's trust-constr; nothing it says about its own success is taken on trust:
progress is measured, and optimality is tested by the linearised problem.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import BFGS, Bounds, NonlinearConstraint, minimize
from scipy.sparse import diags_array

from fitting.fit.objective import Nu, j_reg
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.gauss_newton import Finish, squares_model
from fitting.fit.solver.linear_program import Pace, follow, promised_decrease, with_slacks
from fitting.fit.solver.narrow_valley import finish_squares_in_valley, follow_valley
from fitting.fit.solver.symmetry import off_symmetry
from fitting.text.arrays import FloatArray
from fitting.text.notation import how_many

#: Distance from a bound at which every solve starts, as a share of the box (at most in units of x).
INSIDE_SHARE = 1e-3
#: Iterates over which an interior-point solve must lower J, else it is stopped.
PATIENCE = 12
#: Slacks, at most, with which the interior point is asked. Its factors fill as their number
#: squared, since every row sees every parameter: of 2400 rows 0.4 GB, of 9600 samples 6 GB.
#: Beyond, linearised steps go all the way: their linear programs stay sparse.
MOST_SLACKS = 2000
#: Promised decrease, as a share of J, to which the last nu is solved.
LAST_DIGITS = 1e-8
#: Units of x over which the last digits of an end are looked for that is not the lowest: the
#: promise is what one of them lowers J by, and along a valley J falls ever more slowly.
FAR = 3.0
#: What finishes a solve of each smooth misfit, by linearised steps.
FINISHES: dict[str, Callable[[Evaluator, FloatArray, Nu, float], Finish]] = {
    "slack": follow,
    "squares": finish_squares_in_valley,
}
#: What gets its last digits. Along a valley that the data leave open J falls by less than a step
#: may be off elsewhere, over hundreds of units of x: steps are many there, and as long as they go.
LAST_FINISHES: dict[str, Callable[[Evaluator, FloatArray, Nu, float], Finish]] = {
    "slack": partial(follow, pace=Pace(steps=60, farthest=1000.0, creeping=6)),
    "squares": partial(finish_squares_in_valley, steps=20),
}


@dataclass(frozen=True, kw_only=True)
class SolveSettings:
    """How one regularised problem is solved.

    `misfit` is one of `evaluator.MISFITS`; a point is optimal where a linearised step promises
    less than `absolute + relative J` (for "squares", a sum of another dimension,
    `absolute^2 + relative J/10`); `iterations` bounds each interior-point run; `barrier` is
    the largest first barrier parameter and `radius` the first trust radius; `restarts` counts the
    further tries from a perturbed point where optimality is in doubt; `polish`: whether an end at
    which straight steps creep is taken on along its curved valley.
    """

    misfit: str = "slack"
    absolute: float = 1e-7
    relative: float = 1e-4
    iterations: int = 60
    barrier: float = 0.1
    radius: float = 1.0
    restarts: int = 1
    polish: bool = True


def quick_settings(settings: SolveSettings) -> SolveSettings:
    """The same with looser tolerances, no second try and no polish, which takes most of the runs.

    Args:
        settings: of the solve.
    """
    return replace(settings, absolute=1e-5, relative=1e-3, iterations=30, restarts=0, polish=False)


@dataclass(frozen=True, kw_only=True)
class Solve:
    """Outcome of one regularised problem.

    `status` is "optimal" or "stalled", `message` a sentence; `optimality` the decrease of J that a
    linearised step still promises; `iterations` of the interior point, `steps` of the finish.
    """

    x: FloatArray
    optimality: float
    status: str
    message: str
    iterations: int
    steps: int


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
    settings: SolveSettings,
    generator: np.random.Generator,
) -> Solve:
    """Minimise misfit + J_reg from one start; never worse than the start.

    Order: is the start optimal already? interior point; finish by linearised steps ("slack" and
    "squares"); where optimality is still in doubt, again from a perturbed point, and the better is
    kept.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        settings: misfit, tolerances and limits.
        generator: of the perturbation of a further try.

    Raises:
        FmuFailure: the model failed at a point inside the box.

    Source: the paper's Algorithm 2, line 3.
    """
    best = _attempt(evaluator, start, nu, settings)
    for _ in range(settings.restarts if best.status != "optimal" else 0):
        width = np.minimum(evaluator.upper - evaluator.lower, 1.0)
        nudge = 0.02 * width * generator.standard_normal(best.x.size)
        moved = inside(best.x + nudge, evaluator.lower, evaluator.upper)
        again = _attempt(evaluator, moved, nu, settings)
        if _value(evaluator, again.x, nu, settings) < _value(evaluator, best.x, nu, settings):
            best = again
        if best.status == "optimal":
            break
    return best


def finish(
    evaluator: Evaluator,
    start: FloatArray,
    nu: Nu,
    settings: SolveSettings,
    generator: np.random.Generator,
) -> Solve:
    """Minimise misfit + J_reg from a point near a minimum: by linearised steps, if these do.

    Args:
        evaluator: of the objective.
        start: search vector in the box, shape (n,).
        nu: weight of the Tikhonov term, one or (n,).
        settings: misfit, tolerances and limits.
        generator: of the perturbation of a further try.

    Raises:
        FmuFailure: the model failed at a point inside the box.
    """
    if settings.misfit not in FINISHES:
        return solve(evaluator, start, nu, settings, generator)
    tolerance = _tolerance(_value(evaluator, start, nu, settings), settings)
    end = FINISHES[settings.misfit](evaluator, start, nu, tolerance)
    if end.optimality > _tolerance(_value(evaluator, end.x, nu, settings), settings):
        return solve(evaluator, end.x, nu, settings, generator)
    return Solve(
        x=end.x,
        optimality=end.optimality,
        status="optimal",
        message=f"{end.steps} linearised steps: {end.message}",
        iterations=0,
        steps=end.steps,
    )


def to_the_last_digits(
    evaluator: Evaluator,
    found: Solve,
    nu: Nu,
    settings: SolveSettings,
    least: float = math.inf,
) -> Solve:
    """What a solve found, taken on by linearised steps as long as these promise anything.

    Sums of absolute values have their minima in corners: a few steps more tell which of two is the
    lower. Where an end that is known already lies lower than `FAR` units of x at the promised rate
    could lead, they are not taken.

    Args:
        evaluator: of the objective.
        found: end of the solve.
        nu: weight of the Tikhonov term, one or (n,).
        settings: misfit.
        least: J of the lowest end that is known.

    Raises:
        FmuFailure: the model failed at a point inside the box.
    """
    if settings.misfit not in LAST_FINISHES:
        return found
    if _value(evaluator, found.x, nu, settings) - least > FAR * found.optimality:
        return found
    return _further(evaluator, found, nu, settings, partial(_last_steps, settings.misfit))


def _last_steps(
    misfit: str, evaluator: Evaluator, start: FloatArray, nu: Nu, tolerance: float
) -> Finish:
    end = LAST_FINISHES[misfit](evaluator, start, nu, tolerance)
    count = how_many(end.steps, "step")
    return replace(end, message=f"{count} to the last digits: {end.message}")


def crept(promise: float, value: float, misfit: str) -> bool:
    """Whether linearised steps left last digits that curved ones may find.

    Args:
        promise: decrease of J that a linearised step promises still.
        value: J there.
        misfit: of the solve.
    """
    return misfit in LAST_FINISHES and promise > LAST_DIGITS * value


def along_the_valley(evaluator: Evaluator, found: Solve, nu: Nu, settings: SolveSettings) -> Solve:
    """What a solve found, taken on by curved steps where its last digits left something.

    Args:
        evaluator: of the objective.
        found: end of the solve and of its last digits.
        nu: weight of the Tikhonov term, one or (n,).
        settings: tolerances.

    Raises:
        FmuFailure: the model failed at a point inside the box.
    """
    steps = partial(follow_valley, misfit=settings.misfit)
    return _further(evaluator, found, nu, settings, steps)


def _further(
    evaluator: Evaluator,
    found: Solve,
    nu: Nu,
    settings: SolveSettings,
    steps: Callable[[Evaluator, FloatArray, Nu, float], Finish],
) -> Solve:
    end = steps(evaluator, found.x, nu, LAST_DIGITS * _value(evaluator, found.x, nu, settings))
    if not end.steps:
        return found
    promise, reached = end.optimality, _value(evaluator, end.x, nu, settings)
    status = "optimal" if promise <= _tolerance(reached, settings) else found.status
    return replace(
        found,
        x=end.x,
        optimality=promise,
        status=status,
        message=f"{found.message}; {end.message}",
        steps=found.steps + end.steps,
    )


def _value(evaluator: Evaluator, x: FloatArray, nu: Nu, settings: SolveSettings) -> float:
    return total(evaluator.point(x), nu, settings.misfit)


def _tolerance(value: float, settings: SolveSettings) -> float:
    if settings.misfit == "squares":
        return settings.absolute**2 + 0.1 * settings.relative * value
    return settings.absolute + settings.relative * value


def _attempt(evaluator: Evaluator, start: FloatArray, nu: Nu, settings: SolveSettings) -> Solve:
    begun = _value(evaluator, start, nu, settings)
    promise = _promise(evaluator, start, nu, settings)
    if promise <= _tolerance(begun, settings):
        least = begun - _tolerance(begun, settings)
        value = partial(_value, evaluator, nu=nu, settings=settings)
        lower_point = off_symmetry(evaluator, start, value, least)
        if lower_point is None:
            return Solve(
                x=start,
                optimality=promise,
                status="optimal",
                message="the start is optimal already",
                iterations=0,
                steps=0,
            )
        start, begun = lower_point, value(lower_point)
        promise = _promise(evaluator, start, nu, settings)
    # a barrier of 2m + 2n terms costs (2m + 2n) mu at its minimum: no more than there is to gain
    terms = 2 * (evaluator.point(start).residuals.size + start.size)
    barrier = float(np.clip(promise / terms, 1e-9, settings.barrier))
    rows = evaluator.point(start).residuals.size
    if settings.misfit == "slack" and rows > MOST_SLACKS:
        x, iterations, said = start, 0, f"{rows} rows are too many for an interior point"
    else:
        inner = replace(settings, barrier=barrier)
        x, iterations, said = _interior_point(evaluator, start, nu, inner)
    if iterations and not _value(evaluator, x, nu, settings) < begun:
        # also catches NaN: trust-constr has been seen to report success for both
        x, said = start, f"the interior point did not lower J ({said})"
    steps = 0
    if settings.misfit in FINISHES:
        tolerance = _tolerance(_value(evaluator, x, nu, settings), settings)
        end = FINISHES[settings.misfit](evaluator, x, nu, tolerance)
        x, steps, promise = end.x, end.steps, end.optimality
        said = f"{said}; {steps} linearised steps: {end.message}" if steps else said
    else:
        promise = _promise(evaluator, x, nu, settings)
    reached = promise <= _tolerance(_value(evaluator, x, nu, settings), settings)
    status = "optimal" if reached else "stalled"
    return Solve(
        x=x, optimality=promise, status=status, message=said, iterations=iterations, steps=steps
    )


def _promise(evaluator: Evaluator, x: FloatArray, nu: Nu, settings: SolveSettings) -> float:
    try:
        return promised_decrease(evaluator, x, nu, settings.misfit)
    except ArithmeticError:
        return math.inf  # no certificate: the point counts as not optimal


class _Watch:
    """Keeps the best iterate by the true J; stops a solve that is there, or that gets nowhere."""

    def __init__(self, evaluator: Evaluator, nu: Nu, settings: SolveSettings) -> None:
        self.evaluator, self.nu, self.settings = evaluator, nu, settings
        self.n = evaluator.lower.size
        self.best_x: FloatArray | None = None
        self.best = math.inf
        self.mark, self.waited = math.inf, 0
        self.iterations = 0
        self.stopped = ""

    def __call__(self, y: FloatArray, state: Any) -> bool:
        self.iterations += 1
        x = np.array(y[: self.n], dtype=float)
        if np.all((x >= self.evaluator.lower) & (x <= self.evaluator.upper)):
            value = _value(self.evaluator, x, self.nu, self.settings)
            if value < self.best:
                self.best, self.best_x = value, x
                # the solver has this Jacobian already: the test costs no simulation
                if _promise(self.evaluator, x, self.nu, self.settings) <= self._enough():
                    self.stopped = "optimal"
                    return True
        if self.best < self.mark - 0.1 * self._enough():
            self.mark, self.waited = self.best, 0
        else:
            self.waited += 1
        if self.waited >= PATIENCE:
            self.stopped = "J stopped falling"
        return bool(self.stopped)

    def _enough(self) -> float:
        return _tolerance(self.best, self.settings)


def _interior_point(
    evaluator: Evaluator, start: FloatArray, nu: Nu, settings: SolveSettings
) -> tuple[FloatArray, int, str]:
    """Best iterate of trust-constr, its number of iterations and its own words."""
    x0 = inside(start, evaluator.lower, evaluator.upper)
    build = {"slack": _slack_problem, "absolute": _plain_problem, "squares": _squares_problem}
    problem = build[settings.misfit](evaluator, x0, nu, settings)
    watch = _Watch(evaluator, nu, settings)
    options = {
        "maxiter": settings.iterations,
        "initial_tr_radius": settings.radius,
        "initial_barrier_parameter": settings.barrier,
        "initial_barrier_tolerance": settings.barrier,
        "gtol": 1e-9,
        "xtol": 1e-10,
        "barrier_tol": 1e-9,
    }
    with warnings.catch_warnings():
        # a quasi-Newton update without curvature is usual for rows that are straight
        warnings.filterwarnings("ignore", message="delta_grad == 0.0", category=UserWarning)
        warnings.filterwarnings("ignore", message="Singular Jacobian matrix", category=UserWarning)
        answer = minimize(method="trust-constr", callback=watch, options=options, **problem)
    if watch.best_x is None:
        return x0, watch.iterations, "no iterate inside the box"
    said = watch.stopped or str(answer.message).rstrip(".")
    return watch.best_x, watch.iterations, f"interior point: {said}"


def _slack_problem(
    evaluator: Evaluator, x0: FloatArray, nu: Nu, settings: SolveSettings
) -> dict[str, Any]:
    n = x0.size
    rows = np.abs(evaluator.point(x0).residuals)
    m = rows.size
    curvature = diags_array(np.concatenate([np.full(n, nu), np.zeros(m)]), format="csr")

    def bands(y: FloatArray) -> FloatArray:
        r, s = evaluator.point(np.array(y[:n])).residuals, y[n:]
        return np.concatenate([r - s, -r - s])

    def band_slopes(y: FloatArray) -> Any:
        return with_slacks(evaluator.jacobian(np.array(y[:n])))

    free = np.full(m, np.inf)
    return {
        "fun": lambda y: float(np.sum(y[n:])) + j_reg(y[:n], nu),
        "x0": np.concatenate([x0, rows + settings.barrier]),
        "jac": lambda y: np.concatenate([nu * y[:n], np.ones(m)]),
        "hess": lambda y: curvature,
        "constraints": [
            NonlinearConstraint(bands, -np.inf, 0.0, jac=band_slopes, hess=BFGS(init_scale=1.0))
        ],
        "bounds": _box(
            np.concatenate([evaluator.lower, -free]), np.concatenate([evaluator.upper, free]), n
        ),
    }


def _plain_problem(
    evaluator: Evaluator, x0: FloatArray, nu: Nu, settings: SolveSettings
) -> dict[str, Any]:
    def slope(x: FloatArray) -> FloatArray:
        signs = np.sign(evaluator.point(np.array(x)).residuals)
        gradient: FloatArray = evaluator.jacobian(np.array(x)).T @ signs + nu * x
        return gradient

    return {
        "fun": lambda x: total(evaluator.point(np.array(x)), nu, "absolute"),
        "x0": x0,
        "jac": slope,
        "hess": BFGS(init_scale=1.0),
        "bounds": _box(evaluator.lower, evaluator.upper, x0.size),
    }


def _squares_problem(
    evaluator: Evaluator, x0: FloatArray, nu: Nu, settings: SolveSettings
) -> dict[str, Any]:
    return {
        "fun": lambda x: total(evaluator.point(np.array(x)), nu, "squares"),
        "x0": x0,
        "jac": lambda x: squares_model(evaluator, np.array(x), nu).slope,
        "hess": lambda x: squares_model(evaluator, np.array(x), nu).curvature,
        "bounds": _box(evaluator.lower, evaluator.upper, x0.size),
    }


def _box(lower: FloatArray, upper: FloatArray, n: int) -> Bounds:
    # the FMU may refuse what lies outside the box, so no trial may leave it
    keep = np.arange(lower.size) < n
    return Bounds(lower, upper, keep_feasible=keep)
