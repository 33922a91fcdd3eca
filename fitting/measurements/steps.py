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

What an FMU's own steps leave is seen where a trace is sampled more finely than was recorded
(`Look`). Communication steps of half the length change nothing where an FMU integrates in steps of
its own that fit into either. Between these it stands still, or it divides a shorter communication
step anew. With y_k at the ends of its steps of length h, Euler's method leaves at most

    (h/2) integral |y''| dt  =  1/2 sum |y_(k+1) - 2 y_k + y_(k-1)|

of a system whose errors do not grow. Those of an oscillation may: what is off along its motion
shifts it in time, and stays. With z = (y', y''/w), w^2 = <y''^2>/<y'^2>, over all stretches in
which the input does not change, the shift after a time t and what it makes of the output are

    s(t) = (h/2) integral |z'|/|z| dt,     max |y'(t)| s(t)

which is added twice where y'' changes its sign again and again: a motion that rushes and rests, or
whose period depends on its size, is shifted by more than its mean. Where communication steps are no
multiples of h, input and output are late by a step, max |y_(k+1) - y_k|, besides. A better method
leaves less, which no observation from outside shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from fitting.fmu.runs import SampledSignal
from fitting.signal.free_decay import FewSamples
from fitting.signal.window import Window
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray, Scalar

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

    ``change`` was observed when they were halved, ``runs`` is what that took; ``own_s`` is a step
    of the FMU's own that the samples do not fit (0: none, or they do), ``internal_step_s`` one
    between whose ends its output was observed not to change, ``is_model``: which is declared to
    belong to the model, ``shifted``: which shifts an oscillation in time. ``few``: at which samples
    the response to a pulse is simulated, where all follow from them to ``tolerance``, which is
    checked in every evaluation, and to ``few_error`` in the survey; None: at all of them. Outputs
    come ``delay_steps`` steps late and are read so much later. ``grid_s``: the only communication
    step that the FMU takes, between whose ends samples are interpolated; 0: they divide a spacing.
    ``shift`` (n,), in the output's unit, is what halved steps show of the error at the solution,
    with its sign, which then takes the place of the bound; None: the bound is all that is known.
    """

    label: str
    spacing_s: float
    per_sample: int
    bound: float
    change: float = 0.0
    runs: int = 0
    own_s: float = 0.0
    internal_step_s: float = 0.0
    is_model: bool = False
    shifted: bool = False
    few: FewSamples | None = None
    tolerance: float = 0.0
    few_error: float = 0.0
    extrapolated: bool = False
    delay_steps: int = 0
    grid_s: float = 0.0
    shift: FloatArray | None = field(default=None, compare=False, repr=False)

    @property
    def step_s(self) -> float:
        """Communication step, s."""
        return self.grid_s or self.spacing_s / self.per_sample


def first_steps(spacing_s: float, own_s: float | None) -> tuple[int, float]:
    """Steps between samples to begin with, and the FMU's own step where it does not fit.

    Args:
        spacing_s: of the samples, s.
        own_s: step that the FMU declares, s; None: it declares none.
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
    ``bound`` that of the error of those; ``left`` is that error with its sign, in the output's
    unit, of each run under the input.
    """

    driven: Sequence[FloatArray] = ()
    others: Sequence[FloatArray] = ()
    changed: float = 0.0
    bound: float = np.inf
    left: Sequence[FloatArray] = ()

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
        change = max(map(relative_change, before, after))
        rho = max(0.5, change / self.changed) if self.changed > 0.0 else 0.5
        times = 1.0 / (1.0 - rho) if rho < STALLED else UNKNOWN
        left = [times * (y - x) for x, y in zip(self.driven, finer.driven, strict=True)]
        return replace(finer, changed=change, bound=times * change, left=left)

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


#: Fourth differences that bound what cubic splines leave: 5/384 of those of a smooth function, an
#: eighth of a bend, which is half of its fourth difference.
SPLINE_LEFT = 1.0 / 16.0


def interpolated(values: FloatArray, at: FloatArray) -> tuple[FloatArray, float]:
    """Values between steps by cubic splines, and what these leave at most; steps' own as they are.

    Args:
        values: at the ends of steps of one length, shape (n,), n at least 5.
        at: where they are wanted, in steps from the first on, shape (m,).
    """
    near = np.round(at).astype(np.intp)
    if np.all(np.abs(at - near) <= WHOLE * np.maximum(1.0, near)):
        return values[near], 0.0
    left = SPLINE_LEFT * float(np.max(np.abs(np.diff(values, 4))))
    return np.asarray(CubicSpline(np.arange(values.size), values)(at)), left


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
        steps //= 2  # the last runs gave the error of those before
    pair = bool(finer.driven) and one.bound > wanted and two.bound < one.bound
    result = two if pair else one
    return replace(
        plan,
        per_sample=steps,
        bound=result.bound,
        change=result.changed,
        runs=runs,
        extrapolated=pair,
        shift=result.left[0] if len(result.left) == 1 and len(one.others) == 0 else None,
    )


def step_decision(plans: Sequence[StepPlan]) -> Decision:
    """What a plan decided on the steps of all its traces.

    Args:
        plans: one for each trace.
    """
    worst = max(plans, key=lambda plan: plan.bound)
    numbers: dict[str, Scalar] = {
        "step_s": min(plan.step_s for plan in plans),
        "longest_s": max(plan.step_s for plan in plans),
        "per_sample": max(plan.per_sample for plan in plans),
        "change": worst.change,
        "runs": sum(plan.runs for plan in plans),
        "own_s": max(plan.own_s for plan in plans),
    }
    if pairs := sum(plan.extrapolated for plan in plans):
        numbers["extrapolated"] = pairs
    if any(plan.delay_steps for plan in plans):
        numbers["late"] = True
    if any(plan.grid_s for plan in plans):
        numbers["refused"] = True
    # the longest step between whose ends the FMU was seen to stand still
    if internal_step_s := max(plan.internal_step_s for plan in plans):
        numbers["stands_s"] = internal_step_s
        if any(plan.is_model for plan in plans):
            numbers["is_model"] = True
        if any(plan.shifted for plan in plans):
            numbers["shifted"] = True
    # of how many samples decays are simulated, the most, and how many follow
    if all_few := [plan.few for plan in plans if plan.few]:
        few = max(all_few, key=lambda few: few.samples)
        numbers |= {"few": few.indices.size, "of": few.samples}
    return Decision(kind=Kind.STEP, basis=Basis.HALVED, bound=worst.bound, numbers=numbers)


def relative_change(
    values: FloatArray | ComplexArray, expected: FloatArray | ComplexArray
) -> float:
    """Largest difference over the largest value expected; zero where that is zero.

    Args:
        values: shape (n,).
        expected: shape (n,), in the same unit.
    """
    largest = float(np.max(np.abs(expected), initial=0.0))
    return float(np.max(np.abs(expected - values), initial=0.0)) / largest if largest > 0.0 else 0.0


#: Communication steps of a closer look at most, and how many there are between two samples.
REFINED_STEPS, FEWEST, MOST = 8192, 4, 64
#: Moves that make a step of its own.
LEAST_MOVES = 6
#: Changes of the sign of y'' that make an oscillation: few modes that only decay have fewer.
LEAST_TURNS = 3
#: How often the shift of an oscillation is counted.
SHIFTED = 2.0
#: Of the largest value, what a difference is rounded to.
ROUNDED = 64.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Look:
    """Samples of a trace, the first or all, with ``fine`` communication steps between two of them.

    Args:
        window: of the samples.
        signal: what is held over the steps, and observed at the samples.
        fine: how many steps.
    """

    window: Window
    signal: SampledSignal
    fine: int

    @cached_property
    def closer(self) -> Window:
        """A sample after every communication step."""
        count = self.fine * (self.window.samples - 1) + 1
        step_s = self.window.step_s / self.fine
        return Window(tones_hz=(), settle_s=self.window.settle_s, step_s=step_s, samples=count)

    @cached_property
    def hold_signal(self) -> SampledSignal:
        """The same, observed at the end of every step as it was held over it.

        An output that follows its input at once then moves when the next step is over, not at its
        start, where one that stands between steps of its own does.
        """
        kept = self.signal.values
        observed = np.concatenate([kept[:1], kept])[-self.closer.samples :]
        return SampledSignal(self.signal.names, self.signal.step_s, kept, observed)

    @cached_property
    def pushed(self) -> BoolArray:
        """Whether the input changes between two steps (n - 1,)."""
        return np.asarray(np.any(np.diff(self.hold_signal.at_samples, axis=0) != 0.0, axis=1))

    def standing_s(self, values: FloatArray) -> float:
        """The step between whose ends the output stands still, s; 0: it does not.

        An output that follows its input at once moves when that does: no step of its own.

        Args:
            values: of the output, after every step (n,).
        """
        moved = np.flatnonzero(np.diff(values))
        between = np.diff(moved)
        if moved.size < LEAST_MOVES or between.min() < 2 or np.ptp(between) > 1:
            return 0.0
        if np.array_equal(moved, np.flatnonzero(self.pushed)):
            return 0.0
        return self.closer.step_s * float(np.mean(between))


def refinements(per_sample: int, samples: int) -> tuple[int, ...]:
    """Communication steps between two samples of closer looks, even multiples of those of a run.

    Args:
        per_sample: steps of a run between two samples.
        samples: of the trace.
    """
    whole = per_sample * 2 * (max(FEWEST, min(MOST, REFINED_STEPS // (per_sample * samples))) // 2)
    finer = per_sample * 2 * math.ceil(MOST / (2 * per_sample))
    return (whole, finer) if whole < finer else (whole,)


def euler_leaves(values: FloatArray, pushed: BoolArray, *, late: bool) -> tuple[float, bool]:
    """What Euler's method over steps of the FMU's own leaves, and whether it shifts an oscillation.

    It is relative to the largest value, and may be more than that: so are then the
    derivatives by a frequency that meet it.

    Args:
        values: of an output that stands still between its steps (n,).
        pushed: whether the input changes between two of them (n - 1,).
        late: whether communication steps end between its own.
    """
    largest = float(np.max(np.abs(values)))
    if largest == 0.0:
        return 0.0, False
    moves = np.diff(values)
    at = np.append(0, np.flatnonzero(moves) + 1)
    left = 0.5 * float(np.sum(np.abs(np.diff(values[at], 2))))
    if late:
        left += float(np.max(np.abs(moves)))
    times = np.append(0, np.cumsum(pushed))[at]
    shifted = _shifted(values[at] / largest, times[3:] == times[:-3])
    return left / largest + SHIFTED * shifted, shifted > 0.0


def _shifted(ends: FloatArray, still: BoolArray) -> float:
    """What the shift of an oscillation makes of values at the ends of steps; 0: it is none.

    Args:
        ends: over the largest of them (n,).
        still: whether the input does not change over three steps (n - 3,).
    """
    speed, turn, further = (np.diff(ends, k)[: still.size] for k in (1, 2, 3))
    plain = still & (np.abs(turn) > ROUNDED)
    turns = np.count_nonzero(np.diff(np.sign(turn))[plain[1:] & plain[:-1]])
    if turns < LEAST_TURNS:
        return 0.0
    w = float(np.linalg.norm(turn[still]) / np.linalg.norm(speed[still]))
    ratio = np.hypot(turn, further / w)[plain] / np.hypot(speed, turn / w)[plain]
    each = np.full(speed.size, float(np.mean(ratio)))
    each[plain] = ratio
    return float(np.max(0.5 * np.cumsum(each) * np.abs(speed)))
