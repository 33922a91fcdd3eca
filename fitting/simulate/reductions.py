"""What may be left out of a model: its bound, stated or measured, and the work that it saves."""

from __future__ import annotations

import math
from dataclasses import replace

from fitting.fmu.accuracy import Reduction
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.text.arrays import Scalar


def model_decision(reduction: Reduction[Scalar], basis: Basis, bound: float) -> Decision:
    """A decision on a reduction that is taken; its numbers are to be added.

    Args:
        reduction: a reduction that the FMU declares.
        basis: on what the bound rests.
        bound: relative error at most.
    """
    return Decision(
        kind=Kind.MODEL,
        basis=basis,
        bound=bound,
        subject=reduction.name,
        settings=dict(reduction.set),
    )


def with_numbers(decision: Decision, **numbers: Scalar) -> Decision:
    """The decision with more to tell.

    Args:
        decision: of the plan.
        **numbers: what the decision rests on, by name.
    """
    return replace(decision, numbers={**decision.numbers, **numbers})


def not_taken(decision: Decision, *, forced: bool = False) -> Decision:
    """The decision, not taken; `forced`: because the user forbade it.

    Args:
        decision: of the plan.
        forced: whether the user has said so.
    """
    return replace(decision, taken=False, forced=forced)


def forbidden(reduction: Reduction[Scalar]) -> Decision:
    """The decision on what the user forbade.

    Args:
        reduction: a reduction that the FMU declares.
    """
    return Decision(
        kind=Kind.MODEL,
        basis=Basis.FORBIDDEN,
        bound=math.nan,
        subject=reduction.name,
        settings=dict(reduction.set),
        forced=True,
        taken=False,
    )


def no_cheaper(reduction: Reduction[Scalar]) -> Decision:
    """The decision on what saves nothing, whose error was not looked for.

    Args:
        reduction: a reduction that the FMU declares.
    """
    unknown = model_decision(reduction, Basis.NO_CHEAPER, 0.0)
    return replace(not_taken(unknown), bound=math.nan)


def no_cheaper_than(decision: Decision) -> Decision:
    """The decision on what saves a run's time and costs that of an evaluation.

    Args:
        decision: that a reduction is taken.
    """
    return replace(not_taken(decision), basis=Basis.NO_CHEAPER, bound=math.nan)


def roughly(ratio: float) -> float:
    """How many times cheaper, as 2 or a power of ten: what a clock reproduces.

    Args:
        ratio: of processor times, above 1.
    """
    return min((2.0, *(10.0**k for k in range(1, 13))), key=lambda x: abs(math.log(x / ratio)))


def refused(reduction: Reduction[Scalar], message: str) -> Decision:
    """The decision on what the FMU does not do.

    Args:
        reduction: a reduction that the FMU declares.
        message: what the FMU answered.
    """
    return Decision(
        kind=Kind.MODEL,
        basis=Basis.REFUSED,
        bound=math.nan,
        subject=reduction.name,
        numbers={"message": message},
        settings=dict(reduction.set),
        taken=False,
    )
