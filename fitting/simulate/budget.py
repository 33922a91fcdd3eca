"""A plan as a record of decisions: each with the error that it may cost, all within one budget.

Bounds are relative errors of an amplitude. They add up, so a promise is their sum, and what may
still be decided is what the sum leaves of the accuracy that was wanted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from fitting.text.arrays import Scalar
from fitting.text.units import checked_accuracy

#: Shares of a wanted accuracy, summing to less than one: what every kind of decision may use.
SHARES: Mapping[str, float] = {
    "model": 0.3,
    "settling": 0.2,
    "solver": 0.25,
    "samples": 0.1,
    "input": 0.05,
    "maximum": 0.1,
}


@dataclass(frozen=True)
class Decision:
    """One choice of a plan, the relative error of an amplitude that it may cost, and the reason.

    `forced`: the user asked for it, or (`taken` False) forbade it. A decision that was not `taken`
    costs nothing; its `bound` says what it would have cost (NaN: not known).

    Raises:
        ValueError: a bound below zero, or one that is taken and not known.
    """

    subject: str
    choice: str
    bound: float
    sentence: str
    forced: bool = False
    taken: bool = True

    def __post_init__(self) -> None:
        if self.bound < 0.0 or (self.taken and math.isnan(self.bound)):
            raise ValueError(f"decision on {self.subject}: bound {self.bound!r}, wanted 0 or more")

    @property
    def cost(self) -> float:
        """What it takes of the budget."""
        return self.bound if self.taken else 0.0


@dataclass(frozen=True)
class Budget:
    """Decisions against a wanted accuracy.

    Raises:
        BadInput: an accuracy that is not between 0 and 1.
    """

    wanted: float
    decisions: tuple[Decision, ...] = ()

    def __post_init__(self) -> None:
        checked_accuracy(self.wanted, "accuracy")

    @property
    def promised(self) -> float:
        """Sum of the bounds: the accuracy that can be promised."""
        return math.fsum(decision.cost for decision in self.decisions)

    @property
    def left(self) -> float:
        """What the decisions leave of the wanted accuracy, at least 0."""
        return max(0.0, self.wanted - self.promised)

    @property
    def kept(self) -> bool:
        """Whether the bounds sum to at most the wanted accuracy."""
        return self.promised <= self.wanted

    def with_decision(self, decision: Decision) -> Budget:
        """The budget with one more decision."""
        return Budget(self.wanted, (*self.decisions, decision))

    @property
    def sentence(self) -> str:
        """The sum against what was wanted, in words."""
        if self.kept:
            return (
                f"In all: amplitudes within {self.promised:.1e} of themselves, wanted "
                f"{self.wanted:.1e}."
            )
        return (
            f"In all: {self.promised:.1e} is what can be promised, not the {self.wanted:.1e} that "
            f"was wanted; {self._most()}."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must know: a promise that cannot be given, reductions beyond their bound."""
        said = [] if self.kept else [f"Accuracy: {self.sentence.removeprefix('In all: ')}"]
        said += [
            f"{d.subject} ({d.choice}) is forced beyond its bound: it may be off by {d.bound:.1e}, "
            f"wanted {self.wanted:.1e}."
            for d in self.decisions
            if d.taken and d.forced and d.bound > self.wanted
        ]
        return tuple(said)

    def _most(self) -> str:
        largest = max(self.decisions, key=lambda decision: decision.cost)
        return f"most of it is due to {largest.subject} ({largest.choice})"


@dataclass(frozen=True)
class PlanRecord:
    """A plan as a result holds it; `settings` are the start values that it chose for the FMU."""

    wanted: float
    promised: float
    decisions: tuple[Decision, ...]
    settings: Mapping[str, Scalar] = field(default_factory=dict)


def record_of(budget: Budget, settings: Mapping[str, Scalar]) -> PlanRecord:
    """The record of a finished budget."""
    return PlanRecord(budget.wanted, budget.promised, budget.decisions, dict(settings))


def sentences_of(budget: Budget) -> tuple[str, ...]:
    """A line per decision, and the sum; "settle 66 ms: transient below 1e-9"."""
    return (*(told(decision) for decision in budget.decisions), budget.sentence)


def told(decision: Decision) -> str:
    """One decision as a line: subject, choice, reason."""
    mark = " (as asked for)" if decision.forced and decision.taken else ""
    most = f"; at most {decision.bound:.1e}" if decision.cost > 0.0 else ""
    return f"{decision.subject}: {decision.choice}{mark}; {decision.sentence}{most}"
