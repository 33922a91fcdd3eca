"""A plan as a record of decisions: each with the error that it may cost, all within one budget.

Bounds are relative errors of an amplitude. They add up, so a promise is their sum, and what may
still be decided is what the sum leaves of the accuracy that was wanted. What decisions are called,
and their sentences, is the business of `fitting.simulate.words`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from enum import StrEnum

from fitting.text.arrays import Scalar
from fitting.text.units import checked_accuracy


class Kind(StrEnum):
    """What is decided."""

    MODEL = "model"
    SETTLING = "settling"
    WINDOW = "window"
    SOLVER = "solver"
    INPUT = "input"
    SAMPLES = "samples"
    ROUNDING = "rounding"
    MAXIMUM = "maximum"
    CURVE = "curve"
    STEP = "step"
    GRID = "grid"
    ACCURACY = "accuracy"


class Basis(StrEnum):
    """What a bound rests on, or why something is not taken."""

    STEADY = "steady"  # settling: amplitudes do not change from the start on
    WATCHED = "watched"  # settling: they stand still at last
    UNSTEADY = "unsteady"  # settling: they do not
    REPEATED = "repeated"  # settling: amplitudes repeat no better, however long the FMU runs
    OWN_STEP = "own step"  # grid: the FMU stands still between steps of its own
    FIXED_STEP = "fixed step"  # grid: the FMU declares a fixed step
    OTHER_STEPS = "other steps"  # grid: the FMU refuses steps that are no multiple of it
    NOISE = "noise"  # accuracy: a part of the noise of the data
    USUAL = "usual"  # accuracy: none was asked for, and the usual one is beyond the FMU
    ORDER = "order"  # step: errors fall as a power of it, seen over three steps
    PRESCRIBED = "prescribed"  # settling, solver: the user's own value
    DECLARED = "declared"  # settling: the campaign declares that the start is steady
    LINE_WIDTH = "line width"  # settling: by the damping that is stated
    LESS_DAMPING = "less damping"  # settling: watched, and longer for what a fit may try
    COHERENT = "coherent"  # window: whole periods
    FITTED = "fitted"  # window: tones without a common period
    STATED = "stated"  # model: an output of the FMU
    COMPARED = "compared"  # the change that a better setting makes
    UNMEASURED = "unmeasured"  # model: a run without the reduction would take too long
    CLOSED = "closed"  # model: a start state from which the orbit closes; the model is whole
    NO_CHEAPER = "no cheaper"  # model: an evaluation takes as long
    FORBIDDEN = "forbidden"  # model: by the user
    REFUSED = "refused"  # model: by the FMU
    DOUBLE = "double"  # rounding of numbers of 53 bits
    POLYNOMIAL = "polynomial"  # maximum: the remainder of an interpolation
    RATIONAL = "rational"  # curve: a rational function, checked in every evaluation
    NONLINEAR = "nonlinear"  # curve: half the drive does not give half the response
    HALVED = "halved"  # step: the change that half of it makes
    IRREGULAR = "irregular"  # curve: no rational function of low degree


#: Shares of a wanted accuracy, summing to less than one: what every kind of decision may use.
SHARES: Mapping[Kind, float] = {
    Kind.MODEL: 0.3,
    Kind.SETTLING: 0.2,
    Kind.SOLVER: 0.25,
    Kind.SAMPLES: 0.1,
    Kind.INPUT: 0.05,
    Kind.MAXIMUM: 0.1,
}


@dataclass(frozen=True)
class Decision:
    """One choice of a plan, the relative error of an amplitude that it may cost, and the reason.

    `subject`: the reduction or parameter; `settings`: start values that it sets; `numbers` of its
    sentence; `bound` of the error if it is `taken` (NaN: unknown); `forced`: requested, or (not
    `taken`) forbidden.

    Raises:
        ValueError: a bound below zero, or one that is taken and not known.
    """

    kind: Kind
    basis: Basis
    bound: float
    _: KW_ONLY
    subject: str = ""
    numbers: Mapping[str, Scalar] = field(default_factory=dict)
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    forced: bool = False
    taken: bool = True

    def __post_init__(self) -> None:
        if self.bound < 0.0 or (self.taken and math.isnan(self.bound)):
            name = f"{self.kind} {self.subject}".strip()
            raise ValueError(f"decision on {name}: bound {self.bound!r}, wanted 0 or more")

    @property
    def is_reduction(self) -> bool:
        """Whether a part of the model is left out by it, because of what that saves."""
        return self.kind == Kind.MODEL and self.taken and not self.forced

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

    def remaining(self, without: Kind | None = None) -> float:
        """What the decisions leave of the wanted accuracy, at least 0.

        Args:
            without: kind of decisions that do not count.
        """
        spent = math.fsum(d.cost for d in self.decisions if d.kind != without)
        return max(0.0, self.wanted - spent)

    @property
    def kept(self) -> bool:
        """Whether the bounds sum to at most the wanted accuracy."""
        return self.promised <= self.wanted

    def with_decision(self, decision: Decision) -> Budget:
        """The budget with one more decision.

        Args:
            decision: of the plan.
        """
        return Budget(self.wanted, (*self.decisions, decision))

    def with_instead(self, decision: Decision) -> Budget:
        """The budget with a decision instead of all others of its kind.

        Args:
            decision: of the plan.
        """
        others = tuple(d for d in self.decisions if d.kind != decision.kind)
        return Budget(self.wanted, (*others, decision))

    def record(self, settings: Mapping[str, Scalar]) -> PlanRecord:
        """What a result holds of a plan.

        Args:
            settings: values of FMU variables that the plan chose, by name.
        """
        return PlanRecord(
            wanted=self.wanted,
            promised=self.promised,
            decisions=self.decisions,
            settings=dict(settings),
        )

    def of(self, kind: Kind, subject: str = "") -> tuple[Decision, ...]:
        """The decisions of a kind, on that subject where one is given.

        Args:
            kind: of the decisions.
            subject: of the decision; empty for any.
        """
        result = (d for d in self.decisions if d.kind == kind)
        return tuple(d for d in result if not subject or d.subject == subject)


@dataclass(frozen=True, kw_only=True)
class PlanRecord:
    """A plan with the start values `settings` that it sets in the FMU."""

    wanted: float
    promised: float
    decisions: tuple[Decision, ...]
    settings: Mapping[str, Scalar] = field(default_factory=dict)
