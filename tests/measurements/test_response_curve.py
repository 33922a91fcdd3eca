"""The complex response over drive frequency, against closed forms: phases, runs and their number.

Truth: A(u) X = g solved at 50 digits (`tests.support.reference`), X = 1/(k - m w^2 + i w c) of the
driven oscillator in C, and for hundreds of scenes the two modes of `tests.support.modal_workers`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import fitting as ff
from fitting.campaign import Drive, Setup
from fitting.campaign.parameters import Parameter
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import CurvePlan, Plan
from fitting.measurements.response_curve import ResponseCurve, plan_curve
from fitting.simulate.batch import Batch, Workers, together
from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.words import decision_in_words
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from tests.support import reference
from tests.support.cfmu_build import build_c_fmu
from tests.support.modal_workers import (
    FITTED,
    ModalWorkers,
    RandomScene,
    modal_model,
    phasors,
    random_scene,
)
from tests.support.twins import swift_model

TWO_PI = 2.0 * math.pi
#: Two modes 400 Hz apart, 40 and 60 Hz wide, coupled by their damping; a drive that leads by 0.7.
SCENE: dict[str, Scalar] = {
    "theta": 1.9,
    "reflection": False,
    "d1": 40.0,
    "d2": 60.0,
    "eta_plus": 1.0e5,
    "eta_minus": 1.004e5,
    "g1": 1.0,
    "g2": 0.8,
    "A1": 3.0,
    "phase1": 0.7,
}
OUTPUTS = ("q1_hybrid", "q2_hybrid")


def parameter(name: str, lower: float, upper: float) -> Parameter:
    return Parameter(
        name=name, unit="Hz", lower=lower, upper=upper, start=lower, reference=lower, scale=1.0
    )


def two_modes(plan: Plan | None = None) -> DrivenModel:
    """The coupled oscillator, driven by tones of its own; d1 is a parameter."""
    drive = Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"), amplitude=3.0)
    start = {**SCENE, "periodic_start": True}
    setup = Setup(drive, "q1_hybrid", start_values=start, steady_start=True)
    d1 = parameter("d1", 1.0, 100.0)
    return DrivenModel(setup=setup, parameters=(d1,), plan=plan or Plan(0.0))


def truth(u_hz: FloatArray, mode: int, **changes: Scalar) -> ComplexArray:
    """X(u) A exp(i phase) at 50 digits."""
    p = SimpleNamespace(**{**SCENE, **changes})
    turned = float(p.A1) * np.exp(1j * float(p.phase1))
    return np.asarray(turned * np.array([complex(reference.phasors(p, u)[mode]) for u in u_hz]))


def responses(
    curves: list[ResponseCurve], table: FloatArray, u_hz: FloatArray, workers: Workers
) -> tuple[list[ComplexArray], Batch]:
    """What curves return, predicted side by side, and the batch that they were simulated in."""
    batch = Batch()
    task = together([curve.predict(table, u_hz, batch) for curve in curves])
    while True:
        try:
            next(task)
        except StopIteration as ended:
            return ended.value, batch
        batch.simulate(workers)


def test_phasors_of_a_drive_of_its_own_have_the_phase_of_time_zero(swift: ff.Fmu) -> None:
    """Also where the drive has a phase and settings change it; two outputs share their runs."""
    u = 1.0e5 + np.array([-300.0, -11.0, 0.0, 203.0, 400.0, 777.0])
    table = np.array([[40.0], [25.0], [40.0]])
    curves = [ResponseCurve(two_modes(), output=name) for name in OUTPUTS]
    turned = ResponseCurve(two_modes(), {"phase1": -2.0}, "q2_hybrid")
    found, batch = responses([*curves, turned], table, u, swift.workers)
    for mode, rows in enumerate(found[:2]):
        for row, d1 in zip(rows, (40.0, 25.0, 40.0), strict=True):
            exact = truth(u, mode, d1=d1)
            assert np.max(np.abs(row - exact) / np.abs(exact)) < 1e-9
    exact = truth(u, 1, phase1=-2.0)
    assert np.max(np.abs(found[2][0] - exact) / np.abs(exact)) < 1e-9
    # two different parameter vectors; both outputs of one drive come from one run
    assert len(batch.owners) == 2 * u.size * 2
    assert batch.count(3).tolist() == [2 * u.size, 2 * u.size, 0]


def test_phasors_of_a_driven_input_lag_as_the_closed_form_does(tmp_path: Path) -> None:
    """A tone on the input has phase zero: below the resonance in phase, at its top a quarter."""
    mass, damping, stiffness = 1e-3, 0.2, 4e3
    eta = math.sqrt(stiffness / mass) / TWO_PI
    u = np.round(eta + np.array([-150.0, -20.0, 0.0, 15.0, 90.0]), 2)
    drive = Drive(input="force", amplitude=2.5, samples_per_period=40)
    setup = Setup(drive, "displacement", start_values={"damping": damping})
    model = DrivenModel(setup=setup, parameters=(), plan=Plan(0.3))
    with FmuWorkers(build_c_fmu(tmp_path), workers=1) as workers:
        [[found]], _ = responses([ResponseCurve(model)], np.empty((1, 0)), u, workers)
    w = TWO_PI * u
    exact = 2.5 / (stiffness - mass * w**2 + 1j * w * damping)
    # images of the held input are left: (1/40)^2 of the tone, off resonance
    assert np.max(np.abs(found / exact - 1.0)) < 2e-5


# --- few runs for many points ---------------------------------------------------------------


def planned(
    curve: ResponseCurve, u_hz: FloatArray, vectors: list[FloatArray], workers: Workers
) -> ResponseCurve:
    """The curve under the plan that is made for it, at the frequency that is largest there."""
    top = float(u_hz[int(np.argmax(np.abs(curve.simulated(vectors[0], u_hz[::50], workers))) * 50)])
    plan = plan_curve(curve, u_hz, vectors[:1], workers, top)
    return replace(curve, model=replace(curve.model, plan=plan))


@pytest.mark.parametrize(
    ("changes", "span_hz", "most"),
    [
        ({"theta": 0.0, "g2": 0.0}, (-300.0, 300.0), 8),  # one mode
        ({}, (-300.0, 700.0), 9),  # two modes
        ({"eta_minus": 1.00010e5, "theta": 2.3}, (-200.0, 210.0), 9),  # closer than they are wide
        ({"theta": 0.7, "g2": -1.0}, (-300.0, 700.0), 9),  # with an antiresonance between them
    ],
    ids=["one mode", "two modes", "avoided crossing", "antiresonance"],
)
def test_eight_runs_give_a_thousand_points(
    swift: ff.Fmu, changes: dict[str, Scalar], span_hz: tuple[float, float], most: int
) -> None:
    """And one at half the drive, at every parameter vector, to 1e-9 of each value."""
    u = 1.0e5 + np.linspace(*span_hz, 1001)
    model = two_modes(Plan(0.0, budget=Budget(1e-6)))
    curve = ResponseCurve(model, changes, OUTPUTS[1 if "g2" not in changes else 0])
    table = np.array([[40.0], [25.0], [61.0]])
    curve = planned(curve, u, [table[0]], swift.workers)
    [found], batch = responses([curve], table, u, swift.workers)
    assert np.max(batch.count(3)) <= most
    [decision] = curve.model.plan.decisions
    assert decision.bound == 1e-9
    assert decision.numbers["points"] == 1001
    assert f"{decision.numbers['runs']} runs" in decision_in_words(decision)
    places = np.arange(0, 1001, 20)
    for row, [d1] in zip(found, table, strict=True):
        exact = truth(u[places], OUTPUTS.index(curve.place.output), **changes, d1=d1)
        assert np.max(np.abs(row[places] / exact - 1.0)) < 1e-9


@pytest.mark.parametrize(("phase2", "tones"), [(0.7, 2), (0.9, 1)])
def test_tones_of_the_fmu_share_runs_where_both_act_alike(
    swift: ff.Fmu, phase2: float, tones: int
) -> None:
    """Where it has to settle, five runs; a second tone of another phase is no such tone."""
    u, p = 1.0e5 + np.linspace(-300.0, 700.0, 1001), np.array([40.0])
    settings: dict[str, Scalar] = {"phase2": phase2, "periodic_start": False}
    curve = ResponseCurve(two_modes(Plan(0.25, budget=Budget(1e-6))), settings, OUTPUTS[1])
    curve = planned(curve, u, [p], swift.workers)
    [found], batch = responses([curve], p[np.newaxis], u, swift.workers)
    [plan] = curve.model.plan.curves
    assert plan.tones == tones
    assert batch.count(1)[0] == plan.runs == plan.nodes_hz.size // tones + 1
    places = np.arange(0, 1001, 20)
    exact = truth(u[places], 1)
    assert np.max(np.abs(found[0][places] / exact - 1.0)) < 1e-8


def test_tones_on_an_input_share_runs_and_are_held_over_the_same_steps(tmp_path: Path) -> None:
    """Three runs for 61 points, nearer to the closed form than a run for each of them.

    A drive held over 16 steps in a period promises less than is wanted: what that leaves is no
    reason to simulate every point.
    """
    mass, damping, stiffness = 1e-3, 1.0, 4e4
    eta = math.sqrt(stiffness / mass) / TWO_PI
    u = np.round(eta + np.linspace(-300.0, 300.0, 61))
    drive = Drive(input="force", amplitude=2.5, samples_per_period=16)
    start: dict[str, Scalar] = {"damping": damping, "stiffness": stiffness}
    setup = Setup(drive, "displacement", start_values=start)
    images = Decision(kind=Kind.INPUT, basis=Basis.COMPARED, bound=1e-4)
    plan, p = Plan(0.06, budget=Budget(1e-6, (images,))), np.empty(0)
    curve = ResponseCurve(DrivenModel(setup=setup, parameters=(), plan=plan))
    with FmuWorkers(build_c_fmu(tmp_path), workers=1) as workers:
        plan = plan_curve(curve, u, [p], workers)
        shared = replace(curve, model=replace(curve.model, plan=plan))
        [found], batch = responses([shared], p[np.newaxis], u, workers)
        each = curve.simulated(p, u, workers)
    decision = plan.decisions[-1]
    assert batch.count(1)[0] == decision.numbers["runs"] == 3
    assert decision.numbers["points"] == 61
    assert f"up to {decision.numbers['tones']} tones" in decision_in_words(decision)
    w = TWO_PI * u
    exact = 2.5 / (stiffness - mass * w**2 + 1j * w * damping)
    assert np.all(np.abs(found[0] / exact - 1.0) < np.abs(each / exact - 1.0) + 1e-8)


def promised(scene: RandomScene, workers: ModalWorkers) -> tuple[CurvePlan, Batch, float]:
    """Plan, batch, and largest relative error of any point at any of its parameter vectors."""
    curve = ResponseCurve(modal_model(scene.start, output=scene.output))
    vectors = list(scene.vectors)
    curve = planned(curve, scene.u_hz, vectors, workers)
    [found], batch = responses([curve], np.array(vectors), scene.u_hz, workers)
    exact = np.array([scene.truth(p) for p in vectors])
    [plan] = curve.model.plan.curves
    return plan, batch, float(np.max(np.abs(found / exact - 1.0)))


@pytest.mark.parametrize("first", range(0, 60, 12))
def test_random_scenes_keep_what_is_promised(first: int) -> None:
    """One line, both or a wing, Q up to 1e6, at parameters widths away from those of the plan.

    `tests/bench/bench_curve.py` does the same for hundreds of them.
    """
    for seed in range(first, first + 12):
        plan, batch, error = promised(random_scene(seed), ModalWorkers())
        assert plan.is_interpolated, seed
        assert error <= plan.tolerance <= 1e-7, seed
        assert np.max(batch.count(4)) <= 21, seed


def test_several_settings_are_answered_in_one_batch() -> None:
    """As along a control quantity: each has a plan of its own, and all share the rounds."""
    u, p = 1.0e5 + np.linspace(-300.0, 700.0, 1001), np.array([1.9, 40.0, 60.0, 1.0e5, 1.004e5])
    model, workers = modal_model({}), ModalWorkers()
    places: list[dict[str, Scalar]] = [{"g2": 0.1 * k} for k in range(8)]
    for settings in places:
        curve = ResponseCurve(model, settings)
        model = replace(model, plan=plan_curve(curve, u, [p], workers))
    [decision] = model.plan.decisions
    assert decision.numbers["curves"] == decision.numbers["interpolated"] == 8
    assert decision.bound == 1e-9
    curves = [ResponseCurve(model, settings) for settings in places]
    found, batch = responses(curves, p[np.newaxis], u, workers)
    assert batch.count(1)[0] == decision.numbers["runs"]
    assert batch.count(1)[0] <= 8 * 11
    for settings, [row] in zip(places, found, strict=True):
        values = {**settings, **dict(zip(FITTED, p, strict=True))}
        assert np.max(np.abs(row / phasors(values, u, 0) - 1.0)) < 1e-9


def test_a_mode_that_appears_and_a_nonlinearity_are_noticed_at_their_parameters() -> None:
    """The plan saw one linear mode: elsewhere runs are added, or every point is simulated."""
    u, p = 1.0e5 + np.linspace(-100.0, 100.0, 501), np.array([0.0, 40.0, 60.0, 1.0e5, 1.004e5])
    workers = ModalWorkers()
    alone = planned(ResponseCurve(modal_model({"g2": 0.0})), u, [p], workers)
    mixed = np.array([0.5, *p[1:4], 1.0003e5])
    [found], batch = responses([alone], np.array([p, mixed]), u, workers)
    few, more = batch.count(2)
    assert few < more <= 11
    values = dict(zip(FITTED, mixed, strict=True))
    assert np.max(np.abs(found[1] / phasors({**values, "g2": 0.0}, u, 0) - 1.0)) < 1e-9
    # the same plan meets a response that depends on its size
    bent = {"g2": 0.0, "bend": 0.1 / np.max(np.abs(found[0])) ** 2}
    other = replace(alone.model, setup=replace(alone.model.setup, start_values=bent))
    changed = replace(alone, model=other)
    [found], batch = responses([changed], p[np.newaxis], u, workers)
    assert batch.count(1)[0] > u.size
    exact = phasors({**dict(zip(FITTED, p, strict=True)), "g2": 0.0}, u, 0)
    exact *= 1.0 + bent["bend"] * np.abs(exact) ** 2
    assert np.max(np.abs(found[0] / exact - 1.0)) < 1e-12


def test_a_nonlinear_fmu_is_run_at_every_point(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The Duffing string, driven as weakly as its shipped sweep: planned by two runs."""
    drive = Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"), amplitude=0.04)
    start: dict[str, Scalar] = {"theta": 0.0, "d1": 94.0, "alpha2": 0.0, "kappa": 0.0, "solver": 1}
    setup = Setup(
        drive, "q1_hybrid", start_values={**start, "periodic_start": True}, steady_start=True
    )
    plan = Plan(0.0, budget=Budget(1e-6))
    curve = ResponseCurve(DrivenModel(setup=setup, parameters=(), plan=plan))
    u, p = 6.94026e6 + np.linspace(-150.0, 150.0, 31), np.empty(0)
    with FmuWorkers(swift_model("DuffingOscillator", tmp_path_factory), workers=1) as workers:
        counted = CountedWorkers(workers)
        plan = plan_curve(curve, u, [p], counted, top_hz=6.94026e6)
        assert counted.runs == 2
        curve = replace(curve, model=replace(curve.model, plan=plan))
        [found], batch = responses([curve], p[np.newaxis], u[::10], workers)
        assert np.array_equal(found[0], curve.simulated(p, u[::10], workers))
    [decision] = plan.decisions
    assert decision.basis == Basis.NONLINEAR
    assert not decision.taken
    assert batch.count(1)[0] == u[::10].size
    assert f"{float(decision.numbers['found']):.1e}" in decision_in_words(decision)


@dataclass
class CountedWorkers:
    """Workers that count their `runs`."""

    workers: Workers
    runs: int = 0

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        self.runs += len(runs)
        return self.workers.run(runs)


@pytest.mark.parametrize(("noise", "interpolated"), [(0.0, True), (1e-7, False)])
def test_an_fmu_with_noise_is_run_at_every_point(
    tmp_path: Path, noise: float, interpolated: bool
) -> None:
    """A foreign FMU, driven by its input: without noise nine runs give a hundred points."""
    mass, damping, stiffness = 1e-3, 1.0, 4e4
    eta = math.sqrt(stiffness / mass) / TWO_PI
    u = np.round(eta + np.linspace(-300.0, 300.0, 61))
    drive = Drive(input="force", amplitude=2.5, samples_per_period=16)
    start: dict[str, Scalar] = {"damping": damping, "stiffness": stiffness}
    setup = Setup(drive, "displacement", start_values=start)
    plan = Plan(0.05, budget=Budget(1e-6))
    curve = ResponseCurve(DrivenModel(setup=setup, parameters=(), plan=plan))
    fmu = build_c_fmu(tmp_path, marks={"NOISE": noise})
    p = np.empty(0)
    with FmuWorkers(fmu, workers=1) as workers:
        plan = plan_curve(curve, u, [p], workers)
        curve = replace(curve, model=replace(curve.model, plan=plan))
        [found], batch = responses([curve], p[np.newaxis], u, workers)
        each = curve.simulated(p, u, workers)
    [decision] = plan.decisions
    assert decision.taken == interpolated
    if not interpolated:
        assert np.array_equal(found[0], each)
        assert batch.count(1)[0] == u.size
        return
    assert batch.count(1)[0] <= 11
    # the tones are in the staircase of the held input, and its images are not what is compared
    w = TWO_PI * u
    exact = 2.5 / (stiffness - mass * w**2 + 1j * w * damping)
    off = np.max(np.abs(each / exact - 1.0))
    assert np.max(np.abs(found[0] / exact - 1.0)) < off + decision.bound
