"""Communication step of a trace: halved until the trace changes by less than was wanted.

With D_j the largest change of a trace, over its largest value, from n 2^j steps between samples to
twice as many, and rho = D_j/D_(j-1), what is left at n 2^j is taken for

    D_j/(1 - rho),   rho at least 1/2

which is a geometric series: more than it is for any method of first order or higher.

An input whose mean is held over every step leaves even powers of the step, where it is smooth
within steps. Of two runs y(h) and y(2h) under it

    (4 y(h) - y(2h))/3

has lost the second power (Richardson). Its own changes bound what is left of it in the same way,
whatever the powers are; it is taken where it keeps what was wanted and one run does not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

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
    extrapolated: bool = False

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


@dataclass(frozen=True)
class StepRuns:
    """Runs of a trace at some parameters: ``driven`` under its input, and ``others``.

    ``changed`` is what they changed of the runs of longer steps, over the largest value, and
    ``bound`` that of the error of those.
    """

    driven: Sequence[FloatArray] = ()
    others: Sequence[FloatArray] = ()
    changed: float = 0.0
    bound: float = np.inf

    @property
    def count(self) -> int:
        """How many runs."""
        return len(self.driven) + len(self.others)

    def then(self, finer: StepRuns) -> StepRuns:
        """Runs of shorter steps, with what they show of these; as they are where these are none.

        Args:
            finer: the same runs.
        """
        if not self.count:
            return finer
        before, after = (*self.driven, *self.others), (*finer.driven, *finer.others)
        change = max(map(_change, before, after))
        rho = max(0.5, change / self.changed) if self.changed > 0.0 else 0.5
        bound = change / (1.0 - rho) if rho < STALLED else UNKNOWN * change
        return replace(finer, changed=change, bound=bound)

    def extrapolated(self, finer: StepRuns) -> StepRuns:
        """The finer runs, those under the input without the second power of the step.

        Args:
            finer: the same runs, of half the step.
        """
        return StepRuns(list(map(extrapolated, self.driven, finer.driven)), finer.others)


def extrapolated(coarse: FloatArray, fine: FloatArray) -> FloatArray:
    """A run (n,) without the second power of its step, (4 y(h) - y(2h))/3.

    Args:
        coarse: of twice the step, shape (n,).
        fine: shape (n,).
    """
    return (4.0 * fine - coarse) / 3.0


def planned_steps(
    plan: StepPlan, simulated: Callable[[int], StepRuns], wanted: float, samples: int
) -> StepPlan:
    """The plan with as many steps as are wanted for an accuracy.

    Args:
        plan: with the steps to begin with.
        simulated: the trace at some parameters, for a number of steps between samples.
        wanted: largest error, relative to the largest value.
        samples: of a run.
    """
    steps, one = plan.per_sample, simulated(plan.per_sample)
    two = StepRuns()
    runs = one.count
    for _ in range(MOST_HALVINGS):
        finer = simulated(2 * steps)
        runs += finer.count
        both = one.extrapolated(finer)
        one, two = one.then(finer), two.then(both)
        if min(one.bound, two.bound) <= wanted or 4 * steps * samples > MOST_STEPS:
            break
        steps *= 2
    else:
        steps //= 2  # the last runs told of those before
    pair = bool(finer.driven) and one.bound > wanted and two.bound < one.bound
    result = two if pair else one
    return replace(
        plan,
        per_sample=steps,
        bound=result.bound,
        change=result.changed,
        runs=runs,
        extrapolated=pair,
    )


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
            **_extrapolated(plans),
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


def _extrapolated(plans: Sequence[StepPlan]) -> dict[str, Scalar]:
    """How many traces are extrapolated."""
    count = sum(plan.extrapolated for plan in plans)
    return {"extrapolated": count} if count else {}


def _few(plans: Sequence[StepPlan]) -> dict[str, Scalar]:
    """Of how many samples decays are simulated, the most, and how many follow."""
    most = max((p.few for p in plans if p.few), key=lambda few: few.samples, default=None)
    return {} if most is None else {"few": most.indices.size, "of": most.samples}


def _change(coarse: FloatArray, fine: FloatArray) -> float:
    largest = float(np.max(np.abs(fine), initial=0.0))
    return float(np.max(np.abs(fine - coarse), initial=0.0)) / largest if largest > 0.0 else 0.0
