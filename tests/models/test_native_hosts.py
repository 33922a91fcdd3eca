"""The native twin in hosts in C, under the compiler's checks of memory, operations and threads."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.c_hosts import Pythonless, Transcript
from tests.support.fmus import (
    DISCARD,
    ERROR,
    FATAL,
    LIVELY,
    OK,
    REFUSALS,
    TIMES,
    Unpacked,
    unpack,
)
from tests.support.native_runs import CASES, Case, closed_form, refusals, rows_of, script_of
from tests.support.processes import MOST_S
from tests.support.twins import checked_binary, need_compiler, shipped_binary, twin_of

OSCILLATOR = CASES[0]
MEMORY = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
THREADS = ("-fsanitize=thread",)
#: What a call that fails answers.
FAILED = {2: DISCARD, 3: ERROR}
EVERY = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
#: Compiled anew: one of the C files of either version of FMI, and the model with memory of its own.
FEW = pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            id=case.name,
            marks=()
            if (case.model, case.fmi) in {("CoupledOscillator", 3), ("CoupledModes3", 2)}
            else pytest.mark.nightly,
        )
        for case in CASES
    ],
)


def twin(model: str, fmi: int, factory: pytest.TempPathFactory) -> Unpacked:
    return unpack(twin_of(model, factory, fmi), factory.mktemp("twin"))


# --- memory and operations -----------------------------------------------------------------------


#: That of FMI 2.0 is in the checks of the other models, too.
VERSIONS = [pytest.param(2, id="fmi2", marks=pytest.mark.nightly), pytest.param(3, id="fmi3")]


@pytest.fixture(scope="module", params=VERSIONS)
def host(
    request: pytest.FixtureRequest,
    compiled: Callable[..., Path],
    tmp_path_factory: pytest.TempPathFactory,
) -> Pythonless:
    """The C program and a binary that stop at the first access or operation that C forbids."""
    need_compiler()
    fmu = twin("CoupledOscillator", request.param, tmp_path_factory)
    binary = checked_binary(tmp_path_factory.mktemp("checked"), fmu.path, *MEMORY)
    return Pythonless(compiled("replay", *MEMORY, fmi=request.param), fmu, binary)


def test_runs_in_a_host_without_python(host: Pythonless) -> None:
    found = closed_form(host)
    assert found.rest_error < 1e-13
    assert found.orbit_error < 1e-11
    transcript = found.transcript
    assert {status for _, _, status, _ in transcript.lines} == {OK}
    assert transcript.log == []
    assert [float(last) for _, last in transcript.of("step")] == [
        before + (time - before) for before, time in zip([0.0, *TIMES], TIMES, strict=False)
    ] * 2


def test_nothing_is_touched_that_is_not_its_own(host: Pythonless) -> None:
    """Every solver, refusal, state, derivative and misuse."""
    reference_of = host.fmu.references
    outputs = " ".join(str(reference_of[name]) for name in ("q1_hybrid", "q1_hybrid_X_u1"))
    script = script_of(host, OSCILLATOR)[:-3]
    for known in ("theta", "b", "solver"):  # the last one has no derivative
        script += ["reset 0", *host.start(**LIVELY), "step 0 0 1e-5"]
        script += [f"dir 0 0.5 {reference_of[known]} {outputs}"]
    if "time" in reference_of:  # which FMI 3.0 has among the variables
        script += ["reset 0", *host.start(**LIVELY), *host.get("q1", "time", "q2")]
    script += refusals(host)
    script += ["reset 0", "getr 0 9999 0", "reset 0", f"setr 0 {reference_of['q1']} 1"]
    script += ["restore 0", "unpack 0", "drop 0", "exit 0", "exit 0", "step 0 0 1", "new 2 c"]
    transcript = host.play([*script, "free 0", "free 1", "free 2"])
    failed = FAILED[2 if host.fmu.description.fmiVersion == "2.0" else 3]
    statuses = [status for status, _ in transcript.of("step")]
    assert statuses.count(failed) == len(REFUSALS) + 1
    assert set(statuses) == {OK, failed}
    assert [status for status, _ in transcript.of("dir")] == [OK, OK, DISCARD]
    for refusal, (_, said) in zip(
        REFUSALS, transcript.of("gets")[len(OSCILLATOR.runs) :], strict=True
    ):
        assert refusal.name in said
        assert refusal.value in said


def test_a_state_goes_on_bit_for_bit(host: Pythonless) -> None:
    """In the instance that it was taken of, and, as bytes, in another one."""
    for rows in rows_of(host, host.play(script_of(host, OSCILLATOR))):
        _, changed, restored, other = rows
        assert restored == other
        assert changed != restored


def test_a_host_is_told_why_it_gets_no_instance(host: Pythonless) -> None:
    stranger = copy(host.fmu.description)
    stranger.guid = "{none}"
    transcript = replace(host, fmu=host.fmu._replace(description=stranger)).play(["new 0 a"])
    assert transcript.of("new") == [(FATAL, "")]
    [(status, said)] = transcript.log
    assert status == ERROR
    assert "another FMU" in said


# --- threads -------------------------------------------------------------------------------------


@FEW
def test_threads_do_not_race(
    case: Case,
    compiled: Callable[..., Path],
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Instances in threads, each as it is alone; no two threads touch the same memory."""
    need_compiler()
    fmu = twin(case.model, case.fmi, tmp_path_factory)
    binary = checked_binary(tmp_path / "checked", fmu.path, *THREADS)
    program = compiled("threads", *THREADS, "-pthread", fmi=case.fmi)
    alone = Pythonless(compiled("replay", *THREADS, fmi=case.fmi), fmu, binary)
    scripts = [script_of(alone, replace(case, runs=case.runs[k::4])) for k in range(4)]
    files = [tmp_path / f"{k}.txt" for k in range(4)]
    for file, script in zip(files, scripts, strict=True):
        file.write_text("".join(f"{line}\n" for line in script))
    command = [program, binary, fmu.folder / "resources", fmu.description.guid, *files]
    done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_S)
    assert (done.returncode, done.stderr) == (0, "")
    for file, script in zip(files, scripts, strict=True):
        together = Transcript.read(file.with_name(f"{file.name}.out").read_text())
        assert together == alone.play(script)


# --- memory after initialisation -----------------------------------------------------------------


@EVERY
def test_memory_is_got_for_instances_and_states_alone(
    case: Case, compiled: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Counted in the whole process, C library included; nothing while a simulation runs."""
    need_compiler()
    fmu = twin(case.model, case.fmi, tmp_path_factory)
    host = Pythonless(compiled("replay", fmi=case.fmi), fmu, shipped_binary(fmu.folder))
    counting = compiled("allocations", "-shared", "-fPIC")
    done = host.run(script_of(host, case), LD_PRELOAD=str(counting))
    assert done.returncode == 0, done.stderr
    got = {line.split()[3] for line in done.stdout.splitlines() if line.startswith("allocated")}
    assert got == {"new", "save", "unpack"}
