"""Which of several fits is reported: the least J, and among equal ones one with all its values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.fit.objective import Objective
from fitting.fit.solver.continuation import Outcome, equal_j


def chosen(
    objectives: Sequence[Objective], outcomes: Sequence[Outcome]
) -> tuple[list[Outcome], int]:
    """The outcomes, each with the chain that is reported as its best, and the index of the best.

    Among chains and alternatives of equal J those are preferred at which every derived output has
    a value; else the campaign's order decides.

    Args:
        objectives: one per alternative.
        outcomes: what came of each alternative.

    Raises:
        FmuFailure: the model failed at the end of a chain.
    """
    found = [_with_values(*pair) for pair in zip(objectives, outcomes, strict=True)]
    complete = [_complete(*pair) for pair in zip(objectives, found, strict=True)]
    return found, _best_alternative(found, complete)


def _complete(objective: Objective, outcome: Outcome) -> bool:
    """Whether every derived output has a value at the best end of an alternative."""
    best = outcome.best
    if best is None:
        return False
    [outputs] = objective.response.derived_many([np.array(best.steps[-1].parameters)])
    return all(bool(np.all(np.isfinite(values))) for values in outputs.values())


def _with_values(objective: Objective, outcome: Outcome) -> Outcome:
    """The outcome whose best chain has, among those of equal J, a value for every output."""
    best = outcome.best
    if best is None or _complete(objective, outcome):
        return outcome
    for chain in outcome.chains:
        if chain is best or chain.joined is not None or len(chain.steps) < len(best.steps):
            continue
        if equal_j(chain.steps[-1].j, best.steps[-1].j):
            others = tuple(other for other in outcome.chains if other is not chain)
            moved = replace(outcome, chains=(chain, *others))
            if _complete(objective, moved) and moved.best is chain:
                return moved
    return outcome


def _best_alternative(outcomes: list[Outcome], complete: list[bool]) -> int:
    """Index of the least J among the furthest.

    Between equal ones those decide at which every output has a value (`complete`), then the
    campaign's order.
    """
    best = 0
    for k, outcome in enumerate(outcomes):
        one, other = outcomes[best].best, outcome.best
        if other is None or outcome is outcomes[best]:
            continue
        longer = one is None or len(other.steps) > len(one.steps)
        as_long = one is not None and len(other.steps) == len(one.steps)
        lower = one is not None and other.steps[-1].j < one.steps[-1].j - 1e-6 * (
            1.0 + one.steps[-1].j
        )
        equal = as_long and one is not None and equal_j(other.steps[-1].j, one.steps[-1].j)
        if equal and complete[k] != complete[best]:
            lower = complete[k]
        if longer or (as_long and lower):
            best = k
    return best
