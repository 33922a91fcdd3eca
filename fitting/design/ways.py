"""Ways to spend the same time of the laboratory: each kind of measurement alone, and a mixture.

Each way is the best choice of its own candidates that the time allows, the mixture that of all of
them, in one information matrix whose variables are those of all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fitting.design.choice import AS_GOOD, choose
from fitting.design.result import Way
from fitting.design.weighing import Weighed
from fitting.text.errors import BadInput

#: What the mixture is called.
TOGETHER = "together"


def _least(weighed: Weighed) -> int:
    """Measurements of a kind at least: a campaign has two sweeps over a control or more."""
    return 1 if weighed.limits.sweeps is None else 2


def alone(name: str, weighed: Weighed, criterion: str) -> Weighed:
    """The best choice of one kind alone.

    Args:
        name: of the kind.
        weighed: its candidates, with a time.
        criterion: "target", "D" or "A".

    Raises:
        BadInput: the time is too short for what a campaign must have.
    """
    best, least = weighed.choosing(criterion), _least(weighed)
    if len(best.chosen) < least:
        wanted = weighed.takes_s([int(np.argmin(weighed.problem.costs))] * least)
        raise BadInput(
            f"{name}: {weighed.limits.time_s:.6g} s are too short for it; wanted {wanted:.6g} s "
            f"at least, {'two sweeps' if least > 1 else 'one measurement'}"
        )
    return best


def together(kinds: Sequence[Weighed], criterion: str) -> tuple[Weighed, ...] | None:
    """The best choice of all kinds, a choice of each; None: no mixture is better, or can be made.

    What is chosen of the others counts as known in each, so that all promise the same in the end.

    Args:
        kinds: of the same campaign, weighed together, each with its choice alone, with one time.
        criterion: "target", "D" or "A".
    """
    parts = _mixed(kinds, criterion, [()] * len(kinds))
    few = [0 < len(part) < _least(kind) for kind, part in zip(kinds, parts, strict=True)]
    if any(few):  # sweeps, but fewer than a campaign must have: two in any case
        pairs = zip(kinds, few, strict=True)
        fixed = [kind.chosen[: _least(kind)] if is_few else () for kind, is_few in pairs]
        parts = _mixed(kinds, criterion, fixed)
    if sum(bool(part) for part in parts) < 2:
        return None
    mixture = []
    for kind, part in zip(kinds, parts, strict=True):
        problem = kind.problem
        for other, its in zip(kinds, parts, strict=True):
            if other is not kind:
                problem = problem.with_known(its, other.problem)
        mixture.append(replace(kind, problem=problem, chosen=tuple(part)))
    return tuple(mixture)


def _mixed(
    kinds: Sequence[Weighed], criterion: str, fixed: Sequence[Sequence[int]]
) -> list[list[int]]:
    """The best choice of all kinds, with what is `fixed` of each in any case, a list of each."""
    problem = kinds[0].problem
    for kind in kinds[1:]:
        problem = problem.joined(kind.problem)
    begins = np.cumsum([0, *(kind.problem.candidates for kind in kinds)])
    first = [int(begin) + i for begin, part in zip(begins, fixed, strict=False) for i in part]
    limits = [kind.limits for kind in kinds]
    time_s = min(each.time_s or 0.0 for each in limits) - float(problem.costs[first].sum())
    costs = problem.costs.copy()
    costs[[i for i in first if problem.singles[i]]] = np.inf  # measured already
    rest = replace(problem.with_known(first, problem), costs=costs)
    number = min(each.number for each in limits) - len(first)
    chosen = [*first, *choose(rest, number, criterion, max(time_s, 0.0))]
    return [[c - int(a) for c in chosen if a <= c < b] for a, b in pairwise(begins)]


def way_of(name: str, choices: Mapping[str, Weighed]) -> Way:
    """A way in numbers: what it takes, and the error that it promises.

    Args:
        name: of the way.
        choices: of each kind, by its name.
    """
    some = next(each for each in choices.values() if each.chosen)
    return Way(
        name=name,
        counts={kind: len(each.chosen) for kind, each in choices.items() if each.chosen},
        takes_s=float(sum(each.takes_s(each.chosen) for each in choices.values())),
        expected=some.expected(some.chosen),
    )


def in_order(ways: Sequence[Way]) -> tuple[Way, ...]:
    """The ways, the least error (on average) first; a mixture has to be better by 2 %."""
    gain = {way.name: np.exp(AS_GOOD) if way.name == TOGETHER else 1.0 for way in ways}
    return tuple(sorted(ways, key=lambda way: way.expected.mean * gain[way.name]))
