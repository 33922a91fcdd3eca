"""Communication step of a trace: halved until the trace changes by less than was wanted.

With D_j the largest change of a trace, over its largest value, from n 2^j steps between samples to
twice as many, and rho = D_j/D_(j-1), what is left at n 2^j is taken for

    D_j/(1 - rho),   rho at least 1/2

which is a geometric series: more than it is for any method of first order or higher.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.signal.free_decay import FewSamples
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.text.arrays import FloatArray, Scalar

#: Communication steps of a run, at most, and how often they are halved.
MOST_STEPS, MOST_HALVINGS = 2_000_000, 12
#: A ratio of changes above this is no convergence: what is left is then this many changes.
STALLED, UNKNOWN = 0.9, 10.0
#: Steps of the FMU's own between samples, at most: with more it was made for faster signals, and
#: halving finds what this one takes.
MOST_OWN = 32
#: How far a spacing may be from whole steps of the FMU's own, relative.
WHOLE = 1e-6


@dataclass(frozen=True, kw_only=True)
class StepPlan:
    """Steps ``per_sample`` of one trace, ``label``, and what they may be off by, relative.

    ``change`` was seen when they were halved, ``runs`` is what that took; ``own_s`` is a step of
    the FMU's own that the samples do not fit (0: none, or they do), ``stands_s`` one between whose
    ends it was seen to stand still, ``shifted``: which shifts an oscillation in time. ``few``: at
    which samples the response to a pulse is simulated, where all follow from them to
    ``tolerance``, which is checked in every evaluation, and to ``few_error`` in the survey; None:
    at all of them.
    """

    label: str
    spacing_s: float
    per_sample: int
    bound: float
    change: float = 0.0
    runs: int = 0
    own_s: float = 0.0
    stands_s: float = 0.0
    shifted: bool = False
    few: FewSamples | None = None
    tolerance: float = 0.0
    few_error: float = 0.0

    @property
    def step_s(self) -> float:
        """Communication step, s."""
        return self.spacing_s / self.per_sample


def first_steps(spacing_s: float, own_s: float | None) -> tuple[int, float]:
    """Steps between samples to begin with, and the FMU's own step where it does not fit.

    Args:
        spacing_s: of the samples, s.
        own_s: step that the FMU was made for, s; None: it tells none.
    """
    if own_s is None:
        return 1, 0.0
    steps = max(1, round(spacing_s / own_s))
    if steps > MOST_OWN:
        return 1, 0.0
    misfit = abs(spacing_s / steps / own_s - 1.0)
    return steps, own_s if misfit > WHOLE and own_s > spacing_s else 0.0


def planned_steps(
    plan: StepPlan,
    simulated: Callable[[int], Sequence[FloatArray]],
    wanted: float,
    samples: int,
) -> StepPlan:
    """The plan with as many steps as are wanted for an accuracy.

    Args:
        plan: with the steps to begin with.
        simulated: the trace at some parameters, for a number of steps between samples.
        wanted: largest error, relative to the largest value.
        samples: of a run.
    """
    steps, runs = plan.per_sample, 0
    before = simulated(steps)
    runs += len(before)
    last, bound, change = 0.0, 0.0, 0.0
    for _ in range(MOST_HALVINGS):
        after = simulated(2 * steps)
        runs += len(after)
        change = max(map(_change, before, after))
        rho = max(0.5, change / last) if last > 0.0 else 0.5
        bound = change / (1.0 - rho) if rho < STALLED else UNKNOWN * change
        if bound <= wanted or 4 * steps * samples > MOST_STEPS:
            break
        steps, before, last = 2 * steps, after, change
    return StepPlan(
        label=plan.label,
        spacing_s=plan.spacing_s,
        per_sample=steps,
        bound=bound,
        change=change,
        runs=runs,
        own_s=plan.own_s,
    )


def _change(coarse: FloatArray, fine: FloatArray) -> float:
    largest = float(np.max(np.abs(fine), initial=0.0))
    return float(np.max(np.abs(fine - coarse), initial=0.0)) / largest if largest > 0.0 else 0.0


def step_decision(plans: Sequence[StepPlan]) -> Decision:
    """What a plan decided on the steps of all its traces.

    Args:
        plans: one for each trace.
    """
    worst = max(plans, key=lambda plan: plan.bound)
    return Decision(
        kind=Kind.STEP,
        basis=Basis.HALVED,
        bound=worst.bound,
        numbers={
            "step_s": min(plan.step_s for plan in plans),
            "longest_s": max(plan.step_s for plan in plans),
            "per_sample": max(plan.per_sample for plan in plans),
            "change": worst.change,
            "runs": sum(plan.runs for plan in plans),
            "own_s": max(plan.own_s for plan in plans),
            **_stands(plans),
            **_few(plans),
        },
    )


def _stands(plans: Sequence[StepPlan]) -> dict[str, Scalar]:
    """The longest step between whose ends the FMU was seen to stand still."""
    longest = max(plan.stands_s for plan in plans)
    if not longest:
        return {}
    shifted = {"shifted": True} if any(plan.shifted for plan in plans) else {}
    return {"stands_s": longest, **shifted}


def _few(plans: Sequence[StepPlan]) -> dict[str, Scalar]:
    """Of how many samples decays are simulated, the most, and how many follow."""
    most = max((p.few for p in plans if p.few), key=lambda few: few.samples, default=None)
    return {} if most is None else {"few": most.indices.size, "of": most.samples}
