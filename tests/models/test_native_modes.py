"""The native twin of N coupled modes: the Python FMU's numbers and words, pump included."""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

import build_fmu
from fmu_src import coupled_modes, native_binary
from tests.models.test_modes_pump import pumped
from tests.models.test_native import Run, same
from tests.support.c_hosts import Pythonless
from tests.support.fmus import DISCARD, OK, Instance, Unpacked, unpack
from tests.support.modes_scenes import PUMP, THREE, Scene, scenes
from tests.support.processes import MOST_S
from tests.support.twins import STRICT, checked_binary, need_compiler, twin_of

ENVELOPE, RK4 = 1, 2
Pair = tuple[Instance, Instance]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("modes")


@pytest.fixture(scope="module")
def twins(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], Unpacked]:
    """The twin of as many modes as asked for."""
    made: dict[int, Unpacked] = {}

    def twin(n: int) -> Unpacked:
        if n not in made:
            fmu = twin_of(f"CoupledModes{n}", tmp_path_factory)
            made[n] = unpack(fmu, tmp_path_factory.mktemp(f"twin{n}"))
        return made[n]

    return twin


@pytest.fixture(scope="module")
def pairs(twins: Callable[[int], Unpacked], folder: Path) -> Iterator[Callable[[int], Pair]]:
    """An instance of the Python FMU and one of its twin, of as many modes as asked for."""
    made: dict[int, Pair] = {}

    def pair(n: int) -> Pair:
        if n not in made:
            python = unpack(build_fmu.build(f"CoupledModes{n}", folder), folder / f"unpacked{n}")
            made[n] = Instance(python), Instance(twins(n))
        return made[n]

    yield pair
    for one in made.values():
        for fmu in one:
            fmu.slave.freeInstance()


def run(fmu: Instance, start: Scene, times: list[float], changes: Mapping[int, Scene]) -> Run:
    """Every status, every output and every message of a run with changes before its steps."""
    fmu.slave.reset()
    fmu.messages.clear()
    fmu.start(**start)
    now, statuses, rows = 0.0, [], [fmu.outputs()]
    for k, time in enumerate(times):
        fmu.set(**changes.get(k, {}))
        statuses.append(fmu.step(now, time - now))
        now += time - now
        rows.append(fmu.outputs())
    return statuses, rows, list(fmu.messages)


def course(scene: Scene, settings: Scene) -> tuple[list[float], dict[int, Scene]]:
    """When a run communicates, and what is changed on the way: a tone, modes, the input."""
    period = 1.0 / scene["f1"]
    cycles = (0.3, 0.6, 1.0, 1.3, 2.0) if settings.get("solver") == RK4 else (0.3, 9, 40, 41.3, 2e3)
    changes: dict[int, Scene] = {2: {"u1": 1.01 * scene["u1"]}, 3: {"d1": 1.5 * scene["d1"]}}
    if settings.get("solver") != ENVELOPE:
        changes[4] = {"b": 1.0}
    return [x * period for x in cycles], changes


SETTINGS: list[Scene] = [{}, {"solver": ENVELOPE}, {"periodic_start": True}, {"solver": RK4}]
SETTINGS += [{"periodic_start": True, "tolerance": 1e-6}, {"solver": ENVELOPE, "tolerance": 1e-11}]
NAMES = ["exact", "envelope", "on orbit", "rk4", "on orbit to 1e-6", "envelope to 1e-11"]


@pytest.mark.parametrize("settings", SETTINGS, ids=NAMES)
def test_every_scene_is_that_of_the_python_fmu(
    pairs: Callable[[int], Pair], settings: Scene
) -> None:
    """Of all outputs; kHz to GHz, Q from 10 to 1e8, degenerate, uncoupled, with a pump and without.

    Of long chains there are few, as Python takes its time for these.
    """
    cases = [*scenes(3, 5, seed=3), pumped(3, 0, seed=23), THREE | PUMP]
    cases += [] if settings else [pumped(3, 1, seed=23)]
    for scene in cases:
        python, native = (run(fmu, scene | settings, *course(scene, settings)) for fmu in pairs(3))
        assert same(python, native) <= 1e-12, scene
        assert set(python[0]) == {OK}, python[2]


REFUSED: Mapping[str, Scene] = {
    "no frequency": {"f2": 0.0},
    "no number": {"d1": math.nan},
    "no number, of a pair": {"depth_lambda23": math.inf},
    "no number, single": {"pump_phase": -math.inf},
    "no number, input": {"b": math.nan},
    "negative coupling": {"lambda13": -1.0},
    "negative drive": {"u2": -5.0},
    "too strong a coupling": {"lambda12": 1.2},
    "undamped orbit": {"d3": 0.0, "periodic_start": True},
    "undamped resonance": {"lambda12": 0.0, "lambda13": 0.0, "d1": 0.0, "u1": 1.0, "depth_f1": 0.0},
    "undamped, pumped": {"d2": 0.0} | PUMP,
    "growth": {"d1": -1.0},
    "input in a frame": {"solver": ENVELOPE, "b": 1.0},
    "no frame": {"solver": ENVELOPE, "u1": 0.0, "u2": 0.0},
    "no such solver": {"solver": 7},
    "no time": {"rk4_substep": -1e-20},
    "no such tolerance": {"tolerance": 0.0},
    "no tolerance": {"tolerance": math.nan},
    "too long a substep": {"solver": RK4, "rk4_substep": 1.0},
    "no pump": {"depth_f1": 0.1, "pump_hz": 0.0},
    "unstable": {"depth_f1": 0.9, "pump_hz": 2.0},
    "too slow and too deep": {"depth_f1": 0.9, "pump_hz": 1e-3},
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_are_those_of_the_python_fmu(pairs: Callable[[int], Pair], case: str) -> None:
    """The same sentences and statuses, at the start and where a parameter is changed to it."""
    words = []
    for values in ({}, REFUSED[case]):
        later = {} if values else {2: {k: v for k, v in REFUSED[case].items() if k not in FIXED}}
        python, native = (
            run(fmu, THREE | values, [0.1, 0.5, 2.0, 400.0], later) for fmu in pairs(3)
        )
        assert same(python, native) <= 1e-12
        assert pairs(3)[0].status_message() == pairs(3)[1].status_message()
        words += python[2]
    assert words != []


def test_a_chain_that_is_too_long_is_refused_alike(pairs: Callable[[int], Pair]) -> None:
    long = {"u1": 1.3, "A2": 0.0, "lambda12": 0.0, "lambda13": 0.0, "d1": 0.07}
    long |= {"pump_hz": 1.0 / 20000.0, "depth_f1": 0.4}
    python, native = (run(fmu, THREE | long, [0.1], {}) for fmu in pairs(3))
    assert same(python, native) <= 1e-12
    assert "1500 sidebands" in python[2][0][1]


def test_one_mode_without_pairs_compiles_without_a_warning(tmp_path: Path) -> None:
    """Its lists of couplings are empty."""
    model = coupled_modes._model(1)
    for name, text in native_binary.written(model, "coupled_modes", {}).items():
        (tmp_path / name).write_text(text)
    folder = build_fmu.SOURCE / native_binary.FOLDER
    need_compiler()
    [tool] = native_binary.toolchains(())
    sources = [str(path) for path in folder.glob("*modes*.c")]
    places = [f"-I{folder}", f"-I{tmp_path}", f"-I{native_binary.headers()}"]
    command = [*tool.command, "-std=c11", *STRICT, "-fsyntax-only", *places, *sources]
    subprocess.run(command, check=True, timeout=MOST_S)


FIXED = {"solver", "rk4_substep", "periodic_start", "tolerance"}


def test_the_description_is_that_of_the_python_fmu(
    pairs: Callable[[int], Pair], twins: Callable[[int], Unpacked], folder: Path
) -> None:
    pairs(3)
    ours, theirs = (
        twins(3).description,
        unpack(folder / "CoupledModes3.fmu", folder / "again").description,
    )
    known = [
        [(v.name, v.valueReference, v.start, v.causality, v.unit) for v in d.modelVariables]
        for d in (ours, theirs)
    ]
    assert known[0] == known[1]
    assert not ours.coSimulation.needsExecutionTool


@pytest.mark.parametrize("values", [{}, PUMP], ids=["unpumped", "pumped"])
@pytest.mark.parametrize("solver", [0, ENVELOPE, RK4])
def test_a_state_goes_on_bit_for_bit_in_another_instance(
    twins: Callable[[int], Unpacked], solver: int, values: Scene
) -> None:
    """Even in one that was made ready for other parameters meanwhile."""

    def tail(fmu: Instance) -> list[list[float]]:
        fmu.set(d2=0.11, **({} if solver == ENVELOPE else {"b": 0.3}))
        return [[fmu.step(t, 0.7), *fmu.outputs().values()] for t in (0.7, 1.4, 2.1)]

    with Instance(twins(3), "one") as one, Instance(twins(3), "other") as other:
        one.start(**THREE | values, solver=solver).step(0.0, 0.7)
        state = one.slave.getFMUState()
        kept = one.slave.serializeFMUstate(state)
        rows = tail(one)
        one.slave.setFMUState(state)
        assert tail(one) == rows
        other.start(**THREE | PUMP | {"f1": 1.1}).step(0.0, 0.3)
        taken = other.slave.deSerializeFMUstate(kept)
        other.slave.setFMUState(taken)
        assert tail(other) == rows
        one.slave.freeFMUState(state)
        other.slave.freeFMUState(taken)


def test_what_has_decayed_for_decades_is_the_steady_state(pairs: Callable[[int], Pair]) -> None:
    """exp(-1e11) lies outside the exponents of many a format."""
    steady = []
    for fmu in pairs(3):
        fmu.slave.reset()
        fmu.start(**THREE, periodic_start=True)
        steady.append([fmu.step(0.0, 1e12), *fmu.get("q1", "q3")])
        fmu.slave.reset()
        fmu.start(**THREE)
        assert [fmu.step(0.0, 1e12), *fmu.get("q1", "q3")] == pytest.approx(steady[-1], rel=1e-12)
    assert steady[1] == pytest.approx(steady[0], rel=1e-12)


def test_nothing_is_touched_that_is_not_its_own(
    twins: Callable[[int], Unpacked], compiled: Callable[..., Path], tmp_path: Path
) -> None:
    """Solvers, refusals, states and changes under the compiler's checks, without a Python."""
    checks = "-fsanitize=address,undefined", "-fno-sanitize-recover=all"
    binary = checked_binary(tmp_path, twins(3).path, *checks)
    host = Pythonless(compiled("replay", *checks), twins(3), binary)
    outputs = twins(3).names("output")
    script = ["new 0 a", "new 1 b"]
    starts = [THREE | s | pump for s in SETTINGS for pump in ({}, PUMP)]
    for start in (*starts, *(THREE | values for values in REFUSED.values())):
        script += [
            "reset 0",
            *host.start(0, **start),
            "step 0 0 0.1",
            "save 0",
            *host.set(0, {"d1": 0.07, "u1": 1.1}),
            "step 0 0.1 0.5",
            *host.get(*outputs),
            "restore 0",
            "step 0 0.1 40",
            *host.get(*outputs),
            "drop 0",
        ]
    transcript = host.play([*script, "free 0", "free 1"])
    assert {status for status, _ in transcript.of("step")} == {OK, DISCARD}
    statuses = [status for status, _ in transcript.of("step")]
    assert statuses[: 3 * len(starts)] == [OK] * (3 * len(starts))
