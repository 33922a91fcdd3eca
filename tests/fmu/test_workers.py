"""FMUs in worker processes: right numbers, and every way to fail becomes a sentence.

Truth for the numbers is the closed solution of m x'' + c x' + k x = F, written down here anew.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import mpmath
import numpy as np
import pytest

from fitting.fmu.description import read_description, validation_problems
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import InputSignal, Run
from fitting.fmu.worker.pulse import open_pulse
from fitting.fmu.worker.simulation import values_over_steps
from fitting.signal.tones import cycle_fraction
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure
from tests.support.cfmu_build import build_c_fmu
from tests.support.processes import Clock, is_gone, wait_until

MASS, DAMPING, STIFFNESS = 1.25e-3, 2.5e-2, 4.1e3
START: dict[str, Scalar] = {"mass": MASS, "damping": DAMPING, "stiffness": STIFFNESS}
PULLED = Run(
    start_values={**START, "force": 1.0},
    settle_s=0.0,
    sample_step_s=1e-3,
    samples=6,
    outputs=("displacement",),
)
# values of `misbehave`, in the order of the enum in model.h
HANGS, CRASHES, NAN, ENDS_EARLY, FAILS_AT_START, FAILS_IN_STEP, PENDING, WARNS = range(1, 9)
HANGS_AT_START, ABORTS = 9, 10


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cfmus")


@pytest.fixture(scope="session")
def good(folder: Path) -> Path:
    return build_c_fmu(folder)


@pytest.fixture(scope="session")
def good3(folder: Path) -> Path:
    """The same for FMI 3.0."""
    return build_c_fmu(folder, fmi=3)


@pytest.fixture(scope="module")
def running(good: Path) -> Iterator[FmuWorkers]:
    """Open for all that neither counts nor misses a process: one costs more than their runs."""
    with FmuWorkers(good) as workers:
        yield workers


@pytest.fixture(scope="module")
def running3(good3: Path) -> Iterator[FmuWorkers]:
    """The like for FMI 3.0."""
    with FmuWorkers(good3) as workers:
        yield workers


@pytest.fixture(scope="module")
def fresh(good: Path) -> Iterator[FmuWorkers]:
    """A new instance for every run: what reused ones are held against."""
    with FmuWorkers(good, reuse="never") as workers:
        yield workers


@pytest.fixture(scope="module")
def keeps_derived(folder: Path) -> Path:
    """Its reset keeps what was derived from parameters."""
    return build_c_fmu(folder, reset="RESET_KEEPS_DERIVED")


def step_response(times: np.ndarray) -> np.ndarray:
    """Displacement of the oscillator under a unit force from rest."""
    gamma = DAMPING / (2 * MASS)
    omega = math.sqrt(STIFFNESS / MASS - gamma**2)
    decay = np.exp(-gamma * times)
    swing = np.cos(omega * times) + gamma / omega * np.sin(omega * times)
    return np.asarray((1 - decay * swing) / STIFFNESS)


def test_numbers_of_fmi_2_and_3_are_those_of_the_closed_solution(good: Path, good3: Path) -> None:
    for path in (good, good3):
        assert validation_problems(path) == []
        with FmuWorkers(path) as workers:
            late = replace(PULLED, settle_s=0.05, start_time_s=3.0)
            both, late_result = workers.run([PULLED, late])
        np.testing.assert_allclose(both[:, 0], step_response(np.arange(6) * 1e-3), rtol=1e-11)
        expected = step_response(0.05 + np.arange(6) * 1e-3)
        np.testing.assert_allclose(late_result[:, 0], expected, rtol=1e-10)


def test_values_of_every_type_arrive_and_outputs_of_several_types_are_read(
    good: Path, good3: Path
) -> None:
    for path in (good, good3):
        with FmuWorkers(path) as workers:
            outputs = ("steps", "displacement", "line_width")
            plain, by_flag, by_label = workers.run(
                [
                    replace(PULLED, outputs=outputs),
                    replace(
                        PULLED,
                        outputs=outputs,
                        start_values={**START, "force": 1, "inverted": True},
                    ),
                    replace(
                        PULLED,
                        outputs=outputs,
                        start_values={**START, "force": 1, "label": "upside down"},
                    ),
                ]
            )
        np.testing.assert_array_equal(plain[:, 0], np.arange(6))
        np.testing.assert_allclose(plain[:, 2], DAMPING / MASS / (2 * math.pi), rtol=1e-15)
        np.testing.assert_array_equal(by_flag[:, 1], -plain[:, 1])
        np.testing.assert_array_equal(by_label[:, 1], -plain[:, 1])


def test_generated_input_drives_to_the_closed_steady_state(running: FmuWorkers) -> None:
    frequency_hz, amplitude, phase = 280.0, 0.7, 0.4
    step_s = 1 / (frequency_hz * 200)
    signal_ = InputSignal("force", ((frequency_hz, amplitude, phase), (50.0, 0.0, 0.0)), step_s)
    periods, n = 420, 40  # exp(-10 π·420/280) = 3e-21 of the transient is left
    run = Run(
        start_values=START,
        settle_s=periods / frequency_hz,
        sample_step_s=5 * step_s,
        samples=n,
        outputs=("displacement",),
        input_signal=signal_,
    )
    [result] = running.run([run])
    omega = 2 * math.pi * frequency_hz
    response = 1 / (STIFFNESS - MASS * omega**2 + 1j * omega * DAMPING)
    times = periods / frequency_hz + np.arange(n) * 5 * step_s
    expected = (amplitude * response * np.exp(1j * (omega * times + phase))).real
    assert np.abs(result[:, 0] - expected).max() < 1e-6 * np.abs(response * amplitude)


def test_held_values_keep_their_phase_at_large_times() -> None:
    f, t0, h = 6.94016e6, 1234.5, 1e-8
    values = values_over_steps(((f, 2.0, 0.3),), t0, h, 7)
    with mpmath.workdps(50):
        sinc = mpmath.sin(mpmath.pi * f * h) / (mpmath.pi * f * h)
        for k, value in enumerate(values):
            t = mpmath.mpf(float(t0 + (k + 0.5) * h))
            exact = 2 / sinc * mpmath.cos(2 * mpmath.pi * mpmath.mpf(f) * t + mpmath.mpf(0.3))
            assert abs(value - exact) < 1e-14
    assert abs(float(cycle_fraction(1 / 3, np.array([3e15]))[0])) <= 1.0


def test_samples_do_not_accumulate_time(running: FmuWorkers) -> None:
    n, step = 2001, 0.1 * 1e-3
    [result] = running.run([replace(PULLED, samples=n, sample_step_s=step)])
    np.testing.assert_allclose(
        result[:, 0], step_response(np.arange(n) * step), rtol=1e-9, atol=1e-16
    )


@pytest.mark.parametrize(
    ("misbehave", "words"),
    [
        (NAN, ["displacement is nan", "t = 0.001 s", "after 0 s"]),
        (ENDS_EARLY, ["t = 0.0005 s", "0.001 s", "discard"]),
        (FAILS_AT_START, ["fmi2EnterInitializationMode", "'error'", "told to"]),
        (FAILS_IN_STEP, ["fmi2DoStep", "t = 0.0 s", "0.001 s", "'error'", "from 0 s"]),
        (PENDING, ["'pending'"]),
        (CRASHES, ["SIGSEGV", "crash at 0 s"]),
        (ABORTS, ["SIGABRT", "assertion"]),
    ],
)
def test_failure_is_a_sentence_with_the_parameters(
    good: Path, running: FmuWorkers, misbehave: int, words: list[str]
) -> None:
    bad = replace(PULLED, start_values={**PULLED.start_values, "misbehave": misbehave})
    two = FmuWorkers(good, workers=2) if misbehave == CRASHES else nullcontext(running)
    with two as workers:
        with pytest.raises(FmuFailure) as failure:
            workers.run([PULLED, PULLED, bad, PULLED])
        assert failure.value.parameters == bad.start_values
        assert failure.value.fmu == good
        for word in words:
            assert word in failure.value.message
        [after] = workers.run([PULLED])  # the caller, and the object, live on
    np.testing.assert_allclose(after[:, 0], step_response(np.arange(6) * 1e-3), rtol=1e-11)


@pytest.mark.parametrize(
    "misbehave",
    [FAILS_IN_STEP, *(pytest.param(x, marks=pytest.mark.nightly) for x in (FAILS_AT_START, NAN))],
)
def test_a_run_that_fails_costs_an_instance_and_no_process(good: Path, misbehave: int) -> None:
    """Neither it nor the run behind it is made on an instance that another run was made on."""
    calm = replace(PULLED, start_values={**PULLED.start_values, "misbehave": 0})
    bad = replace(calm, start_values={**calm.start_values, "misbehave": misbehave})
    with FmuWorkers(good) as workers:
        other = replace(calm, start_values={**calm.start_values, "force": 2.0})
        before, _, _ = workers.run([calm, other, calm])
        assert workers.verdict.reused
        instances = workers.counts.instances
        for _ in range(3):
            with pytest.raises(FmuFailure):
                workers.run([bad, calm])
            [after] = workers.run([calm])
            assert after.tobytes() == before.tobytes()
        assert workers.counts.processes == 1
        assert workers.counts.instances == instances + 6


def test_a_run_is_not_blamed_for_a_failure_before_it(good: Path) -> None:
    """A process that ends after a failure is replaced; one that ends again is told."""
    fails, crashes = (
        replace(PULLED, start_values={**PULLED.start_values, "misbehave": how})
        for how in (FAILS_AT_START, CRASHES)
    )
    with FmuWorkers(good) as workers:
        with pytest.raises(FmuFailure, match="'error'"):
            workers.run([fails])
        with pytest.raises(FmuFailure, match="SIGSEGV"):
            workers.run([PULLED, crashes])
        assert workers.counts.processes == 2


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.nightly)])
def test_a_batch_of_many_messages_is_one_batch(good: Path, workers: int) -> None:
    """Displacements go with the force, in the order of the runs; the run that fails is named."""
    forces = np.arange(1.0, 4_502.0)
    runs = [replace(PULLED, start_values={**START, "force": force}) for force in forces.tolist()]
    at = 2_300
    bad = replace(runs[at], start_values={**runs[at].start_values, "misbehave": FAILS_AT_START})
    with FmuWorkers(good, workers=workers) as pool:
        found = np.stack([result[:, 0] for result in pool.run(runs)])
        expected = forces[:, np.newaxis] * step_response(np.arange(6) * 1e-3)
        np.testing.assert_allclose(found, expected, rtol=1e-11)
        with pytest.raises(FmuFailure, match="'error'") as failure:
            pool.run([*runs[:at], bad, *runs[at + 1 :]])
        assert failure.value.parameters["force"] == forces[at]
        assert failure.value.at == at
        assert at - 1 in failure.value.answers or workers == 2
        assert at not in failure.value.answers


def in_second_run(workers: FmuWorkers) -> bool:
    """Whether the second run of a batch is under way in the first process."""
    process = workers._open.processes[0]
    return process is not None and process.pulse.at_run == 1


def in_trial(workers: FmuWorkers) -> bool:
    """Whether a reset is being tried in the first process."""
    process = workers._open.processes[0]
    return process is not None and bool(process.pulse.in_trial)


@pytest.mark.parametrize(
    "misbehave", [HANGS_AT_START, pytest.param(HANGS, marks=pytest.mark.nightly)]
)
def test_endless_loop_is_stopped(good: Path, misbehave: int, clock: Clock) -> None:
    bad = replace(PULLED, start_values={**PULLED.start_values, "misbehave": misbehave})
    with FmuWorkers(good, timeout_s=60.0) as workers:
        workers.run([PULLED])
        clock.runs = lambda: in_second_run(workers)
        with pytest.raises(FmuFailure, match="60 s") as failure:
            workers.run([PULLED, bad])
        assert failure.value.parameters == bad.start_values
        assert clock.now > 60.0


@pytest.mark.parametrize(
    ("misbehave", "words"),
    [
        (ENDS_EARLY, "asks to end"),
        (PENDING, r"0\.0005 s.* 0\.001 s"),
        (FAILS_IN_STEP, "make this step"),
        (FAILS_AT_START, "at the start"),
        pytest.param(CRASHES, "SIGSEGV", marks=pytest.mark.nightly),
    ],
)
def test_failures_of_fmi_3(running3: FmuWorkers, misbehave: int, words: str) -> None:
    with pytest.raises(FmuFailure, match=words):
        running3.run([replace(PULLED, start_values={**START, "misbehave": misbehave})])


def test_warnings_are_kept_and_do_not_stop(good: Path) -> None:
    slow = replace(PULLED, start_values={**START, "misbehave": WARNS})
    latest = []
    with FmuWorkers(good) as workers:
        for runs in ([slow] * 3, [PULLED]):
            workers.run(runs)
            [warning] = workers.warnings  # the FMU's own words, as often as they come
            assert warning.endswith("99 % load")
            latest.append(workers.latest_warnings)
    assert latest == [(warning,), ()]


def test_a_flood_of_warnings_is_cut_short_in_a_sentence(good: Path) -> None:
    """One for every step; what is beyond fifty is dropped, and that is said."""
    lost = replace(PULLED, start_values={**START, "misbehave": NAN}, allow_nan=True)
    with FmuWorkers(good) as workers:
        workers.run([replace(lost, samples=51)])
        assert len(workers.warnings) == 50
        assert workers.warnings[-1].startswith("lost the state")
        workers.run([replace(lost, samples=81)])
        assert len(workers.warnings) == 51
        assert workers.warnings[-1].startswith("… ")
        assert workers.latest_warnings == workers.warnings


def test_nan_is_handed_back_only_where_it_is_allowed(running: FmuWorkers) -> None:
    run = replace(PULLED, start_values={**START, "misbehave": NAN}, allow_nan=True)
    [result] = running.run([run])
    assert np.isnan(result[1:, 0]).all()


def stiffness_runs(n: int) -> list[Run]:
    values = [{**PULLED.start_values, "stiffness": STIFFNESS + 10.0 * i} for i in range(n)]
    return [replace(PULLED, start_values=value) for value in values]


@pytest.mark.parametrize(
    ("reset", "reused", "word"),
    [
        ("RESET_WORKS", True, "bit for bit"),
        # all are set for every run anyway
        pytest.param("RESET_KEEPS_PARAMETERS", True, "bit for bit", marks=pytest.mark.nightly),
        ("RESET_DOES_NOTHING", False, "displacement"),
        pytest.param("RESET_KEEPS_DERIVED", False, "displacement", marks=pytest.mark.nightly),
        pytest.param("RESET_FREEZES_OUTPUT", False, "displacement", marks=pytest.mark.nightly),
        ("RESET_FAILS", False, "fmi2Reset"),
        ("RESET_CRASHES", False, "SIGSEGV"),
        ("RESET_HANGS", False, "no answer"),
    ],
)
def test_reset_is_trusted_only_where_it_works(
    folder: Path, fresh: FmuWorkers, clock: Clock, reset: str, reused: bool, word: str
) -> None:
    runs = stiffness_runs(12)
    before = fresh.counts.instances
    expected = fresh.run(runs)
    assert fresh.counts.instances == before + len(runs)
    assert "asked for" in fresh.verdict.note
    with FmuWorkers(build_c_fmu(folder, reset=reset), timeout_s=60.0) as workers:
        clock.runs = lambda: reset == "RESET_HANGS" and in_trial(workers)
        results = workers.run(runs) + workers.run(runs)
        assert word in workers.verdict.note
        assert workers.verdict.reused is reused
        assert (workers.counts.instances < 5) is reused
    for result, truth in zip(results, expected + expected, strict=True):
        assert result.tobytes() == truth.tobytes()


def test_a_value_that_is_varied_later_is_checked_then(
    keeps_derived: Path, fresh: FmuWorkers
) -> None:
    """A reset that keeps what was derived from the stiffness passes while only the force varies."""
    forces = [replace(PULLED, start_values={**START, "force": 1.0 + i}) for i in range(5)]
    with FmuWorkers(keeps_derived) as workers:
        workers.run(forces)
        before = workers.verdict.reused
        results = workers.run(stiffness_runs(4))
        assert (before, workers.verdict.reused) == (True, False)
    expected = fresh.run(stiffness_runs(4))
    assert [r.tobytes() for r in results] == [r.tobytes() for r in expected]


@pytest.mark.parametrize("once", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_reset_is_not_proven_by_a_run_at_rest(
    folder: Path, fresh: FmuWorkers, once: bool
) -> None:
    """The first run shows no value, as a probe without a drive; then stiffness and force vary."""
    still = replace(PULLED, start_values={**START, "force": 0.0})
    runs = [still, PULLED, *stiffness_runs(4)[1:]]
    path = build_c_fmu(folder, reset="RESET_KEEPS_DERIVED", once=once)
    with FmuWorkers(path) as workers:
        results = workers.run(runs)
        assert workers.verdict.reused is False
        assert workers.verdict.lied
    expected = fresh.run(runs)
    assert [r.tobytes() for r in results] == [r.tobytes() for r in expected]


def test_a_reset_is_not_proven_by_runs_that_end_at_once(
    keeps_derived: Path, fresh: FmuWorkers
) -> None:
    """Runs of one sample, taken before the first step, show no damping."""
    ends = replace(PULLED, samples=1)
    runs = [ends, replace(ends, start_values={**PULLED.start_values, "damping": 0.5}), PULLED]
    runs += [replace(PULLED, start_values={**PULLED.start_values, "damping": 0.5})]
    with FmuWorkers(keeps_derived) as workers:
        results = workers.run(runs)
        assert workers.verdict.reused is False
    expected = fresh.run(runs)
    assert [r.tobytes() for r in results] == [r.tobytes() for r in expected]


def test_one_instance_per_process(folder: Path, fresh: FmuWorkers) -> None:
    """Declared so and true: still compared with a new instance, in a process of its own."""
    with FmuWorkers(build_c_fmu(folder, once=True)) as workers:
        results = workers.run(stiffness_runs(20))
        assert workers.verdict.reused is True
        assert workers.counts.processes == workers.counts.instances == 2
    expected = fresh.run(stiffness_runs(20))
    assert [r.tobytes() for r in results] == [r.tobytes() for r in expected]


def test_process_is_replaced_after_many_instances(good: Path) -> None:
    runs = [replace(PULLED, samples=1)] * 1100
    with FmuWorkers(good, reuse="never") as workers:
        assert len(workers.run(runs)) == len(runs)
        assert workers.counts.instances == 1100
        assert workers.counts.processes == 3


def test_what_a_run_does_not_name_has_its_start_value(folder: Path) -> None:
    """Also in an FMU whose reset keeps the parameters that runs before have set."""
    plain = stiffness_runs(5)
    inverted = [replace(r, start_values={**r.start_values, "inverted": True}) for r in plain]
    mixed = [run for pair in zip(inverted, plain, strict=True) for run in pair]
    with FmuWorkers(build_c_fmu(folder, reset="RESET_KEEPS_PARAMETERS")) as workers:
        results = workers.run(mixed)
        assert workers.verdict.reused is True
    for first, second in zip(results[::2], results[1::2], strict=True):
        np.testing.assert_array_equal(first, -second)


def test_several_workers_give_what_one_gives(good: Path) -> None:
    runs = stiffness_runs(7)
    with FmuWorkers(good) as one, FmuWorkers(good, workers=3) as three:
        assert all((a == b).all() for a, b in zip(one.run(runs), three.run(runs), strict=True))
        assert three.run([]) == []


@pytest.mark.parametrize(
    "misbehave", [CRASHES, pytest.param(FAILS_IN_STEP, marks=pytest.mark.nightly)]
)
def test_a_batch_that_fails_is_no_failure_of_the_next_one(good: Path, misbehave: int) -> None:
    bad = replace(PULLED, start_values={**PULLED.start_values, "misbehave": misbehave})
    with FmuWorkers(good, workers=2) as pool:
        pool.run([PULLED, PULLED])
        with pytest.raises(FmuFailure) as failed:
            pool.run([PULLED, bad, PULLED])
        assert failed.value.parameters["misbehave"] == misbehave
        [answer] = pool.run([PULLED])
        expected = step_response(np.arange(6) * 1e-3)
        np.testing.assert_allclose(answer[:, 0], expected, rtol=1e-11)


def test_a_batch_that_nobody_waits_for_any_more_is_none_of_the_next_ones(
    good: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with FmuWorkers(good, workers=2) as pool:
        pool.run([PULLED])
        late = replace(PULLED, settle_s=0.05)
        with monkeypatch.context() as patched:
            patched.setattr(pool, "_wait", _interrupted)
            with pytest.raises(KeyboardInterrupt):
                pool.run([late, late, late])
        [answer] = pool.run([PULLED])
        expected = step_response(np.arange(6) * 1e-3)
        np.testing.assert_allclose(answer[:, 0], expected, rtol=1e-11)


def _interrupted(_job: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    "name", ["Gerät (neu)", pytest.param("mit Leerzeichen", marks=pytest.mark.nightly)]
)
def test_folder_names_that_fmus_stumble_over(
    tmp_path: Path, good: Path, oscillator_fmu: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    odd = tmp_path / name
    odd.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(odd))
    target = odd / "ein FMU (Kopie).fmu"
    target.write_bytes(oscillator_fmu.read_bytes())
    with FmuWorkers(target) as workers:
        [result] = workers.run(
            [
                Run(
                    start_values={"theta": 1.95},
                    settle_s=0.0,
                    sample_step_s=1.0,
                    samples=1,
                    outputs=("lambda",),
                )
            ]
        )
    assert 0.6e6 < result[0, 0] < 0.7e6


def test_the_oscillator_is_reused(oscillator_fmu: Path) -> None:
    """λ² = −½ sin 2θ (η₋² − η₊²) at the published angles, one process, instances reset."""
    eta_plus, eta_minus = 6.94026e6, 7.02760e6
    angles = [1.9498, 2.0406, 1.7, 1.8, 2.5]
    runs = [
        Run(
            start_values={
                "theta": a,
                "eta_plus": eta_plus,
                "eta_minus": eta_minus,
                "periodic_start": True,
            },
            settle_s=0.0,
            sample_step_s=1e-6,
            samples=2,
            outputs=("lambda", "q1_hybrid"),
        )
        for a in angles
    ]
    with FmuWorkers(oscillator_fmu) as workers:
        results = workers.run(runs)
        assert workers.verdict.reused is True
        assert workers.counts.instances == 2
    for angle, result in zip(angles, results, strict=True):
        truth = math.sqrt(-0.5 * math.sin(2 * angle) * (eta_minus**2 - eta_plus**2))
        assert result[0, 0] == pytest.approx(truth, rel=1e-12)


def test_two_fmus_at_once_do_not_disturb_each_other(good: Path, oscillator_fmu: Path) -> None:
    run = Run(
        start_values={"theta": 1.9},
        settle_s=0.0,
        sample_step_s=1e-6,
        samples=3,
        outputs=("q1_hybrid",),
    )
    with FmuWorkers(good) as a, FmuWorkers(oscillator_fmu) as b, FmuWorkers(oscillator_fmu) as c:
        b.run([run])
        [pulled] = a.run([PULLED])
        assert (b.run([run])[0] == c.run([run])[0]).all()
    np.testing.assert_allclose(pulled[:, 0], step_response(np.arange(6) * 1e-3), rtol=1e-11)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start_values": {"masss": 1.0}}, r"'masss'.* mass\b"),
        ({"start_values": {"displacement": 1.0}}, "'displacement'.* output"),
        ({"start_values": {"mass": "heavy"}}, "mass = 'heavy'.* Real"),
        ({"start_values": {"misbehave": 1.5}}, r"misbehave = 1\.5.* Integer"),
        ({"outputs": ("position",)}, "no variable 'position'"),
        ({"outputs": ("label",)}, "wanted a number"),
        ({"outputs": ()}, "outputs is"),
        ({"samples": 0}, "samples is 0"),
        ({"settle_s": math.nan}, "settle_s is nan"),
        ({"sample_step_s": -1.0}, "sample_step_s is -1.0"),
        ({"input_signal": InputSignal("mass", (), 1e-4)}, "wanted a Real input"),
        ({"input_signal": InputSignal("force", (), 3e-4)}, "3.33333333 steps"),
    ],
)
def test_a_run_that_does_not_fit_the_fmu(
    running: FmuWorkers, changes: dict[str, object], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        running.run([replace(PULLED, **changes)])  # type: ignore[arg-type]


def test_coarse_input_signal_is_refused() -> None:
    with pytest.raises(BadInput, match="at least 4"):
        InputSignal("force", ((300.0, 1.0, 0.0),), 1e-3)


def test_files_that_cannot_be_used(folder: Path, good: Path, tmp_path: Path) -> None:
    foreign = build_c_fmu(tmp_path, platform="plan9")
    with pytest.raises(BadInput, match="plan9"):
        FmuWorkers(foreign)
    text = tmp_path / "text.fmu"
    text.write_text("this is not a zip file")
    with pytest.raises(BadInput, match=r"text\.fmu"):
        read_description(text)
    with pytest.raises(BadInput, match=r"absent\.fmu"):
        read_description(tmp_path / "absent.fmu")


CALLER = """
import signal, sys
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it
workers = FmuWorkers(sys.argv[1])
run = Run(
    start_values={"mass": 1.0}, settle_s=0.0, sample_step_s=1.0, samples=2,
    outputs=("displacement",),
)
workers.run([run])
[process] = workers._open.processes
print(process.pid, workers._open.home, process.pulse.started, flush=True)
if sys.argv[2] == "busy":
    run = Run(
        start_values={"misbehave": 1}, settle_s=0.0, sample_step_s=1.0, samples=2,
        outputs=("displacement",),
    )
    workers.run([run])
sys.stdin.read()
"""


def _pulse_of(caller: int, home: Path) -> Path:
    """Where another process finds the pulse of a caller's only worker."""
    if sys.platform != "linux":
        return home / "worker0.pulse"
    files = list(Path(f"/proc/{caller}/fd").iterdir())
    return next(path for path in files if "memfd:pulse" in os.readlink(path))


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    ("how", "state"),
    [
        (signal.SIGKILL, "busy"),
        (signal.SIGTERM, "idle"),
        (signal.SIGINT, "busy"),
        pytest.param(signal.SIGKILL, "idle", marks=pytest.mark.nightly),
        pytest.param(signal.SIGINT, "idle", marks=pytest.mark.nightly),
    ],
)
def test_nothing_is_left_behind_when_the_caller_is_killed(
    good: Path, tmp_path: Path, how: signal.Signals, state: str
) -> None:
    """Busy: the worker sits in an endless loop of the FMU meanwhile."""
    script = tmp_path / "caller.py"
    script.write_text(CALLER)
    caller = subprocess.Popen(
        [sys.executable, str(script), str(good), state],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        text=True,
    )
    with caller:
        assert caller.stdout is not None
        pid, home, begun = caller.stdout.readline().split()
        if state == "busy":
            pulse = open_pulse(_pulse_of(caller.pid, Path(home)))
            # the batch, and the new instance or the reset before the run
            wait_until(lambda: pulse.started >= int(begun) + 2, "the run that never ends")
        caller.send_signal(how)
        wait_until(lambda: caller.poll() is not None, "the end of the caller")
        assert caller.returncode != 0
    wait_until(lambda: is_gone(int(pid)), "the end of the worker")
    wait_until(lambda: not Path(home).exists(), "the unpacked FMU to be removed")


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_worker_does_not_hear_ctrl_c(good: Path) -> None:
    """A terminal sends it to all; what it means is for the caller to decide."""
    with FmuWorkers(good) as workers:
        [process] = workers._open.processes
        assert process is not None
        os.kill(process.pid, signal.SIGINT)  # as early as can be: Python is still starting
        [first] = workers.run([PULLED])
        os.kill(process.pid, signal.SIGINT)
        [second] = workers.run([PULLED])
        assert workers.counts.processes == 1
    assert first.tobytes() == second.tobytes()
