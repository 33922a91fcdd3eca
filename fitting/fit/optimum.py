"""The most likely point: least squares over the likelihood in the bounds of the campaign."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH
from fitting.fit.levenberg import (
    LEAST_DAMPING,
    PROMISE,
    UNCONSTRAINED,
    Constraint,
    Expansion,
    Goal,
    expand,
    minimise,
)
from fitting.fit.likelihood import Exhausted, Likelihood, LikelihoodEvaluator, Request
from fitting.fit.linearisation import SMALLEST_SIGMA, Linearisation
from fitting.fit.objective import central
from fitting.signal.student import normal_square, tail
from fitting.text.arrays import FloatArray
from fitting.text.errors import OutOfBudget

#: Probability of a chi square below which it is taken for more than noise.
TOO_LARGE_P = 0.05
#: Chi square by which the data may be described better with wider noise, and times that a search
#: is gone on with where they are: then it had been stuck.
MISSED, ONCE_MORE = 0.1, 3
#: Rise of chi square, one by the slopes, up to which a step is not seen, and the factor on it then.
SEEN, LONGER = 0.5, 4.0
#: Gain in chi square, were a bound not there, from which the bound is active.
ACTIVE = 0.1
#: Times that noise is taken anew from the residuals that it leaves, and the change that is none.
SCATTER_ROUNDS, SAME_SCATTER = 4, 1e-3
#: Relative error of a slope by forward differences, at most.
BLURRED = 1e-3
#: Distance from a bound, in widths of the box, at which a point is at it.
AT_LIMIT = 1e-6


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """The most likely point: its likelihood (inflation in it) and the point with its slopes.

    `chi_square` of the data before inflation, against `degrees_of_freedom`; `converged`
    whether a minimum was reached. `noise_freedom` are the degrees of freedom of the noise where
    the residuals determine it, infinite where it is known as it is stated.
    """

    likelihood: Likelihood
    expansion: Expansion
    chi_square: float
    degrees_of_freedom: float
    converged: bool
    noise_freedom: float = np.inf

    @property
    def least(self) -> float:
        """Chi square (inflated, priors included) at the optimum."""
        return self.expansion.chi_square

    def delta(self, chi_square: float, freedom: float | None = None) -> float:
        """Dchi^2 of a point, as improbable as of noise that is known (`normal_square`).

        Args:
            chi_square: at the point, inflated and with priors.
            freedom: of the noise; None: that of all rows.
        """
        return self.calibrated(chi_square - self.least, freedom)

    def calibrated(self, increase: float, freedom: float | None = None) -> float:
        """An increase of chi square, as improbable as of noise that is known.

        Args:
            increase: over the optimum.
            freedom: of the noise; None: that of all rows.
        """
        return normal_square(increase, self.noise_freedom if freedom is None else freedom)

    def freedom_along(self, slope: FloatArray, covariance: FloatArray) -> float:
        """Degrees of freedom of the noise of one value; those of all rows without a slope.

        Args:
            slope: d value/dx, shape (n,).
            covariance: of x, shape (n, n).
        """
        likelihood, m = self.likelihood, self.likelihood.data_rows
        if np.isinf(self.noise_freedom) or not np.all(np.isfinite(slope)):
            return self.noise_freedom
        stated_dof = likelihood.scatter if likelihood.inflation == 1.0 else np.ones(m)
        here = Linearisation(
            rows=self.expansion.sample.rows[:m],
            matrix=self.expansion.matrix[:m],
            prior=np.ones(slope.size),
            scatter=stated_dof,
            freedom=self.noise_freedom,
        )
        return here.freedom_of(slope, covariance)


def most_likely(evaluator: LikelihoodEvaluator, starts: Sequence[FloatArray]) -> Optimum:
    """Least squares in the box from several starts; residuals beyond the noise widen them.

    The first start wins where another is no better by PROMISE: in a valley the point next to the
    reported solution is taken. k^2 = chi^2/freedom where noise alone reaches that chi^2 less often
    than TOO_LARGE_P, else one (`inflation_of`). Wider noise leaves no less of the data than the
    least chi square: where it does, the descent had been stuck, and is gone on with.

    Args:
        evaluator: evaluates the likelihood without inflation; is given the inflated one.
        starts: search vectors, the end of Algorithm 2 first.

    Raises:
        OutOfBudget: the evaluator's limit does not let it begin.
        FmuFailure: the model failed at the first start.
    """
    stated = evaluator.likelihood
    result = _with_noise(evaluator, starts)
    for _ in range(ONCE_MORE):
        data = result.expansion.sample.rows[: result.likelihood.data_rows]
        # at the optimum itself, by the noise as it is stated
        square = result.likelihood.inflation**2 * float(data @ data)
        if square > result.chi_square - MISSED:
            break
        evaluator.likelihood = stated
        result = _with_noise(evaluator, [result.expansion.x])
    here = result.expansion
    with evaluator.limited():
        [[read]] = evaluator([Request((here.x,), rows=False)])
    sample = replace(here.sample, outputs=read.outputs)
    return replace(result, expansion=replace(here, sample=sample))


def confirmed(evaluator: LikelihoodEvaluator, optimum: Optimum) -> Optimum:
    """The optimum, or a lower one that a search finds from a standard error away.

    Where a model has events, or steps of its own, it is a staircase: slopes over short differences
    mean little, and a search ends where it began. A standard error is a difference that the data
    see: chi square is one more there, if the slopes are right, the other parameters following:

        x +- C e_i/sqrt(C_ii)

    A step that they do not see, behind the edge of a stair, is made longer, up to the bounds.

    Args:
        evaluator: of the likelihood, which was given that of the optimum.
        optimum: where a search ended.
    """
    steps = _standard_errors(optimum)
    while steps.size:  # chi square falls by MISSED at least wherever they begin anew
        likelihood, x = optimum.likelihood, optimum.expansion.x
        around = np.clip(x + steps, likelihood.lower, likelihood.upper)
        try:
            with evaluator.limited():
                [samples] = evaluator([Request(tuple(around), outputs=False)])
            values = np.array([float(sample.rows @ sample.rows) for sample in samples])
            values[np.isnan(values)] = np.inf  # the model fails there
            lowest = int(np.argmin(values))
            if values[lowest] < optimum.least - MISSED:
                # residuals that are smaller widen the noise by less
                evaluator.likelihood = replace(likelihood, inflation=1.0)
                optimum = most_likely(evaluator, [around[lowest]])
                steps = _standard_errors(optimum)
                continue
        except Exhausted:
            break
        is_inside = np.all(np.abs(steps) < likelihood.widths, axis=1)
        steps = LONGER * steps[(values < optimum.least + SEEN) & is_inside]
    return optimum


def _standard_errors(optimum: Optimum) -> FloatArray:
    """Steps (2 k, n) by a standard error of each of k parameters, up and down; others follow."""
    covariance = _of_data(optimum.likelihood, optimum.expansion).covariance
    own = [k for k, p in enumerate(optimum.likelihood.parameters) if not p.experiments]
    steps = covariance[own] / np.sqrt(np.diag(covariance))[own, np.newaxis]
    return np.concatenate([steps, -steps])


def with_central_slopes(evaluator: LikelihoodEvaluator, optimum: Optimum) -> Optimum:
    """The optimum with slopes of rows and outputs by central differences, on which intervals rest.

    Along directions that the data hardly constrain errors are large, and so is what an error of a
    slope along them does to the error of a value that is constant there. Forward differences, which
    are enough to descend by, have errors of the step, these of its square. Values of single
    experiments, of which there may be many, have a prior that constrains them.

    Args:
        evaluator: of the likelihood of the optimum.
        optimum: the most likely point.
    """
    likelihood, here = optimum.likelihood, optimum.expansion
    steps, own = likelihood.objective.steps, [bool(p.experiments) for p in likelihood.parameters]
    around = central(here.x, steps, likelihood.lower, likelihood.upper, np.array(own))
    try:
        [nodes] = evaluator([Request(around.nodes)])
        if not all(np.all(np.isfinite(node.rows)) for node in nodes):
            # steps at which the model fails go the other way
            return replace(optimum, expansion=expand(evaluator, [here.x])[0])
    except Exhausted:  # outputs have no slopes then
        unknown = np.full((here.sample.outputs.size, here.x.size), np.nan)
        return replace(optimum, expansion=replace(here, outward=unknown))
    matrix = around.quotients([node.rows for node in nodes])
    outward = around.quotients([node.outputs for node in nodes])
    return replace(optimum, expansion=Expansion(here.sample, matrix, outward))


def _with_noise(evaluator: LikelihoodEvaluator, starts: Sequence[FloatArray]) -> Optimum:
    """The lowest end of some descents, gone on from with wider noise where it wants that."""
    best, converged = _best_of(evaluator, starts)
    best, converged, noise_freedom = _with_own_scatter(evaluator, best, converged)
    likelihood = evaluator.likelihood
    data = best.sample.rows[: likelihood.data_rows]
    chi_square = float(data @ data)
    free = freedom_of(likelihood, best)
    stated_dof = likelihood.objective.data.noise_freedom
    inflation = inflation_of(chi_square, free, noise_freedom=stated_dof)
    if inflation > 1.0:
        noise_freedom = free
        evaluator.likelihood = replace(likelihood, inflation=inflation)
        best, converged = _best_of(evaluator, [best.x])
    return Optimum(
        likelihood=evaluator.likelihood,
        expansion=best,
        chi_square=chi_square,
        degrees_of_freedom=free,
        converged=converged,
        noise_freedom=noise_freedom,
    )


def _with_own_scatter(
    evaluator: LikelihoodEvaluator, best: Expansion, converged: bool
) -> tuple[Expansion, bool, float]:
    """The same with noise that the residuals determine taken from those of the best point itself.

    s^2 = sum r^2/nu over such rows, nu what parameters, scales and backgrounds leave of them: chi
    square is then nu, however the rows were weighed on the way here. With the degrees of freedom.
    """
    if not evaluator.likelihood.scatter.size:
        return best, converged, np.inf
    freedom = np.inf
    for _ in range(SCATTER_ROUNDS):
        likelihood, m = evaluator.likelihood, evaluator.likelihood.data_rows
        own = likelihood.scatter > 0.0
        here = _of_data(likelihood, best)
        solved = likelihood.objective.data.solved_of(known=False)
        freedom = float(np.count_nonzero(own) - np.sum(here.leverage[own]) - solved)
        if freedom < 0.5:  # as many unknowns as rows: their scatter tells nothing
            return best, converged, 0.5
        left = (best.sample.rows[:m] * likelihood.scatter)[own]
        sigma = likelihood.noise.sigma.copy()
        sigma[own] *= np.sqrt(float(left @ left) / freedom)
        sigma = np.maximum(sigma, SMALLEST_SIGMA)
        if np.all(np.abs(sigma / likelihood.noise.sigma - 1.0) < SAME_SCATTER):
            break
        noise = replace(likelihood.noise, sigma=sigma)
        evaluator.likelihood = replace(likelihood, noise=noise)
        best, converged = _best_of(evaluator, [best.x])
    return best, converged, freedom


def active_bounds_at(
    likelihood: Likelihood,
    here: Expansion,
    besides: Sequence[int],
    constraint: Constraint = UNCONSTRAINED,
) -> tuple[int, ...]:
    """Parameters that a limit holds against the data, though the model allows what lies beyond.

    Without the limit the parameter would lower the merit, as far as that is straight, while the
    others follow that are at no limit themselves: with a' the parameter's column without what the
    others take away,

        gain = (a' r)^2/(a' a')

    Slopes by forward differences are known to `BLURRED`: what is no larger is none.

    Args:
        likelihood: with the limits.
        here: a point with its slopes.
        besides: parameters that are held on purpose.
        constraint: that the point keeps to.
    """
    rows, matrix = here.sample.rows, here.matrix * likelihood.widths
    blur = BLURRED * np.linalg.norm(rows) * np.linalg.norm(matrix, axis=0)
    if constraint.output >= 0:
        outward = np.nan_to_num(here.outward[constraint.output]) * likelihood.widths
        rows = np.append(rows, constraint.residual(here.sample))
        matrix = np.vstack([matrix, constraint.weight * outward])
    least, most = likelihood.declared
    near = AT_LIMIT * likelihood.widths
    below, above = here.x - likelihood.lower <= near, likelihood.upper - here.x <= near
    movable = (below & (likelihood.lower > least + near)) | (
        above & (likelihood.upper < most - near)
    )
    free = ~(below | above)
    free[list(besides)] = False
    damped = np.vstack([matrix, np.sqrt(LEAST_DAMPING) * np.eye(free.size)])
    basis, _ = np.linalg.qr(damped[:, free])
    active = []
    for i in map(int, np.flatnonzero(movable)):
        column = damped[:, i] - basis @ (basis.T @ damped[:, i])
        slope = float(column[: rows.size] @ rows)
        pushed = slope > blur[i] if below[i] else slope < -blur[i]
        if i not in besides and pushed and slope**2 > ACTIVE * float(column @ column):
            active.append(i)
    return tuple(active)


def _best_of(
    evaluator: LikelihoodEvaluator, starts: Sequence[FloatArray]
) -> tuple[Expansion, bool]:
    """The lowest end of searches from several starts, and whether it is a minimum."""
    # whatever begins later begins where something was found, which is not to be lost
    with evaluator.limited() if evaluator.evaluations else nullcontext():
        try:
            started = expand(evaluator, starts, outputs=False)
        except Exhausted:
            least = len(starts) * (len(evaluator.likelihood.parameters) + 1)
            raise OutOfBudget(
                f"budget: found {evaluator.limit}, wanted more: the first linearisation alone "
                f"takes {least} evaluations"
            ) from None
    # all else is counted from here: closer than what is no longer worth a step elsewhere
    goal = Goal(promise=0.1 * PROMISE)
    ended = minimise(evaluator, started, goal=goal)
    lowest = ended[0]
    for result in ended[1:]:
        if result.chi_square < lowest.chi_square - PROMISE:
            lowest = result
    for _ in range(ONCE_MORE):  # a long valley takes more steps than a search has
        if lowest.reached or lowest.is_cut or not np.isfinite(lowest.chi_square):
            break
        [lowest] = minimise(evaluator, [lowest.end], goal=goal)
    return lowest.end, lowest.reached


def freedom_of(likelihood: Likelihood, end: Expansion) -> float:
    """Degrees of freedom that the rows of the data keep: less what is solved for inside them.

    Args:
        likelihood: of the data.
        end: rows and slopes at the point where the fit ended.
    """
    here = _of_data(likelihood, end)
    return max(0.5, here.degrees_of_freedom - likelihood.objective.data.solved_inside)


def _of_data(likelihood: Likelihood, end: Expansion) -> Linearisation:
    """The rows of the data alone, with bounds and priors."""
    m = likelihood.data_rows
    prior = 1.0 / np.hypot(UNIFORM_WIDTH / likelihood.widths, likelihood.inverse_prior_sigma)
    return Linearisation(rows=end.sample.rows[:m], matrix=end.matrix[:m], prior=prior)


def inflation_of(
    chi_square: float,
    free: float,
    least_p: float = TOO_LARGE_P,
    noise_freedom: float = np.inf,
) -> float:
    """Factor on standard deviations for residuals beyond the noise: sqrt(chi^2/freedom) or one.

    Args:
        chi_square: of the data.
        free: degrees of freedom that it is held against.
        least_p: probability of such a chi square below which it is too large for noise.
        noise_freedom: degrees of freedom of the noise where it is estimated, else infinite.

    Source: the scale factor of the Particle Data Group, Review of Particle Physics, section 5.2.2,
    used only where chi^2 is too large for noise.
    """
    if free <= 0.0 or tail(chi_square, free, noise_freedom) >= least_p:
        return 1.0
    return max(1.0, float(np.sqrt(chi_square / free)))
