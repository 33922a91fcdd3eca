"""FMUs that advance in steps of their own: asked at these, or told for what they are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.simulate.budget import Basis, Decision, Kind
from fitting.simulate.planner import DrivePlan
from fitting.simulate.solver import simplest
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu, build_own_step_fmu
from tests.support.own_step import phasor
from tests.support.plan_words import plan_in_words

TONE = 30.3
STEP = 1e-3


def planned(path: Path, accuracy: float | None = None) -> DrivePlan:
    with ff.Fmu(path) as fmu:
        values = {"tone": TONE}
        return fmu.plan(values, tones=("tone",), outputs="displacement", accuracy=accuracy)


def grid_of(plan: DrivePlan) -> Decision:
    return plan.budget.of(Kind.GRID)[0]


def off(plan: DrivePlan, step_s: float = STEP) -> float:
    """How far the amplitude is from that of the FMU's own difference equation."""
    return abs(float(plan.amplitudes[0][0, 0]) / abs(phasor(TONE, step_s)) - 1.0)


def test_noise_that_nearly_does_ends_settling(tmp_path: Path) -> None:
    """Amplitudes that repeat to a quarter of a share: doubled on, the time was minutes of runs."""
    with ff.Fmu(build_c_fmu(tmp_path, marks={"NOISE": 5e-6}), workers=1) as fmu:
        drive = ff.Drive(input="force", samples_per_period=28)
        values = {"damping": 0.4}
        asked = {"drive": drive, "outputs": "displacement", "accuracy": 1e-4}
        plan = fmu.plan(values, tones=[320.0], **asked)  # type: ignore[arg-type]
        steps = fmu.workers.counts.steps
    w = 2.0 * math.pi * 320.0
    true = 1.0 / abs(complex(4e3 - 1e-3 * w * w, 0.4 * w))
    assert plan.settle_s < 0.2  # a transient takes 5 ms to fall by e
    assert steps < 200_000
    assert abs(float(plan.amplitudes[0][0, 0]) / true - 1.0) <= plan.promised <= 1e-4


@pytest.mark.parametrize(
    ("kind", "told", "fmi", "basis"),
    [
        ("STANDS_BETWEEN", False, 2, Basis.OWN_STEP),
        ("LOSES_TIME", True, 2, Basis.OWN_STEP),
        ("REFUSES", True, 2, Basis.OTHER_STEPS),
        pytest.param("REFUSES", False, 2, Basis.OTHER_STEPS, marks=pytest.mark.nightly),
        ("REFUSES", True, 3, Basis.FIXED_STEP),
    ],
)
def test_an_fmu_is_asked_at_its_own_steps(
    kind: str, told: bool, fmi: int, basis: Basis, tmp_path: Path
) -> None:
    plan = planned(build_own_step_fmu(tmp_path, kind, told=told, fmi=fmi))
    assert off(plan) <= plan.promised <= 1e-6
    assert grid_of(plan).basis == basis
    assert grid_of(plan).numbers["step_s"] == STEP
    [window] = plan.windows
    steps = window.times_s() / STEP
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    assert "steps of 1 ms" in plan_in_words(plan.budget)[0]


def test_a_step_that_is_told_wrongly_is_found_by_watching(tmp_path: Path) -> None:
    plan = planned(build_own_step_fmu(tmp_path, "LATE_CLOCK", told=True))
    assert grid_of(plan).numbers["step_s"] == 1.001e-3
    assert off(plan, 1.001e-3) <= plan.promised <= 1e-6
    assert not grid_of(plan).numbers["is_declared"]


@pytest.fixture(scope="module")
def uneven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its steps have many lengths, 0.5 to 1.5 ms: no grid has them."""
    return build_own_step_fmu(tmp_path_factory.mktemp("uneven"), "UNEVEN")


def test_settling_ends_where_amplitudes_repeat_no_better(uneven: Path) -> None:
    """A sample is late by up to 1.5 ms, 2 pi 30.3 Hz x 1.5 ms = 0.29 rad."""
    plan = planned(uneven, 1e-3)
    [settling] = plan.budget.of(Kind.SETTLING)
    assert settling.basis == Basis.REPEATED
    assert 0.03 < float(settling.numbers["repeats"]) < 0.29
    assert plan.settle_s < 20.0 / (math.pi * 2.0)  # some decay times of its 2 Hz line, no more
    held = (math.pi * TONE * 1.5e-3) ** 2 / 6.0  # what holding the force over a step may change
    assert off(plan, 0.0) <= plan.promised + held
    assert not plan.budget.kept
    said = plan_in_words(plan.budget)
    assert any(f"{float(settling.numbers['repeats']):.1e}" in line for line in said)
    assert "1.0e-03" in said[-1]


def test_nobody_asked_for_more_than_an_fmu_can_give(
    uneven: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = planned(uneven)
    assert plan.budget.kept
    assert plan.promised <= plan.budget.wanted < 1.1 * plan.promised
    drive = [
        "--tones",
        "tone",
        "--set",
        f"tone={TONE}",
        "--outputs",
        "displacement",
        "--plan",
        "--verbose",
    ]
    assert main(["simulate", str(uneven), *drive]) == 0
    said = capsys.readouterr().out
    assert f"(goal {plan.budget.wanted:.1e})" in said
    assert "default 1e-06" in said
    assert main(["simulate", str(uneven), *drive, "--accuracy", "1e-6"]) == 1
    assert "default 1e-06" not in capsys.readouterr().out


def test_an_fmu_that_integrates_by_communication_steps_gets_short_ones(tmp_path: Path) -> None:
    """Semi-implicit Euler, of first order: half the step, half the error."""
    plan = planned(build_own_step_fmu(tmp_path, "FOLLOWS"), 3e-2)
    [step] = plan.budget.of(Kind.STEP)
    assert (step.basis, step.numbers["order"]) == (Basis.ORDER, 1)
    assert off(plan, 0.0) <= plan.promised <= 3e-2
    assert off(plan, 0.0) > 0.2 * step.bound  # neither wasted
    [run] = plan.runs
    assert run.longest_step_s == step.numbers["step_s"]


def test_a_sweep_and_a_held_drive_keep_to_the_steps(tmp_path: Path) -> None:
    path = build_own_step_fmu(tmp_path, "REFUSES", told=True)
    with ff.Fmu(path) as fmu:
        swept = fmu.sweep([28.0, 30.3, 32.0], tone="tone", output="displacement")
        drive = ff.Drive(input="force", amplitude=0.5)
        held = fmu.plan({"level": 0.0}, tones=[20.0, 23.0], drive=drive, outputs="displacement")
    truth = [abs(phasor(f, STEP)) for f in (28.0, 30.3, 32.0)]
    assert swept.curves[0].amplitudes == pytest.approx(truth, abs=swept.accuracy * max(truth))
    # a held tone of that amplitude is the same force over the same steps, over sinc(f h)
    wanted = [0.5 * abs(phasor(f, STEP)) / np.sinc(f * STEP) for f in (20.0, 23.0)]
    assert held.amplitudes[0][:, 0] == pytest.approx(wanted, rel=held.promised)
    assert held.budget.kept


# --- feed-through ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lag(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_lag_fmu(tmp_path_factory.mktemp("lag"))) as fmu:
        yield fmu


@pytest.mark.parametrize("per_period", [8, 24, 100])
def test_a_gain_of_one_reads_one(lag: ff.Fmu, per_period: int) -> None:
    """y = u: what is held over a step is larger than the tone, by 1/sinc(1/24) = 1.0029."""
    drive = ff.Drive(input="u", amplitude=2.0, samples_per_period=per_period)
    values = {"gain": 0.0, "through": 1.0}
    found = lag.simulate(values, tones=[50.0], drive=drive, outputs="y", accuracy=1e-6)
    assert found.peaks[0, 0] == pytest.approx(2.0, rel=1e-12)


def test_a_lag_with_feed_through_answers_as_its_transfer_function(lag: ff.Fmu) -> None:
    """1/(1 + i w tau) + through."""
    drive = ff.Drive(input="u", samples_per_period=100)
    values = {"tau": 2e-3, "through": 0.7}
    found = lag.simulate(values, tones=[50.0], drive=drive, outputs="y", accuracy=1e-3)
    truth = abs(1.0 / (1.0 + 2j * math.pi * 50.0 * 2e-3) + 0.7)
    assert found.peaks[0, 0] == pytest.approx(truth, rel=found.accuracy)
    assert found.accuracy <= 1e-3


@pytest.mark.parametrize(
    ("seen", "within", "wanted"),
    [
        (1.0003e-3, 4e-4, (1e-3,)),
        (2.26757e-5, 2e-5, (2.2676e-5, 1.0 / 44100.0)),
        (0.02, 1e-3, (0.02,)),
    ],
)
def test_a_step_is_the_simplest_number(
    seen: float, within: float, wanted: tuple[float, ...]
) -> None:
    assert simplest(seen, within) == pytest.approx(wanted, rel=1e-12)
