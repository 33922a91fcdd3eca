"""Runs of a scene at a setting: amplitudes from an FMU, and what they cost."""

from __future__ import annotations

import math
import multiprocessing
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting.fmu import FmuWorkers, InputSignal, Run
from fitting.lab.tradeoff.reading import Sampling, sample
from fitting.lab.tradeoff.records import COHERENT, Setting
from fitting.lab.tradeoff.scenes import Drive, Scene, Solver
from fitting.text.arrays import FloatArray, Scalar

#: Held steps per period where neither setting nor campaign says.
HELD = "held steps per period"
SUBSTEPS = "substeps per period"
#: Samples over one period of a single tone.
SINGLE_SAMPLES = 5


@dataclass(frozen=True)
class Patience:
    """How often something is timed: `least` times and `total_s` in all, once if that takes long."""

    least: int = 5
    total_s: float = 0.1
    long_s: float = 0.5


@dataclass(frozen=True)
class Cost:
    """Medians of wall and processor time in s, calls of one repeat."""

    seconds: float
    cpu_s: float
    repeats: int
    runs: int
    steps: int
    reads: int
    solver_steps: int


class Bench:
    """A scene on running FMU workers; counts what every evaluation asks for."""

    def __init__(self, scene: Scene, workers: FmuWorkers, patience: Patience) -> None:
        self.scene, self.workers, self.patience = scene, workers, patience
        self._reads = self._solver_steps = 0
        # every layout begins with a run that is cheap to repeat when a reset is put to the test
        if scene.solvers:
            self.warm(setting_values(scene, scene.solvers[0], scene.solvers[0].resolutions[0]))

    def warm(self, values: dict[str, Scalar], drives: Sequence[Drive] = ()) -> None:
        """Let the workers prove that these values may vary between resets, on runs of no length."""
        chosen = drives or self.scene.drives[:1]
        self.workers.run(
            [
                Run({**self.scene.values, **d.values, **values}, 0.0, 1.0, 1, self._outputs(d))
                for d in chosen
            ]
        )

    def amplitudes(
        self, setting: Setting, drives: Sequence[Drive] | None = None, scene: Scene | None = None
    ) -> list[FloatArray]:
        """Amplitudes at the tones of every drive (the scene's own), one array each."""
        scene = scene or self.scene
        driven = scene.drives if drives is None else drives
        plans = [self.sampling(setting, drive) for drive in driven]
        runs = [self._run(scene, setting, d, s) for d, s in zip(driven, plans, strict=True)]
        answers = self.workers.run(runs)
        self._reads += sum(s.samples for s in plans)
        self._solver_steps += sum(substeps(setting, scene, s) for s in plans)
        return [s.amplitudes(a[:, 0]) for s, a in zip(plans, answers, strict=True)]

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of runs that were made elsewhere, counted like any other."""
        self._reads += sum(run.samples for run in runs)
        return self.workers.run(runs)

    def timed(self, work: Callable[[], float]) -> tuple[float, Cost]:
        """Result of some work, and its cost."""
        walls: list[float] = []
        cpus: list[float] = []
        patience = self.patience
        while True:
            before, self._reads, self._solver_steps = self.workers.counts, 0, 0
            cpu, wall = cpu_seconds(), time.perf_counter()
            result = work()
            walls.append(time.perf_counter() - wall)
            cpus.append(cpu_seconds() - cpu)
            total = sum(walls)
            if total >= patience.long_s or (
                len(walls) >= patience.least and total >= patience.total_s
            ):
                break
        counts = self.workers.counts
        return result, Cost(
            statistics.median(walls),
            statistics.median(cpus),
            len(walls),
            counts.runs - before.runs,
            counts.steps - before.steps,
            self._reads,
            self._solver_steps,
        )

    def idle(self, values: dict[str, Scalar], length_s: float) -> float:
        """One run of that length with a single sample, which is handed back."""
        scene = self.scene
        start = {**scene.values, **scene.drives[0].values, **values}
        return float(self.workers.run([Run(start, length_s, 1.0, 1, (scene.output,))])[0][0, 0])

    def sampling(self, setting: Setting, drive: Drive) -> Sampling:
        """When a drive is sampled at a setting; a single tone over one period of its own."""
        held = int(setting.resolution) if setting.resolution_kind == HELD else self.scene.held
        if len(drive.tones_hz) == 1 and setting.reader == COHERENT:
            return sample(drive.tones_hz, setting.settle_s, COHERENT, 0.0, SINGLE_SAMPLES, held)
        return sample(
            drive.tones_hz,
            setting.settle_s,
            setting.reader,
            setting.window_s,
            setting.samples,
            held,
        )

    def _run(self, scene: Scene, setting: Setting, drive: Drive, s: Sampling) -> Run:
        values = {**scene.values, **drive.values, **setting.values}
        signal = None
        if scene.input is not None:
            rows = tuple((tone, scene.level, 0.0) for tone in drive.tones_hz)
            signal = InputSignal(scene.input, rows, s.input_step_s)
        return Run(
            values, s.settle_s, s.step_s, s.samples, self._outputs(drive), input_signal=signal
        )

    def _outputs(self, drive: Drive) -> tuple[str, ...]:
        return (drive.output or self.scene.output,)


def setting_values(
    scene: Scene, solver: Solver, resolution: float, periodic: bool = False
) -> dict[str, Scalar]:
    """Start values of a solver at a resolution; every setting of a scene sets the same variables.

    Then all runs share one layout, and the workers prove only once that a reset may vary them.
    """
    values: dict[str, Scalar] = {}
    for other in reversed(scene.solvers):
        values.update(other.values)
    values.update(solver.values)
    for other in scene.solvers:
        if other.variable and other.variable not in values:
            values[other.variable] = 0.0
    if solver.variable:
        values[solver.variable] = (
            1.0 / (resolution * scene.fastest_hz) if solver.kind == SUBSTEPS else resolution
        )
    if scene.start:
        values[scene.start] = periodic
    return values


def substeps(setting: Setting, scene: Scene, s: Sampling) -> int:
    """Steps of a solver with a fixed substep, doStep calls for others."""
    if setting.resolution_kind != SUBSTEPS:
        return s.samples - 1 + bool(s.settle_s)
    longest = 1.0 / (setting.resolution * scene.fastest_hz)
    lead = math.ceil(s.settle_s / longest * (1.0 - 1e-12))
    return lead + (s.samples - 1) * max(1, math.ceil(s.step_s / longest * (1.0 - 1e-12)))


def cpu_seconds() -> float:
    """Processor time of this process and its workers in s; NaN where the system does not tell."""
    total = time.process_time()
    for child in multiprocessing.active_children():
        try:
            text = Path(f"/proc/{child.pid}/schedstat").read_text(encoding="ascii")
        except OSError:
            return math.nan
        total += int(text.split()[0]) * 1e-9
    return total
