"""Ways to spend the same time of the laboratory: each kind of measurement alone, and all together.

Each way is the best choice of its own candidates that the time allows, the mixture that of all of
them. They stand in one information matrix, whose variables are the parameters, the scale of the
data so far, and what the new measurements of each way have in common.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from fitting.design.candidates import Limits
from fitting.design.choice import AS_GOOD, DesignProblem, choose_within
from fitting.design.proposal import Choice, expected_of
from fitting.design.result import Expected, Prospect
from fitting.design.weighing import Weighed, chosen_by
from fitting.text.errors import BadInput
from fitting.text.records import read_json, write_json

NAME = "ways.json"
#: What the mixture is called.
TOGETHER = "together"
#: Sweeps over a control that a campaign has, at least.
FEWEST_SWEEPS = 2


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way to spend the time: what it takes, s, and the target's error that is expected then.

    `counts` are its measurements by the name of the kind: one, of a mixture several.
    """

    name: str
    counts: Mapping[str, int]
    takes_s: float
    expected: Expected


@dataclass(frozen=True, kw_only=True)
class Ways(Prospect):
    """Ways to spend `time_s`, s, the one with the least expected error first."""

    time_s: float
    ways: tuple[Way, ...]

    @property
    def best(self) -> Way:
        """The one with the least expected error."""
        return self.ways[0]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of measurement that can be made: its name, its limits, its candidates."""

    name: str
    limits: Limits
    weighed: Weighed


def alone(kind: Kind, criterion: str) -> Choice:
    """The best choice of one kind alone.

    Args:
        kind: with a time.
        criterion: "target", "D" or "A".

    Raises:
        BadInput: the time is too short for what a campaign must have.
    """
    chosen = chosen_by(kind.weighed, kind.limits, criterion)
    least = FEWEST_SWEEPS if kind.limits.sweeps is not None else 1
    if len(chosen) < least:
        shortest = [int(np.argmin(kind.weighed.problem.costs))] * least
        wanted = Choice(kind.weighed, shortest).takes_s(kind.limits)
        raise BadInput(
            f"{kind.name}: {kind.limits.time_s:.6g} s are too short for it; wanted {wanted:.6g} s "
            f"at least, {'two sweeps' if least > 1 else 'one measurement'}"
        )
    return Choice(kind.weighed, chosen)


def together(kinds: Sequence[Kind], criterion: str) -> tuple[Choice, ...] | None:
    """The best choice of all kinds, a choice of each; None: there is no mixture that can be made.

    What is chosen of the others counts as known in each, so that all promise the same in the end.

    Args:
        kinds: of the same campaign, weighed together, with one time.
        criterion: "target", "D" or "A".
    """
    parts = _mixed(kinds, criterion, [[] for _ in kinds])
    if any(_is_too_few(kind, part) for kind, part in zip(kinds, parts, strict=True)):
        pairs = [
            alone(kind, criterion).chosen[:FEWEST_SWEEPS] if _is_too_few(kind, part) else []
            for kind, part in zip(kinds, parts, strict=True)
        ]
        parts = _mixed(kinds, criterion, pairs)
    if sum(bool(part) for part in parts) < 2:
        return None
    return tuple(
        Choice(replace(kind.weighed, problem=_beside_the_others(kinds, parts, k)), part)
        for k, (kind, part) in enumerate(zip(kinds, parts, strict=True))
    )


def _is_too_few(kind: Kind, part: Sequence[int]) -> bool:
    """Sweeps, but fewer than a campaign must have."""
    return kind.limits.sweeps is not None and 0 < len(part) < FEWEST_SWEEPS


def _mixed(kinds: Sequence[Kind], criterion: str, kept: Sequence[Sequence[int]]) -> list[list[int]]:
    """The best choice of all kinds beside what is `kept` of each in any case, a list of each."""
    problem = kinds[0].weighed.problem
    for kind in kinds[1:]:
        problem = problem.beside(kind.weighed.problem)
    sizes = [kind.weighed.problem.candidates for kind in kinds]
    begins = np.cumsum([0, *sizes])
    fixed = [int(first) + i for first, part in zip(begins, kept, strict=False) for i in part]
    time_s = min(kind.limits.time_s or 0.0 for kind in kinds) - float(problem.costs[fixed].sum())
    costs = problem.costs.copy()
    costs[[i for i in fixed if problem.singles[i]]] = np.inf  # measured already
    left = replace(problem.with_known(fixed, problem), costs=costs)
    number = min(kind.limits.number for kind in kinds) - len(fixed)
    chosen = [*fixed, *choose_within(left, max(time_s, 0.0), number, criterion)]
    return [
        [int(c - first) for c in chosen if first <= c < last] for first, last in pairwise(begins)
    ]


def _beside_the_others(
    kinds: Sequence[Kind], parts: Sequence[Sequence[int]], own: int
) -> DesignProblem:
    """The problem of one kind where what is chosen of the others counts as known."""
    problem = kinds[own].weighed.problem
    for k, (kind, part) in enumerate(zip(kinds, parts, strict=True)):
        if k != own:
            problem = problem.with_known(part, kind.weighed.problem)
    return problem


def way_of(name: str, kinds: Sequence[Kind], choices: Sequence[Choice]) -> Way:
    """A way in numbers.

    Args:
        name: of the way.
        kinds: of its measurements.
        choices: of each kind.
    """
    limits = [kind.limits for kind in kinds]
    takes = [choice.takes_s(each) for choice, each in zip(choices, limits, strict=True)]
    done = next(choice for choice in choices if choice.chosen)
    return Way(
        name=name,
        counts={k.name: len(c.chosen) for k, c in zip(kinds, choices, strict=True) if c.chosen},
        takes_s=float(sum(takes)),
        expected=expected_of(done.weighed.sigmas(done.chosen)),
    )


def in_order(ways: Sequence[Way]) -> tuple[Way, ...]:
    """The ways, the least error (on average) first; a mixture has to be better by 2 %.

    Args:
        ways: of one time.
    """
    gain = {way.name: np.exp(AS_GOOD) if way.name == TOGETHER else 1.0 for way in ways}
    return tuple(sorted(ways, key=lambda way: way.expected.mean * gain[way.name]))


def sentences_of(kinds: Sequence[Kind], *, mixed: bool) -> tuple[str, ...]:
    """What times were counted with, and whether a mixture stands among the ways.

    Args:
        kinds: that were compared.
        mixed: there is a mixture.
    """
    said = []
    for kind in kinds:
        limits = kind.limits
        each = (
            f"a point of a sweep counts {limits.point_s:g} s"
            if limits.sweeps is not None
            else f"a spectrum counts {limits.spectrum_s:g} s"
        )
        change = f"{limits.change_s:g} s" if limits.change_s else "nothing"
        said.append(f"{kind.name}: {each}, the change to another measurement {change}.")
    if not mixed:
        said.append(
            "There is no mixture among them: none that the time allows is better than one kind "
            "alone, or its sweeps, two at least, would take all of it."
        )
    return tuple(said)


def write_ways(ways: Ways, folder: Path) -> Path:
    """Write `ways.json` into a folder, whole or not at all.

    Args:
        ways: what is written.
        folder: where it goes.
    """
    path = folder / NAME
    write_json(path, ways)
    return path


def read_ways(path: Path) -> Ways:
    """Read it back.

    Args:
        path: of ways.json.

    Raises:
        BadInput: a key is wrong.
    """
    return read_json(path, Ways)
