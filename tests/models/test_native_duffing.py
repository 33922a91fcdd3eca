"""The native twin of the Duffing oscillator: the Python FMU's numbers and words."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import build_fmu
from tests.models.test_native import Run, same
from tests.support.c_hosts import Pythonless
from tests.support.duffing_scenes import ORBIT, RK4, SCENES
from tests.support.fmus import DISCARD, LIVELY, OK, Instance, Unpacked, unpack
from tests.support.twins import checked_binary, twin_of

REFUSED: Mapping[str, Mapping[str, Any]] = {
    "too strong": {"A1": 1e5},
    "branch of two tones": ORBIT | {"branch": 1},
    "branch at rest": {"branch": 1},
    "no such branch": {"branch": 4},
    "no such solver": {"solver": 0},
    "no tolerance": {"tolerance": 0.5},
    "no number": {"alpha1": float("inf")},
    "overdamped": {"d1": 2e7},
    "beyond the frame": {"u1": 1e5, "u2": 1e5},
    "tones apart": {"u1": 5.0e6, "u2": 1.4e7},
    "third harmonic": {"eta_minus": 2.08e7},
    "input": {"b": 1.0},
    "input on an orbit": RK4 | ORBIT | {"b": 1.0},
    "growth": {"d1": -1e4, "d2": -1e4},
    "undamped orbit": ORBIT | {"d1": 0.0},
}


@pytest.fixture(scope="module")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    fmu = twin_of("DuffingOscillator", tmp_path_factory)
    return unpack(fmu, tmp_path_factory.mktemp("twin"))


@pytest.fixture(scope="module")
def pair(
    twin: Unpacked, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Instance, Instance]]:
    """An instance of the Python FMU and one of its twin."""
    folder = tmp_path_factory.mktemp("python")
    python = unpack(build_fmu.build("DuffingOscillator", folder), folder / "unpacked")
    with Instance(python) as slow, Instance(twin) as quick:
        yield slow, quick


def run(fmu: Instance, start: Mapping[str, Any], change: Mapping[str, Any]) -> Run:
    """Every status, every output and every message of a run with a change in its middle."""
    fmu.slave.reset()
    fmu.messages.clear()
    fmu.start(**start)
    # 20 ms, several decay times; or some periods, as rk4 takes its time in Python
    step, now, statuses, rows = 3.3e-3 if start.get("solver") != 2 else 1e-6, 0.0, [], []
    for k in range(6):
        fmu.set(**(change if k == 3 else {}))
        statuses.append(fmu.step(now, step))
        now += step
        rows.append(fmu.outputs())
    return statuses, rows, list(fmu.messages)


@pytest.mark.parametrize("scene", SCENES)
def test_every_scene_is_that_of_the_python_fmu(pair: tuple[Instance, Instance], scene: str) -> None:
    python, native = (run(fmu, *SCENES[scene]) for fmu in pair)
    assert same(python, native) <= 1e-12
    assert set(python[0]) == {OK}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_are_those_of_the_python_fmu(pair: tuple[Instance, Instance], case: str) -> None:
    python, native = (run(fmu, REFUSED[case], {}) for fmu in pair)
    assert same(python, native) == 0.0
    assert python[2] != []
    assert pair[0].status_message() == pair[1].status_message()


@pytest.mark.nightly
def test_nothing_is_touched_that_is_not_its_own(
    twin: Unpacked, compiled: Callable[..., Path], tmp_path: Path
) -> None:
    """Every scene and refusal, a state kept and taken back, under the compiler's checks."""
    checks = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    binary = checked_binary(tmp_path, twin.path, *checks)
    host = Pythonless(compiled("replay", *checks), twin, binary)
    outputs = twin.names("output")
    script = ["new 0 a"]
    for start, change in (*SCENES.values(), *((values, {}) for values in REFUSED.values())):
        known = {k: v for k, v in (dict(LIVELY) | dict(start)).items() if k in twin.references}
        values = known if start.get("solver") == 2 else dict(start)
        script += [
            "reset 0",
            *host.start(0, **values),
            "step 0 0 1e-4",
            "save 0",
            *host.set(0, change),
            "step 0 1e-4 1e-4",
            *host.get(*outputs),
            "restore 0",
            "step 0 1e-4 1e-4",
            *host.get(*outputs),
            "drop 0",
        ]
    transcript = host.play([*script, "free 0"])
    assert {status for status, _ in transcript.of("step")} == {OK, DISCARD}
