"""Runs of the scenes of the oscillator, and their errors against the equations at 50 digits."""

from __future__ import annotations

import math

from tests.support import reference, scenes
from tests.support.fmus import OK, Instance
from tests.support.scenes import Scene

MODES = ("q1_hybrid", "q2_hybrid")
GRID = [*scenes.corners(), *scenes.grid(270, seed=20260711), *scenes.held_input(12, seed=3)]


def simulate(
    fmu: Instance, scene: Scene, times: list[float], **settings: float
) -> list[list[float]]:
    """Run a scene to the times, holding its inputs, and return both modes there."""
    fmu.slave.reset()
    fmu.start(**scene.parameters, **settings)
    now, rows = 0.0, []
    for k, time in enumerate(times):
        if scene.inputs:
            fmu.set(b=scene.inputs[k])
        assert fmu.step(now, time - now) == OK, fmu.messages
        now += time - now
        rows.append(fmu.get(*MODES))
    return rows


def communication_points(scene: Scene) -> list[float]:
    """Return the times that the FMU itself reaches when stepping by ``step_s``."""
    times, now = [], 0.0
    for k in range(len(scene.inputs) or 2):
        now += scene.step_s * (k + 1) - now
        times.append(now)
    return times


def relative_errors(scene: Scene, found: list[list[float]], times: list[float]) -> list[float]:
    """Return the largest error of each mode over its largest amplitude."""
    truth = reference.displacements(scene, times, scene.periodic_start, scene.inputs or None)
    amplitudes = [
        max(math.hypot(float(row[i]), float(row[2 + i]) * scene.eta_plus / eta) for row in truth)
        for i, eta in enumerate((scene.eta_plus, scene.eta_minus))
    ]
    return [
        max(abs(float(f[i] - row[i])) for f, row in zip(found, truth, strict=True))
        / (amplitudes[i] if amplitudes[i] > 1e-13 * max(amplitudes) else max(amplitudes) or 1.0)
        for i in (0, 1)
    ]
