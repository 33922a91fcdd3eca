"""Runs of a scene at a setting: when it is sampled, how it is read, and what that costs."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from scipy.signal import windows

from fitting.extension.fmu import FmuWorkers, Run
from fitting.lab.tradeoff.records import COHERENT, FLAT_TOP, HELD, SUBSTEPS, Cost, Setting
from fitting.lab.tradeoff.scenes import LONGEST_PERIOD_S, Scene
from fitting.signal.window import SPARE_SAMPLES, Window, plan_window, whole_steps
from fitting.simulate.drive import Drive
from fitting.text.arrays import FloatArray, Scalar

Result = TypeVar("Result")

#: Where the mean of the tones is seen, as a share of the sampling rate: amid the band.
PLACE = 0.25


@dataclass(frozen=True)
class Patience:
    """How often something is timed: `least` times and `total_s` in all, once if that takes long."""

    least: int = 5
    total_s: float = 0.1
    long_s: float = 0.5


class Bench:
    """A scene on running FMU workers; counts what every evaluation asks for."""

    def __init__(self, scene: Scene, workers: FmuWorkers, patience: Patience) -> None:
        self.scene, self.workers, self.patience = scene, workers, patience
        self._reads = self._solver_steps = 0
        # every layout begins with a run that is cheap to repeat when a reset is put to the test
        first = scene.solvers[0]
        self.warm(scene.values_of(first, first.resolutions[0]))

    def warm(self, values: dict[str, Scalar]) -> None:
        """Let the workers prove that these values may vary between resets, on a short run.

        Args:
            values: start values, by name.
        """
        self.idle(values, 0.0)

    def idle(self, values: dict[str, Scalar], length_s: float) -> float:
        """One run of that length with a single sample, which is handed back.

        Args:
            values: start values, by name.
            length_s: length of the run, s.
        """
        drive = self.scene.drives[0]
        run = Run(
            start_values={**drive.start_values, **values},
            settle_s=length_s,
            sample_step_s=1.0,
            samples=1,
            outputs=drive.outputs,
        )
        return float(self.workers.run([run])[0][0, 0])

    def amplitudes(
        self, setting: Setting, drives: Sequence[Drive] | None = None
    ) -> list[FloatArray]:
        """Amplitudes (tones,) of every drive (the scene's own).

        Args:
            setting: of the simulation: solver, settling, samples.
            drives: each with tones and amplitudes.
        """
        driven = self.scene.drives if drives is None else drives
        seen = [self.window(setting, drive) for drive in driven]
        pairs = list(zip(driven, seen, strict=True))
        answers = self.run([drive.run(window, setting.values) for drive, window in pairs])
        self._solver_steps += sum(self.substeps(setting, window) for window in seen)
        return [
            read(setting.reader, window, values[:, 0])
            for window, values in zip(seen, answers, strict=True)
        ]

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of runs, counted.

        Args:
            runs: to be simulated.
        """
        self._reads += sum(run.samples for run in runs)
        return self.workers.run(runs)

    def timed(self, work: Callable[[], Result]) -> tuple[Result, Cost]:
        """Result of some work, and its cost: medians of the times, counts of one repeat.

        Args:
            work: is called and timed.
        """
        walls: list[float] = []
        cpus: list[float] = []
        patience = self.patience
        while True:
            before, self._reads, self._solver_steps = self.workers.counts, 0, 0
            cpu, wall = cpu_seconds(self.workers), time.perf_counter()
            result = work()
            walls.append(time.perf_counter() - wall)
            cpus.append(cpu_seconds(self.workers) - cpu)
            if sum(walls) >= (patience.long_s if len(walls) < patience.least else patience.total_s):
                break
        counts = self.workers.counts
        return result, Cost(
            seconds=statistics.median(walls),
            cpu_s=statistics.median(cpus),
            repeats=len(walls),
            runs=counts.runs - before.runs,
            steps=counts.steps - before.steps,
            reads=self._reads,
            solver_steps=self._solver_steps,
        )

    def window(self, setting: Setting, drive: Drive) -> Window:
        """When a drive is sampled at a setting; a single tone over one period of its own.

        Args:
            setting: of the simulation: solver, settling, samples.
            drive: tones and amplitudes that drive.
        """
        held = int(setting.resolution) if setting.resolution_kind == HELD else self.scene.held
        if len(drive.tones_hz) == 1 and setting.reader == COHERENT:
            return window_of(drive.tones_hz, setting.settle_s, COHERENT, 0.0, 0, held)
        return window_of(
            drive.tones_hz,
            setting.settle_s,
            setting.reader,
            setting.window_s,
            setting.samples,
            held,
        )

    def substeps(self, setting: Setting, window: Window) -> int:
        """Steps of a solver with a fixed substep, doStep calls for others.

        Args:
            setting: of the simulation: solver, settling, samples.
            window: settling and samples of a run.
        """
        if setting.resolution_kind != SUBSTEPS:
            return window.samples - 1 + bool(window.settle_s)
        longest = 1.0 / (setting.resolution * self.scene.fastest_hz)
        lead = math.ceil(window.settle_s / longest * (1.0 - 1e-12))
        each = max(1, math.ceil(window.step_s / longest * (1.0 - 1e-12)))
        return lead + (window.samples - 1) * each


@lru_cache(maxsize=4096)
def window_of(
    tones_hz: tuple[float, ...],
    settle_s: float,
    reader: str,
    window_s: float,
    samples: int,
    held: int = 0,
) -> Window:
    """When to take about that many samples.

    The coherent reader takes a common period, and where the tones have none the window of a tone
    fit. The other readers place the tones amid the band, over about `window_s`. `held` > 0: input
    steps per period of the fastest tone, of which a step and the settling take a whole number. Kept
    for who asks again: no cost of a simulation that is repeated.

    Args:
        tones_hz: frequencies of the tones, Hz.
        settle_s: time before the first sample, s.
        reader: how amplitudes are read of samples.
        window_s: length of the window, s.
        samples: number of samples.
        held: steps in a period of the fastest tone for which an input is held; 0: none is.
    """
    if reader == COHERENT:
        spare = samples - 2 * len(tones_hz) - 1 if samples else SPARE_SAMPLES
        return plan_window(
            tones_hz,
            settle_s,
            samples_per_period=held,
            spare=max(0, spare),
            longest_s=LONGEST_PERIOD_S,
        )
    mean = sum(tones_hz) / len(tones_hz)
    step = (max(0, round(mean * window_s / samples - PLACE)) + PLACE) / mean
    count = 0
    if held:
        count = max(1, round(step * max(tones_hz) * held))
        step = count / (max(tones_hz) * held)
        settle_s = whole_steps(settle_s, step / count)
    return Window(
        tones_hz=tones_hz,
        settle_s=settle_s,
        step_s=step,
        samples=samples,
        coherent=False,
        held_steps=count,
    )


def read(reader: str, window: Window, samples: FloatArray) -> FloatArray:
    """Amplitudes (tones,) in the sampled values (samples,).

    Args:
        reader: how amplitudes are read of samples.
        window: settling and samples of a run.
        samples: values (samples, outputs).
    """
    if reader == COHERENT:
        return window.read(samples).amplitudes
    return largest_lines(samples, window.step_s, window.tones_hz, flat=reader == FLAT_TOP)


def largest_lines(
    samples: FloatArray, step_s: float, tones_hz: Sequence[float], *, flat: bool
) -> FloatArray:
    """Amplitude (tones,) of the largest line of a spectrum about each tone, nearer than any other.

    2 |sum x_j w_j exp(-2 pi i j k/n)| / sum w_j at the bins k: with a flat-top window w at most
    0.01 dB off for a tone between two bins, without one (w = 1) at most 3.92 dB.

    Source: G. Heinzel, A. Ruediger, R. Schilling, Spectrum and spectral density estimation by the
    DFT, 2002, section 8.

    Args:
        samples: values (samples, outputs).
        step_s: time between samples, s.
        tones_hz: frequencies of the tones, Hz.
        flat: whether the window is tapered with a flat top.
    """
    n = samples.size
    taper = windows.flattop(n, sym=False) if flat else np.ones(n)
    lines = 2.0 * np.abs(np.fft.rfft(samples * taper)) / float(np.sum(taper))
    turns = [tone * step_s % 1.0 for tone in tones_hz]
    seen = [n * min(turn, 1.0 - turn) for turn in turns]  # folded, in bins
    found = []
    for place in seen:
        others = [abs(place - other) for other in seen if other != place]
        reach = max(1.0, 0.5 * min(others, default=4.0))
        low, high = int(np.ceil(place - reach)), int(np.floor(place + reach))
        found.append(float(np.max(lines[max(0, low) : min(lines.size, high + 1)])))
    return np.array(found)


def cpu_seconds(workers: FmuWorkers) -> float:
    """Processor time of this thread and of the FMU's process in s; others may work beside it.

    NaN where the system does not tell, or where several processes share the work: then the sum of
    their times is none that anybody waits for.

    Args:
        workers: processes that run the FMU.
    """
    if len(workers.pids) != 1:
        return math.nan
    try:
        text = Path(f"/proc/{workers.pids[0]}/schedstat").read_text(encoding="ascii")
    except OSError:
        return math.nan
    return time.thread_time() + int(text.split()[0]) * 1e-9
