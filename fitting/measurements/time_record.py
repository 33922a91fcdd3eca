"""Time records: values over time, whose runs begin with them, fitted together; their survey.

The response to a pulse is a run of the FMU at all samples, or at few from which the others follow.

The survey plans a record's communication step and examines an unknown start. It serves every kind
of record whose runs begin with it: samples of an output, or what a demodulator makes of them.

`is_late`: whether an FMU hands over its output one communication step late.
The commonest mistake of hand-written slaves: an output of the beginning of a step is returned at
its end, y_h(t) = q(t - h). With half the step it is y_(h/2)(t) = q(t - h/2), so that

    y_h(t) = y_(h/2)(t - h/2)

at every t, which no integration error does. Such an output is read one step later.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fitting.fmu.accuracy import MODEL
from fitting.fmu.description import INTEGRATOR_TOLERANCE, USUAL_TOLERANCE
from fitting.fmu.runs import SampledSignal, Segment
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.gain import Solved
from fitting.measurements.measurement import Predicting, Prediction
from fitting.measurements.plan import Plan
from fitting.measurements.records import OfSetup, Together, check_pair, check_words
from fitting.measurements.steps import (
    MOST_STEPS,
    REFINED_STEPS,
    Look,
    StepPlan,
    StepRuns,
    euler_leaves,
    extrapolated,
    first_steps,
    interpolated,
    planned_steps,
    refinements,
    relative_change,
)
from fitting.signal.free_decay import FewSamples, rebuilt
from fitting.signal.time_grid import refuse_clipped, spacing_s
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation, Workers
from fitting.simulate.budget import Kind as Decided
from fitting.text.arrays import (
    ComplexArray,
    FloatArray,
    IntArray,
    Scalar,
    as_numbers,
    as_values,
)
from fitting.text.errors import BadInput, FmuFailure, NoAnswer
from fitting.text.finding import Finding

FIRST, DETECTED = BEGINS = ("first", "found")


class RequestedRuns(NamedTuple):
    """Numbers of the runs that answer for a trace; None: it wants none.

    Args:
        driven: under its input.
        decay: after a pulse; of a few samples where the plan has few.
        further: whatever else.
        coarse: as `driven`, of half as many steps: both are extrapolated.
        at: where samples are between the steps of `driven`, in steps; None: they are at their ends.
    """

    driven: int | None = None
    decay: int | None = None
    further: int | None = None
    coarse: int | None = None
    at: FloatArray | None = None

    def under_input(self, batch: Batch, output: str) -> FloatArray | None:
        """The output (n,) under the input; None: none was asked for.

        Args:
            batch: that has simulated the runs.
            output: its name.
        """
        if self.driven is None:
            return None
        fine = batch.samples(self.driven, output)
        if self.at is not None:
            return interpolated(fine, self.at)[0]
        if self.coarse is None:
            return fine
        return extrapolated(batch.samples(self.coarse, output), fine)


@dataclass(frozen=True, eq=False)
class TimeRecord(OfSetup):
    """Values over time; the kinds explain the fields.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite or are clipped, a negative sigma.
    """

    time_s: npt.ArrayLike
    values: npt.ArrayLike
    _: KW_ONLY
    input: str = ""
    offset: bool = False
    sigma: float = 0.0
    begin: str = FIRST
    setting_sigma: Mapping[str, float] = field(default_factory=dict)
    source: str = "trace"
    left_out: tuple[Finding, ...] = ()
    t: FloatArray = field(init=False)
    y: FloatArray | ComplexArray = field(init=False)
    spacing_s: float = field(init=False)

    #: Whether values are those of a demodulator, amplitudes or phasors: then a step of a run may be
    #: many periods, and what it may not be is found by halving it.
    is_demodulated = False

    def __post_init__(self) -> None:
        t = as_numbers(self.time_s, f"{self.source}: times")
        read = as_values if self.is_demodulated else as_numbers
        y = read(self.values, f"{self.source}: values")
        check_pair(self.source, "times", t, "values", y)
        object.__setattr__(self, "spacing_s", spacing_s(t, self.source))
        self._set_samples(t, y)
        check_words(self, self.source, begin=BEGINS)
        if not self.sigma >= 0.0:
            raise BadInput(f"{self.source}: sigma is wanted as zero or more")
        self.check_statements()
        first = 0 if self.begin == FIRST else self.decay_begin()
        self._set_samples(t[first:], y[first:])
        for part in (self.y.real, self.y.imag) if np.iscomplexobj(self.y) else (self.y.real,):
            refuse_clipped(part, self.source)
        self.check_samples()

    def _set_samples(self, t: FloatArray, y: FloatArray | ComplexArray) -> None:
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "y", y)

    def check_statements(self) -> None:
        """Complain of fields that do not go together."""

    def decay_begin(self) -> int:
        """Index of the first sample of the free decay.

        Raises:
            BadInput: there is none.
        """
        raise NotImplementedError

    def check_samples(self) -> None:
        """Complain of too few samples."""

    @property
    def is_simulated_alone(self) -> bool:
        """Whether its values are those of its run, but for an offset."""
        return False

    @property
    def first_words(self) -> str:
        """Where it begins, in words."""
        if self.begin == FIRST:
            return "the first sample"
        return f"{self.t[0]:.6g} s, where the free decay was found to begin"

    @property
    def has_unknown_start(self) -> bool:
        """Whether it rests on free responses, which a pulse gives."""
        return True

    @property
    def run_step_s(self) -> float:
        """Spacing of the samples of its runs, s."""
        return self.spacing_s

    @property
    def run_samples(self) -> int:
        """How many samples its longest run has."""
        return int(self.y.size)

    @property
    def value_share(self) -> float:
        """The largest value over the unit of its rows."""
        return 1.0

    def look(self, fine: int, most: int = REFINED_STEPS) -> Look | None:
        """A closer look at its run under the input; None: nothing but its start moves it.

        Args:
            fine: steps between two samples.
            most: steps in all.
        """
        return None

    def on_grid(self, grid_s: float) -> tuple[Look, FloatArray] | None:
        """Its run under the input by steps of one length, and where samples are between these.

        Args:
            grid_s: length of a step, s.

        Returns:
            The run, and the samples' times in steps, shape (n,); None: an unknown start.
        """
        return None

    @property
    def shifts(self) -> IntArray:
        """Samples by which the responses to a pulse are shifted against each other."""
        raise NotImplementedError

    @property
    def pulse_window(self) -> Window:
        """Samples of the response to a pulse, as long as the record and its shifts."""
        raise NotImplementedError

    def ask(
        self,
        values: Mapping[str, Scalar],
        plan: StepPlan | None,
        batch: Batch,
        output: str,
        owner: int,
    ) -> RequestedRuns:
        """Numbers of the runs that answer for it.

        Args:
            values: start values of the FMU, by name.
            plan: of its steps; None: one between two samples, and all samples.
            batch: where runs are asked for.
            output: name of the output.
            owner: which evaluation pays for them.
        """
        raise NotImplementedError

    def read(
        self, runs: RequestedRuns, decay: FloatArray | None, batch: Batch, output: str
    ) -> tuple[FloatArray | ComplexArray, FloatArray]:
        """Values (n,) as the model has them, and derivatives (rows, k) by what is solved inside.

        Args:
            runs: numbers of its runs.
            decay: after a pulse, whole; None: it wants none.
            batch: that has simulated them.
            output: name of the output.
        """
        raise NotImplementedError

    def pulse(
        self, per_sample: int, level: float = 1.0, window: Window | None = None
    ) -> SampledSignal:
        """One spacing of the input at a level, then nothing.

        Args:
            per_sample: steps between two samples.
            level: of the pulse, in the FMU's unit.
            window: samples of the response; None: `pulse_window`.
        """
        window = window or self.pulse_window
        kept = np.zeros((per_sample * window.samples, 1))
        kept[:per_sample] = level
        step_s = window.step_s / per_sample
        return SampledSignal((self.input,), step_s, kept, np.zeros((window.samples, 1)))


#: Blocks, and samples of each, that are tried one after the other.
BLOCKS = ((12, 4), (16, 6), (24, 8), (32, 12))
#: Of this many samples one is simulated, at most: with more it is not worth it.
SPARED = 4


def few_samples(samples: int) -> list[FewSamples]:
    """Which samples of a decay may be worth a trial, the fewest first.

    Args:
        samples: of the whole run.
    """
    apart = [each for each in BLOCKS if SPARED * each[0] * each[1] <= samples]
    tried = [FewSamples(samples, blocks, length) for blocks, length in apart]
    return [few for few in tried if SPARED * few.indices.size <= samples]


def ask_decay(
    trace: TimeRecord,
    values: Mapping[str, Scalar],
    plan: StepPlan | None,
    batch: Batch,
    output: str,
    owner: int = 0,
) -> int:
    """Number of the run after a pulse: at few samples, where the plan has few.

    Args:
        trace: whose decay it is.
        values: start values of the FMU, by name.
        plan: of its steps; None: one between two samples, and all samples.
        batch: where runs are asked for.
        output: name of the output.
        owner: which evaluation pays for the run.
    """
    if plan is None or plan.few is None:
        signal = trace.pulse(1 if plan is None else plan.per_sample)
        return batch.ask(values, trace.pulse_window, signal, output, owner)
    step_s = trace.pulse_window.step_s
    own = Variation(
        {trace.input: 1.0},
        Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=1),
        moved=trace.input,
        segments=_segments(plan.few, step_s),
    )
    [run] = batch.ask_varied(values, [own], output, owner)
    return run


def read_decay(plan: StepPlan, batch: Batch, run: int, output: str) -> FloatArray | None:
    """All samples of a run after a pulse; None where they do not follow from the few of it.

    Args:
        plan: of the steps of its trace.
        batch: that has simulated it.
        run: its number.
        output: name of the output.
    """
    observed = batch.samples(run, output)
    if plan.few is None:
        return observed
    result = rebuilt(plan.few, observed[1:], plan.tolerance)  # the first is seen under the pulse
    return None if result is None else result.samples


@lru_cache(maxsize=64)
def _segments(few: FewSamples, step_s: float) -> tuple[Segment, ...]:
    """A sample each, at the very times of the whole run; the input is zero from the first on."""
    times = [float((k + 1) * step_s) for k in few.indices]
    before = [step_s, *times[:-1]]
    return tuple(
        Segment(value=0.0, settle_s=then - now, sample_step_s=step_s, samples=1)
        for now, then in zip(before, times, strict=True)
    )


#: Change of a response to half a pulse, doubled, above which an FMU is not linear.
NONLINEAR = 1e-6
#: Of the accuracy that is left, what decays of few samples may cost, and the part of that which
#: they may at the points of the survey.
SHARE, MARGIN = 0.03, 0.1
#: An error below which no more samples are tried, and the part of an error that more of them are
#: taken for.
GOAL, BETTER = 1e-11, 0.1
#: Part of the accuracy that is left from which what steps leave is looked at with its sign.
MATERIAL = 0.1
#: How far a communication step may be from whole steps of the FMU's own, as seen, relative.
UNEVEN = 0.01
#: How much coarser equations are integrated to see what the tolerance leaves, and which part of
#: that change: the error goes as the tolerance, so that a hundredth would do.
COARSER, LEFT = 100.0, 0.1
#: A change below this is none.
ROUNDING = 1e-16


@dataclass(frozen=True)
class Survey:
    """Runs of one trace, as its series drives the FMU."""

    kind: Traces
    trace: TimeRecord
    model: DrivenModel
    workers: Workers
    batch: Batch = field(default_factory=Batch)
    delay_steps: int = 0

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
        running = self._that_run(points, count)
        left = plan.budget.remaining() if plan.budget is not None else self.kind.setup.accuracy
        left /= trace.value_share  # steps are compared by the largest value, the budget by rows
        if not self.delay_steps and self._is_late(points[0], count, left):
            return replace(self, delay_steps=1).planned(points)
        try:
            steps = planned_steps(first, partial(self._simulated, running), left, trace.run_samples)
            steps = self._integrated(running, self._refined(running, steps, left))
        except NoAnswer:
            raise
        except FmuFailure:
            self.batch.forget()
            alone = self._on_grid(points, own_s or first.step_s)
            if alone is None:
                raise
            steps = alone
        if trace.has_unknown_start and self.model.any_steps and steps.per_sample == 1:
            steps = self._of_few_samples(running, steps, left)
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
        if before.delay_steps != self.delay_steps:
            return replace(self, delay_steps=before.delay_steps).reviewed(p)
        share = self.trace.value_share
        left = plan.budget.remaining(Decided.STEP) / share
        runs = partial(self._simulated, [p])
        coarsest = before.per_sample // 2 if before.extrapolated else before.per_sample
        started = replace(before, per_sample=coarsest)
        try:
            steps = self._on_grid([p], before.grid_s) if before.grid_s else None
            if steps is None:
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
            if steps.shift is None or steps.bound <= MATERIAL * share * left:
                return plan
            return plan.with_steps(replace(before, bound=steps.bound, shift=steps.shift))
        longest = max(before.internal_step_s, steps.internal_step_s)
        return plan.with_steps(
            replace(
                before,
                bound=steps.bound,
                internal_step_s=longest,
                is_model=steps.is_model,
                shifted=before.shifted or steps.shifted,
            )
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
            self._ask(values, look.closer, look.hold_signal),
            self._ask(values, look.window, look.signal),
        ]
        half = trace.look(fine // 2, REFINED_STEPS // 2) if steps.extrapolated else None
        if half is not None:
            requested.append(self._ask(values, half.window, half.signal))
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
        coarse, fines = (runs.under_input(batch, output) for runs in (runs_planned, finest))
        if coarse is None or fines is None:
            raise TypeError(f"{trace.source}: nothing drives it")
        change = relative_change(coarse[: look.window.samples], fines)
        if change <= steps.bound or 2.0 * change <= left:
            if change <= steps.bound:
                return replace(steps, runs=runs)
            return replace(steps, runs=runs, bound=2.0 * change, shift=None)
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
        if self.kind.setup.annotation.own_step == MODEL:
            return replace(steps, is_model=True)
        fine = max(1, math.ceil((1.0 - UNEVEN) * steps.spacing_s / steps.internal_step_s))
        look = self.trace.look(fine, MOST_STEPS)
        if look is None:
            return steps
        run = self._ask(values, look.closer, look.hold_signal)
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

    def _on_grid(self, points: Sequence[FloatArray], grid_s: float) -> StepPlan | None:
        """The only steps that the FMU takes, with what they leave and what is between them.

        Args:
            points: parameter vectors (n,), the first of which the FMU takes.
            grid_s: length of a step, s.

        Returns:
            None: the start is unknown, which pulses of other lengths would have to span.

        Raises:
            FmuFailure: the FMU refuses these, too.
        """
        gridded = self.trace.on_grid(grid_s)
        if gridded is None:
            return None
        look, at = gridded
        steps = replace(self._plan(1), grid_s=grid_s, internal_step_s=grid_s)
        is_model = self.kind.setup.annotation.own_step == MODEL
        for k, p in enumerate(points):
            values = self.kind.start_values(self.model, self.trace, p)
            run = self._ask(values, look.window, look.signal)
            try:
                self.batch.simulate(self.workers)
            except NoAnswer:
                raise
            except FmuFailure:  # it may refuse a part of the box
                self.batch.forget()
                if k == 0:
                    raise
                continue
            observed, left, shifts = self.batch.samples(run, self.output), 0.0, False
            if not is_model:
                left, shifts = euler_leaves(observed, look.pushed, late=False)
            between = interpolated(observed, at)[1] / (float(np.max(np.abs(observed))) or 1.0)
            steps = replace(
                steps,
                runs=steps.runs + 1,
                bound=max(steps.bound, left + between),
                is_model=is_model,
                shifted=steps.shifted or shifts,
            )
        return steps

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
            before, after = (trace.read(whole, decay, batch, output)[0] for decay in decays)
            worst.append((relative_change(decays[0], decays[1]), relative_change(after, before)))
        return max(d for d, _ in worst), max(v for _, v in worst)

    def _plan(self, per_sample: int) -> StepPlan:
        """So many steps between two samples, and whole runs."""
        return StepPlan(
            label=self.kind.key(self.trace),
            spacing_s=self.trace.run_step_s,
            per_sample=per_sample,
            bound=0.0,
            delay_steps=self.delay_steps,
        )

    def _ask(self, values: Mapping[str, Scalar], window: Window, signal: SampledSignal) -> int:
        """Number of a run whose outputs are read as late as they come."""
        late = replace(window, delay_steps=self.delay_steps)
        return self.batch.ask(values, late, signal, self.output)

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

    def _is_late(self, p: FloatArray, per_sample: int, left: float) -> bool:
        """Whether the output under the input comes one communication step late.

        Looked at where half a step changes more than is left.

        Args:
            p: parameters (n,) that the FMU takes.
            per_sample: steps between two samples.
            left: accuracy that is still to be had.
        """
        looks = [self.trace.look(fine) for fine in (per_sample, 2 * per_sample)]
        values = self.kind.start_values(self.model, self.trace, p)
        try:
            whole, halves = (self._simulated([p], per_sample * k) for k in (1, 2))
            if whole.then(halves).changed <= left or self.model.integrated:
                return False
            runs = [self._ask(values, each.closer, each.hold_signal) for each in looks if each]
            self.batch.simulate(self.workers)
        except NoAnswer:
            raise
        except FmuFailure:  # it refuses such steps
            self.batch.forget()
            return False
        return bool(runs) and is_late(*(self.batch.samples(run, self.output) for run in runs))

    def _that_run(self, points: Sequence[FloatArray], per_sample: int) -> list[FloatArray]:
        """The points that the FMU takes, the first in any case: it may refuse a part of the box."""
        running = [points[0]]
        for p in points[1:]:
            try:
                self._simulated([p], per_sample)
            except NoAnswer:
                raise
            except FmuFailure:
                self.batch.forget()
                continue
            running.append(p)
        return running

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


@dataclass(frozen=True, kw_only=True)
class Traces(Together[TimeRecord]):
    """One or several traces that are fitted together, a sample or its two parts in each row."""

    FIELD = "traces"
    is_trace = True

    traces: tuple[TimeRecord, ...] = field(default=())

    @property
    def sampled_hz(self) -> tuple[float, ...]:
        """Rates of the samples of demodulators, each once."""
        rates = (1.0 / trace.spacing_s for trace in self.traces if trace.is_demodulated)
        return tuple(dict.fromkeys(rates))

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

    def shift(self, plan: Plan) -> FloatArray | None:
        """What all rows are off by, as halved steps show it with its sign, (m,); None: not known.

        Args:
            plan: of the series.
        """
        result = []
        for trace in self.traces:
            steps = plan.step_plan(self.key(trace))
            if steps is None or steps.shift is None or not trace.is_simulated_alone:
                return None
            result.append(trace.rows_of(steps.shift))
        return np.concatenate(result)

    def key(self, trace: TimeRecord) -> str:
        """What the plan knows a trace by.

        Args:
            trace: one of them.
        """
        return f"{self.series}/{'demodulated/' * trace.is_demodulated}{trace.label}"

    def start_values(
        self, model: DrivenModel, trace: TimeRecord, p: FloatArray
    ) -> dict[str, Scalar]:
        """Start values of the runs of a trace, of the whole model.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
        """
        return model.whole.values(p, trace.label or None, trace.settings)

    def ask(
        self, model: DrivenModel, trace: TimeRecord, p: FloatArray, batch: Batch, owner: int
    ) -> RequestedRuns:
        """Numbers of the runs that answer for a trace.

        Args:
            model: the FMU as the series drives it.
            trace: one of them.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for.
            owner: which evaluation pays for them.
        """
        plan, values = model.plan.step_plan(self.key(trace)), self.start_values(model, trace, p)
        return trace.ask(values, plan, batch, self.output_of(trace), owner)

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
            values, designs = zip(
                *(t.read(runs, decay, batch, self.output_of(t)) for t, runs, decay in trios),
                strict=True,
            )
            solved = tuple(Solved(design, np.empty(0)) for design in designs)
            result.append(Prediction(np.concatenate(values), solved=solved))
        return result

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


#: Difference of the two runs at equal times, over the largest value, from which they are compared,
#: and the share of it that is left at shifted times, at most.
MOVED, STAYED = 1e-4, 0.05


def is_late(whole: FloatArray, halves: FloatArray) -> bool:
    """Whether an output over steps is what it is over half of them half a step earlier.

    Args:
        whole: of the start and after every step, shape (n,), in its unit.
        halves: of the start and after every half of a step, shape (m,), at least 2 n - 1.
    """
    count = min(whole.size - 1, (halves.size - 1) // 2)
    later, before, same = (
        whole[1 : count + 1],
        halves[1 : 2 * count : 2],
        halves[2 : 2 * count + 1 : 2],
    )
    largest = float(np.max(np.abs(same), initial=0.0))
    moved = float(np.max(np.abs(later - same), initial=0.0))
    left = float(np.max(np.abs(later - before), initial=0.0))
    return moved > MOVED * largest and left < STAYED * moved
