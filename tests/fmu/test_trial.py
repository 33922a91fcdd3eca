"""What a doctor tries on a running FMU, held against models whose answer is known by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest
import pythonfmu

from fitting.check.examination import Costs, Examination, examine, measure_costs, repeated_steps
from fitting.check.findings import Severity, rule_findings, trial_findings
from fitting.check.inputs import try_inputs
from fitting.check.resets import try_resets
from fitting.check.runs import STEPS, Probes, pushed_run, trial_step_s
from fitting.check.steps import try_repeats
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.text.finding import Kind
from tests.support.cfmu_build import (
    build_c_fmu,
    build_lag_fmu,
    build_own_step_fmu,
    build_reference_fmu,
    reworded,
)
from tests.support.processes import Clock


@pytest.fixture(scope="module")
def lag_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_lag_fmu(tmp_path_factory.mktemp("lag"))


@pytest.fixture(scope="module")
def lag(lag_fmu: Path) -> Iterator[FmuWorkers]:
    """One process for all that tries no reset."""
    with FmuWorkers(lag_fmu) as workers:
        yield workers


@pytest.mark.parametrize("step_s", [0.02, 0.3])
def test_half_a_step_shows_a_solver_that_steps_with_the_host(
    step_s: float, lag: FmuWorkers
) -> None:
    """Euler's steps of x' = 1 - x give 1 - (1 - h)^n, in halves 1 - (1 - h/2)^(2 n)."""
    found = try_repeats(probes := Probes(lag, {"euler": 1.0}), pushed_run(probes, step_s), STEPS)
    whole = [1.0 - (1.0 - step_s) ** n for n in range(STEPS + 1)]
    halves = [1.0 - (1.0 - 0.5 * step_s) ** (2 * n) for n in range(STEPS + 1)]
    difference = max(abs(a - b) for a, b in zip(whole, halves, strict=True))
    assert found is not None
    assert found.halves == pytest.approx(difference / max(whole), rel=1e-9)
    assert found.output == "y"


def test_exact_steps_do_not_mind_their_length_and_counted_steps_are_no_result(
    tmp_path: Path,
) -> None:
    with FmuWorkers(build_c_fmu(tmp_path)) as workers:
        found = try_repeats(probes := Probes(workers), pushed_run(probes, 1e-3), STEPS)
    assert found is not None
    assert found.halves < 1e-12


def test_what_changes_no_output_is_named(lag_fmu: Path) -> None:
    """A lag with its input held at rest sees neither gain nor tau; pushed, it sees all of them."""
    with FmuWorkers(lag_fmu) as workers:
        pushed, resting = Probes(workers), Probes(workers, {"u": 0.0})
        assert try_resets(pushed, pushed_run(pushed, 0.1)).idle == ()
        idle = try_resets(resting, pushed_run(resting, 0.1)).idle
        assert idle == ("tau", "gain", "through", "euler")


@pytest.mark.parametrize(
    ("reset", "kept", "true"),
    [
        ("RESET_WORKS", (), True),
        ("RESET_DOES_NOTHING", ("",), False),
        pytest.param("RESET_FREEZES_OUTPUT", ("",), False, marks=pytest.mark.nightly),
        ("RESET_KEEPS_DERIVED", ("mass", "damping", "stiffness"), False),
        ("RESET_KEEPS_PARAMETERS", ("mass", "damping", "stiffness", "force", "inverted"), False),
        ("RESET_FAILS", (), True),
    ],
)
def test_a_reset_is_tried_with_one_value_set(
    reset: str, kept: tuple[str, ...], true: bool, tmp_path: Path
) -> None:
    """By the text of each reset in model.h; one that fails tells so, and is no lie."""
    with FmuWorkers(build_c_fmu(tmp_path, reset=reset)) as workers:
        found = try_resets(probes := Probes(workers), pushed_run(probes, 1e-3))
    assert (found.kept, found.true) == (kept, true)


def test_noise_is_told_from_errors_of_the_step(tmp_path: Path) -> None:
    """The output is x (1 + 1e-3 sin ...), another sine in every run: at most 2e-3 apart."""
    with FmuWorkers(build_c_fmu(tmp_path, marks={"NOISE": 1e-3})) as workers:
        found = try_repeats(probes := Probes(workers), pushed_run(probes, 1e-3), 64)
    assert found is not None
    assert not found.falls
    assert 1e-3 < found.floor <= 2.01e-3
    assert found.again == 0.0
    assert found.late < 2.0 * found.early


def test_noise_that_grows_is_told(tmp_path: Path) -> None:
    """1e-6 (1 + 1e3 t): 64 times as large after 64 ms."""
    marks = {"NOISE": 1e-6, "GROWTH": 1e3}
    with FmuWorkers(build_c_fmu(tmp_path, marks=marks)) as workers:
        found = examine(workers, 1e-3, {})
        said = [f.sentence for f in trial_findings(workers.description, found)]
    assert found.repeats is not None
    n = found.repeats.steps
    assert found.repeats.late <= 2.01e-6 * (1.0 + n)
    assert found.repeats.early <= 2.01e-6 * (1.0 + n / 4.0)
    assert any(f"{found.repeats.late:.1e}" in sentence for sentence in said)


@pytest.mark.parametrize(
    "own_s",
    [
        *(2e-6, 9e-4, 0.07),
        *(pytest.param(s, marks=pytest.mark.nightly) for s in (3e-5, 3e-4, 1.25e-3, 0.01)),
    ],
)
def test_a_step_of_its_own_is_found(own_s: float, tmp_path: Path) -> None:
    """Not told by the description, much shorter or longer than a trial step, or no part of it."""
    with FmuWorkers(build_c_fmu(tmp_path, marks={"OWN_STEP": own_s})) as workers:
        own = try_repeats(probes := Probes(workers), pushed_run(probes, 1e-3), 256)
    assert own is not None
    assert own.own_step_s == pytest.approx(own_s, rel=0.02)


def test_no_step_is_found_where_there_is_none(lag: FmuWorkers) -> None:
    none = try_repeats(probes := Probes(lag), pushed_run(probes, 1e-3), 64)
    assert none is not None
    assert math.isnan(none.own_step_s)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("LOSES_TIME", "in steps of 0.0005 s"),
        ("REFUSES", "it refuses steps of 0.0005 s"),
    ],
)
def test_steps_that_are_lost_or_refused_are_told(kind: str, said: str, tmp_path: Path) -> None:
    """The oscillator of own_step.h, whose own step is the trial step, in halves of it."""
    with FmuWorkers(build_own_step_fmu(tmp_path, kind)) as workers:
        found = examine(workers, 1e-3, {})
        sentences = [f.sentence for f in trial_findings(workers.description, found)]
    assert [s for s in sentences if s.startswith(said)]
    assert not [s for s in sentences if "differ" in s or "repeat" in s]


def test_outputs_that_go_by_the_number_of_steps_are_told(tmp_path: Path) -> None:
    """x (1 + sin ...), another sine for every number of steps."""
    with FmuWorkers(build_c_fmu(tmp_path, marks={"NOISE": 1.0})) as workers:
        found = examine(workers, 1e-3, {})
        sentences = [f.sentence for f in trial_findings(workers.description, found)]
    assert found.repeats is not None
    assert found.repeats.floor > 0.3
    [said] = [s for s in sentences if "other ones" in s]
    assert f"displacement by {found.repeats.floor:.1e}" in said


@pytest.mark.parametrize(
    ("reset", "said"), [("RESET_FAILS", "fmi2Reset"), ("RESET_CRASHES", "SIGSEGV")]
)
def test_a_reset_that_does_not_work_is_told(reset: str, said: str, tmp_path: Path) -> None:
    with FmuWorkers(build_c_fmu(tmp_path, reset=reset)) as workers:
        found = examine(workers, 1e-3, {})
        [sentence] = [f.sentence for f in trial_findings(workers.description, found)]
    assert found.resets is not None
    assert found.resets.true  # what fails is no lie
    assert said in found.resets.fails
    assert sentence.endswith(found.resets.fails)


def test_what_acts_late_is_not_called_idle(tmp_path: Path) -> None:
    """The ball falls from 1 m for 0.45 s before its bounce matters, longer than 16 steps."""
    with FmuWorkers(build_reference_fmu(tmp_path, "BouncingBall")) as workers:
        found = examine(workers, 0.01, {})
        sentences = [f.sentence for f in trial_findings(workers.description, found)]
    assert found.resets is not None
    assert found.resets.idle == ()
    assert not [s for s in sentences if s.startswith("parameter")]


def test_what_an_input_does_at_once_and_later(lag: FmuWorkers) -> None:
    """y = x + through u: without ``through`` a step is wanted, with it none; no gain: nothing."""
    for values, acts, at_once in (
        ({}, True, False),
        ({"through": 0.5}, True, True),
        ({"gain": 0.0}, False, False),
    ):
        [effect] = try_inputs(probes := Probes(lag, values), pushed_run(probes, 0.1))
        assert (effect.name, effect.acts, effect.at_once) == ("u", acts, at_once)


def test_tunable_parameters_are_moved_between_steps(tmp_path: Path) -> None:
    """The damping counts when the FMU is initialised: moved later, it does nothing."""
    words = {
        'name="damping" valueReference="1" causality="parameter" variability="fixed"': (
            'name="damping" valueReference="1" causality="parameter" variability="tunable"'
        )
    }
    with FmuWorkers(reworded(build_c_fmu(tmp_path), words)) as workers:
        effects = try_inputs(probes := Probes(workers), pushed_run(probes, 1e-3))
        said = [
            f.sentence for f in trial_findings(workers.description, Examination(effects=effects))
        ]
    assert {e.name: e.acts for e in effects} == {"force": True, "damping": False}
    [sentence] = said
    assert sentence.startswith("parameter damping: ")


def test_own_steps_are_kept_to(tmp_path: Path) -> None:
    """Four of a fixed step, so that quarters are whole ones; else that of its experiment."""
    fixed = {"<CoSimulation ": '<CoSimulation fixedInternalStepSize="5e-4" '}
    usual = {"<ModelStructure>": '<DefaultExperiment stepSize="0.004"/><ModelStructure>'}
    plain = build_c_fmu(tmp_path)
    told = build_c_fmu(tmp_path, fmi=3)
    assert trial_step_s(read_description(plain)) is None
    assert trial_step_s(read_description(reworded(told, fixed))) == 2e-3
    assert trial_step_s(read_description(reworded(plain, usual))) == 0.004


@pytest.fixture(scope="module")
def late_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An oscillator, exact over every step; one output alone, which `late` = 1 returns late."""
    slave = Path(__file__).parents[1] / "bench/foreign/LateOutput.py"
    made = tmp_path_factory.mktemp("late")
    pythonfmu.FmuBuilder.build_FMU(str(slave), dest=str(made))
    return made / "LateOutput.fmu"


@pytest.mark.parametrize("f_hz", [0.02, 14e3, 2e9])
def test_steps_resolve_the_response_of_an_fmu_that_declares_none(
    f_hz: float, late_fmu: Path
) -> None:
    """Whatever its frequency, every value acts; long after, nothing moves that it could act on."""
    with FmuWorkers(late_fmu) as workers:
        values = {"late": 0.0, "f0": f_hz, "d": 0.5 * f_hz}
        found = examine(workers, None, values)
        assert found.resets is not None
        assert 8.0 < 1.0 / (f_hz * found.resets.step_s) < 50.0
        assert found.resets.excited
        assert found.resets.idle == ("late",)  # from 0 to 0.001, which is no as well
        settled = examine(workers, 100.0 / f_hz, values)
        assert settled.resets is not None
        assert (settled.resets.idle, settled.resets.excited) == (("d", "late"), False)
        said = [f.sentence for f in trial_findings(workers.description, settled)]
        assert not [sentence for sentence in said if sentence.startswith("parameter d")]


def test_an_output_that_comes_a_step_late_is_found(late_fmu: Path) -> None:
    with FmuWorkers(late_fmu) as workers:
        for late in (0.0, 1.0):
            found = examine(workers, None, {"late": late})
            kinds = [f.kind for f in trial_findings(workers.description, found)]
            assert kinds.count(Kind.output_late) == late


def test_what_repeats_to_less_than_any_accuracy_is_no_warning(tmp_path: Path) -> None:
    with FmuWorkers(build_c_fmu(tmp_path, marks={"NOISE": 1e-11})) as workers:
        found = examine(workers, 1e-3, {})
    [finding] = trial_findings(workers.description, found)
    assert finding.severity is Severity.COSMETIC
    assert finding.sentence.startswith("outputs repeat to")


def test_a_hang_when_an_instance_is_freed_is_found(tmp_path: Path, clock: Clock) -> None:
    hung = tmp_path / "hung"
    clock.runs = hung.exists
    marks = {"HANGS_WHEN_FREED": hung}
    with FmuWorkers(build_c_fmu(tmp_path, marks=marks), timeout_s=70.0) as workers:
        found = examine(workers, 1e-3, {})
    assert found.trial is not None
    assert found.failure is not None
    assert "free an instance" in found.failure.message
    assert "70 s" in found.failure.message


def test_costs_are_measured(lag_fmu: Path) -> None:
    """Of a program that was started for it no two runs are alike: only what cannot be otherwise."""
    with FmuWorkers(lag_fmu) as workers:
        probes = Probes(workers)
        run = pushed_run(probes, 1e-3)
        try_resets(probes, run)
        before = workers.counts
        costs = measure_costs(probes, run)
        spent = workers.counts.processor_s - before.processor_s
    assert not costs.anew
    assert 0.0 < costs.step_s < spent
    assert 0.0 < costs.start_s < spent
    assert costs.bytes_per_run < 1e5 or math.isnan(costs.bytes_per_run)


@pytest.mark.parametrize(("step_s", "steps"), [(1e-6, 256), (0.01, 64), (1.0, 16)])
def test_a_slow_fmu_is_tried_in_fewer_steps(step_s: float, steps: int) -> None:
    costs = Costs(step_s=step_s, start_s=0.0, bytes_per_run=0.0, anew=False)
    assert repeated_steps(costs) == steps


def test_broken_rules_are_told_once_the_grave_ones_first() -> None:
    said = [
        "ModelStructure/InitialUnknowns does not contain the expected set of variables. "
        'Expected { "a" (line 3) } but was { }.',
        'The unit "furlong" of variable "a" (line 3) is not defined.',
        'The unit "stone" of variable "b" (line 40) is not defined.',
        'Variable "c" (line 5) has no start value.',
    ]
    found = rule_findings(said)
    assert [f.severity for f in found] == [Severity.CAREFUL, Severity.CAREFUL, Severity.COSMETIC]
    assert [f.count for f in found] == [2, 1, 1]
    assert found[0].sentence == said[1]
    assert rule_findings([]) == ()
