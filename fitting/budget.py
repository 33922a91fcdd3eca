"""A plan as a record of decisions: each with the error that it may cost, all within one budget.

Bounds are relative errors of an amplitude. They add up, so a promise is their sum, and what may
still be decided is what the sum leaves of the accuracy that was wanted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from fitting.errors import BadInput

Scalar = float | int | bool | str

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


def checked_accuracy(value: float, where: str) -> float:
    """The accuracy, if it is one; BadInput, beginning with ``where``, if it is none."""
    if not (math.isfinite(value) and 0.0 < value < 1.0):
        raise BadInput(f"{where}: found {value!r}, wanted a relative accuracy above 0 and below 1")
    return value


@dataclass(frozen=True)
class Reduction:
    """Start values under which the FMU computes less than it could.

    `bound` names an FMU output that bounds the relative error, "{output}" in it standing for the
    output that is read; without it the error is measured.

    Raises:
        BadInput: no name, or nothing that is set.
    """

    name: str
    set: Mapping[str, Scalar]
    bound: str | None = None

    def __post_init__(self) -> None:
        if not (self.name and self.set):
            raise BadInput(f"reduction {self.name!r}: wanted a name and values to set")


@dataclass(frozen=True)
class Hints:
    """What is known of an FMU: how it is told to be accurate, and what makes it cheaper.

    `tolerance` and `substep` name the parameters that bound its solver's relative error and its
    substep (s); `full` are start values of the model with nothing left out; `force` and `forbid`
    name reductions.

    Raises:
        BadInput: a name in `force` or `forbid` that is none of the reductions (where there are
            any: an FMU may have its own), or is in both.
    """

    tolerance: str | None = None
    substep: str | None = None
    full: Mapping[str, Scalar] = field(default_factory=dict)
    reductions: tuple[Reduction, ...] = ()
    force: Sequence[str] = ()
    forbid: Sequence[str] = ()

    def __post_init__(self) -> None:
        names = [r.name for r in self.reductions]
        if len(set(names)) < len(names):
            raise BadInput(f"reductions {', '.join(names)}: two have one name")
        if self.reductions:
            self.check_names()
        both = sorted(set(self.force) & set(self.forbid))
        if both:
            raise BadInput(f"'{both[0]}' is both in force and in forbid")

    def check_names(self) -> None:
        """BadInput for a name in `force` or `forbid` that is none of the reductions."""
        names = [r.name for r in self.reductions]
        for key, wanted in (("force", self.force), ("forbid", self.forbid)):
            for name in wanted:
                if name not in names:
                    known = ", ".join(names) or "none"
                    raise BadInput(f"{key}: no reduction '{name}', wanted one of: {known}")

    def over(self, own: Hints) -> Hints:
        """These hints, and what an FMU says of its `own` where these say nothing.

        Raises:
            BadInput: `force` or `forbid` name none of the reductions.
        """
        merged = replace(
            self,
            tolerance=self.tolerance or own.tolerance,
            substep=self.substep or own.substep,
            full=self.full or own.full,
            reductions=self.reductions or own.reductions,
        )
        merged.check_names()
        return merged
