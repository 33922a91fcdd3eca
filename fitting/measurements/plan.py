"""The plan of a series of measurements: settling, settings and points, with their decisions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace

from fitting.measurements.curve_plan import CurvePlan, Place, curve_decision
from fitting.measurements.traces.step_plan import StepPlan, step_decision
from fitting.signal.grid import ANY_TIME, Grid
from fitting.simulate.budget import Budget, Decision, Kind, PlanRecord
from fitting.simulate.words import decision_in_words, sum_in_words
from fitting.text.arrays import FloatArray, Scalar


@dataclass(frozen=True)
class Plan:
    """How the FMU is simulated for the measurements of one series, and what that rests on.

    `settings` are start values of the FMU that the plan chose; `order` is that of the combinations
    of tones which the response was seen to hold; `budget` holds the decisions, None where nothing
    was decided; `remarks` are sentences beside them. A sweep whose maximum sets the scale is
    simulated at `nodes_hz`: `maximum_bias` is what the maximum may be off by, `maximum_bend` (1/Hz)
    the third derivative of 1/A^2 over its second, which bounds that from three points (None: not
    known). `curves` tell how responses over frequency are simulated, `steps` by which communication
    steps traces are. `grid`: at which times the FMU is asked for tones.
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
        result = (c for c in self.curves if c.place == place and c.holds(frequency_hz))
        return next(result, None)

    def with_curve(self, curve: CurvePlan) -> Plan:
        """The plan with a further curve; one decision tells of all of them.

        Args:
            curve: how a response over frequency is simulated.
        """
        curves = (*self.curves, curve)
        if self.budget is None:
            return replace(self, curves=curves)
        others = tuple(d for d in self.budget.decisions if d.kind != Kind.CURVE)
        budget = Budget(self.budget.wanted, (*others, curve_decision(curves)))
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
        """The plan with the steps of a trace, a further one or anew; one decision tells of all.

        Args:
            result: for the trace.
        """
        steps = (*(plan for plan in self.steps if plan.label != result.label), result)
        if self.budget is None:
            return replace(self, steps=steps)
        others = tuple(d for d in self.budget.decisions if d.kind != Kind.STEP)
        budget = Budget(self.budget.wanted, (*others, step_decision(steps)))
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
    def has_long_steps(self) -> bool:
        """Whether free decays are simulated at few samples, with long steps between these."""
        return any(steps.few is not None for steps in self.steps)

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
        return (*map(_sentence, self.budget.decisions), sum_in_words(self.budget), *self.remarks)

    @property
    def record(self) -> PlanRecord | None:
        """The plan for a result."""
        return None if self.budget is None else self.budget.record(self.settings)


def _sentence(decision: Decision) -> str:
    text = decision_in_words(decision)
    return f"{text[0].upper()}{text[1:]}."
