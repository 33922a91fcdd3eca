"""The plan of a series of measurements: settling, settings and points, with their decisions.

A `CurvePlan` states at which few frequencies a response over frequency is simulated, or all. Its
bound is a tolerance that every evaluation checks itself against, so it is a promise for all
parameters, not for those alone at which the plan was made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.measurements.steps import StepPlan, step_decision
from fitting.signal.grid import ANY_TIME, Grid
from fitting.signal.rational import Interpolation
from fitting.simulate.budget import Basis, Budget, Decision, Kind, PlanRecord
from fitting.simulate.words import decision_in_words, sum_in_words
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray, IntArray, Scalar

#: Changes by values that are left out give the error to this factor (300 random scenes, with and
#: without noise: tests/bench/bench_curve.py).
SAFETY = 5.0


@dataclass(frozen=True, kw_only=True)
class Place:
    """Output and settings of a response; `label` of the place, None where it has none."""

    output: str
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    label: str | None = None


@dataclass(frozen=True, kw_only=True)
class CurvePlan:
    """Runs for the response of one place over `points` frequencies, from `low_hz` to `high_hz`.

    Interpolated, where `basis` is RATIONAL, between `supports_hz` (m,) and `others_hz` (m,) to
    within `tolerance` of itself, with one run at half the drive that has `half_hz` among its tones.
    A run has `tones` of them, which changes responses by no more than `superposed`, relative. Else
    every point is simulated: `error` is the relative error that stood in the way, `tolerance` what
    was wanted, `tried` the number of runs that were not enough.
    """

    place: Place
    low_hz: float
    high_hz: float
    points: int
    basis: Basis
    tolerance: float
    supports_hz: tuple[float, ...] = ()
    others_hz: tuple[float, ...] = ()
    half_hz: float = 0.0
    tones: int = 1
    superposed: float = 0.0
    error: float = 0.0
    tried: int = 0

    @property
    def is_interpolated(self) -> bool:
        """Whether fewer runs than points are made."""
        return self.basis == Basis.RATIONAL

    @property
    def nodes_hz(self) -> FloatArray:
        """Frequencies of the runs at the full drive, supports first, Hz."""
        return np.array([*self.supports_hz, *self.others_hz])

    @property
    def runs(self) -> int:
        """Runs of an evaluation, where its checks hold."""
        return len(self.groups) + 1 if self.is_interpolated else self.points

    @property
    def bound(self) -> float:
        """Relative error that the interpolation and the superposed tones may cost."""
        return self.tolerance + self.superposed

    @cached_property
    def groups(self) -> tuple[IntArray, ...]:
        """Positions in `nodes_hz` of the tones of every run, as far apart as they can be."""
        order, runs = np.argsort(self.nodes_hz), self.nodes_hz.size // self.tones
        return tuple(order[k::runs] for k in range(runs))

    @cached_property
    def half_run(self) -> int:
        """Which of `groups` has `half_hz`."""
        return next(k for k, g in enumerate(self.groups) if self.half_hz in self.nodes_hz[g])

    def drafted(
        self, points_hz: FloatArray, values: ComplexArray, half: ComplexArray
    ) -> tuple[ComplexArray, BoolArray]:
        """Interpolations at several parameter vectors (k, m), and which of them are known (k,).

        Args:
            points_hz: frequencies that are wanted (m,), Hz.
            values: at `nodes_hz`, shape (k, 2 m).
            half: by half the drive at `half_hz`, shape (k,).
        """
        result = self.interpolation(values).at(points_hz)
        here = values[:, self.nodes_hz == self.half_hz][:, 0]
        largest = np.max(np.abs(result.values), axis=1)
        with np.errstate(all="ignore"):
            known = SAFETY * np.max(result.uncertainty, axis=1) <= self.tolerance
            known &= grown_change(here, half, largest) <= self.tolerance
        return result.values, known

    def interpolation(self, values: ComplexArray) -> Interpolation:
        """The interpolation of what was simulated at its nodes.

        Args:
            values: at `nodes_hz`, shape (2 m,), or (k, 2 m) of several at once.
        """
        m = len(self.supports_hz)
        return Interpolation(
            supports_hz=np.array(self.supports_hz),
            supports=values[..., :m],
            others_hz=np.array(self.others_hz),
            others=values[..., m:],
        )


def curve_decision(curves: Sequence[CurvePlan]) -> Decision:
    """One decision for all curves of a plan: an amplitude belongs to one of them.

    Args:
        curves: of the plan, one at least.
    """
    taken = [c for c in curves if c.is_interpolated]
    numbers: dict[str, Scalar] = {
        "curves": len(curves),
        "interpolated": len(taken),
        "points": sum(c.points for c in curves),
        "runs": sum(c.runs for c in curves),
    }
    if taken:
        numbers["degree"] = max(len(c.supports_hz) - 1 for c in taken)
        numbers["safety"] = SAFETY
        numbers["tones"] = max(c.tones for c in taken)
        bound = max(c.bound for c in taken)
        return Decision(kind=Kind.CURVE, basis=Basis.RATIONAL, bound=bound, numbers=numbers)
    worst = max(curves, key=lambda c: c.error)
    numbers |= {"found": worst.error, "wanted": worst.tolerance, "tried": worst.tried}
    bound = min(worst.error, 1.0)
    return Decision(kind=Kind.CURVE, basis=worst.basis, bound=bound, numbers=numbers, taken=False)


def grown_change(whole: ComplexArray, half: ComplexArray, largest: FloatArray) -> FloatArray:
    """Bound of the relative change at any point by halving the drive, but for the half, (k,).

    What is not linear grows with the square of the response, at the least, and shifts a resonance,
    by which the response changes the more the larger it is.

    Args:
        whole: responses at one frequency, shape (k,).
        half: to half the drive, there, shape (k,).
        largest: sizes of the responses at any point, shape (k,).
    """
    with np.errstate(all="ignore"):
        change = np.abs(2.0 * half / whole - 1.0)
        grown = change * np.maximum(1.0, largest / np.abs(whole)) ** 3
    return np.where(np.isfinite(grown), grown, np.inf)


@dataclass(frozen=True, kw_only=True)
class DraftedCurve:
    """An interpolation at one parameter vector that is to hold at `points` (m,) to a `tolerance`.

    `half` is the response to half the drive at `half_hz`.
    """

    points: FloatArray
    tolerance: float
    curve: Interpolation
    half_hz: float
    half: complex

    @cached_property
    def values(self) -> ComplexArray:
        """Phasors (m,) as they are interpolated."""
        return self.curve.function(self.points)

    @cached_property
    def _top_hz(self) -> float:
        sizes = np.nan_to_num(np.abs(self.values))
        return float(self.points[int(np.argmax(sizes))])

    @cached_property
    def uncertainty(self) -> float:
        """Bound of the relative error of the interpolation at any point."""
        return SAFETY * float(np.max(self.curve.uncertainty(self.points)))

    @cached_property
    def nonlinearity(self) -> float:
        """Bound of the relative change at any point by halving the drive, but for the half."""
        here = complex(self.curve.function(np.array([self.half_hz]))[0])
        largest = float(np.max(np.abs(self.values)))
        return float(grown_change(np.array([here]), np.array([self.half]), np.array([largest]))[0])

    @property
    def is_known(self) -> bool:
        """Whether both bounds keep to the tolerance."""
        return self.uncertainty <= self.tolerance and self.nonlinearity <= self.tolerance

    @property
    def may_become_known(self) -> bool:
        """Whether further runs can make both bounds known."""
        if self.uncertainty > self.tolerance:
            return self.curve.frequency_hz.size + 2 < self.points.size
        return self.nonlinearity > self.tolerance and self.half_hz != self._top_hz

    @property
    def wanted_hz(self) -> tuple[tuple[float, ...], float]:
        """Frequencies of further runs, Hz, and the part of the drive that they have."""
        if self.uncertainty > self.tolerance:
            return self.curve.wanted_hz(self.points), 1.0
        return (self._top_hz,), 0.5

    def with_values(self, frequency_hz: tuple[float, ...], values: ComplexArray) -> DraftedCurve:
        """The draft with the answers to what it wanted.

        Args:
            frequency_hz: as `wanted_hz` gave them.
            values: phasors there.
        """
        if len(frequency_hz) == 1:
            return replace(self, half_hz=frequency_hz[0], half=complex(values[0]))
        one, other = frequency_hz
        return replace(self, curve=self.curve.with_values((one, other), values))


@dataclass(frozen=True)
class Plan:
    """How the FMU is simulated for the measurements of one series, and what that rests on.

    `settings` are start values of the FMU that the plan chose; `order` is that of the combinations
    of tones which the response was observed to hold; `budget` holds the decisions, None where
    nothing was decided; `remarks` are sentences with them. A sweep whose maximum sets the scale is
    simulated at `nodes_hz`: `maximum_bias` is what the maximum may be off by, `maximum_bend` (1/Hz)
    the third derivative of 1/A^2 over its second, which bounds that from three points (None: not
    known). `curves` are the runs for responses over frequency, `steps` the communication steps of
    traces. `grid`: at which times the FMU is asked for tones.
    """

    settle_s: float
    _: KW_ONLY
    budget: Budget | None = None
    order: int = 1
    nodes_hz: tuple[float, ...] = ()
    remarks: tuple[str, ...] = ()
    settings: Mapping[str, Scalar] = field(default_factory=dict)
    maximum_bias: float | None = None
    maximum_bend: float | None = None
    curves: tuple[CurvePlan, ...] = ()
    steps: tuple[StepPlan, ...] = ()
    grid: Grid = ANY_TIME

    def curve(self, place: Place, frequency_hz: FloatArray) -> CurvePlan | None:
        """What was planned for a response at these frequencies; None: nothing was.

        Args:
            place: output and settings.
            frequency_hz: where it is wanted, Hz.
        """
        low_hz, high_hz = np.min(frequency_hz, initial=np.inf), np.max(frequency_hz, initial=0.0)
        mine = (c for c in self.curves if c.place == place)
        return next((c for c in mine if c.low_hz <= low_hz and high_hz <= c.high_hz), None)

    def with_curve(self, curve: CurvePlan) -> Plan:
        """The plan with a further curve; one decision covers all of them.

        Args:
            curve: how a response over frequency is simulated.
        """
        curves = (*self.curves, curve)
        budget = self.budget and self.budget.with_instead(curve_decision(curves))
        return replace(self, curves=curves, budget=budget)

    def with_decision(self, decision: Decision) -> Plan:
        """The plan with a further decision, the first of all.

        Args:
            decision: of the plan.
        """
        if self.budget is None:
            return self
        return replace(self, budget=Budget(self.budget.wanted, (decision, *self.budget.decisions)))

    def step_plan(self, label: str) -> StepPlan | None:
        """What was planned for a trace; None: nothing was.

        Args:
            label: of the trace.
        """
        return next((plan for plan in self.steps if plan.label == label), None)

    def with_steps(self, result: StepPlan) -> Plan:
        """The plan with the steps of a trace, a further one or anew; one decision covers all.

        Args:
            result: for the trace.
        """
        steps = (*(plan for plan in self.steps if plan.label != result.label), result)
        budget = self.budget and self.budget.with_instead(step_decision(steps))
        return replace(self, steps=steps, budget=budget)

    def runs_as(self, other: Plan) -> bool:
        """Whether it asks the FMU for the same runs of traces, whatever either promises.

        Args:
            other: plan of the same series.
        """
        return {x.label: x.per_sample for x in self.steps} == {
            x.label: x.per_sample for x in other.steps
        }

    @property
    def of_whole_runs(self) -> Plan:
        """The same with free decays at all samples."""
        return replace(self, steps=tuple(replace(steps, few=None) for steps in self.steps))

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Every choice with its bound."""
        return () if self.budget is None else self.budget.decisions

    @property
    def promised(self) -> float:
        """Sum of the bounds, NaN where nothing was decided."""
        return float("nan") if self.budget is None else self.budget.promised

    @property
    def sentences(self) -> tuple[str, ...]:
        """The plan for a report: a line per decision, the sum, remarks."""
        if self.budget is None:
            return self.remarks
        words = map(decision_in_words, self.budget.decisions)
        sentences = (f"{text[0].upper()}{text[1:]}." for text in words)
        return (*sentences, sum_in_words(self.budget), *self.remarks)

    @property
    def record(self) -> PlanRecord | None:
        """The plan for a result."""
        return None if self.budget is None else self.budget.record(self.settings)
