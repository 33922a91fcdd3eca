"""What a plan looks at: drives run with this or that setting, and read at their tones.

What runs cost is counted: communication steps, and substeps where the FMU takes any. The same plan
then comes out of any machine, busy or not. What a reduction saves is timed: processor time of the
FMU's process and of the thread that asks, while no other thread drives it; two settings in turn,
always as often, so that a plan takes the same runs everywhere; long runs at their beginning, and
reckoned up by their counted steps.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from statistics import median
from typing import Any, TypeVar

import numpy as np

from fitting.fmu.accuracy import AccuracyAnnotation, read_accuracy_annotation
from fitting.fmu.description import FmuDescription, FmuVariable
from fitting.fmu.runs import Run, communication_steps, row_times
from fitting.signal.grid import Grid
from fitting.signal.window import Window
from fitting.simulate.batch import Workers
from fitting.simulate.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

#: Combinations of the tones that do not fold onto a tone, tried in this order.
ORDERS = (1, 5, 11, 21, 41)
#: A tone below this part of an output's largest value is none: it is rounding.
NOTHING = 1e-12
#: A coherent window longer than this many beats is given up where time costs, for a tone fit.
BEATS = 6.0
#: A number of windows is whole where it is so but for this: lengths are rounded.
WHOLE = 1e-9
#: Substeps over a coherent window from which time costs.
COSTLY = 5e3
#: Periods of the fastest tone in a run that shows whether the FMU takes substeps, and how many
#: substeps there are in one where nothing is said of them.
TRIAL_PERIODS, SUBSTEPS = 16, 40
#: Tolerances by which it shows whether a solver chooses its steps.
TOLERANCES = 1e-3, 1e-9
#: What a period of the fastest tone counts where substeps are not known: compiled code takes some
#: tens of them in the time of a tenth of a communication step, and an adaptive solver far fewer.
UNNAMED = 0.1
#: What a period counts where equations are integrated here, in Python: some 15 steps of twelve
#: evaluations, a few thousandths of a second.
EXCHANGED = 300.0
#: The same where they are linear and solved exactly: eight looks whether they are.
LINEAR = 16.0
#: What a beat of the tones adds where a solver chooses its steps, as these have to follow it: some
#: fifty steps of seven evaluations. Averaged equations of two modes in Python were measured to
#: take as long as 280 substeps at a tolerance of 2e-6.
BEAT_STEPS = 400
#: Steps of a run from which it is timed at its beginning, and drives that are timed.
TIMED, MOST_TIMED = 4e3, 4
#: Looks by which it shows whether amplitudes repeat, how far apart they are in periods, and the
#: held steps in a period that distinguish these times.
SHIFTS, SHIFT, FINEST = 9, 0.01, 100
#: A reduction is taken where an evaluation then takes less than this part of the processor time.
CHEAPER = 0.8
#: Pairs that are timed.
PAIRS = 7

Result = TypeVar("Result")


@dataclass(frozen=True)
class Knowledge:
    """What is known of an FMU: how it is made accurate, and its variables by name.

    `step_s` is the step that it was made for (None: it declares none), and `fixed_step` whether its
    solver takes no other; `exchange`: its equations are integrated here, and an input is no
    staircase. `slow`: settings with which steps of its solver follow the beats of the tones alone.
    """

    annotation: AccuracyAnnotation = field(default_factory=AccuracyAnnotation)
    variables: Mapping[str, FmuVariable] = field(default_factory=dict)
    step_s: float | None = None
    fixed_step: bool = False
    exchange: bool = False
    slow: tuple[Mapping[str, Scalar], ...] = ()

    @property
    def is_foreign(self) -> bool:
        """Whether the FMU names no parameter that sets its accuracy."""
        return self.annotation.substep is None and self.annotation.tolerance is None


def knowledge_of(
    description: FmuDescription, annotation: AccuracyAnnotation | None = None
) -> Knowledge:
    """What an FMU declares of itself, where `annotation` does not state otherwise.

    Args:
        description: of the FMU.
        annotation: what the FMU states of its own accuracy.

    Raises:
        BadInput: annotation that name variables which the FMU does not have.
    """
    merged = (annotation or AccuracyAnnotation()).over(read_accuracy_annotation(description))
    names = [name for name in (merged.tolerance, merged.substep) if name is not None]
    for name in (*names, *merged.full, *(name for r in merged.reductions for name in r.set)):
        description.variable(name)
    return Knowledge(
        merged,
        description.settable,
        step_s=description.step_s,
        fixed_step=description.fixed_step,
        exchange=description.exchange is not None,
        slow=tuple(reduction.set for reduction in merged.reductions if reduction.slow),
    )


def attempt(trial: Callable[[], Result]) -> Result | None:
    """What a trial of the FMU gives; None where it fails, as with steps too long for its solver.

    Args:
        trial: runs the FMU with a setting that it may refuse.

    Raises:
        NoAnswer: the FMU does not answer; another trial would cost as much time.
    """
    try:
        return trial()
    except NoAnswer:
        raise
    except FmuFailure:
        return None


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Tones in one run: complex amplitudes (tones, outputs) with the phase at time 0.

    `mean` (outputs,); `rest` (outputs,) is the root mean square of what mean and tones leave,
    `largest` (outputs,) the largest value, `condition` the factor by which a fit of the tones may
    amplify rounding.
    """

    tones: ComplexArray
    mean: FloatArray
    rest: FloatArray
    largest: FloatArray
    condition: float

    @property
    def amplitudes(self) -> FloatArray:
        """Peak amplitudes, (tones, outputs), NaN where there is no oscillation but rounding."""
        sizes = np.abs(self.tones)
        return np.where(sizes > NOTHING * self.largest, sizes, np.nan)

    @property
    def constant(self) -> tuple[bool, ...]:
        """Which outputs do not oscillate."""
        return tuple(bool(np.isnan(column).all()) for column in self.amplitudes.T)

    @property
    def spread(self) -> float:
        """Strongest over weakest tone of an output, the largest of all outputs."""
        sizes = self.amplitudes
        strongest = np.nanmax(np.where(np.isnan(sizes), 0.0, sizes), axis=0)
        return max(1.0, _largest(strongest / sizes))

    @property
    def rounding(self) -> float:
        """Relative error that comes of rounding the samples of a weak tone next to a strong one."""
        return _largest(
            32.0 * np.finfo(float).eps * self.condition * self.largest / self.amplitudes
        )


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.max(known)) if known.size else 0.0


@dataclass
class Probe:
    """Runs of some drives; answers are kept for who asks again.

    With `of_largest` errors are relative to the largest amplitude of all drives, else to each
    amplitude. Common periods beyond `longest_s` are given up for a tone fit.
    """

    drives: tuple[Drive, ...]
    workers: Workers
    known: Knowledge = field(default_factory=Knowledge)
    _: KW_ONLY
    of_largest: bool = False
    longest_s: float = math.inf
    _readings: dict[object, list[Reading]] = field(default_factory=dict)
    _acting: dict[object, bool] = field(default_factory=dict)

    @property
    def fastest_hz(self) -> float:
        """The fastest line of all drives, Hz."""
        return max(drive.fastest_hz for drive in self.drives)

    def with_drives(self, drives: tuple[Drive, ...]) -> Probe:
        """The same of other drives, of which nothing is known yet.

        Args:
            drives: each with tones and amplitudes.
        """
        return replace(self, drives=drives, _readings={}, _acting={})

    def on(self, grid: Grid) -> Probe:
        """The same drives, sampled at the times of a grid.

        Args:
            grid: at which times the FMU is asked.
        """
        return self.with_drives(tuple(replace(drive, grid=grid) for drive in self.drives))

    # -- runs and what is read of them ----------------------------------------------------------

    def windows(self, settle_s: float, order: int = 1) -> list[Window]:
        """When each drive is sampled after that time.

        Args:
            settle_s: time before the first sample, s.
            order: highest sum of the absolute factors of combinations kept off the tones.
        """
        return [drive.window(settle_s, order, self.longest_s) for drive in self.drives]

    def _runs(
        self, settings: Mapping[str, Scalar], windows: Sequence[Window], more: tuple[str, ...] = ()
    ) -> list[Run]:
        pairs = zip(self.drives, windows, strict=True)
        return [drive.run(window, settings, more) for drive, window in pairs]

    def read(
        self, settings: Mapping[str, Scalar], settle_s: float, order: int = 1
    ) -> list[Reading]:
        """What every drive shows after that time.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
            order: highest sum of the absolute factors.
        """
        windows = self.windows(settle_s, order)
        # what else a window keeps off the tones does not change its samples
        key = (_key(settings), *(replace(w, mixture_bins=(), mixtures=0) for w in windows))
        if key not in self._readings:
            answers = self.workers.run(self._runs(settings, windows))
            self._readings[key] = list(map(_reading, self.drives, windows, answers))
        return self._readings[key]

    def by_order(
        self, settings: Mapping[str, Scalar], settle_s: float
    ) -> Iterator[tuple[int, list[Reading]]]:
        """Each order that changes the samples, and what the drives show with them.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
        """
        before: list[Reading] | None = None
        with suppress(BadInput):  # no sampling keeps so many lines off the tones
            for order in ORDERS:
                here = self.read(settings, settle_s, order)
                if here is not before:
                    yield order, here
                before = here

    def separating(
        self, settings: Mapping[str, Scalar], settle_s: float, wanted: float
    ) -> Probe | None:
        """The same of windows that keep enough combinations of the tones off them; None: these do.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
            wanted: relative error by combinations that is none.
        """
        readings = dict(self.by_order(settings, settle_s))
        finest = readings[max(readings)]
        least = next(k for k, read in readings.items() if self.errors(read, finest) <= wanted)
        if least == ORDERS[0]:
            return None
        return self.with_drives(tuple(replace(d, highest_order=least) for d in self.drives))

    def largest(self, settings: Mapping[str, Scalar], settle_s: float, output: str) -> float:
        """Largest size of a further output at the samples of every drive.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
            output: name of the output.
        """
        runs = self._runs(settings, self.windows(settle_s), (output,))
        answers = self.workers.run(runs)
        columns = [run.outputs.index(output) for run in runs]
        return max(float(np.max(np.abs(a[:, k]))) for a, k in zip(answers, columns, strict=True))

    def changes(self, after: Sequence[Reading], before: Sequence[Reading]) -> float:
        """Largest change from one reading of all drives to another, phases and rest included.

        Args:
            after: readings with the change, one per drive.
            before: readings without the change, one per drive.
        """
        pairs = zip(after, before, strict=True)
        sizes = [np.abs(a.tones - b.tones) + np.abs(a.rest - b.rest) for a, b in pairs]
        return self._relative(sizes, after)

    def errors(self, result: Sequence[Reading], truth: Sequence[Reading]) -> float:
        """Largest difference of what is read: of amplitudes, or of amplitudes and phases.

        Args:
            result: readings, one per drive.
            truth: readings that are taken for true.
        """
        sizes = [
            np.abs(f.tones - t.tones if drive.phases else np.abs(f.tones) - np.abs(t.tones))
            for drive, f, t in zip(self.drives, result, truth, strict=True)
        ]
        return self._relative(sizes, truth)

    def unexplained(self, readings: Sequence[Reading]) -> float:
        """Largest root mean square of what the tones leave in the samples, over the tones.

        Args:
            readings: one per drive.
        """
        sizes = [np.broadcast_to(reading.rest, reading.tones.shape) for reading in readings]
        return self._relative(sizes, readings)

    def _relative(self, sizes: Sequence[FloatArray], truth: Sequence[Reading]) -> float:
        amplitudes = [reading.amplitudes for reading in truth]
        if self.of_largest:
            top = max(_largest(a) for a in amplitudes)
            amplitudes = [np.where(np.isnan(a), np.nan, top) for a in amplitudes]
        return max(_largest(s / a) for s, a in zip(sizes, amplitudes, strict=True))

    def repetition(self, settings: Mapping[str, Scalar], settle_s: float) -> float:
        """How far amplitudes repeat at times some hundredths of a period apart.

        What moves with time, a transient or a line near the tones, does so smoothly over so short a
        time, and a parabola through its phasors is taken off; what remains is no motion.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
        """
        finest = [replace(d, steps_per_period=max(d.steps_per_period, FINEST)) for d in self.drives]
        probe, shifts = self.with_drives(tuple(finest)), np.arange(SHIFTS, dtype=float)
        observed = [
            probe.read(settings, settle_s + k * SHIFT / self.fastest_hz) for k in range(SHIFTS)
        ]
        powers = np.vander(shifts, 3)
        projector = np.eye(SHIFTS) - powers @ np.linalg.pinv(powers)
        sizes = []
        for readings in zip(*observed, strict=True):
            tones = np.stack([reading.tones for reading in readings])
            rest = np.abs(np.tensordot(projector, tones, axes=1)).max(axis=0)
            sizes.append(rest * math.sqrt(SHIFTS / (SHIFTS - 3)))
        return self._relative(sizes, observed[-1])

    # -- windows --------------------------------------------------------------------------------

    def shorten_windows(self, settings: Mapping[str, Scalar]) -> None:
        """Give up common periods that are much longer than the beats, where time costs.

        Args:
            settings: values of FMU variables, by name.
        """
        for drive in self.drives:
            lines = drive.lines_hz
            gaps = [abs(a - b) for i, a in enumerate(lines) for b in lines[:i]]
            if not gaps or not min(gaps) > 0.0:
                continue
            period, beats = float(drive.grid.whole_s(lines)), BEATS / min(gaps)
            if period > beats and self.substeps_per_s(settings) * period > COSTLY:
                self.longest_s = min(self.longest_s, beats)

    def common_length_s(self) -> float | None:
        """Length of the longest window where it is whole windows of every drive, s; else None."""
        windows = self.windows(0.0)
        longest_s = max(window.length_s for window in windows)
        counts = [longest_s / window.length_s for window in windows]
        whole = all(abs(count - round(count)) < WHOLE for count in counts)
        return longest_s if whole and all(window.coherent for window in windows) else None

    # -- what a run costs -----------------------------------------------------------------------

    def work(self, settings: Mapping[str, Scalar], settle_s: float) -> float:
        """What the longest run with this time to settle costs: communication steps and substeps.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
        """
        rate = self.substeps_per_s(settings)
        result = []
        for run in self._runs(settings, self.windows(settle_s)):
            end_s = row_times(run)[-1]
            if run.input_signal is not None:
                steps = round(end_s / run.input_signal.step_s)
            elif run.longest_step_s:
                steps = communication_steps(run)
            else:
                steps = run.rows + 1 + len(run.segments)
            result.append(steps + end_s * rate)
        return max(result)

    def cost_ratio(
        self,
        reduced: tuple[Mapping[str, Scalar], float],
        whole: tuple[Mapping[str, Scalar], float],
    ) -> float | None:
        """Processor time of the first drives' runs with some settings over that with others.

        None where it is not reported. Of long runs the first steps are timed, and all are counted.

        Args:
            reduced: settings by name, and the time before the first sample, s.
            whole: the others.
        """
        timed = self.drives[:MOST_TIMED]
        evaluations, scale = [], 1.0
        for power, (settings, settle_s) in ((1.0, reduced), (-1.0, whole)):
            work = self.work(settings, settle_s)
            if work <= TIMED:
                runs = self._runs(settings, self.windows(settle_s))[:MOST_TIMED]
            else:
                # where none are counted, communication steps alone are what is many
                rate = self.substeps_per_s(settings) or self.fastest_hz
                step_s = 1.0 / (FINEST * self.fastest_hz)
                runs = [d.run_at(settings, TIMED / rate, step_s, 2) for d in timed]
                scale *= (work / TIMED) ** power
            evaluations.append(partial(self.workers.run, runs))
        ratio = cost_ratio(self.workers, *evaluations)
        return None if ratio is None else scale * ratio

    def substeps_per_s(self, settings: Mapping[str, Scalar]) -> float:
        """Substeps that the FMU takes in a second of its time, counted by a fixed rule.

        Args:
            settings: values of FMU variables, by name.
        """
        substep, tolerance = self.known.annotation.substep, self.known.annotation.tolerance
        if own_s := self.drives[0].grid.step_s:
            return 1.0 / own_s
        if self.known.exchange:
            integrated = tolerance and self._acts(settings, tolerance, TOLERANCES)
            return (EXCHANGED if integrated else LINEAR) * self.fastest_hz
        if substep is not None and self.acts_as_substep(settings):
            value = {**self.drives[0].start_values, **settings}.get(substep)
            return 1.0 / float(value) if value else SUBSTEPS * self.fastest_hz
        if tolerance is None:
            # a tenth of a step in a period where nothing is named; no steps where what is named
            # does not act
            return UNNAMED * self.fastest_hz if substep is None else 0.0
        if not self._acts(settings, tolerance, TOLERANCES):
            return 0.0
        # steps that a solver chooses follow the fastest beat; at most twice those of substeps
        span_hz = max(max(drive.tones_hz) - min(drive.tones_hz) for drive in self.drives)
        beats = min(BEAT_STEPS * span_hz, 2.0 * SUBSTEPS * self.fastest_hz)
        chosen = {**self.drives[0].start_values, **settings}

        def start(name: str) -> Scalar | None:
            return chosen.get(name, getattr(self.known.variables.get(name), "start", None))

        slow = any(all(start(k) == v for k, v in each.items()) for each in self.known.slow)
        return beats if slow else UNNAMED * self.fastest_hz + beats

    def acts_as_substep(self, settings: Mapping[str, Scalar]) -> bool:
        """Whether the parameter that is called a substep changes anything with these settings.

        Args:
            settings: values of FMU variables, by name.
        """
        name, coarse = self.known.annotation.substep, 1.0 / (SUBSTEPS * self.fastest_hz)
        return name is not None and self._acts(settings, name, (coarse, 0.5 * coarse))

    def substep_error(self, settings: Mapping[str, Scalar], value: float) -> float:
        """Change of a short run by half a substep, over its largest value; infinite: one fails.

        Args:
            settings: values of FMU variables, by name.
            value: of the substep, in its unit.
        """
        runs = self._short_runs(settings, str(self.known.annotation.substep), (value, 0.5 * value))
        if runs is None:
            return math.inf
        largest = float(np.max(np.abs(runs[1])))
        change = float(np.max(np.abs(runs[0] - runs[1])))
        return change / largest if largest > 0.0 and math.isfinite(change) else math.inf

    def _short_runs(
        self, settings: Mapping[str, Scalar], name: str, values: tuple[float, float]
    ) -> list[FloatArray] | None:
        """Short runs with each of these values of a solver's parameter; None: one fails."""
        drive = self.drives[0]
        tone = drive.fastest_hz
        # the window of one tone is short, whatever the others are
        one = replace(drive, tones_hz=(tone,), read_hz=(), highest_order=1)
        window = one.window(TRIAL_PERIODS / tone)
        runs = [one.run(window, {**settings, name: v}) for v in values]
        return attempt(partial(self.workers.run, runs))

    def _acts(self, settings: Mapping[str, Scalar], name: str, values: tuple[float, float]) -> bool:
        """Whether a short run with these values differs in any bit, or fails with one of them."""
        others = {key: value for key, value in settings.items() if key != name}
        # the value of the solver's other parameter does not decide it, and a plan tries many
        knobs = self.known.annotation.tolerance, self.known.annotation.substep
        key = name, _key({k: value for k, value in others.items() if k not in knobs})
        if key not in self._acting:
            runs = self._short_runs(others, name, values)
            self._acting[key] = runs is None or runs[0].tobytes() != runs[1].tobytes()
        return self._acting[key]


def _reading(drive: Drive, window: Window, values: FloatArray) -> Reading:
    """The lines of a drive in the last samples of its run, (rows, outputs)."""
    fit, values = drive.fit(window), values[-window.samples :]
    result = fit(values)
    largest = np.max(np.abs(values), axis=0)  # squares of shares stay numbers, whatever the unit
    shares = result.rest / np.where(largest > 0.0, largest, 1.0)
    # a tone that is moved has no phase at time 0
    phasors = result.phasors if drive.approach is None else result.amplitudes.astype(complex)
    return Reading(
        tones=phasors,
        mean=result.mean,
        rest=largest * np.sqrt(np.mean(shares**2, axis=0)),
        largest=largest,
        condition=float(np.linalg.norm(fit.projector, 2) * math.sqrt(window.samples)),
    )


def _key(settings: Mapping[str, Scalar]) -> tuple[tuple[str, Scalar], ...]:
    return tuple(sorted(settings.items()))


def processor_s(workers: Workers) -> float | None:
    """Processor time so far of the FMU's processes and this thread, s; None: it is not reported.

    Args:
        workers: processes that run the FMU.
    """
    counts: Any = getattr(workers, "counts", None)
    return None if counts is None else counts.processor_s + time.thread_time()


def cost_ratio(
    workers: Workers, reduced: Callable[[], object], whole: Callable[[], object]
) -> float | None:
    """Processor time of one evaluation over that of another; None: it is not reported.

    Of the median of pairs, each timed in turn, and the ratio of the least times the one nearer to
    equal costs; where they disagree which is dearer, costs are equal. A busy machine, or one that
    changes its speed, slows both of a pair alike, and only ever adds to a time: with eight busy
    processes the medians scattered by 5 %, the least times by 15 %, rarely both.

    Args:
        workers: processes that run the FMU, in which both spend their time.
        reduced: evaluates one setting.
        whole: evaluates the other.
    """

    def timed(evaluate: Callable[[], object]) -> float:
        before = processor_s(workers)
        evaluate()
        after = processor_s(workers)
        return 0.0 if before is None or after is None else after - before

    if processor_s(workers) is None:
        return None
    alone: Any = getattr(workers, "alone", nullcontext)
    with alone():
        reduced(), whole()  # the first run with other settings does more
        pairs = [(timed(reduced), timed(whole)) for _ in range(PAIRS)]
    least = [min(times) for times in zip(*pairs, strict=True)]
    ratios = [one / other if other > 0.0 else 1.0 for one, other in (*pairs, least)]
    either = sorted((median(ratios[:-1]), ratios[-1], 1.0))
    return either[1]  # the middle one of both and of equal costs
