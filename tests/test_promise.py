"""The promise of a plan: no amplitude is further from the truth than was wanted, whatever scene.

Truth is mpmath's solution of the linear equations, a 2 x 2 system per tone (`tests.reference`);
for the cubic model a Fourier collocation of the full equations, written here on its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

from fitting.budget import Hints
from fitting.drive import Drive
from fitting.drive_plan import plan_drive
from fitting.fmu import FmuWorkers
from tests import reference
from tests.scenes import Scene

ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-9)
SCENES = 100
REDUCTIONS = ("periodic start", "far mode left out", "far mode quasi-static", "rotating frame")


def linear_scene(k: int) -> Scene:
    """Scene k of a seeded grid: Q 5 to 1e8, any frequency, tones 1e-4 to 10 line widths apart."""
    rng = np.random.default_rng([4, k])
    eta = 10.0 ** rng.uniform(0.0, 9.0)
    q1, q2 = 10.0 ** rng.uniform(np.log10(5.0), 8.0, 2)
    width = eta / q1
    apart = width * 10.0 ** rng.uniform(-4.0, 1.0)
    # tones as people write them, and in every fifth scene as nobody does
    digits = int(np.ceil(-np.log10(0.1 * apart)))
    u1 = eta + width * rng.uniform(-2.0, 2.0)
    u1, u2 = (u1, u1 + apart) if k % 5 == 4 else (round(u1, digits), round(u1 + apart, digits))
    return Scene(
        f"scene {k}",
        theta=float(rng.uniform(0.0, np.pi)),
        reflection=bool(rng.integers(2)),
        d1=width,
        d2=eta / q2,
        eta_plus=eta,
        eta_minus=eta * (1.0 + 10.0 ** rng.uniform(-6.0, 0.3)),
        u1=abs(float(u1)),
        u2=abs(float(u2)),
        A2=float(rng.choice([1.0, 0.1])),
        phase1=float(rng.uniform(-3.0, 3.0)),
        periodic_start=bool(k % 4 == 3),
    )


def truth_of(scene: Scene) -> np.ndarray:
    """Amplitudes (tones, modes) from mpmath."""
    rows = []
    for u, size in ((scene.u1, scene.A1), (scene.u2, scene.A2)):
        rows.append([float(mp.mpf(size) * abs(x)) for x in reference.phasors(scene, u)])
    return np.array(rows)


@pytest.fixture(scope="module")
def workers(oscillator_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(oscillator_fmu) as running:
        yield running


@pytest.mark.parametrize("accuracy", ACCURACIES)
def test_linear_scenes_keep_the_promise(accuracy: float, workers: FmuWorkers) -> None:
    for k in range(SCENES):
        scene = linear_scene(k)
        drive = Drive(scene.parameters, (scene.u1, scene.u2), ("q1_hybrid", "q2_hybrid"))
        # reductions take time to be tried; every tenth scene does
        hints = Hints() if k % 10 == 0 else Hints(forbid=REDUCTIONS)
        plan = plan_drive(drive, accuracy, workers, workers.description, hints)
        found = plan.read(workers.run([plan.run])[0])
        error = float(np.max(np.abs(found / truth_of(scene) - 1.0)))
        assert plan.promised <= accuracy, (scene, plan.sentences)
        assert error <= plan.promised, (scene, error, plan.sentences)
