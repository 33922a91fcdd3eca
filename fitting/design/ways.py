"""Ways to spend the same time of the laboratory: each kind of measurement alone, and a mixture.

Each way is the best choice of its own candidates that the time allows, the mixture that of all of
them, in one information matrix whose variables are those of all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fitting.design.choice import AS_GOOD, choose
from fitting.design.result import Way
from fitting.design.weighing import Weighed
from fitting.text.errors import BadInput

#: What the mixture is called.
TOGETHER = "together"


@dataclass(frozen=True)
class Choice:
    """Candidates of one kind, and those of them that are to be measured, in order of use."""

    weighed: Weighed
    chosen: Sequence[int]

    @property
    def least(self) -> int:
        """Measurements at least: a campaign has two sweeps over a control or more."""
        return 1 if self.weighed.limits.sweeps is None else 2


def alone(name: str, weighed: Weighed, criterion: str) -> Choice:
    """The best choice of one kind alone.

    Args:
        name: of the kind.
        weighed: its candidates, with a time.
        criterion: "target", "D" or "A".

    Raises:
        BadInput: the time is too short for what a campaign must have.
    """
    choice = Choice(weighed, weighed.chosen_by(criterion))
    if len(choice.chosen) < choice.least:
        wanted = weighed.takes_s([int(np.argmin(weighed.problem.costs))] * choice.least)
        raise BadInput(
            f"{name}: {weighed.limits.time_s:.6g} s are too short for it; wanted {wanted:.6g} s "
            f"at least, {'two sweeps' if choice.least > 1 else 'one measurement'}"
        )
    return choice


def together(kinds: Sequence[Choice], criterion: str) -> tuple[Choice, ...] | None:
    """The best choice of all kinds, a choice of each; None: no mixture is better, or can be made.

    What is chosen of the others counts as known in each, so that all promise the same in the end.

    Args:
        kinds: of the same campaign, weighed together, each with its choice alone, with one time.
        criterion: "target", "D" or "A".
    """
    parts = _mixed(kinds, criterion, [[] for _ in kinds])
    few = [0 < len(part) < kind.least for kind, part in zip(kinds, parts, strict=True)]
    if any(few):  # sweeps, but fewer than a campaign must have: two in any case
        fixed = [
            k.chosen[: k.least] if is_few else [] for k, is_few in zip(kinds, few, strict=True)
        ]
        parts = _mixed(kinds, criterion, fixed)
    if sum(bool(part) for part in parts) < 2:
        return None
    mixture = []
    for k, (kind, part) in enumerate(zip(kinds, parts, strict=True)):
        problem = kind.weighed.problem
        for i, (other, its) in enumerate(zip(kinds, parts, strict=True)):
            if i != k:
                problem = problem.with_known(its, other.weighed.problem)
        mixture.append(Choice(replace(kind.weighed, problem=problem), part))
    return tuple(mixture)


def _mixed(
    kinds: Sequence[Choice], criterion: str, fixed: Sequence[Sequence[int]]
) -> list[list[int]]:
    """The best choice of all kinds, with what is `fixed` of each in any case, a list of each."""
    problem = kinds[0].weighed.problem
    for kind in kinds[1:]:
        problem = problem.joined(kind.weighed.problem)
    begins = np.cumsum([0, *(kind.weighed.problem.candidates for kind in kinds)])
    first = [int(begin) + i for begin, part in zip(begins, fixed, strict=False) for i in part]
    limits = [kind.weighed.limits for kind in kinds]
    time_s = min(each.time_s or 0.0 for each in limits) - float(problem.costs[first].sum())
    costs = problem.costs.copy()
    costs[[i for i in first if problem.singles[i]]] = np.inf  # measured already
    rest = replace(problem.with_known(first, problem), costs=costs)
    number = min(each.number for each in limits) - len(first)
    chosen = [*first, *choose(rest, number, criterion, max(time_s, 0.0))]
    return [[c - int(a) for c in chosen if a <= c < b] for a, b in pairwise(begins)]


def way_of(name: str, choices: Mapping[str, Choice]) -> Way:
    """A way in numbers: what it takes, and the error that it promises.

    Args:
        name: of the way.
        choices: of each kind, by its name.
    """
    any_choice = next(choice for choice in choices.values() if choice.chosen)
    return Way(
        name=name,
        counts={kind: len(c.chosen) for kind, c in choices.items() if c.chosen},
        takes_s=float(sum(c.weighed.takes_s(c.chosen) for c in choices.values())),
        expected=any_choice.weighed.expected(any_choice.chosen),
    )


def in_order(ways: Sequence[Way]) -> tuple[Way, ...]:
    """The ways, the least error (on average) first; a mixture has to be better by 2 %."""
    gain = {way.name: np.exp(AS_GOOD) if way.name == TOGETHER else 1.0 for way in ways}
    return tuple(sorted(ways, key=lambda way: way.expected.mean * gain[way.name]))
