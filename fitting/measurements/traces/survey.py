"""Survey of a trace: runs by which its communication step is planned, and an unknown start checked.

It serves every kind of trace whose runs begin with the record: samples of an output, or what a
demodulator makes of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from fitting.campaign import Setup
from fitting.fmu import HeldSignal
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.measurements.traces.decay_run import ask_decay, few_samples, read_decay
from fitting.measurements.traces.step_plan import StepPlan, first_steps, planned_steps
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Workers
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

#: Change of a response to half a pulse, doubled, above which an FMU is not linear.
NONLINEAR = 1e-6
#: Of the accuracy that is left, what decays of few samples may cost, and the part of that which
#: they may at the points of the survey.
SHARE, MARGIN = 0.01, 0.1
#: An error below which no more samples are tried. Elsewhere it may be so many times as large as at
#: the points of the survey, or as rounding is.
GOAL, WORSE, FLOOR = 1e-11, 100.0, 1e-10


class Asked(NamedTuple):
    """Numbers of the runs that answer for a trace; None: it wants none.

    Args:
        driven: under its input.
        decay: after a pulse; of a few samples where the plan says so.
        further: whatever else.
    """

    driven: int | None = None
    decay: int | None = None
    further: int | None = None


class Begun(Protocol):
    """A trace whose runs begin with the record."""

    @property
    def source(self) -> str:
        """What complaints name it by."""

    @property
    def label(self) -> str:
        """Its name."""

    @property
    def input(self) -> str:
        """The FMU's input that is driven."""

    @property
    def settings(self) -> Mapping[str, Scalar]:
        """Start values of the FMU during the trace."""

    @property
    def run_step_s(self) -> float:
        """Spacing of the samples of its runs, s."""

    @property
    def run_samples(self) -> int:
        """How many samples its longest run has."""

    @property
    def has_own_steps(self) -> bool:
        """Whether its runs begin with the step that the FMU was made for."""

    @property
    def has_unknown_start(self) -> bool:
        """Whether it rests on free responses, which a pulse gives."""

    @property
    def pulse_window(self) -> Window:
        """Samples of the response to a pulse."""

    def pulse(self, per_sample: int, level: float = 1.0) -> HeldSignal:
        """A short pulse at the input.

        Args:
            per_sample: steps between two samples.
            level: of the pulse, in the FMU's unit.
        """


T = TypeVar("T", bound=Begun)
T_contra = TypeVar("T_contra", bound=Begun, contravariant=True)


class Kind(Protocol[T_contra]):
    """Traces of one kind of one series."""

    @property
    def setup(self) -> Setup:
        """What is observed, and how accurately."""

    def key(self, trace: T_contra) -> str:
        """What the plan knows a trace by."""

    def output(self, trace: T_contra) -> str:
        """The FMU's output that a trace shows."""

    def ask(
        self, model: DrivenModel, trace: T_contra, p: FloatArray, batch: Batch, owner: int
    ) -> Asked:
        """Numbers of the runs that answer for a trace."""


@dataclass(frozen=True)
class Survey(Generic[T]):
    """Runs of one trace of a kind, as its series drives the FMU."""

    kind: Kind[T]
    trace: T
    model: DrivenModel
    workers: Workers

    def planned(self, points: Sequence[FloatArray]) -> Plan:
        """The model's plan with the communication step of the trace.

        Args:
            points: parameter vectors (n,); the FMU may refuse all but the first.

        Raises:
            BadInput: an unknown start of an FMU that is not linear.
        """
        plan, trace = self.model.plan, self.trace
        own_s = self.model.own_step_s if trace.has_own_steps else None
        steps, misfit_s = first_steps(trace.run_step_s, own_s)
        first = StepPlan(
            label=self.kind.key(trace),
            spacing_s=trace.run_step_s,
            per_sample=steps,
            bound=0.0,
            own_s=misfit_s,
        )
        self._refuse_nonlinear(points[0], steps)
        kept = self._that_run(points, steps)
        left = plan.budget.left if plan.budget is not None else self.kind.setup.accuracy
        runs = partial(self._simulated, kept)
        steps = planned_steps(first, runs, left, trace.run_samples)
        if own_s is None and steps.per_sample == 1:
            steps = self._of_few_samples(kept, steps, left)
        return plan.with_steps(steps)

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
        trace, most = self.trace, SHARE * max(0.0, left - steps.bound)
        if not trace.has_unknown_start or most <= 0.0:
            return steps
        best = steps
        for few in few_samples(trace.pulse_window.samples):
            error = self._misfit(points, replace(steps, few=few, tolerance=most))
            if error <= MARGIN * most and (best.few is None or error < best.few_error):
                tolerance = min(most, max(FLOOR, WORSE * error))
                best = replace(steps, few=few, tolerance=tolerance, few_error=error)
            if best.few is not None and best.few_error <= GOAL:
                break
        return replace(best, bound=steps.bound + best.tolerance)

    def _misfit(self, points: Sequence[FloatArray], steps: StepPlan) -> float:
        """Largest difference of whole decays from those of few samples, over their largest."""
        trace, output, batch = self.trace, self.kind.output(self.trace), Batch()
        asked = []
        for p in points:
            values = self.model.values(p, trace.label or None, trace.settings)
            few, whole = (ask_decay(trace, values, s, batch, output) for s in (steps, None))
            asked.append((few, whole))
        try:
            batch.simulate(self.workers)
        except NoAnswer:
            raise
        except FmuFailure:  # it refuses long steps
            return np.inf
        worst = 0.0
        for few, run in asked:
            whole, found = batch.samples(run, output), read_decay(steps, batch, few, output)
            if found is None:
                return np.inf
            largest = float(np.max(np.abs(whole)))
            worst = max(worst, float(np.max(np.abs(found - whole))) / largest)
        return worst

    def _simulated(self, points: Sequence[FloatArray], per_sample: int) -> list[FloatArray]:
        """Outputs of its runs at all points, with so many steps between two samples."""
        trial = StepPlan(
            label=self.kind.key(self.trace),
            spacing_s=self.trace.run_step_s,
            per_sample=per_sample,
            bound=0.0,
        )
        model = replace(self.model, plan=replace(self.model.plan, steps=(trial,)))
        batch, output = Batch(), self.kind.output(self.trace)
        asked = [
            run
            for k, p in enumerate(points)
            for run in self.kind.ask(model, self.trace, p, batch, k)
            if run is not None
        ]
        batch.simulate(self.workers)
        return [batch.samples(run, output) for run in asked]

    def _that_run(self, points: Sequence[FloatArray], per_sample: int) -> list[FloatArray]:
        """The points that the FMU takes, the first in any case: it may refuse a part of the box."""
        kept = [points[0]]
        for p in points[1:]:
            try:
                self._simulated([p], per_sample)
            except NoAnswer:
                raise
            except FmuFailure:
                continue
            kept.append(p)
        return kept

    def _refuse_nonlinear(self, p: FloatArray, per_sample: int) -> None:
        """Complain of an unknown start where half a pulse does not give half the response."""
        trace = self.trace
        if not trace.has_unknown_start:
            return
        values = self.model.values(p, trace.label or None, trace.settings)
        output, batch = self.kind.output(trace), Batch()
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
