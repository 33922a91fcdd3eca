"""Which of several fits is reported: the least J, and among equal ones one with all its values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import to_model
from fitting.fit.alternative import Outcome, polished_end
from fitting.fit.objective import Objective
from fitting.fit.solver.continuation import Chain, Course, equal_j, is_lower

#: Ends that are taken on along curved valleys, at most.
POLISHED = 3


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


def polished_ends(courses: Sequence[Course], outcomes: Sequence[Outcome]) -> list[Outcome]:
    """The outcomes, the chosen one taken on along a curved valley where straight steps crept.

    Curved steps are many, so that only what is reported has them; that may be another end then.
    Nothing is done where the user stopped the search.

    Args:
        courses: objective, schedule, settings and journal of each alternative.
        outcomes: what came of each, in the same order.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    objectives = [course.objective for course in courses]
    found = list(outcomes)
    for _ in range(POLISHED):
        if any(outcome.interrupted for outcome in found):
            break
        valued, best = chosen(objectives, found)
        further = polished_end(courses[best], valued[best])
        if further is None:
            break
        found[best] = further
    return found


def _complete(objective: Objective, outcome: Outcome) -> bool:
    """Whether every derived output has a value at the best end of an alternative."""
    best = outcome.best
    return best is not None and _valued(objective, [best])[0]


def _valued(objective: Objective, chains: Sequence[Chain]) -> list[bool]:
    """Whether every derived output has a value at the ends of some chains."""
    ends = [np.array(chain.steps[-1].parameters) for chain in chains]
    answers = objective.response.derived_many(ends) if ends else []
    return [
        all(bool(np.all(np.isfinite(values))) for values in outputs.values()) for outputs in answers
    ]


def _with_values(objective: Objective, outcome: Outcome) -> Outcome:
    """The outcome whose best chain has, among those of equal J, a value for every output.

    Its twins come first, whose J is the same, then the others from the lowest on.
    """
    best = outcome.best
    if best is None or _complete(objective, outcome):
        return outcome
    equal = [
        chain
        for chain in outcome.chains
        if chain is not best
        and chain.joined is None
        and chain.nu == best.nu
        and equal_j(chain.steps[-1].j, best.steps[-1].j)
    ]
    equal.sort(key=lambda chain: chain.steps[-1].j)
    candidates = [*_twins(objective, outcome, best), *equal]
    for chain, whole in zip(candidates, _valued(objective, candidates), strict=True):
        if whole:
            return replace(outcome, reported=chain)
    return outcome


def _twins(objective: Objective, outcome: Outcome, chain: Chain) -> list[Chain]:
    """The same chain with its end moved to each of its twins, as one more level that costs none."""
    last = chain.steps[-1]
    moved = []
    for twin in outcome.twins:
        x = twin.of(objective.parameters, np.array(last.x))
        if x is not None:
            step = replace(
                last,
                x=tuple(map(float, x)),
                parameters=tuple(map(float, to_model(objective.parameters, x))),
                level=last.level + 1,
                message=f"{last.message}; the same fit where every output has a value",
                iterations=0,
                evaluations=0,
                jacobians=0,
                runs=0,
                seconds=0.0,
            )
            moved.append(replace(chain, steps=(*chain.steps, step)))
    return moved


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
        further = one is None or other.nu < one.nu
        as_far = one is not None and other.nu == one.nu
        lower = one is not None and is_lower(other.steps[-1].j, one.steps[-1].j)
        equal = as_far and one is not None and equal_j(other.steps[-1].j, one.steps[-1].j)
        if equal and complete[k] != complete[best]:
            lower = complete[k]
        if further or (as_far and lower):
            best = k
    return best
