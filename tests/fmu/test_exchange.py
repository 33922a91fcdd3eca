"""FMUs of model exchange: integrated, with events, simulated, fitted."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitting as ff
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.simulate.planner import DrivePlan
from fitting.text.finding import Kind, of_kind
from tests.support.cfmu_build import build_exchange_fmu, build_reference_fmu

#: A line of 320 Hz at 318 Hz, which soon settles.
DAMPED = {"damping": 2.0}


VERSIONS = [pytest.param(2, id="FMI 2", marks=pytest.mark.nightly), pytest.param(3, id="FMI 3")]


@pytest.fixture(scope="module", params=VERSIONS)
def exchange(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_exchange_fmu(tmp_path_factory.mktemp("exchange"), request.param)


@pytest.fixture(scope="module")
def workers(exchange: Path) -> Iterator[FmuWorkers]:
    with FmuWorkers(exchange) as running:
        yield running


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    """That of FMI 2.0."""
    path = build_exchange_fmu(tmp_path_factory.mktemp("exchange"))
    with ff.Fmu(path, workers=1) as opened:
        yield opened


def test_its_equations_are_integrated(workers: FmuWorkers) -> None:
    """x(0) = 1 mm, at rest: exp(-g t) (cos w t + g/w sin w t), g = c/2m, w^2 = k/m - g^2."""
    run = Run(
        start_values={"height": 1e-3},
        settle_s=0.0,
        sample_step_s=1e-3,
        samples=50,
        outputs=("displacement",),
    )
    g, t = 10.0, np.arange(50) * 1e-3
    w = math.sqrt(4e6 - g * g)
    truth = 1e-3 * np.exp(-g * t) * (np.cos(w * t) + g / w * np.sin(w * t))
    assert workers.run([run])[0][:, 0] == pytest.approx(truth, abs=1e-7 * 1e-3)


def test_state_and_time_events_are_met(workers: FmuWorkers) -> None:
    """A ball of 1 m height that is thrown back without loss: parabolas of 2 sqrt(2 h / g) each."""
    run = Run(
        start_values={
            "mass": 1.0,
            "stiffness": 0.0,
            "damping": 0.0,
            "weight": -9.81,
            "wall": 1.0,
            "height": 1.0,
        },
        settle_s=0.0,
        sample_step_s=0.11,
        samples=40,
        outputs=("displacement", "clock"),
    )
    t = np.arange(40) * 0.11
    between = 2.0 * math.sqrt(2.0 / 9.81)
    since_top = np.mod(t + between / 2.0, between) - between / 2.0
    height, clock = workers.run([run])[0].T
    assert height == pytest.approx(1.0 - 9.81 / 2.0 * since_top**2, abs=1e-9)
    assert clock == pytest.approx(np.floor(t), abs=0.0)  # whole seconds, by time events


def test_a_drive_is_no_staircase(fmu: ff.Fmu) -> None:
    """x + through F: the transfer function plus a real number, at few steps in a period too."""
    drive = ff.Drive(input="force", samples_per_period=8)
    values = {**DAMPED, "through": 2e-3}
    plan = fmu.plan(values, tones=[300.0], drive=drive, outputs="displacement", accuracy=1e-3)
    w = 2.0 * math.pi * 300.0
    truth = abs(1.0 / (4e3 - 1e-3 * w * w + 2.0j * w) + 2e-3)
    assert float(plan.amplitudes[0][0, 0]) == pytest.approx(truth, rel=plan.promised)
    assert plan.promised <= 1e-3


def test_an_fmu_that_cannot_be_driven_is_refused(exchange: Path, tmp_path: Path) -> None:
    path = tmp_path / "scheduled.fmu"
    with zipfile.ZipFile(exchange) as archive, zipfile.ZipFile(path, "w") as other:
        for name in archive.namelist():
            content = archive.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'<ModelExchange modelIdentifier="exchange"/>', b"")
            other.writestr(name, content)
    with pytest.raises(ff.BadInput, match=r"neither .*exchange"):
        read_description(path)


@pytest.fixture(scope="module")
def dahlquist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """x' = -k x, by both interfaces; its co-simulation is Euler's method in steps of 0.1 s."""
    return build_reference_fmu(tmp_path_factory.mktemp("both"), "Dahlquist")


def test_either_interface_can_be_chosen(dahlquist: Path) -> None:
    """Model exchange is exp(-k t), co-simulation (1 - 0.1 k)^n; the latter is the usual one."""
    t = 0.1 * np.arange(20)
    run = Run(start_values={"k": 0.7}, settle_s=0.0, sample_step_s=0.1, samples=20, outputs=("x",))

    def seen(interface: str | None) -> np.ndarray:
        with FmuWorkers(read_description(dahlquist, interface)) as workers:
            return workers.run([run])[0][:, 0]

    assert seen("model-exchange") == pytest.approx(np.exp(-0.7 * t), abs=1e-10)
    assert seen("co-simulation") == pytest.approx(0.93 ** np.arange(20), abs=1e-12)
    assert (seen(None) == seen("co-simulation")).all()


def test_an_interface_that_is_not_there_is_refused(exchange: Path) -> None:
    with pytest.raises(ff.BadInput, match=r"model-exchange.*co-simulation"):
        ff.Fmu(exchange, interface="co-simulation")
    with pytest.raises(ff.BadInput, match=r"'both'.*model-exchange"):
        ff.Fmu(exchange, interface="both")


def test_a_decay_is_fitted_by_either_interface(dahlquist: Path, tmp_path: Path) -> None:
    """Euler's method has a wide error, and the result says what else the FMU offers."""
    t, rng = 0.1 * np.arange(60), np.random.default_rng(2)
    volt = np.exp(-0.83 * t) + 1e-3 * rng.standard_normal(t.size)
    file = tmp_path / "decay.csv"
    rows = zip(t.tolist(), volt.tolist(), strict=True)
    file.write_text("time (s),x (V)\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
    found = {}
    for name in ("model-exchange", "co-simulation"):
        made, _ = ff.init(file, dahlquist, out=tmp_path / name, told={"interface": name})
        result = ff.fit(ff.Problem.of(made), starts=1).result
        k = result.parameters["k"]
        assert abs(k.value - 0.83) < 2.0 * k.std, name
        found[name] = k.std, of_kind(result.findings, Kind.model_exchange_offered)
    assert found["model-exchange"][0] < 1e-3 < 1e-2 < found["co-simulation"][0]
    assert found["co-simulation"][1]
    assert not found["model-exchange"][1]


def test_model_exchange_is_taken_instead_of_own_steps(dahlquist: Path) -> None:
    """Nobody chose: equations without steps of 0.1 s, and errors of the noise alone."""
    t, rng = 0.1 * np.arange(60), np.random.default_rng(2)
    volt = np.exp(-0.83 * t) + 1e-3 * rng.standard_normal(t.size)
    trace = ff.Trace(t, volt, setup=ff.Setup(ff.Drive(), "x"), sigma=1e-3)
    with ff.Fmu(dahlquist, workers=1) as fmu:
        result = ff.fit(ff.Problem(fmu, ff.Parameter("k", 0.5, bounds=(0.1, 5)), trace)).result
    k = result.parameters["k"]
    assert abs(k.value - 0.83) < 3.0 * k.std
    slopes = t * np.exp(-0.83 * t)
    assert k.std == pytest.approx(1e-3 / np.linalg.norm(slopes), rel=0.1)
    [taken] = of_kind(result.findings, Kind.model_exchange_taken)
    assert taken.numbers["step_s"] == pytest.approx(0.1, rel=0.02)


@pytest.mark.parametrize("interface", [None, "co-simulation"])
def test_model_exchange_is_taken_instead_of_many_steps(
    interface: str | None, tmp_path: Path
) -> None:
    """A method of first order over communication steps, samples 0.4 rad apart."""
    t = 2e-4 * np.arange(150)
    k, c, m = 4e3, 0.4, 1e-3
    g, w = c / (2.0 * m), math.sqrt(k / m - (c / (2.0 * m)) ** 2)
    x = (1.0 - np.exp(-g * t) * (np.cos(w * t) + g / w * np.sin(w * t))) / k
    x += 2e-6 * np.random.default_rng(4).standard_normal(t.size)
    trace = ff.Trace(
        t,
        x,
        setup=ff.Setup(ff.Drive(), "displacement"),
        input="force",
        driven=(t, np.ones(t.size)),
        interpolation="held",
        sigma=2e-6,
        unit="m",
    )
    parameters = [
        ff.Parameter("stiffness", 3.8e3, bounds=(3e3, 5e3), unit="N/m"),
        ff.Parameter("damping", 0.5, bounds=(0.1, 1.0), unit="N.s/m"),
    ]
    path = build_exchange_fmu(tmp_path, both=True)
    with ff.Fmu(path, workers=1, interface=interface) as fmu:
        result = ff.fit(ff.Problem(fmu, parameters, trace), starts=1).result
    for name, true in (("stiffness", k), ("damping", c)):
        found = result.parameters[name]
        assert abs(found.value - true) < 3.0 * found.std
    taken = of_kind(result.findings, Kind.model_exchange_taken)
    assert len(taken) == (interface is None)
    assert all(each.numbers["step_s"] < 2e-4 / 16.0 for each in taken)


def free_decay(workers: FmuWorkers, spacing_s: float, **values: float) -> np.ndarray:
    """Displacement at ten times, from 1 mm at rest."""
    run = Run(
        start_values={"height": 1e-3, "damping": 0.0, **values},
        settle_s=0.0,
        sample_step_s=spacing_s,
        samples=10,
        outputs=("displacement",),
    )
    return workers.run([run])[0][:, 0]


def test_linear_equations_are_solved_exactly(workers: FmuWorkers) -> None:
    """cos w t over 300 periods, to rounding: an integration to 1e-9 is off by 3e-7 there."""
    spacing_s = 0.1 * math.pi
    truth = 1e-3 * np.cos(2e3 * spacing_s * np.arange(10))
    assert free_decay(workers, spacing_s) == pytest.approx(truth, abs=1e-11 * 1e-3)


@pytest.mark.parametrize(("hard", "gap"), [(1e9, 0.0), (1e13, 9.7e-4)], ids=["cubic", "beyond"])
def test_equations_that_are_linear_in_part_are_integrated(
    workers: FmuWorkers, hard: float, gap: float
) -> None:
    """The second one is linear but for the last hundredth of its way, where no event tells it.

    The truth is an integration of the same motion in scaled units, a thousand times as fine.
    """

    def rate(_: float, y: np.ndarray) -> list[float]:
        beyond = max(abs(y[0]) - gap / 1e-3, 0.0)
        force = y[0] + math.copysign(hard * 1e-6 / 4e3 * beyond**3, y[0])
        return [y[1], -force]

    spacing_s = 7e-3
    t = 2e3 * spacing_s * np.arange(10)
    solved = solve_ivp(
        rate,
        (0.0, t[-1]),
        [1.0, 0.0],
        method="DOP853",
        t_eval=t,
        rtol=1e-12,
        atol=1e-13,
        max_step=0.05,
    )
    found = free_decay(workers, spacing_s, hard=hard, gap=gap)
    assert found == pytest.approx(1e-3 * solved.y[0], abs=1e-5 * 1e-3)


def test_the_tolerance_of_the_integration_follows_the_accuracy(fmu: ff.Fmu) -> None:
    """Of a hardening spring, whose equations are integrated; of a linear one none is chosen."""
    values, drive = {"damping": 2.0, "hard": 1e10}, ff.Drive(input="force")

    def plan(accuracy: float, **more: float) -> DrivePlan:
        given = {**values, **more}
        return fmu.plan(
            given, tones=[315.0], drive=drive, outputs="displacement", accuracy=accuracy
        )

    coarse, fine = plan(1e-3), plan(1e-5)
    assert max(coarse.promised / 1e-3, fine.promised / 1e-5) <= 1.0
    ratio = float(coarse.amplitudes[0][0, 0]) / float(fine.amplitudes[0][0, 0])
    assert ratio == pytest.approx(1.0, abs=coarse.promised + fine.promised)
    chosen = [float(p.settings["integrator_tolerance"]) for p in (coarse, fine)]
    assert chosen[0] > 10.0 * chosen[1]
    assert "integrator_tolerance" not in plan(1e-5, hard=0.0).settings
