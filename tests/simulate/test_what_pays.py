"""A plan takes what pays, bounds what it takes, and has no absolute times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.pool import FmuWorkers
from fitting.simulate.budget import Basis, Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import plan_drives
from fitting.simulate.probe import Knowledge, cost_ratio
from fitting.text.arrays import FloatArray, Scalar
from fmu_src.oscillator_equations import Parameters
from fmu_src.oscillator_rk4 import RungeKuttaSolver
from tests.support.line_workers import LineWorkers

MODES = {"d1": 120.0, "d2": 90.0, "eta_plus": 6.94026e6, "eta_minus": 7.02760e6}


@pytest.fixture(scope="module")
def fmu(oscillator_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(oscillator_fmu, workers=1) as opened:
        yield opened


def amplitude_of_one_mode(f_hz: float, eta_hz: float, width_hz: float) -> float:
    """Peak of q in q'' + 2 pi w q' + (2 pi eta)^2 q = cos(2 pi f t)."""
    square = (2.0 * math.pi) ** 2
    return 1.0 / abs(square * (eta_hz**2 - f_hz**2 + 1j * f_hz * width_hz))


def test_equal_runs_promise_the_same_whatever_was_wanted(fmu: ff.Fmu) -> None:
    """The transient of a run from rest, by which a start is compared, is no error of the start."""
    plans = [fmu.plan({"u1": "6.94018 MHz"}, accuracy=accuracy) for accuracy in (1e-2, 1e-6)]
    assert plans[0].runs == plans[1].runs
    assert plans[0].promised == pytest.approx(plans[1].promised, rel=0.5)
    assert plans[0].promised < 1e-12
    start, *others = plans[0].budget.of(Kind.MODEL)
    assert (start.basis, start.taken, start.bound) == (Basis.CLOSED, True, 0.0)
    assert {d.basis for d in others} == {Basis.NO_CHEAPER}
    assert not any(d.taken for d in others)


def test_what_saves_from_rest_is_taken_there_and_not_after_an_exact_start(fmu: ff.Fmu) -> None:
    exact, resting = (
        fmu.plan({"u1": "6.94018 MHz"}, accuracy=ff.Accuracy(1e-2, forbid=forbidden))
        for forbidden in ((), ("periodic start",))
    )
    assert "other_mode" not in exact.settings
    assert resting.settings["other_mode"] in (1, 2)


def test_a_ratio_of_costs_is_that_of_the_processor_time() -> None:
    """Of 40 000 turns of a loop to 10 000, whatever else the machine does."""

    class Counting:
        class counts:  # noqa: N801 - as the workers have it
            processor_s = 0.0

    def turns(count: int) -> float:
        return math.fsum(math.sin(k) for k in range(count))

    ratio = cost_ratio(Counting(), lambda: turns(10_000), lambda: turns(40_000))  # type: ignore[arg-type]
    assert ratio is not None
    assert 0.15 < ratio < 0.4
    assert cost_ratio(LineWorkers({}), lambda: 0, lambda: 0) is None


def test_a_tone_that_is_switched_off_has_no_frequency(fmu: ff.Fmu) -> None:
    p = Parameters(
        theta=0.3,
        reflection=False,
        d1=5.0,
        d2=5.0,
        eta_plus=2.0e3,
        eta_minus=2.1e3,
        u1=2.0e3,
        u2=6.94e6,
        A1=1.0,
        A2=0.0,
        phase1=0.0,
        phase2=0.0,
        g1=0.0,
        g2=0.0,
    )
    assert RungeKuttaSolver(p, 0.0).substep == 1.0 / (40 * 2.1e3)
    assert RungeKuttaSolver(p._replace(A2=1.0), 0.0).substep == 1.0 / (40 * 6.94e6)
    scene = {"A2": 0.0, "eta_plus": 2.0e3, "eta_minus": 2.1e3, "u1": 2.001e3, "solver": 2}
    plan = fmu.plan({**scene, "d1": 5.0, "d2": 5.0, "theta": 0.0}, accuracy=1e-2)
    assert plan.drives[0].tones_hz == (2.001e3,)
    assert plan.promised <= 1e-2
    truth = amplitude_of_one_mode(2.001e3, 2.0e3, 5.0)
    assert float(plan.amplitudes[0][0, 0]) == pytest.approx(truth, rel=plan.promised)


def test_an_exact_start_is_taken_however_long_a_response_from_rest_takes(fmu: ff.Fmu) -> None:
    """At 1 MHz and Q 1e8 it settles for hundreds of seconds."""
    scene = {"eta_plus": 1.0e6, "eta_minus": 1.1e6, "d1": 0.01, "d2": 0.01, "A2": 0.0}
    plan = fmu.plan({**scene, "theta": 0.0, "u1": 1.000001e6})
    assert plan.settings["periodic_start"] is True
    assert plan.promised < 1e-9
    truth = amplitude_of_one_mode(1.000001e6, 1.0e6, 0.01)
    assert float(plan.amplitudes[0][0, 0]) == pytest.approx(truth, rel=1e-9)


@pytest.mark.parametrize("settle_s", [None, 50_000.0])
def test_a_sweep_at_a_millihertz_settles(fmu: ff.Fmu, settle_s: float | None) -> None:
    scene = {"eta_plus": 1e-3, "eta_minus": 1.3e-3, "d1": 2e-4, "d2": 2e-4, "theta": 0.0}
    f = np.linspace(0.8e-3, 1.2e-3, 11)
    found = fmu.sweep(f, scene, accuracy=ff.Accuracy(1e-4, settle_s=settle_s))
    assert found.steady
    truth = np.array([amplitude_of_one_mode(u, 1e-3, 2e-4) for u in f])
    off = np.abs(found.curves[0].amplitudes - truth) / np.max(truth)
    assert np.max(off) <= found.accuracy <= 1e-4


@pytest.mark.parametrize("start", [0.0, 5e-3, 1e-6])
def test_a_named_substep_is_refined_before_the_response_is_waited_for(start: float) -> None:
    """With steps longer than a hundredth of a period a solver's own damping is next to none."""

    def output(t: FloatArray, values: Mapping[str, Scalar]) -> FloatArray:
        h = float(values.get("h", start)) or 5e-3
        rate = 2.0 if h <= 2.6e-4 else 0.01
        ringing = np.exp(-rate * t) * np.cos(2.0 * np.pi * 97.3 * t)
        return np.asarray((1.0 + (h / 2e-3) ** 4) * np.cos(2.0 * np.pi * 100.0 * t) + ringing)

    drive = Drive(start_values={}, tones_hz=(100.0,), outputs=("x",))
    known = Knowledge(AccuracyAnnotation(substep="h"))
    plan = plan_drives((drive,), 1e-3, LineWorkers({"x": output}), known)
    assert plan.settle_s < 10.0
    assert plan.promised <= 1e-3


def test_missing_damping_has_no_bound_and_is_named(fmu: ff.Fmu) -> None:
    scene: dict[str, Scalar] = {**MODES, "d1": 0.0, "d2": 0.0}
    found = fmu.simulate(scene)
    assert found.accuracy == math.inf
    assert not found.steady
    assert fmu.missing_damping(found) == ("d1", "d2")
    damped = fmu.simulate(MODES)
    assert fmu.missing_damping(damped) == ()


def test_what_a_run_may_take_ends_a_search_and_can_be_raised(swift_fmu: Path) -> None:
    scene = {"A2": 0.0, "eta_plus": 2.0e3, "eta_minus": 2.1e3, "u1": 2.001e3, "solver": 2}
    values = {**scene, "d1": 5.0, "d2": 5.0, "theta": 0.0}
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        short, long = (
            fmu.plan(values, accuracy=ff.Accuracy(1e-4, work=work, forbid="periodic start"))
            for work in (5e3, 1e6)
        )
    [settling] = short.budget.of(Kind.SETTLING)
    assert (settling.basis, settling.numbers["ended_by"]) == (Basis.UNSTEADY, "work")
    assert not short.budget.kept
    assert long.budget.kept


def test_workers_report_processor_time(oscillator_fmu: Path) -> None:
    with FmuWorkers(oscillator_fmu) as workers:
        drive = Drive(start_values={"A2": 0.0}, tones_hz=(6.94e6,), outputs=("q1_hybrid",))
        short, long = (drive.run(drive.window(0.0), {"solver": s}) for s in (0, 0))
        ratio = cost_ratio(workers, lambda: workers.run([short]), lambda: workers.run([long] * 8))
    assert ratio is not None
    assert ratio < 0.8


def test_a_forced_reduction_that_silences_an_output_is_named(fmu: ff.Fmu) -> None:
    scene = {**MODES, "theta": 0.0, "A2": 0.0, "u1": 7.0276e6}
    with pytest.raises(ff.BadInput, match="far mode left out"):
        fmu.plan(scene, outputs="q1_hybrid", accuracy=ff.Accuracy(1e-3, force="far mode left out"))
