"""The oscillator FMU in fmpy: restored, reset, and side by side with others."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

import build_fmu
from tests.support.fmus import DISCARD, LIVELY, OK, TIMES, Instance, Unpacked, unpack
from tests.support.processes import MOST_S

HOSTS = Path(__file__).parents[1] / "support" / "hosts"
SOLVERS = (0, 1, 2)


# --- reset and state -----------------------------------------------------------------------------


@pytest.mark.parametrize("solver", SOLVERS)
def test_reset_is_complete(oscillator: Unpacked, instance: Instance, solver: int) -> None:
    names = oscillator.names("output")
    with Instance(oscillator) as fresh:
        wanted = fresh.start(solver=solver).run([2e-6, 5e-6], *names)
    b = 0.0 if solver == 1 else 1e9
    instance.start(solver=solver, reflection=True, b=b, **LIVELY).run([3e-6], *names)
    instance.set(theta=0.5, d1=-1.0, u2=3e5)
    instance.step(3e-6, 1e-6)
    instance.slave.reset()
    parameters = oscillator.names("parameter")
    defaults = vars(oscillator.parameters())
    assert instance.get(*parameters) == [defaults[name] for name in parameters]
    assert instance.get("b") == [0.0]
    assert instance.start(solver=solver).run([2e-6, 5e-6], *names) == wanted


def changed_run(instance: Instance, solver: int) -> None:
    """Bring an instance into a state that its variables alone do not tell."""
    instance.start(solver=solver, **LIVELY).run(TIMES[:3], "q1")
    instance.set(theta=2.2, u1=1.01e5, phase2=0.2)
    instance.step(TIMES[2], TIMES[3] - TIMES[2])
    if solver != 1:  # a rotating frame cannot carry the input
        instance.set(b=2e9)
    instance.step(TIMES[3], TIMES[4] - TIMES[3])


def continued(instance: Instance, names: Sequence[str]) -> list[list[float]]:
    """Go on from where ``changed_run`` ended, through another change."""
    rows = []
    for k in range(5, 12):
        if k == 8:
            instance.set(d1=7e3, u2=1.3e5)
        if instance.step(TIMES[k - 1], TIMES[k] - TIMES[k - 1]) != OK:
            raise AssertionError(instance.messages)
        rows.append(instance.get(*names))
    return rows


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_run_restored_in_its_middle_continues_bit_for_bit(
    oscillator: Unpacked, instance: Instance, solver: int
) -> None:
    names = oscillator.names("output")
    changed_run(instance, solver)
    here = instance.get(*names)
    state = instance.slave.getFMUstate()
    wanted = continued(instance, names)
    instance.set(theta=float("nan"))  # even a failure is undone
    instance.step(TIMES[11], 1e-5)
    instance.slave.setFMUstate(state)
    assert instance.get(*names) == here
    assert continued(instance, names) == wanted
    instance.slave.setFMUstate(state)  # and the state is still what it was
    assert continued(instance, names) == wanted
    instance.slave.freeFMUstate(state)


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_run_restored_from_bytes_in_a_new_process_continues_bit_for_bit(
    oscillator: Unpacked, instance: Instance, solver: int, tmp_path: Path
) -> None:
    names = oscillator.names("output")
    changed_run(instance, solver)
    state = instance.slave.getFMUstate()
    (tmp_path / "state").write_bytes(instance.slave.serializeFMUstate(state))
    wanted = continued(instance, names)
    command = [sys.executable, str(HOSTS / "continue_run.py"), str(oscillator.folder)]
    done = subprocess.run(
        [*command, str(tmp_path / "state")],
        check=True,
        capture_output=True,
        text=True,
        timeout=MOST_S,
    )
    got = [[float.fromhex(x) for x in line.split()] for line in done.stdout.splitlines()]
    assert got == wanted


def test_a_state_can_be_taken_before_initialisation(
    oscillator: Unpacked, instance: Instance
) -> None:
    instance.set(theta=2.0)
    state = instance.slave.getFMUstate()
    instance.start(**LIVELY).run(TIMES[:2], "q1")
    instance.slave.setFMUstate(state)
    rows = instance.start().run([1e-5], "q1_hybrid", "D11")
    with Instance(oscillator) as fresh:
        assert fresh.start(theta=2.0).run([1e-5], "q1_hybrid", "D11") == rows


@pytest.mark.parametrize("resets", [500, pytest.param(2000, marks=pytest.mark.nightly)])
def test_resets_grow_the_process_by_less_than_500_bytes_each(
    oscillator: Unpacked, resets: int
) -> None:
    done = subprocess.run(
        [sys.executable, str(HOSTS / "reset_cycles.py"), str(oscillator.folder), str(resets)],
        check=True,
        capture_output=True,
        text=True,
        timeout=MOST_S,
    )
    assert float(done.stdout) < 500.0 * resets


# --- side by side --------------------------------------------------------------------------------

OTHER = dict(LIVELY) | {"theta": 0.4, "d1": 1e3, "solver": 2}


def alone(fmu: Unpacked, **values: Any) -> list[list[float]]:
    """Return the run of an instance that has the process for itself, in a process of its own."""
    return _alone(fmu.folder, tuple(f"{name}={value!r}" for name, value in values.items()))


@cache
def _alone(folder: Path, assignments: tuple[str, ...]) -> list[list[float]]:
    """Once for all that is held against it."""
    done = subprocess.run(
        [sys.executable, str(HOSTS / "run_alone.py"), str(folder), *assignments],
        check=True,
        capture_output=True,
        text=True,
        timeout=MOST_S,
    )
    return [[float.fromhex(x) for x in line.split()] for line in done.stdout.splitlines()]


def interleaved(first: Instance, second: Instance) -> tuple[list[Any], list[Any]]:
    """Step two instances in turns."""
    rows: tuple[list[Any], list[Any]] = ([], [])
    for k, end in enumerate(TIMES[:10]):
        begin = TIMES[k - 1] if k else 0.0
        for instance, row in zip((first, second), rows, strict=True):
            assert instance.step(begin, end - begin) == OK
            row.append(instance.get("q1_hybrid", "q2", "D12"))
    return rows


def test_two_instances_do_not_disturb_each_other(oscillator: Unpacked) -> None:
    one, other = dict(LIVELY), OTHER
    with Instance(oscillator, "one") as first, Instance(oscillator, "other") as second:
        got = interleaved(first.start(**one), second.start(**other))
    assert got == (alone(oscillator, **one), alone(oscillator, **other))


def test_a_failing_instance_does_not_disturb_its_neighbour(oscillator: Unpacked) -> None:
    with Instance(oscillator, "good") as good, Instance(oscillator, "bad") as bad:
        good.start(**LIVELY)
        bad.start(eta_plus=-1.0)
        rows = []
        for k, end in enumerate(TIMES[:10]):
            assert bad.step(0.0, 1e-5) == DISCARD
            begin = TIMES[k - 1] if k else 0.0
            assert good.step(begin, end - begin) == OK
            rows.append(good.get("q1_hybrid", "q2", "D12"))
        assert good.messages == []
    assert rows == alone(oscillator, **LIVELY)


def test_two_fmus_of_the_project_do_not_disturb_each_other(
    oscillator: Unpacked, other_oscillator: Unpacked
) -> None:
    with Instance(oscillator) as first, Instance(other_oscillator) as second:
        assert second.get("theta") == [0.75]
        got = interleaved(first.start(), second.start())
    assert got == (alone(oscillator), alone(other_oscillator))


@pytest.fixture(scope="module")
def other_oscillator(tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    """The FMU built with another start value."""
    folder = tmp_path_factory.mktemp("other")
    return unpack(
        build_fmu.build("CoupledOscillator", folder, {"theta": 0.75}), folder / "unpacked"
    )


def test_two_processes_at_once_do_not_disturb_each_other(oscillator: Unpacked) -> None:
    runs = [dict(LIVELY), OTHER]
    processes = [
        subprocess.Popen(
            [sys.executable, str(HOSTS / "run_alone.py"), str(oscillator.folder)]
            + [f"{name}={value!r}" for name, value in values.items()],
            stdout=subprocess.PIPE,
            text=True,
        )
        for values in runs
    ]
    outputs = [process.communicate(timeout=MOST_S)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    got = [[[float.fromhex(x) for x in row.split()] for row in o.splitlines()] for o in outputs]
    assert got == [alone(oscillator, **values) for values in runs]


# --- the end -------------------------------------------------------------------------------------


def test_no_freed_memory_is_touched_when_the_process_exits(
    oscillator: Unpacked, compiled: Callable[..., Path]
) -> None:
    """The binary of pythonfmu 0.7 does so by itself, and one process in some hundred aborts."""
    fence = compiled("fence", "-shared", "-fPIC")
    done = subprocess.run(
        [sys.executable, str(HOSTS / "run_alone.py"), str(oscillator.folder)],
        capture_output=True,
        text=True,
        timeout=MOST_S,
        env={**os.environ, "LD_PRELOAD": str(fence)},
    )
    assert len(done.stdout.splitlines()) == 10
    assert done.returncode == 0
