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
#: An exchange has to gain at least this much; so many are made at most.
LEAST_GAIN, MOST_EXCHANGES = 1e-6, 200
#: Rounds of exchanges within a time, each over all that is chosen; a share of it that is none.
ROUNDS, NO_TIME = 10, 1e-5


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

    def beside(self, other: DesignProblem) -> DesignProblem:
        """Its candidates, and behind them those of another with the same variables.

        Args:
            other: with the same `base`, `gradients` and `shown`.
        """
        return replace(
            self,
            gains=np.concatenate([self.gains, other.gains], axis=1),
            costs=np.concatenate([self.costs, other.costs]),
            once=np.concatenate([self.singles, other.singles]),
        )

    def with_known(self, chosen: Sequence[int], of: DesignProblem) -> DesignProblem:
        """What the chosen of another problem say counts as known.

        Args:
            chosen: candidates of the other.
            of: with the same variables.
        """
        return replace(self, base=self.base + of.gains[:, list(chosen)].sum(axis=1))

    def information(self, chosen: Sequence[int]) -> FloatArray:
        """F of prior, data and the chosen, (k, n, n).

        Args:
            chosen: candidates, repeated where measured again.
        """
        return np.asarray(self.base + self.gains[:, list(chosen)].sum(axis=1))


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
        return np.asarray(np.nanmean(_finite(np.log(target_sigmas(problem, information))), axis=-1))
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


def _finite(values: FloatArray) -> FloatArray:
    if not np.any(np.isfinite(values)):
        raise ValueError("the target has no gradient at any point")
    return np.where(np.isfinite(values), values, np.nan)


def greedy(problem: DesignProblem, number: int, criterion: str) -> list[int]:
    """`number` candidates, one after the other, each the best beside those before it.

    A candidate may be chosen again: then it is measured again.

    Args:
        problem: candidates and what is known.
        number: of measurements.
        criterion: one of `CRITERIA`.
    """
    chosen: list[int] = []
    for _ in range(number):
        found = _each_added(problem, chosen, criterion, range(problem.candidates))
        chosen.append(int(np.argmin(found)))
    return chosen


def _each_added(
    problem: DesignProblem, chosen: Sequence[int], criterion: str, tried: Sequence[int]
) -> FloatArray:
    """The criterion with each of the tried beside the chosen, shape (tried,); inf: not allowed."""
    gains = problem.gains[:, list(tried)]
    found = losses(problem, problem.information(chosen) + np.swapaxes(gains, 0, 1), criterion)
    again = np.isin(tried, chosen) & problem.singles[list(tried)]
    return np.where(again, np.inf, found)


def exchange(problem: DesignProblem, chosen: Sequence[int], criterion: str) -> list[int]:
    """Swap a chosen candidate for another as long as that betters the criterion, best swap first.

    Args:
        problem: candidates and what is known.
        chosen: candidates to begin with.
        criterion: one of `CRITERIA`.

    Source: V. Fedorov, Theory of Optimal Experiments (1972), on a finite set with repetition.
    """
    current = list(chosen)
    value = float(losses(problem, problem.information(current), criterion))
    everything = range(problem.candidates)
    for _ in range(MOST_EXCHANGES):
        best, swap = value - LEAST_GAIN, None
        for place in range(len(current)):
            rest = current[:place] + current[place + 1 :]
            found = _each_added(problem, rest, criterion, everything)
            if float(np.min(found)) < best:
                best, swap = float(np.min(found)), (rest, int(np.argmin(found)))
        if swap is None:
            break
        current, value = [*swap[0], swap[1]], best
    return current


def economise(problem: DesignProblem, chosen: Sequence[int], criterion: str) -> list[int]:
    """Cheaper candidates in place of the chosen, as far as 2 % of the criterion pay for them.

    Args:
        problem: candidates, their costs, and what is known.
        chosen: candidates to begin with.
        criterion: one of `CRITERIA`.
    """
    current = list(chosen)
    bound = float(losses(problem, problem.information(current), criterion)) + AS_GOOD
    for place in range(len(current)):
        rest = current[:place] + current[place + 1 :]
        found = _each_added(problem, rest, criterion, range(problem.candidates))
        allowed = np.flatnonzero((found <= bound) & (problem.costs < problem.costs[current[place]]))
        if allowed.size:
            costs = problem.costs[allowed]
            cheapest = allowed[costs <= np.min(costs)]
            current[place] = int(cheapest[np.argmin(found[cheapest])])
    return current


def choose(problem: DesignProblem, number: int, criterion: str) -> list[int]:
    """Greedy choice bettered by exchanges, made cheaper, in the order in which each adds the most.

    Exchanges start from the greedy choice of the criterion and from that of D, which also gathers
    what is of use only together; the better end counts.

    Args:
        problem: candidates, their costs, and what is known.
        number: of measurements.
        criterion: one of `CRITERIA`.
    """
    number = min(number, problem.candidates) if np.all(problem.singles) else number
    starts = [greedy(problem, number, criterion)]
    if criterion != "D":
        starts.append(greedy(problem, number, "D"))
    ends = [exchange(problem, start, criterion) for start in starts]
    values = [float(losses(problem, problem.information(end), criterion)) for end in ends]
    best = ends[int(np.argmin(values))]
    return ordered(problem, economise(problem, best, criterion), criterion)


def choose_within(problem: DesignProblem, time_s: float, number: int, criterion: str) -> list[int]:
    """The best that a time allows, in the order in which each adds the most.

    Begun greedily by what each adds, and by what it adds per second, of the criterion and of D,
    which also gathers what is of use only together. Each end is bettered: one of the chosen for
    another or for several that the time allows. The best end counts.

    Args:
        problem: candidates, their costs in s, and what is known.
        time_s: that they may take together, s.
        number: of measurements at most.
        criterion: one of `CRITERIA`.
    """
    best, value = list[int](), np.inf
    for how in dict.fromkeys((criterion, "D")):
        for per_second in (False, True):
            chosen = _filled(problem, [], time_s, number, how, per_second=per_second)
            end = _exchanged_within(problem, chosen, time_s, number, criterion)
            found = float(losses(problem, problem.information(end), criterion))
            if found < value:
                best, value = end, found
    return ordered(problem, best, criterion)


def _each_within(
    problem: DesignProblem, chosen: Sequence[int], time_s: float, criterion: str
) -> FloatArray:
    """The criterion with each candidate beside the chosen, (c,); inf: no time is left for it."""
    left = time_s * (1.0 + NO_TIME) - float(problem.costs[list(chosen)].sum())
    found = _each_added(problem, chosen, criterion, range(problem.candidates))
    return np.where(problem.costs <= left, found, np.inf)


def _filled(
    problem: DesignProblem,
    chosen: Sequence[int],
    time_s: float,
    number: int,
    criterion: str,
    *,
    per_second: bool,
) -> list[int]:
    """The chosen with more of what is left of the time, the best or the best per second first."""
    filled = list(chosen)
    value = float(losses(problem, problem.information(filled), criterion))
    while len(filled) < number:
        found = _each_within(problem, filled, time_s, criterion)
        seconds = np.where(np.isfinite(problem.costs), problem.costs, 1.0)
        merits = (found - value) / (seconds if per_second else 1.0)
        best = int(np.argmin(merits))
        if not found[best] < value - LEAST_GAIN:
            break
        filled, value = [*filled, best], float(found[best])
    return filled


def _exchanged_within(
    problem: DesignProblem, chosen: Sequence[int], time_s: float, number: int, criterion: str
) -> list[int]:
    """Every chosen one in turn for the best that the time allows, then for several."""
    current = list(chosen)
    value = float(losses(problem, problem.information(current), criterion))
    for _ in range(ROUNDS):
        before = value
        for place in range(len(current)):
            rest = current[:place] + current[place + 1 :]
            found = _each_within(problem, rest, time_s, criterion)
            if float(np.min(found)) < value - LEAST_GAIN:
                current[place], value = int(np.argmin(found)), float(np.min(found))
        current = _one_for_several(problem, current, time_s, number, criterion)
        value = float(losses(problem, problem.information(current), criterion))
        if value > before - LEAST_GAIN:
            break
    return current


def _one_for_several(
    problem: DesignProblem, chosen: Sequence[int], time_s: float, number: int, criterion: str
) -> list[int]:
    """The rest of the time filled, once as it is and once with each of the chosen left out."""
    best, value = list(chosen), np.inf
    for left_out in [None, *dict.fromkeys(chosen)]:
        rest = list(chosen)
        if left_out is not None:
            rest.remove(left_out)
        for per_second in (False, True):
            filled = _filled(problem, rest, time_s, number, criterion, per_second=per_second)
            found = float(losses(problem, problem.information(filled), criterion))
            if found < value - LEAST_GAIN:
                best, value = filled, found
    return best


def ordered(problem: DesignProblem, chosen: Sequence[int], criterion: str) -> list[int]:
    """The same candidates, each the best of what is left beside those before it.

    Args:
        problem: candidates and what is known.
        chosen: candidates in any order.
        criterion: one of `CRITERIA`.
    """
    left, order = list(chosen), list[int]()
    while left:
        found = _each_added(problem, order, criterion, left)
        order.append(left.pop(int(np.argmin(found))))
    return order


def exhaustive(problem: DesignProblem, number: int, criterion: str) -> list[int]:
    """The best of all choices of `number` candidates with repetition; for small cases.

    Args:
        problem: candidates and what is known.
        number: of measurements.
        criterion: one of `CRITERIA`.
    """
    every = list(itertools.combinations_with_replacement(range(problem.candidates), number))
    sums = problem.base + np.stack([problem.gains[:, list(s)].sum(axis=1) for s in every])
    return list(every[int(np.argmin(losses(problem, sums, criterion)))])
