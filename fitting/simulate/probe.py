"""What a plan measures: an FMU's drives run with this or that setting, and read at their tones."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from fitting.fmu.records import InputSignal, Run
from fitting.signal.combinations import mixed_hz
from fitting.signal.tones import common_period
from fitting.signal.window import LONGEST_WINDOW_S, SPARE_SAMPLES, Window, plan_window
from fitting.text.arrays import ComplexArray, FloatArray, Scalar

#: Periods of the fastest tone in the two runs that only measure how fast the FMU is.
TRIAL_PERIODS = 64, 512
#: A longer run that takes less than so many times as long, or so many seconds more, says that
#: time costs nothing: on a busy machine that much is chance, and it would be extrapolated.
NO_PACE, NO_PACE_S = 2.5, 0.02
#: A tone below this part of an output's largest value is none: it is rounding.
NOTHING = 1e-12
#: A coherent window longer than this many beats is given up where time costs, for a tone fit.
BEATS = 6.0
#: Seconds of a run over its coherent window from which time costs.
COSTLY_S = 0.05


class Workers(Protocol):
    """What is needed of `fitting.fmu.FmuWorkers`."""

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs)."""
        ...


@dataclass(frozen=True)
class Shot:
    """One drive of an FMU: its start values, the tones in it, the outputs that are read.

    With `input` the tones are fed there, each with amplitude `level`, `steps_per_period` held
    steps in the period of the fastest. `drive_hz` are the tones of the drive, where lines beside
    them are read, and `order` that of the combinations which the response is known to hold.
    """

    values: Mapping[str, Scalar]
    tones_hz: tuple[float, ...]
    outputs: tuple[str, ...]
    input: str | None = None
    level: float = 1.0
    steps_per_period: int = 0
    drive_hz: tuple[float, ...] = ()
    order: int = 1

    def window(
        self, settle_s: float, order: int = 1, longest_s: float = LONGEST_WINDOW_S
    ) -> Window:
        """When to sample it, after that time of settling."""
        held = self.steps_per_period if self.input is not None else 0
        driven = self.drive_hz or self.tones_hz
        return _window(self.tones_hz, driven, settle_s, held, max(order, self.order), longest_s)

    def run(
        self, window: Window, settings: Mapping[str, Scalar], more: tuple[str, ...] = ()
    ) -> Run:
        """The run of such a window; `more` outputs are read beside its own."""
        signal = None
        if self.input is not None:
            driven = self.drive_hz or self.tones_hz
            rows = tuple((tone, self.level, 0.0) for tone in driven)
            signal = InputSignal(self.input, rows, window.input_step_s)
        return Run(
            {**self.values, **settings},
            window.settle_s,
            window.step_s,
            window.samples,
            (*self.outputs, *(name for name in more if name not in self.outputs)),
            input_signal=signal,
        )


@lru_cache(maxsize=4096)
def _window(
    tones_hz: tuple[float, ...],
    driven_hz: tuple[float, ...],
    settle_s: float,
    held: int,
    order: int,
    longest_s: float,
) -> Window:
    coherent = len(tones_hz) == 1 or common_period(tones_hz) <= longest_s
    return plan_window(
        tones_hz,
        settle_s,
        samples_per_period=held,
        mixtures_hz=mixed_hz(driven_hz, order) if coherent else (),
        spare=SPARE_SAMPLES if coherent else SPARE_SAMPLES + 4 * (order - 1),
        longest_s=longest_s,
    )


@dataclass(frozen=True)
class Reading:
    """Tones in one run: complex amplitudes (tones, outputs) with the phase at time 0.

    `rest` (outputs,) is the root mean square of what mean and tones leave, `level` (outputs,) the
    largest value, `condition` the factor by which a fit of the tones may amplify rounding.
    """

    tones: ComplexArray
    rest: FloatArray
    level: FloatArray
    condition: float

    @property
    def amplitudes(self) -> FloatArray:
        """Peak amplitudes, (tones, outputs), NaN where there is no oscillation but rounding."""
        sizes = np.abs(self.tones)
        return np.where(sizes > NOTHING * self.level, sizes, np.nan)

    def apart(self, other: Reading) -> float:
        """Largest change from another reading of the same tones, relative to each amplitude."""
        change = np.abs(self.tones - other.tones) + np.abs(self.rest - other.rest)
        return _largest(change / other.amplitudes)

    def off(self, other: Reading) -> float:
        """Largest difference of amplitudes alone, relative to each: what a user would see."""
        return _largest(np.abs(np.abs(self.tones) - np.abs(other.tones)) / other.amplitudes)

    @property
    def spread(self) -> float:
        """Strongest over weakest tone of an output, the largest of all outputs."""
        sizes = self.amplitudes
        strongest = np.nanmax(np.where(np.isnan(sizes), 0.0, sizes), axis=0)
        return max(1.0, _largest(strongest / sizes))

    @property
    def rounding(self) -> float:
        """Relative error that comes of rounding the samples of a weak tone beside a strong one."""
        return _largest(32.0 * np.finfo(float).eps * self.condition * self.level / self.amplitudes)


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.max(known)) if known.size else 0.0


def read(window: Window, values: FloatArray) -> Reading:
    """The tones in sampled values (samples, outputs)."""
    found = window.read(values)
    largest = np.max(np.abs(values), axis=0)  # squares of shares stay numbers, whatever the unit
    condition = float(np.linalg.norm(window.fit.projector, 2) * math.sqrt(window.samples))
    return Reading(
        found.phasors,
        largest
        * np.sqrt(np.mean((found.rest / np.where(largest > 0.0, largest, 1.0)) ** 2, axis=0)),
        largest,
        condition,
    )


@dataclass(frozen=True)
class Pace:
    """Seconds of a short run, and what every period of the fastest tone adds (0: nothing)."""

    run_s: float
    per_period_s: float


@dataclass
class Probe:
    """Runs of some shots, and what they took; answers are kept for who asks again.

    `order`: no combination of tones up to it folds onto a tone in a coherent window.
    """

    shots: tuple[Shot, ...]
    workers: Workers
    longest_s: float = LONGEST_WINDOW_S
    seconds: float = 0.0
    runs: int = 0
    _kept: dict[object, tuple[list[Reading], float]] = field(default_factory=dict)
    _paces: dict[object, Pace] = field(default_factory=dict)

    def read(
        self, settings: Mapping[str, Scalar], settle_s: float, order: int = 1
    ) -> tuple[list[Reading], float]:
        """What every shot shows after that time, and the seconds that a run took."""
        key = (_key(settings), settle_s, order)
        if key not in self._kept:
            windows = [shot.window(settle_s, order, self.longest_s) for shot in self.shots]
            pairs = zip(self.shots, windows, strict=True)
            answers, seconds = self._run([shot.run(w, settings) for shot, w in pairs])
            found = [read(w, a) for w, a in zip(windows, answers, strict=True)]
            self._kept[key] = found, seconds / len(self.shots)
        return self._kept[key]

    def largest(
        self, settings: Mapping[str, Scalar], settle_s: float, output: str, order: int = 1
    ) -> float:
        """Largest size of a further output at the samples of every shot."""
        windows = [shot.window(settle_s, order, self.longest_s) for shot in self.shots]
        pairs = list(zip(self.shots, windows, strict=True))
        runs = [shot.run(w, settings, (output,)) for shot, w in pairs]
        answers, _ = self._run(runs)
        columns = [run.outputs.index(output) for run in runs]
        return max(float(np.max(np.abs(a[:, k]))) for a, k in zip(answers, columns, strict=True))

    def finer_input(self, most: int) -> bool:
        """Hold generated inputs over half the time from now on; False where that is too fine."""
        steps = [shot.steps_per_period for shot in self.shots if shot.input is not None]
        if not steps or 2 * max(steps) > most:
            return False
        self.hold(tuple(replace(s, steps_per_period=2 * s.steps_per_period) for s in self.shots))
        return True

    def hold(self, shots: tuple[Shot, ...]) -> None:
        """Go on with these shots; what was read of others is forgotten."""
        self.shots = shots
        self._kept.clear()

    def pace(self, settings: Mapping[str, Scalar]) -> Pace:
        """What a run costs, measured once for every setting by a short and a longer run."""
        key = _key(settings)
        if key not in self._paces:
            # in turn, so that both meet the same machine
            pairs = [[self._trial(settings, n) for n in TRIAL_PERIODS] for _ in range(3)]
            short, longer = (min(pair[k] for pair in pairs) for k in (0, 1))
            per_period = (longer - short) / (TRIAL_PERIODS[1] - TRIAL_PERIODS[0])
            costs = longer > NO_PACE * short and longer - short > NO_PACE_S
            self._paces[key] = Pace(short, per_period if costs else 0.0)
        return self._paces[key]

    def cost_s(self, settings: Mapping[str, Scalar], settle_s: float) -> float:
        """Seconds that a run with this time to settle would take, by the pace of short ones."""
        pace = self.pace(settings)
        return max(
            pace.run_s + pace.per_period_s * max(s.tones_hz) * (settle_s + self.length_s(s))
            for s in self.shots
        )

    def length_s(self, shot: Shot) -> float:
        """Length of the window of a shot, s."""
        window = shot.window(0.0, 1, self.longest_s)
        return window.step_s * window.samples

    def settle_on_windows(self, settings: Mapping[str, Scalar]) -> None:
        """Give up common periods that are much longer than the beats, where time costs."""
        for shot in self.shots:
            gaps = [abs(a - b) for i, a in enumerate(shot.tones_hz) for b in shot.tones_hz[:i]]
            if not gaps or not min(gaps) > 0.0:
                continue
            period, beats = float(common_period(shot.tones_hz)), BEATS / min(gaps)
            if period <= beats:
                continue
            if self.pace(settings).per_period_s * period * max(shot.tones_hz) > COSTLY_S:
                self.longest_s = min(self.longest_s, beats)

    def _trial(self, settings: Mapping[str, Scalar], periods: int) -> float:
        """Seconds of a run over so many periods."""
        runs = []
        for shot in self.shots:
            tone = max(shot.tones_hz)
            # the window of one tone is short, whatever the others are
            one = replace(shot, tones_hz=(tone,), drive_hz=())
            runs.append(one.run(one.window(periods / tone), settings))
        return self._run(runs)[1] / len(runs)

    def _run(self, runs: Sequence[Run]) -> tuple[list[FloatArray], float]:
        begun = time.perf_counter()
        answers = self.workers.run(runs)
        seconds = time.perf_counter() - begun
        self.seconds += seconds
        self.runs += len(runs)
        return answers, seconds


def apart(after: Sequence[Reading], before: Sequence[Reading]) -> float:
    """Largest change between two readings of all shots."""
    return max(b.apart(a) for a, b in zip(after, before, strict=True))


def off(found: Sequence[Reading], truth: Sequence[Reading]) -> float:
    """Largest relative error of an amplitude over all shots."""
    return max(f.off(t) for f, t in zip(found, truth, strict=True))


def _key(settings: Mapping[str, Scalar]) -> tuple[tuple[str, Scalar], ...]:
    return tuple(sorted(settings.items()))
