"""Traces of one kind that are fitted together, and the survey of each by runs of the FMU.

The survey plans a trace's communication step and examines an unknown start. It serves every kind of
trace whose runs begin with the record: samples of an output, or what a demodulator makes of them.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from scipy.linalg import block_diag

from fitting.fmu.description import INTEGRATOR_TOLERANCE, USUAL_TOLERANCE
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.gain import Solved
from fitting.measurements.measurement import Predicting, Prediction
from fitting.measurements.plan import Plan
from fitting.measurements.records import Together
from fitting.measurements.steps import (
    MOST_STEPS,
    REFINED_STEPS,
    StepPlan,
    StepRuns,
    euler_leaves,
    extrapolated,
    first_steps,
    planned_steps,
    refinements,
)
from fitting.measurements.time_record import TimeRecord, ask_decay, few_samples, read_decay
from fitting.simulate.batch import Batch, Workers
from fitting.simulate.budget import Kind as Decided
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

T = TypeVar("T", bound=TimeRecord)

#: Change of a response to half a pulse, doubled, above which an FMU is not linear.
NONLINEAR = 1e-6
#: Of the accuracy that is left, what decays of few samples may cost, and the part of that which
#: they may at the points of the survey.
SHARE, MARGIN = 0.03, 0.1
#: An error below which no more samples are tried, and the part of an error that more of them are
#: taken for.
GOAL, BETTER = 1e-11, 0.1
#: How far a communication step may be from whole steps of the FMU's own, as seen, relative.
UNEVEN = 0.01
#: How much coarser equations are integrated to see what the tolerance leaves, and which part of
#: that change: the error goes as the tolerance, so that a hundredth would do.
COARSER, LEFT = 100.0, 0.1
#: A change below this is none.
ROUNDING = 1e-16


class RequestedRuns(NamedTuple):
    """Numbers of the runs that answer for a trace; None: it wants none.

    Args:
        driven: under its input.
        decay: after a pulse; of a few samples where the plan has few.
        further: whatever else.
        coarse: as `driven`, of half as many steps: both are extrapolated.
    """

    driven: int | None = None
    decay: int | None = None
    further: int | None = None
    coarse: int | None = None

    def under_input(self, batch: Batch, output: str) -> FloatArray | None:
        """The output (n,) under the input; None: none was asked for.

        Args:
            batch: that has simulated the runs.
            output: its name.
        """
        if self.driven is None:
            return None
        fine = batch.samples(self.driven, output)
        if self.coarse is None:
            return fine
        return extrapolated(batch.samples(self.coarse, output), fine)


@dataclass(frozen=True)
class Survey(Generic[T]):
    """Runs of one trace of a kind, as its series drives the FMU."""

    kind: TracesTogether[T]
    trace: T
    model: DrivenModel
    workers: Workers
    batch: Batch = field(default_factory=Batch)

    @property
    def output(self) -> str:
        """The FMU's output that the trace shows."""
        return self.kind.output_of(self.trace)

    def planned(self, points: Sequence[FloatArray]) -> Plan:
        """The model's plan with the communication step of the trace.

        Args:
            points: parameter vectors (n,); the FMU may refuse all but the first.

        Raises:
            BadInput: an unknown start of an FMU that is not linear.
        """
        plan, trace = self.model.plan, self.trace
        own_s = None if trace.is_demodulated else self.model.own_step_s
        count, misfit_s = first_steps(trace.run_step_s, own_s)
        first = replace(self._plan(count), own_s=misfit_s)
        self._refuse_nonlinear(points[0], count)
        kept = self._that_run(points, count)
        left = plan.budget.left if plan.budget is not None else self.kind.setup.accuracy
        left /= trace.value_share  # steps are compared by the largest value, the budget by rows
        runs = partial(self._simulated, kept)
        steps = planned_steps(first, runs, left, trace.run_samples)
        steps = self._integrated(kept, self._refined(kept, steps, left))
        if trace.has_unknown_start and self.model.any_steps and steps.per_sample == 1:
            steps = self._of_few_samples(kept, steps, left)
        return plan.with_steps(replace(steps, bound=trace.value_share * steps.bound))

    def reviewed(self, p: FloatArray) -> Plan:
        """The model's plan with what the steps of the trace leave at further parameters.

        Steps that leave more than was wanted are shortened, where that helps.

        Args:
            p: parameters (n,) that the FMU takes.
        """
        plan = self.model.plan
        before = plan.step_plan(self.kind.key(self.trace))
        if before is None or plan.budget is None:
            return plan
        share = self.trace.value_share
        left = max(0.0, plan.budget.remaining_for(Decided.STEP)) / share
        runs = partial(self._simulated, [p])
        coarsest = before.per_sample // 2 if before.extrapolated else before.per_sample
        started = replace(before, per_sample=coarsest)
        try:
            steps = planned_steps(started, runs, left, self.trace.run_samples)
            steps = self._refined([p], steps, left)
            steps = replace(steps, bound=share * steps.bound)
        except NoAnswer:
            raise
        except FmuFailure:  # it refuses shorter steps there
            return plan
        if steps.per_sample > before.per_sample:
            return plan.with_steps(replace(steps, runs=before.runs + steps.runs))
        if not steps.internal_step_s and steps.bound <= max(before.bound, share * left):
            return plan
        longest = max(before.internal_step_s, steps.internal_step_s)
        shifted = before.shifted or steps.shifted
        return plan.with_steps(
            replace(before, bound=steps.bound, internal_step_s=longest, shifted=shifted)
        )

    def _integrated(self, points: Sequence[FloatArray], steps: StepPlan) -> StepPlan:
        """The steps with what the integration of the FMU's equations leaves, where it is done here.

        Args:
            points: parameter vectors (n,) that the FMU takes.
            steps: as they were planned.
        """
        if not self.model.integrated:
            return steps
        plan, name = self.model.plan, INTEGRATOR_TOLERANCE.name
        within = float(plan.settings.get(name, USUAL_TOLERANCE))
        settings = {**plan.settings, name: COARSER * within}
        coarse = replace(self, model=replace(self.model, plan=replace(plan, settings=settings)))
        here = self._simulated(points[:1], steps.per_sample)
        change = coarse._simulated(points[:1], steps.per_sample).then(here).changed
        runs = steps.runs + 2 * here.count
        return replace(steps, runs=runs, bound=steps.bound + LEFT * change)

    def _refined(self, points: Sequence[FloatArray], steps: StepPlan, left: float) -> StepPlan:
        """The steps with what the FMU's own leave, which half a communication step did not show.

        The whole record is sampled as finely as `REFINED_STEPS` steps allow, then its beginning
        more finely: steps of its own may be shorter than those of the first look.

        Args:
            points: parameter vectors (n,) that the FMU takes.
            steps: as halving found them.
            left: accuracy that is still to be had.
        """
        count = steps.per_sample
        for fine in refinements(count, self.trace.run_samples):
            steps = self._refined_once(points, steps, left, fine)
            if steps.internal_step_s or steps.per_sample != count:
                break
        return steps

    def _refined_once(
        self, points: Sequence[FloatArray], steps: StepPlan, left: float, fine: int
    ) -> StepPlan:
        """The same by one look with so many steps between two samples."""
        trace, batch = self.trace, self.batch
        look = trace.look(fine)
        if look is None:
            return steps
        values = self.kind.start_values(self.model, trace, points[0])
        output = self.output
        requested = [
            batch.ask(values, look.closer, look.hold_signal, output),
            batch.ask(values, look.window, look.signal, output),
        ]
        half = trace.look(fine // 2, REFINED_STEPS // 2) if steps.extrapolated else None
        if half is not None:
            requested.append(batch.ask(values, half.window, half.signal, output))
        try:
            batch.simulate(self.workers)
        except NoAnswer:
            raise
        except FmuFailure:  # it refuses short steps
            batch.forget()
            return steps
        observed = batch.samples(requested[0], output)
        finest = RequestedRuns(
            driven=requested[1], coarse=requested[2] if half is not None else None
        )
        internal_step_s, runs = look.standing_s(observed), steps.runs + len(requested)
        if internal_step_s:
            return self._standing(
                values, replace(steps, runs=runs, internal_step_s=internal_step_s)
            )
        runs_planned = self.kind.ask(self._with(steps), trace, points[0], batch, 0)
        batch.simulate(self.workers)
        coarse = runs_planned.under_input(batch, output)
        if coarse is None:
            raise TypeError(f"{trace.source}: nothing drives it")
        change = _change(coarse[: look.window.samples], finest.under_input(batch, output))
        if change <= steps.bound or 2.0 * change <= left:
            bound = steps.bound if change <= steps.bound else 2.0 * change
            return replace(steps, runs=runs, bound=bound)
        finer = planned_steps(
            replace(steps, per_sample=fine),
            partial(self._simulated, points),
            left,
            trace.run_samples,
        )
        return replace(finer, runs=runs + finer.runs)

    def _standing(self, values: Mapping[str, Scalar], steps: StepPlan) -> StepPlan:
        """The steps with what Euler's method leaves over all steps of the FMU's own.

        Args:
            values: start values of the FMU.
            steps: between which it stands still.
        """
        fine = max(1, math.ceil((1.0 - UNEVEN) * steps.spacing_s / steps.internal_step_s))
        look = self.trace.look(fine, MOST_STEPS)
        if look is None:
            return steps
        run = self.batch.ask(values, look.closer, look.hold_signal, self.output)
        self.batch.simulate(self.workers)
        count = steps.step_s / steps.internal_step_s
        late = abs(count - round(count)) > UNEVEN * count
        left, shifts = euler_leaves(self.batch.samples(run, self.output), look.pushed, late=late)
        return replace(
            steps,
            runs=steps.runs + 1,
            bound=steps.bound + left,
            shifted=steps.shifted or shifts,
        )

    def _of_few_samples(
        self, points: Sequence[FloatArray], steps: StepPlan, left: float
    ) -> StepPlan:
        """The steps with the few samples of a decay from which all follow; else as they are.

        At all points they are compared with the whole run. What the FMU's solver makes of a long
        communication step is not known: where it is not exact, nothing follows.

        Args:
            points: parameter vectors (n,) that the FMU takes.
            steps: of whole runs.
            left: accuracy that is still to be had.
        """
        most = SHARE * max(0.0, left - steps.bound)
        best, least = steps, MARGIN * most
        for few in few_samples(self.trace.pulse_window.samples):
            decays, values = self._misfit(points, replace(steps, few=few, tolerance=most))
            error = max(decays, values)
            if error <= least:
                gain = max(1.0, values / max(decays, ROUNDING))
                bound = steps.bound + most
                best = replace(steps, bound=bound, few=few, tolerance=most / gain, few_error=error)
                least = BETTER * error
            if error <= GOAL:
                break
        return best

    def _misfit(self, points: Sequence[FloatArray], steps: StepPlan) -> tuple[float, float]:
        """What few samples change most, relative: whole decays, and the trace as it follows.

        The trace is a combination of decays: where lines are near, small differences of these are
        large ones of it.
        """
        trace, kind, batch = self.trace, self.kind, self.batch
        output, plan = self.output, self._plan(1)
        requested = [
            (
                kind.ask(self._with(plan), trace, p, batch, 0),
                kind.ask(self._with(steps), trace, p, batch, 0),
            )
            for p in points
        ]
        try:
            batch.simulate(self.workers)
        except NoAnswer:
            raise
        except FmuFailure:  # it refuses long steps
            batch.forget()
            return np.inf, np.inf
        worst = [(0.0, 0.0)]
        for whole, few in requested:
            decays = [
                None if runs.decay is None else read_decay(how, batch, runs.decay, output)
                for runs, how in ((whole, plan), (few, steps))
            ]
            if decays[0] is None or decays[1] is None:
                return np.inf, np.inf
            before, after = (kind.read(trace, whole, decay, batch)[0] for decay in decays)
            worst.append((_change(*decays), _change(after, before)))
        return max(d for d, _ in worst), max(v for _, v in worst)

    def _plan(self, per_sample: int) -> StepPlan:
        """So many steps between two samples, and whole runs."""
        return StepPlan(
            label=self.kind.key(self.trace),
            spacing_s=self.trace.run_step_s,
            per_sample=per_sample,
            bound=0.0,
        )

    def _with(self, steps: StepPlan) -> DrivenModel:
        """The model with these steps of the trace."""
        return replace(self.model, plan=replace(self.model.plan, steps=(steps,)))

    def _simulated(self, points: Sequence[FloatArray], per_sample: int) -> StepRuns:
        """Outputs of its runs at all points, with so many steps between two samples."""
        model, batch = self._with(self._plan(per_sample)), self.batch
        output = self.output
        requested = [self.kind.ask(model, self.trace, p, batch, 0) for p in points]
        batch.simulate(self.workers)
        others = [
            run for runs in requested for run in (runs.decay, runs.further) if run is not None
        ]
        return StepRuns(
            [batch.samples(runs.driven, output) for runs in requested if runs.driven is not None],
            [batch.samples(run, output) for run in others],
        )

    def _that_run(self, points: Sequence[FloatArray], per_sample: int) -> list[FloatArray]:
        """The points that the FMU takes, the first in any case: it may refuse a part of the box."""
        kept = [points[0]]
        for p in points[1:]:
            try:
                self._simulated([p], per_sample)
            except NoAnswer:
                raise
            except FmuFailure:
                self.batch.forget()
                continue
            kept.append(p)
        return kept

    def _refuse_nonlinear(self, p: FloatArray, per_sample: int) -> None:
        """Complain of an unknown start where half a pulse does not give half the response."""
        trace = self.trace
        if not trace.has_unknown_start:
            return
        values = self.kind.start_values(self.model, trace, p)
        output, batch = self.output, self.batch
        runs = [
            batch.ask(values, trace.pulse_window, trace.pulse(per_sample, level), output)
            for level in (1.0, 0.5)
        ]
        batch.simulate(self.workers)
        whole, half = (batch.samples(run, output) for run in runs)
        largest = float(np.max(np.abs(whole)))
        if largest == 0.0:
            raise BadInput(
                f"{trace.source}: '{output}' does not answer to a pulse at the input "
                f"'{trace.input}'; wanted an input that excites it"
            )
        off = float(np.max(np.abs(2.0 * half - whole))) / largest
        if off > NONLINEAR:
            raise BadInput(
                f'{trace.source}: start = "unknown" wants a linear FMU: half a pulse at '
                f"'{trace.input}' gives {off:.1e} more or less than half the response; wanted "
                "one whose own drive is off ([fmu.start], as A1 = 0.0), else start values among "
                "the parameters"
            )


def _change(
    result: FloatArray | ComplexArray | None, expected: FloatArray | ComplexArray | None
) -> float:
    """Largest difference over the largest value."""
    if result is None or expected is None:
        return np.inf
    largest = float(np.max(np.abs(expected)))
    return float(np.max(np.abs(result - expected))) / largest if largest > 0.0 else 0.0


R = TypeVar("R", bound=TimeRecord)


@dataclass(frozen=True, kw_only=True)
class TracesTogether(Together[R]):
    """One or several traces of one kind."""

    FIELD = "traces"
    #: What precedes the labels of a kind in the plan.
    GROUP: ClassVar[str] = ""

    traces: tuple[R, ...] = field(default=())

    @property
    def is_trace(self) -> bool:
        """Its rows are samples over time, with which its runs begin."""
        return True

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The plan with the communication step of every trace."""
        plan = model.plan
        for trace in self.traces:
            survey = Survey(self, trace, replace(model, plan=plan), workers)
            plan = survey.planned(points)
        return plan

    def reviewed(self, model: DrivenModel, p: FloatArray, workers: Workers) -> Plan:
        """The plan with what the communication step of every trace leaves there.

        Args:
            model: the FMU as the series drives it.
            p: parameters (n,), each in its own unit.
            workers: of the FMU.
        """
        plan = model.plan
        for trace in self.traces:
            plan = Survey(self, trace, replace(model, plan=plan), workers).reviewed(p)
        return plan

    def key(self, trace: R) -> str:
        """What the plan knows a trace by.

        Args:
            trace: one of them.
        """
        return f"{self.series}/{self.GROUP}{trace.label}"

    def start_values(self, model: DrivenModel, trace: R, p: FloatArray) -> dict[str, Scalar]:
        """Start values of the runs of a trace, of the whole model.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
        """
        return model.whole.values(p, trace.label or None, trace.settings)

    def ask(
        self, model: DrivenModel, trace: R, p: FloatArray, batch: Batch, owner: int
    ) -> RequestedRuns:
        """Numbers of the runs that answer for a trace.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        raise NotImplementedError

    def read(
        self, trace: R, runs: RequestedRuns, decay: FloatArray | None, batch: Batch
    ) -> tuple[FloatArray | ComplexArray, FloatArray]:
        """Values (n,) of a trace as the model has it, and derivatives (rows, k) of its rows.

        The derivatives are those by what is solved inside.

        Args:
            trace: one of them.
            runs: numbers of its runs.
            decay: after a pulse, whole; None: it wants none.
            batch: that has simulated them.
        """
        raise NotImplementedError

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Values of every trace, with the best of what is solved inside."""
        requested = [
            [self.ask(model, trace, p, batch, k) for trace in self.traces]
            for k, p in enumerate(table)
        ]
        yield
        decays = yield from self.decays(model, table, requested, batch)
        result: list[Prediction] = []
        for each, free in zip(requested, decays, strict=True):
            trios = zip(self.traces, each, free, strict=True)
            values, designs = zip(*(self.read(*trio, batch) for trio in trios), strict=True)
            solved = tuple(Solved(design, np.empty(0)) for design in designs)
            result.append(Prediction(np.concatenate(values), solved=solved))
        return result

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """Derivatives of the rows by what is solved inside."""
        return np.asarray(block_diag(*self.solved_blocks(prediction)))

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """A stretch for each trace."""
        return [solved.design for solved in prediction.solved]

    def decays(
        self,
        model: DrivenModel,
        table: FloatArray,
        requested: Sequence[Sequence[RequestedRuns]],
        batch: Batch,
    ) -> Generator[None, None, list[list[FloatArray | None]]]:
        """Responses to a pulse, for every parameter vector and trace; None where none was asked.

        Where they do not follow from few samples, the batch is asked for whole runs.

        Args:
            model: the FMU as the series drives it.
            table: parameter vectors (k, n), each in its own unit.
            requested: runs that the batch has simulated.
            batch: that has.
        """
        result: list[list[FloatArray | None]] = [[None] * len(self.traces) for _ in table]
        again: dict[tuple[int, int], int] = {}
        for i, trace in enumerate(self.traces):
            plan, output = model.plan.step_plan(self.key(trace)), self.output_of(trace)
            for k, p in enumerate(table):
                run = requested[k][i].decay
                if run is None:
                    continue
                result[k][i] = whole = (
                    batch.samples(run, output)
                    if plan is None
                    else read_decay(plan, batch, run, output)
                )
                if whole is None:
                    values = self.start_values(model, trace, p)
                    again[k, i] = ask_decay(trace, values, None, batch, output, k)
        if again:
            yield
        for (k, i), run in again.items():
            result[k][i] = batch.samples(run, self.output_of(self.traces[i]))
        return result
