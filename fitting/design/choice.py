"""Which measurements to choose: greedy and exchange on sums of information matrices, pure algebra.

    F(S) = F_0 + sum of F_c over the chosen c in S,      C = F^-1 without the nuisances

at each of several points, since the point is not known. A criterion is the logarithm of a standard
deviation, averaged over the points, so that differences read as ratios of errors:

    D: ln det C/(2 n)      A: ln(tr C/n)/2      target: ln(g^T C g)/2, g the gradient of the target

D is submodular; A and target are not: two measurements may be worth something only together. Every
candidate is therefore weighed anew in every step (one batch of small inverses), where a lazy greedy
search would trust gains from before; and exchanges follow the greedy choice.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.choices import CRITERIA

#: How much of the best criterion (a ratio of errors) may be given up for cheaper measurements.
AS_GOOD = 0.02
#: An exchange has to gain at least this much; rounds of exchanges; a share of a time that is none.
LEAST_GAIN, ROUNDS, NO_TIME = 1e-6, 50, 1e-5


@dataclass(frozen=True, kw_only=True)
class DesignProblem:
    """Information matrices in variables whose prior is of unit variance, at k points.

    `base` (k, n, n) of prior and data so far, positive definite; `gains` (k, c, n, n) of the
    candidates; `gradients` (k, n) of the target, NaN at a point where it has none; `shown` the
    number of leading variables that count for D and A (the rest are nuisances); `costs` (c,).
    `once`: no candidate is measured twice; of one, or of all (c,).
    """

    base: FloatArray
    gains: FloatArray
    gradients: FloatArray
    shown: int
    costs: FloatArray
    once: bool | BoolArray = False

    @property
    def singles(self) -> BoolArray:
        """Which candidates are measured once at most, (c,)."""
        return np.broadcast_to(np.asarray(self.once, dtype=bool), self.costs.shape)

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return int(self.gains.shape[1])

    def joined(self, other: DesignProblem) -> DesignProblem:
        """Its candidates, and after them those of another with the same variables and base."""
        return replace(
            self,
            gains=np.concatenate([self.gains, other.gains], axis=1),
            costs=np.concatenate([self.costs, other.costs]),
            once=np.concatenate([self.singles, other.singles]),
        )

    def with_known(self, chosen: Sequence[int], of: DesignProblem) -> DesignProblem:
        """The problem to which chosen candidates of one with the same variables are known data."""
        return replace(self, base=self.base + of.gains[:, list(chosen)].sum(axis=1))

    def information(self, chosen: Sequence[int]) -> FloatArray:
        """F of prior, data and the chosen (repeated where measured again), (k, n, n)."""
        return np.asarray(self.base + self.gains[:, list(chosen)].sum(axis=1))

    def loss(self, chosen: Sequence[int], criterion: str) -> float:
        """The criterion with these candidates measured."""
        return float(losses(self, self.information(chosen), criterion))

    def losses_with(
        self, chosen: Sequence[int], criterion: str, time_s: float | None = None
    ) -> FloatArray:
        """The criterion with each candidate added to the chosen, (c,); inf: it is not allowed.

        Args:
            chosen: candidates.
            criterion: one of `CRITERIA`.
            time_s: that all of them may take, s; None: any.
        """
        information = self.information(chosen) + np.swapaxes(self.gains, 0, 1)
        allowed = ~(np.isin(np.arange(self.candidates), chosen) & self.singles)
        if time_s is not None:
            rest_s = time_s * (1.0 + NO_TIME) - float(self.costs[list(chosen)].sum())
            allowed &= self.costs <= rest_s
        return np.where(allowed, losses(self, information, criterion), np.inf)


def losses(problem: DesignProblem, information: FloatArray, criterion: str) -> FloatArray:
    """The criterion of matrices (..., k, n, n), averaged over the points, shape (...).

    Points where the target has no gradient are left out of "target".

    Args:
        problem: for gradients and the number of variables.
        information: matrices F, shape (..., k, n, n).
        criterion: one of `CRITERIA`.

    Raises:
        ValueError: an unknown criterion, or no point where the target has a gradient.
    """
    if criterion == "target":
        logs = np.log(target_sigmas(problem, information))
        if not np.any(np.isfinite(logs)):
            raise ValueError("the target has no gradient at any point")
        return np.asarray(np.nanmean(np.where(np.isfinite(logs), logs, np.nan), axis=-1))
    inner = np.linalg.inv(information)[..., : problem.shown, : problem.shown]
    if criterion == "D":
        return np.asarray(np.mean(np.linalg.slogdet(inner)[1], axis=-1) / (2.0 * problem.shown))
    if criterion == "A":
        traces = np.trace(inner, axis1=-2, axis2=-1) / problem.shown
        return np.asarray(np.mean(0.5 * np.log(traces), axis=-1))
    raise ValueError(f"criterion {criterion!r} is none of {', '.join(CRITERIA)}")


def target_sigmas(problem: DesignProblem, information: FloatArray) -> FloatArray:
    """Standard deviation of the target at every point, sqrt(g^T F^-1 g), shape (..., k).

    Args:
        problem: for the gradients.
        information: matrices F, shape (..., k, n, n).
    """
    g = problem.gradients
    known = np.all(np.isfinite(g), axis=-1)
    safe = np.where(known[:, np.newaxis], g, 0.0)
    solved = np.linalg.solve(information, np.broadcast_to(safe, information.shape[:-1])[..., None])
    return np.where(known, np.sqrt(np.einsum("ki,...ki->...k", safe, solved[..., 0])), np.nan)


def choose(
    problem: DesignProblem, number: int, criterion: str, time_s: float | None = None
) -> list[int]:
    """The best candidates, in the order in which each adds the most.

    Filled greedily, by what each candidate adds and, within a time, by what it adds per second, of
    the criterion and of D, which also gathers what is of use only together; each start is bettered
    by exchanges and the best end counts. Without a time there are as many as asked for, and cheaper
    ones replace them as far as 2 % of the criterion pay for that.

    Args:
        problem: candidates, their costs in s, and what is known.
        number: of measurements; within a time at most.
        criterion: one of `CRITERIA`.
        time_s: that they may take together, s; None: any.

    Source: V. Fedorov, Theory of Optimal Experiments (1972), on a finite set with repetition.
    """
    ends = []
    for rule in dict.fromkeys((criterion, "D")):
        for per_second in (False,) if time_s is None else (False, True):
            filled = _filled(problem, [], rule, number, time_s, per_second)
            ends.append(_exchanged(problem, filled, criterion, number, time_s))
    best = ends[int(np.argmin([problem.loss(end, criterion) for end in ends]))]
    # without a time cheaper candidates in place of the chosen, as far as the criterion pays
    bound, costs = problem.loss(best, criterion) + AS_GOOD, problem.costs
    for place in range(len(best)) if time_s is None else ():
        each = problem.losses_with(best[:place] + best[place + 1 :], criterion)
        allowed = np.flatnonzero((each <= bound) & (costs < costs[best[place]]))
        if allowed.size:
            cheapest = allowed[costs[allowed] <= np.min(costs[allowed])]
            best[place] = int(cheapest[np.argmin(each[cheapest])])
    return ordered(problem, best, criterion)


def _filled(
    problem: DesignProblem,
    chosen: Sequence[int],
    criterion: str,
    number: int,
    time_s: float | None,
    per_second: bool,
) -> list[int]:
    """The chosen with more, up to their number or time, the best or the best per second first."""
    filled = list(chosen)
    value = problem.loss(filled, criterion)
    seconds = np.where(np.isfinite(problem.costs) & per_second, problem.costs, 1.0)
    while len(filled) < number:
        each = problem.losses_with(filled, criterion, time_s)
        best = int(np.argmin((each - value) / seconds))
        # where their number is asked for, one that adds nothing is better than none
        if not each[best] < (np.inf if time_s is None else value - LEAST_GAIN):
            break
        filled, value = [*filled, best], float(each[best])
    return filled


def _exchanged(
    problem: DesignProblem,
    chosen: Sequence[int],
    criterion: str,
    number: int,
    time_s: float | None,
) -> list[int]:
    """Every chosen one in turn for the best that is allowed, then, in a time, for several."""
    current, value = list(chosen), problem.loss(chosen, criterion)
    for _ in range(ROUNDS):
        before = value
        for place in range(len(current)):
            each = problem.losses_with(current[:place] + current[place + 1 :], criterion, time_s)
            if float(np.min(each)) < value - LEAST_GAIN:
                current[place], value = int(np.argmin(each)), float(np.min(each))
        # the rest of the time filled, once as it is and once with each of the chosen left out
        rests = [] if time_s is None else [current]
        for excluded in dict.fromkeys(current) if rests else ():
            rests.append(list(current))
            rests[-1].remove(excluded)
        for rest, per_second in itertools.product(rests, (False, True)):
            filled = _filled(problem, rest, criterion, number, time_s, per_second)
            loss = problem.loss(filled, criterion)
            if loss < value - LEAST_GAIN:
                current, value = filled, loss
        if value > before - LEAST_GAIN:
            break
    return current


def ordered(problem: DesignProblem, chosen: Sequence[int], criterion: str) -> list[int]:
    """The same candidates, each the best of those that remain after those before it."""
    remaining, order = list(chosen), list[int]()
    while remaining:
        gains = np.swapaxes(problem.gains[:, remaining], 0, 1)
        each = losses(problem, problem.information(order) + gains, criterion)
        order.append(remaining.pop(int(np.argmin(each))))
    return order
