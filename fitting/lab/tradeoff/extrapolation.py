"""Settings that take too long to be run: their cost from a shorter run, their error by theory."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from fitting.lab import exact as exact_modes
from fitting.lab.tradeoff.bench import SUBSTEPS, Bench, substeps
from fitting.lab.tradeoff.quantities import error_of
from fitting.lab.tradeoff.records import AMPLITUDES, COHERENT, Measurement, Reference, Setting
from fitting.lab.tradeoff.reference import closed_orbits, refined_setting, richardson

#: Substeps of the run from which the cost of one is measured, and how many are in a period.
SHORT_RUN, RATE = 4000, 40.0
#: Substeps per period of the orbits whose limit is taken for the truth.
LIMIT = (640.0, 1280.0)


class Extrapolation:
    """What a substep costs here, measured once, and what is known of the method's error."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self._wall_s = self._cpu_s = 0.0
        self._errors: dict[float, float] = {}
        if any(solver.kind == SUBSTEPS for solver in bench.scene.solvers):
            self._measure_substep()

    def expected_s(self, setting: Setting) -> float:
        """Wall time that a setting of amplitudes would take, s; 0 where steps are not counted."""
        if setting.resolution_kind != SUBSTEPS or setting.quantity != AMPLITUDES:
            return 0.0
        return self._wall_s * self._calls(setting)[2]

    def measurement(self, setting: Setting, reference: Reference) -> Measurement | None:
        """The row of a setting that is not run; None where its error cannot be known.

        The error is the method's own (linear: where its recursion stands still; with cubic terms:
        that of each tone alone on its closed orbit) and what is left of the transient.
        """
        scene = self.bench.scene
        if setting.quantity != AMPLITUDES or setting.reader != COHERENT or scene.modes is None:
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
        steps, reads, count = self._calls(setting)
        return Measurement(
            setting,
            max(error, reference.error),
            error <= reference.error,
            self._wall_s * count,
            self._cpu_s * count,
            0,
            len(scene.drives),
            steps,
            reads,
            count,
            True,
            f"cost: {count:.3g} substeps, each as in a run of {SHORT_RUN}; error: that {how}, and "
            "what is left of the transient",
        )

    def _measure_substep(self) -> None:
        """Time a run of some thousand substeps, less one of none."""
        bench = self.bench
        values = dict(refined_setting(bench.scene, RATE, 0.0).values)
        bench.warm(values)
        wall, cpu = [], []
        for length in (0.0, SHORT_RUN / (RATE * bench.scene.fastest_hz)):
            _, cost = bench.timed(partial(bench.idle, values, length))
            wall.append(cost.seconds)
            cpu.append(cost.cpu_s)
        self._wall_s = max(1e-9, (wall[1] - wall[0]) / SHORT_RUN)
        self._cpu_s = max(1e-9, (cpu[1] - cpu[0]) / SHORT_RUN)

    def _calls(self, setting: Setting) -> tuple[int, int, int]:
        """Calls of doStep and getReal, and substeps, of all drives."""
        bench = self.bench
        plans = [bench.sampling(setting, drive) for drive in bench.scene.drives]
        steps = sum(s.samples - 1 + bool(s.settle_s) for s in plans)
        counts = (substeps(setting, bench.scene, s) for s in plans)
        return steps, sum(s.samples for s in plans), sum(counts)

    def _linear_error(self, setting: Setting, reference: Reference) -> float:
        """Relative error of what the method settles to with the substeps of this very window."""
        scene = self.bench.scene
        assert scene.modes is not None  # noqa: S101  (the caller has seen to it)
        found = []
        for drive in scene.drives:
            step = self.bench.sampling(setting, drive).step_s
            longest = 1.0 / (setting.resolution * scene.fastest_hz)
            h = step / math.ceil(step / longest * (1.0 - 1e-12))
            found.append(
                exact_modes.runge_kutta_amplitudes(scene.modes, scene.observed, drive.tones_hz, h)
            )
        return error_of(np.concatenate(found) * scene.level, reference)

    def _orbit_error(self, count: float) -> float:
        """Relative error of each tone alone, from orbits of so many substeps in a period."""
        if not self._errors:
            limit = closed_orbits(self.bench, LIMIT)
            self._truth = richardson(limit[0], limit[1])
            self._errors[LIMIT[1]] = float(np.max(np.abs(limit[1] / self._truth - 1.0)))
        if count not in self._errors:
            found = closed_orbits(self.bench, (count,))[0]
            self._errors[count] = float(np.max(np.abs(found / self._truth - 1.0)))
        return self._errors[count]
