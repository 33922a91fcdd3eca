"""Settings that take too long to be run: their cost from a shorter run, their error by theory."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from fitting.lab import exact as exact_modes
from fitting.lab.drive import Drive
from fitting.lab.names import AMPLITUDES
from fitting.lab.string import TwoModes
from fitting.lab.tradeoff.bench import Bench
from fitting.lab.tradeoff.grid import setting_of
from fitting.lab.tradeoff.quantities import error_of, largest_change
from fitting.lab.tradeoff.records import COHERENT, SUBSTEPS, Cost, Measurement, Reference, Setting
from fitting.lab.tradeoff.scenes import Scene
from fitting.text.arrays import FloatArray

#: Substeps of the run from which the cost of one is measured, and how many are in a period.
SHORT_RUN, RATE = 4000, 40.0
SAMPLES = 64


def stepped_setting(
    scene: Scene, substeps: float, settle_s: float, *, periodic: bool = False
) -> Setting:
    """Amplitudes by the solver with that many substeps in a period of the fastest mode.

    Args:
        scene: an FMU with start values, tones and truth.
        substeps: substeps in a period.
        settle_s: time before the first sample, s.
        periodic: whether the run begins on its periodic orbit.
    """
    solver = next(solver for solver in scene.solvers if solver.kind == SUBSTEPS)
    return setting_of(scene, solver, substeps, (periodic, settle_s), SAMPLES)


def closed_orbits(bench: Bench, substeps: float) -> FloatArray:
    """Amplitudes (tones,) of each tone alone by rk4 on its closed orbit.

    So many substeps in a period of the tone. One period holds the whole orbit, so no quality factor
    is too high for it.

    Args:
        bench: the laboratory: sample, drives, instrument, noise.
        substeps: substeps in a period.
    """
    scene = bench.scene
    per_fastest = substeps * min(scene.tones_hz) / scene.fastest_hz
    setting = stepped_setting(scene, per_fastest, 0.0, periodic=True)
    drives = [scene.single_tone(tone) for tone in scene.tones_hz]
    return np.concatenate(bench.amplitudes(setting, drives))


@dataclass
class Extrapolation:
    """What a substep costs here, measured once, and what is known of the method's error."""

    bench: Bench
    _substep: Cost | None = None
    _errors: dict[float, float] = field(default_factory=dict)

    def expected_s(self, setting: Setting) -> float:
        """Wall time that a setting of amplitudes would take, s; 0 where steps are not counted.

        Args:
            setting: of the simulation: solver, settling, samples.
        """
        if setting.resolution_kind != SUBSTEPS or setting.quantity != AMPLITUDES:
            return 0.0
        return self._cost(setting).seconds

    def measurement(self, setting: Setting, reference: Reference) -> Measurement | None:
        """The row of a setting that is not run; None where its error cannot be known.

        The error is the method's own (linear: where its recursion stands still; with cubic terms:
        that of each tone alone on its closed orbit) and what is left of the transient.

        Args:
            setting: of the simulation: solver, settling, samples.
            reference: truth, or the best that is known.
        """
        scene = self.bench.scene
        if setting.reader != COHERENT or scene.sample is None:
            return None
        if scene.linear:
            error, how = self._linear_error(setting, reference), "of the recursion's steady state"
        elif scene.high_q:
            error, how = self._orbit_error(setting.resolution), "of each tone on its closed orbit"
        else:
            return None
        left = math.exp(-math.pi * scene.width_hz * setting.settle_s)
        if setting.periodic:
            left *= error  # what the start lacks is the method's own error
        peaks = np.array(reference.values)
        error += left * float(np.sum(peaks) / np.min(peaks))
        cost = self._cost(setting)
        return Measurement(
            setting=setting,
            error=max(error, reference.error),
            bounded=error <= reference.error,
            cost=cost,
            extrapolated=True,
            note=f"cost: {cost.solver_steps or 0:.3g} substeps, each as in a run of {SHORT_RUN}; "
            f"error: that {how}, and what is left of the transient",
        )

    def _cost(self, setting: Setting) -> Cost:
        """As many times a substep as the setting takes of them."""
        bench, one = self.bench, self._one_substep()
        windows = [bench.window(setting, drive) for drive in bench.scene.drives]
        count = sum(bench.substeps(setting, window) for window in windows)
        return Cost(
            seconds=one.seconds * count,
            cpu_s=one.cpu_s * count,
            runs=len(windows),
            steps=sum(window.samples - 1 + bool(window.settle_s) for window in windows),
            reads=sum(window.samples for window in windows),
            solver_steps=count,
        )

    def _one_substep(self) -> Cost:
        """A run of some thousand substeps, less one of none."""
        if self._substep is None:
            bench = self.bench
            values = dict(stepped_setting(bench.scene, RATE, 0.0).values)
            bench.warm(values)
            lengths = (0.0, SHORT_RUN / (RATE * bench.scene.fastest_hz))
            none, some = (bench.timed(partial(bench.idle, values, s))[1] for s in lengths)
            self._substep = Cost(
                seconds=max((some.seconds - none.seconds) / SHORT_RUN, 1e-9),
                cpu_s=max((some.cpu_s - none.cpu_s) / SHORT_RUN, 1e-9),
            )
        return self._substep

    def _linear_error(self, setting: Setting, reference: Reference) -> float:
        """Relative error of what the method settles to with the substeps of this very window."""
        scene = self.bench.scene
        found = []
        for drive in scene.drives:
            step = self.bench.window(setting, drive).step_s
            longest = 1.0 / (setting.resolution * scene.fastest_hz)
            h = step / math.ceil(step / longest * (1.0 - 1e-12))
            if isinstance(scene.sample, TwoModes):
                tones = drive.tones_hz
                found.append(exact_modes.runge_kutta_amplitudes(scene.sample, 0, tones, h))
        return error_of(np.concatenate(found), reference)

    def _orbit_error(self, count: float) -> float:
        """Relative error of each tone alone, on orbits of so many substeps in a period."""
        scene = self.bench.scene
        if count not in self._errors and scene.sample is not None:
            drives = [Drive.equal((tone,), 1.0) for tone in scene.tones_hz]
            truth = [abs(scene.sample.amplitudes(drive)[0, 0]) for drive in drives]
            self._errors[count] = largest_change(closed_orbits(self.bench, count), np.array(truth))
        return self._errors[count]
