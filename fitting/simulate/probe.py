"""What a plan looks at: drives run with this or that setting, and read at their tones.

What runs cost is counted, not timed: communication steps, and substeps where the FMU takes any.
The same plan then comes out of any machine, busy or not.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial

import numpy as np

from fitting.fmu import Run, row_times
from fitting.fmu.runs import communication_steps
from fitting.signal.grid import Grid
from fitting.signal.window import LONGEST_WINDOW_S, Window
from fitting.simulate.batch import Workers
from fitting.simulate.cost import cost_ratio
from fitting.simulate.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import FmuFailure, NoAnswer

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
#: held steps in a period that tell these times apart.
SHIFTS, SHIFT, FINEST = 9, 0.01, 100


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
        """Relative error that comes of rounding the samples of a weak tone beside a strong one."""
        return _largest(
            32.0 * np.finfo(float).eps * self.condition * self.largest / self.amplitudes
        )


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.max(known)) if known.size else 0.0


@dataclass
class Probe:
    """Runs of some drives; answers are kept for who asks again.

    `substep` and `tolerance` name the parameters that bound the FMU's substep and error;
    `exchange`: its equations are integrated here. With `of_largest` errors are relative to the
    largest amplitude of all drives, else to each amplitude.
    """

    drives: tuple[Drive, ...]
    workers: Workers
    _: KW_ONLY
    substep: str | None = None
    tolerance: str | None = None
    of_largest: bool = False
    exchange: bool = False
    longest_s: float = LONGEST_WINDOW_S
    _kept: dict[object, list[Reading]] = field(default_factory=dict)
    _acting: dict[object, bool] = field(default_factory=dict)

    @property
    def foreign(self) -> bool:
        """Whether the FMU names no parameter that sets its accuracy."""
        return self.substep is None and self.tolerance is None

    @property
    def fastest_hz(self) -> float:
        """The fastest line of all drives, Hz."""
        return max(drive.fastest_hz for drive in self.drives)

    def read(
        self, settings: Mapping[str, Scalar], settle_s: float, order: int = 1
    ) -> list[Reading]:
        """What every drive shows after that time.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
            order: highest sum of the absolute factors.
        """
        key = (_key(settings), settle_s, order)
        if key not in self._kept:
            windows = [drive.window(settle_s, order, self.longest_s) for drive in self.drives]
            pairs = list(zip(self.drives, windows, strict=True))
            answers = self.workers.run([drive.run(w, settings) for drive, w in pairs])
            self._kept[key] = [
                _reading(d, w, values) for (d, w), values in zip(pairs, answers, strict=True)
            ]
        return self._kept[key]

    def largest(self, settings: Mapping[str, Scalar], settle_s: float, output: str) -> float:
        """Largest size of a further output at the samples of every drive.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
            output: name of the output.
        """
        runs = [
            drive.run(drive.window(settle_s, 1, self.longest_s), settings, (output,))
            for drive in self.drives
        ]
        answers = self.workers.run(runs)
        columns = [run.outputs.index(output) for run in runs]
        return max(float(np.max(np.abs(a[:, k]))) for a, k in zip(answers, columns, strict=True))

    def changes(self, after: Sequence[Reading], before: Sequence[Reading]) -> float:
        """Largest change from one reading of all drives to another, phases and rest included.

        Args:
            after: readings with the change, one per drive.
            before: readings without the change, one per drive.
        """
        result = [
            np.abs(a.tones - b.tones) + np.abs(a.rest - b.rest)
            for a, b in zip(after, before, strict=True)
        ]
        return self._relative(result, after)

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

    def _relative(self, sizes: Sequence[FloatArray], truth: Sequence[Reading]) -> float:
        amplitudes = [reading.amplitudes for reading in truth]
        if self.of_largest:
            top = max(_largest(a) for a in amplitudes)
            amplitudes = [np.where(np.isnan(a), np.nan, top) for a in amplitudes]
        return max(_largest(s / a) for s, a in zip(sizes, amplitudes, strict=True))

    def finer_input(self, most: int) -> bool:
        """Hold generated inputs over half the time from now on; False where that is too fine.

        Args:
            most: steps in a period of the fastest tone at most.
        """
        steps = [drive.steps_per_period for drive in self.drives if drive.input is not None]
        if not steps or 2 * max(steps) > most:
            return False
        self.go_on(tuple(replace(d, steps_per_period=2 * d.steps_per_period) for d in self.drives))
        return True

    def held_per_period(self, settle_s: float) -> int | None:
        """Held steps in a period of the fastest tone, at most; None: as many as the FMU has itself.

        Args:
            settle_s: time before the first sample, s.
        """
        if not self.drives[0].grid.step_s:
            return max(drive.steps_per_period for drive in self.drives)
        windows = [d.window(settle_s, 1, self.longest_s) for d in self.drives if d.input]
        if all(w.input_step_s <= d.grid.step_s for w, d in zip(windows, self.drives, strict=True)):
            return None
        return max(int(1.0 / (w.input_step_s * max(w.tones_hz))) for w in windows)

    def on(self, grid: Grid) -> Probe:
        """The same drives, asked at the times of a grid.

        Args:
            grid: at which times the FMU is asked.
        """
        drives = tuple(replace(drive, grid=grid) for drive in self.drives)
        return replace(self, drives=drives, _kept={}, _acting={})

    def repetition(self, settings: Mapping[str, Scalar], settle_s: float) -> float:
        """How far amplitudes repeat at times some hundredths of a period apart.

        What moves with time, a transient or a line beside the tones, does so smoothly over so short
        a time, and a parabola through its phasors is taken off; what is left is no motion.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
        """
        finest = tuple(
            replace(d, steps_per_period=max(d.steps_per_period, FINEST)) for d in self.drives
        )
        look = replace(self, drives=finest, _kept={}, _acting={})
        shifts = np.arange(SHIFTS, dtype=float)
        observed = [
            look.read(settings, settle_s + k * SHIFT / self.fastest_hz) for k in range(SHIFTS)
        ]
        powers = np.vander(shifts, 3)
        left = np.eye(SHIFTS) - powers @ np.linalg.pinv(powers)
        result = []
        for readings in zip(*observed, strict=True):
            tones = np.stack([reading.tones for reading in readings])
            rest = np.abs(np.tensordot(left, tones, axes=1)).max(axis=0)
            result.append(rest * math.sqrt(SHIFTS / (SHIFTS - 3)))
        return self._relative(result, observed[-1])

    def go_on(self, drives: tuple[Drive, ...]) -> None:
        """Look at these drives from now on; what was read of others is forgotten.

        Args:
            drives: each with tones and amplitudes.
        """
        self.drives = drives
        self._kept.clear()

    def length_s(self, drive: Drive) -> float:
        """Length of the window of a drive, s.

        Args:
            drive: tones and amplitudes that drive.
        """
        return drive.window(0.0, 1, self.longest_s).length_s

    def common_length_s(self) -> float | None:
        """Length of the longest window where it is whole windows of every drive, s; else None."""
        windows = [drive.window(0.0, 1, self.longest_s) for drive in self.drives]
        longest_s = max(window.length_s for window in windows)
        counts = [longest_s / window.length_s for window in windows]
        whole = all(abs(count - round(count)) < WHOLE for count in counts)
        return longest_s if whole and all(window.coherent for window in windows) else None

    def work(self, settings: Mapping[str, Scalar], settle_s: float) -> float:
        """What the longest run with this time to settle costs: communication steps and substeps.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
        """
        rate = self.substeps_per_s(settings)
        runs = [d.run(d.window(settle_s, 1, self.longest_s), settings) for d in self.drives]
        return max(_communication_steps(run) + row_times(run)[-1] * rate for run in runs)

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
                windows = [drive.window(settle_s, 1, self.longest_s) for drive in timed]
                runs = [d.run(w, settings) for d, w in zip(timed, windows, strict=True)]
            else:
                rate, step_s = self.substeps_per_s(settings), 1.0 / (FINEST * self.fastest_hz)
                runs = [d.run_at(settings, TIMED / rate, step_s, 2) for d in timed]
                scale *= (work / TIMED) ** power
            evaluations.append(partial(self.workers.run, runs))
        ratio = cost_ratio(self.workers, *evaluations)
        return None if ratio is None else scale * ratio

    def acts_as_substep(self, settings: Mapping[str, Scalar]) -> bool:
        """Whether the parameter that is called a substep changes anything with these settings.

        Args:
            settings: values of FMU variables, by name.
        """
        coarse = 1.0 / (SUBSTEPS * self.fastest_hz)
        return self.substep is not None and self._acts(
            settings, self.substep, (coarse, 0.5 * coarse)
        )

    def substeps_per_s(self, settings: Mapping[str, Scalar]) -> float:
        """Substeps that the FMU takes in a second of its time, counted by a fixed rule.

        One over the step of its own, where it has one; where its equations are solved here, what
        was measured of that; one over its substep where that acts under
        these settings; nothing where neither that nor
        its tolerance does; else, and where the FMU names neither, a tenth of a step in a period of
        the fastest tone, and where its tolerance acts the steps in the fastest beat besides, at
        most twice those of substeps.

        Args:
            settings: values of FMU variables, by name.
        """
        own_s = self.drives[0].grid.step_s
        if own_s:
            return 1.0 / own_s
        if self.exchange:
            integrated = self.tolerance and self._acts(settings, self.tolerance, TOLERANCES)
            return (EXCHANGED if integrated else LINEAR) * self.fastest_hz
        if self.substep is not None and self.acts_as_substep(settings):
            value = {**self.drives[0].start_values, **settings}.get(self.substep)
            return 1.0 / float(value) if value else SUBSTEPS * self.fastest_hz
        if self.tolerance is not None:
            if not self._acts(settings, self.tolerance, TOLERANCES):
                return 0.0
            span_hz = max(max(drive.tones_hz) - min(drive.tones_hz) for drive in self.drives)
            beats = min(BEAT_STEPS * span_hz, 2.0 * SUBSTEPS * self.fastest_hz)
            return UNNAMED * self.fastest_hz + beats
        return UNNAMED * self.fastest_hz if self.substep is None else 0.0

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

    def substep_error(self, settings: Mapping[str, Scalar], value: float) -> float:
        """Change of a short run by half a substep, over its largest value; infinite: one fails.

        Args:
            settings: values of FMU variables, by name.
            value: of the substep, in its unit.
        """
        try:
            a, b = self._short_runs(settings, str(self.substep), (value, 0.5 * value))
        except NoAnswer:
            raise
        except FmuFailure:  # too long a substep, for one
            return math.inf
        largest = float(np.max(np.abs(b)))
        change = float(np.max(np.abs(a - b)))
        return change / largest if largest > 0.0 and math.isfinite(change) else math.inf

    def _short_runs(
        self, settings: Mapping[str, Scalar], name: str, values: tuple[float, float]
    ) -> list[FloatArray]:
        """Short runs with each of these values of a solver's parameter."""
        drive = self.drives[0]
        tone = drive.fastest_hz
        # the window of one tone is short, whatever the others are
        one = replace(drive, tones_hz=(tone,), read_hz=(), highest_order=1)
        window = one.window(TRIAL_PERIODS / tone)
        return self.workers.run([one.run(window, {**settings, name: v}) for v in values])

    def _acts(self, settings: Mapping[str, Scalar], name: str, values: tuple[float, float]) -> bool:
        """Whether a short run with these values of a solver's parameter differs in any bit."""
        others = {key: value for key, value in settings.items() if key != name}
        key = name, _key(others)
        if key not in self._acting:
            try:
                a, b = self._short_runs(others, name, values)
                self._acting[key] = a.tobytes() != b.tobytes()
            except NoAnswer:
                raise
            except FmuFailure:  # too long a substep, for one
                self._acting[key] = True
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


def _communication_steps(run: Run) -> int:
    if run.input_signal is not None:
        return round(row_times(run)[-1] / run.input_signal.step_s)
    if run.longest_step_s:
        return communication_steps(run)
    return run.rows + 1 + len(run.segments)


def _key(settings: Mapping[str, Scalar]) -> tuple[tuple[str, Scalar], ...]:
    return tuple(sorted(settings.items()))
