"""The complex response over drive frequency, against closed forms: phases, runs and their number.

Truth: A(u) X = g solved at 50 digits (`tests.support.reference`), and X = 1/(k - m w^2 + i w c) of
the driven oscillator in C.
"""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from fitting.campaign import Drive, Setup
from fitting.campaign.parameters import Parameter
from fitting.fmu import FmuWorkers
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.measurements.response_curve import ResponseCurve, together
from fitting.simulate.batch import Batch, Workers
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from tests.support import reference
from tests.support.cfmu_build import build_c_fmu

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


def test_phasors_of_a_drive_of_its_own_have_the_phase_of_time_zero(oscillator_fmu: Path) -> None:
    """Also where the drive has a phase and settings change it; two outputs share their runs."""
    u = 1.0e5 + np.array([-300.0, -11.0, 0.0, 203.0, 400.0, 777.0])
    table = np.array([[40.0], [25.0], [40.0]])
    curves = [ResponseCurve(two_modes(), output=name) for name in OUTPUTS]
    turned = ResponseCurve(two_modes(), {"phase1": -2.0}, "q2_hybrid")
    with FmuWorkers(oscillator_fmu, workers=1) as workers:
        found, batch = responses([*curves, turned], table, u, workers)
    for mode, phasors in enumerate(found[:2]):
        for row, d1 in zip(phasors, (40.0, 25.0, 40.0), strict=True):
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
