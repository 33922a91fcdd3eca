"""The promise of a plan: no amplitude is further from the truth than was wanted, whatever scene.

Truth is mpmath's solution of the linear equations, a 2 x 2 system per tone (`tests.reference`);
for the cubic model a Fourier collocation of the full equations, written here on its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.pool import FmuWorkers
from fitting.simulate.drive import Drive
from fitting.simulate.planner import DrivePlan, plan_drives
from fitting.simulate.probe import knowledge_of
from fitting.simulate.words import warnings_in_words
from tests.support import reference
from tests.support.plan_words import plan_in_words
from tests.support.scenes import Scene
from tests.support.twins import swift_model

ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-9)
#: Scenes of a seeded grid; of their first few every kind of scene and accuracy is one.
SCENES, FEW = 100, 10
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


@cache
def truth_of(k: int) -> np.ndarray:
    """Amplitudes (tones, modes) of scene k from mpmath, for every accuracy the same."""
    scene, rows = linear_scene(k), []
    for u, size in ((scene.u1, scene.A1), (scene.u2, scene.A2)):
        rows.append([float(mp.mpf(size) * abs(x)) for x in reference.phasors(scene, u)])
    return np.array(rows)


def planned(
    drive: Drive, accuracy: float, running: FmuWorkers, annotation: AccuracyAnnotation | None = None
) -> DrivePlan:
    return plan_drives((drive,), accuracy, running, knowledge_of(running.description, annotation))


@pytest.fixture(scope="module")
def workers(swift_fmu: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(swift_fmu) as running:
        yield running


@pytest.mark.parametrize(
    "scenes",
    [
        pytest.param(range(FEW), id="few"),
        pytest.param(range(FEW, SCENES), id="all", marks=pytest.mark.nightly),
    ],
)
@pytest.mark.parametrize("accuracy", ACCURACIES)
def test_linear_scenes_keep_the_promise(
    accuracy: float, scenes: range, workers: FmuWorkers
) -> None:
    for k in scenes:
        scene = linear_scene(k)
        drive = Drive(
            start_values=scene.parameters,
            tones_hz=(scene.u1, scene.u2),
            outputs=("q1_hybrid", "q2_hybrid"),
        )
        # reductions take time to be tried; every tenth scene does
        annotation = AccuracyAnnotation() if k % 10 == 0 else AccuracyAnnotation(forbid=REDUCTIONS)
        plan = planned(drive, accuracy, workers, annotation)
        found = plan.read(workers.run(plan.runs)[0])
        error = float(np.max(np.abs(found / truth_of(k) - 1.0)))
        assert plan.promised <= accuracy, (scene, plan_in_words(plan.budget))
        assert error <= plan.promised, (scene, error, plan_in_words(plan.budget))


# --- the cubic model -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Cubic(Scene):
    """A scene of the cubic model."""

    alpha1: float = 0.0
    alpha2: float = 0.0
    kappa: float = 0.0

    @property
    def parameters(self) -> dict[str, float | bool]:
        """Return the start values by the FMU's variable names."""
        cubic = {"alpha1": self.alpha1, "alpha2": self.alpha2, "kappa": self.kappa}
        return super().parameters | cubic


def cubic_scene(q: float, level: float, u1: float, u2: float, two: bool) -> Cubic:
    """Modes at 100 and 137 Hz; `level` is about the shift by the cubic terms in line widths."""
    width, k = 100.0 / q, (2.0 * np.pi * 100.0) ** 2
    drive = float(np.sqrt(8.0 / 3.0 * level / q) * k / q)
    return Cubic(
        f"Q = {q}, level {level}",
        theta=1.9,
        d1=width,
        d2=1.3 * width,
        eta_plus=100.0,
        eta_minus=137.0,
        u1=u1,
        u2=u2,
        A1=drive,
        A2=0.5 * drive if two else 0.0,
        phase2=0.7,
        alpha1=k,
        alpha2=0.8 * k,
        kappa=0.5 * k,
    )


def collocated(p: Cubic, period_s: float, points: int) -> np.ndarray:
    """Amplitudes (tones, modes) of the periodic solution of the full equations, by Newton.

    Both modes on `points` times of one period; derivatives by the Fourier series through them.
    """
    t = period_s * np.arange(points) / points
    k = 2j * np.pi * np.fft.fftfreq(points, period_s / points)
    basis = np.fft.fft(np.eye(points), axis=0)
    first = np.fft.ifft(k[:, np.newaxis] * basis, axis=0).real
    second = np.fft.ifft((k**2)[:, np.newaxis] * basis, axis=0).real
    c, s = np.cos(p.theta), np.sin(p.theta)
    turn = np.array([[c, -s], [s, c]])
    d = 2.0 * np.pi * turn @ np.diag([p.d1, p.d2]) @ turn.T
    squares = [(2.0 * np.pi * eta) ** 2 for eta in (p.eta_plus, p.eta_minus)]
    tones = [(a, u, f) for a, u, f in ((p.A1, p.u1, p.phase1), (p.A2, p.u2, p.phase2)) if a]
    force = sum(a * np.cos(2.0 * np.pi * u * t + f) for a, u, f in tones)
    eye = np.eye(points)
    linear = np.block(
        [
            [second * (i == j) + d[i, j] * first + squares[i] * eye * (i == j) for j in (0, 1)]
            for i in (0, 1)
        ]
    )
    y = np.linalg.solve(linear, np.concatenate([force, force]))
    for _ in range(40):
        q1, q2 = y[:points], y[points:]
        cubic = np.concatenate(
            [
                p.alpha1 * q1**3 + p.kappa * q1 * q2**2,
                p.alpha2 * q2**3 + p.kappa * q1**2 * q2,
            ]
        )
        cross = np.diag(2.0 * p.kappa * q1 * q2)
        slope = np.block(
            [
                [np.diag(3.0 * p.alpha1 * q1**2 + p.kappa * q2**2), cross],
                [cross, np.diag(3.0 * p.alpha2 * q2**2 + p.kappa * q1**2)],
            ]
        )
        change = np.linalg.solve(linear + slope, linear @ y + cubic - np.tile(force, 2))
        y = y - change
        if np.abs(change).max() < 1e-14 * np.abs(y).max():
            break
    spectrum = np.abs(np.fft.rfft(y.reshape(2, points), axis=1)) * 2.0 / points
    return np.array([spectrum[:, round(u * period_s)] for _, u, _ in tones])


CUBIC_SCENES = (
    (cubic_scene(10.0, 0.2, 100.0, 90.0, two=False), 0.01, 64),
    (cubic_scene(8.0, 0.1, 100.0, 125.0, two=True), 0.04, 120),
)


@pytest.fixture(scope="module")
def cubic_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FmuWorkers]:
    fmu = swift_model("DuffingOscillator", tmp_path_factory)
    with FmuWorkers(fmu) as running:
        yield running


@pytest.mark.parametrize(("scene", "period_s", "points"), CUBIC_SCENES)
def test_cubic_scenes_keep_what_is_promised(
    scene: Cubic, period_s: float, points: int, cubic_workers: FmuWorkers
) -> None:
    truth = collocated(scene, period_s, points)
    np.testing.assert_allclose(collocated(scene, period_s, points + 20), truth, rtol=1e-9)
    tones = (scene.u1, scene.u2) if scene.A2 else (scene.u1,)
    drive = Drive(start_values=scene.parameters, tones_hz=tones, outputs=("q1_hybrid",))
    kinds = set()
    for accuracy in (1e-2, 1e-4 if scene.A2 else 1e-6):
        plan = planned(drive, accuracy, cubic_workers)
        found = plan.read(cubic_workers.run(plan.runs)[0])
        error = float(np.max(np.abs(found[:, 0] / truth[:, 0] - 1.0)))
        assert error <= plan.promised <= accuracy, (error, plan_in_words(plan.budget))
        kinds.add(plan.settings["solver"])
    if scene.A2:  # far apart: one frame does not do for both
        assert kinds == {2}


def test_what_cannot_be_promised_is_said(cubic_workers: FmuWorkers) -> None:
    scene = CUBIC_SCENES[0][0]
    drive = Drive(start_values=scene.parameters, tones_hz=(scene.u1,), outputs=("q1_hybrid",))
    annotation = AccuracyAnnotation(force=("averaged envelope",))
    plan = planned(drive, 1e-6, cubic_workers, annotation)
    assert plan.settings["solver"] == 1
    assert plan.promised > 1e-6
    assert not plan.budget.kept
    said = " ".join(warnings_in_words(plan.budget))
    assert "1.0e-06" in said
    assert "averaged envelope (solver = 1) " in said
    error = abs(plan.amplitudes[0][0, 0] / collocated(scene, 0.01, 64)[0, 0] - 1.0)
    assert 1e-6 < error <= plan.promised
