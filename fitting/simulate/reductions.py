"""What may be left out of a model: its bound, stated or measured, and the work that it saves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from fitting.fmu.accuracy import Reduction
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.simulate.probe import Probe
from fitting.simulate.settling import SAFETY, Limits, settle
from fitting.text.arrays import Scalar

#: A reduction is taken if it leaves less than this part of the work of a run.
CHEAPER = 0.8
#: Both models settle until what is left of the transient is this part of what is wanted.
STEADY = 0.02
#: The full model is fine enough when its own error is this part of the reduction's.
FINE = 0.1
#: Halvings of the substep, at most, and the largest factor by which one may have helped.
HALVINGS, ORDER_FOUR = 8, 16.0


@dataclass(frozen=True, kw_only=True)
class FullModel:
    """The full model: its start values, the name of its substep and a first value of that, s.

    `order`: no combination of tones up to it folds onto a tone, as only one of the models has them.
    """

    settings: Mapping[str, Scalar]
    substep: str
    first: float
    order: int

    def at(self, step: float) -> dict[str, Scalar]:
        """Its start values with that substep.

        Args:
            step: length of the step, s.
        """
        return {**self.settings, self.substep: step}


def model_decision(reduction: Reduction, basis: Basis, bound: float) -> Decision:
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


def forbidden(reduction: Reduction) -> Decision:
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


def refused(reduction: Reduction, message: str) -> Decision:
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


def measured(
    probe: Probe,
    reduced: Mapping[str, Scalar],
    full: FullModel,
    wanted: tuple[float, float],
    limits: Limits,
) -> dict[str, float] | None:
    """Bound of a reduction's error by runs of the full model, and what it is made of.

    2 (|reduced - full| + own) + what is left of both transients, relative to each amplitude. `own`
    is the full model's error, by Richardson's rule |h -> h/2| / (r - 1) with the factor r <= 16 by
    which the change fell from one halving to the next (all of the change where r < 2). Halving
    ends when the bound is at most the first of `wanted` or cannot come below the second, when
    `own` is small beside the reduction's error, or when a run would cost more than the limit.
    None: the substep changes nothing, or no run is affordable.

    Args:
        probe: trial runs of the FMU, remembered.
        reduced: settings of the reduced model.
        full: the model without the reduction.
        wanted: error that is wanted, and the one that is left.
        limits: work of the longest run, and longest time to settle.

    Raises:
        BadInput: no sampling keeps combinations of the tones off them up to that order.
        FmuFailure: the FMU failed.
    """
    enough, most = wanted
    steady = settle(probe, full.settings, STEADY * most, limits)
    cheap = probe.read(reduced, steady.settle_s, full.order)
    step, previous = full.first, math.inf
    here = probe.read(full.at(step), steady.settle_s, full.order)
    best: dict[str, float] | None = None
    for _ in range(HALVINGS):
        step /= 2.0
        if probe.work(full.at(step), steady.settle_s) > limits.work:
            break
        better = probe.read(full.at(step), steady.settle_s, full.order)
        change, error = probe.errors(here, better), probe.errors(cheap, better)
        if change == 0.0:
            return None  # it is not the substep that sets the full model's accuracy
        fell = min(previous / change, ORDER_FOUR) if previous < math.inf else 1.0
        own = change / max(fell - 1.0, 1.0)
        bound = SAFETY * (error + own) + 2.0 * steady.bound
        if best is None or bound < best["bound"]:
            best = {"bound": bound, "difference": error, "own": own, "step": step}
        if bound <= enough or own <= FINE * error or SAFETY * (error - 2.0 * own) > most:
            break
        here, previous = better, change
    return best
