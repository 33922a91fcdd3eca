"""The native twin of the oscillator: the Python FMU's numbers and words, without a Python."""

from __future__ import annotations

import ctypes
import math
import struct
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, fromstring

import pytest

import build_fmu
from fmu_src import native_binary
from fmu_src.start_values import BuildError
from tests.support.fmus import (
    DISCARD,
    ERROR,
    LIVELY,
    OK,
    REFUSALS,
    TIMES,
    Instance,
    Unpacked,
    unpack,
)
from tests.support.native_runs import scales
from tests.support.oscillator_runs import GRID, communication_points, relative_errors, simulate
from tests.support.processes import MOST_S
from tests.support.scenes import Scene
from tests.support.twins import need_compiler

MODEL_EXCHANGE = 0


@pytest.fixture(scope="module")
def twin(twin_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Unpacked:
    return unpack(twin_fmu, tmp_path_factory.mktemp("twin"))


@pytest.fixture(scope="module")
def pair(oscillator: Unpacked, twin: Unpacked) -> Iterator[tuple[Instance, Instance]]:
    """An instance of the Python FMU and one of its twin."""
    with Instance(oscillator) as python, Instance(twin) as native:
        yield python, native


# --- the same numbers ----------------------------------------------------------------------------

Run = tuple[list[int], list[dict[str, float]], list[tuple[int, str]]]


def run(fmu: Instance, scene: Scene, times: list[float], settings: Mapping[str, Any]) -> Run:
    """Every status, every output and every message of a run."""
    fmu.slave.reset()
    fmu.messages.clear()
    fmu.start(**scene.parameters, **settings)
    now, statuses, rows = 0.0, [], []
    for k, time in enumerate(times):
        if scene.inputs:
            fmu.set(b=scene.inputs[k])
        statuses.append(fmu.step(now, time - now))
        now += time - now
        rows.append(fmu.outputs())
    return statuses, rows, list(fmu.messages)


def same(python: Run, native: Run) -> float:
    """The largest difference of two runs over the size of what differs; words must be equal."""
    assert native[0] == python[0]
    assert native[2] == python[2]
    size, apart = scales(python[1]), 0.0
    for ours, theirs in zip(native[1], python[1], strict=True):
        for name, value in theirs.items():
            if math.isnan(value) or math.isnan(ours[name]):
                assert math.isnan(value) == math.isnan(ours[name]), name
            else:
                apart = max(apart, abs(ours[name] - value) / size[name])
    return apart


@pytest.mark.parametrize(
    "settings",
    [{}, {"solver": 1}, {"other_mode": 1}, {"other_mode": 2}],
    ids=["exact", "envelope", "quasi-static", "left-out"],
)
def test_every_scene_is_that_of_the_python_fmu(
    pair: tuple[Instance, Instance], settings: Mapping[str, Any]
) -> None:
    """Of all outputs, in all scenes of the grid, extremes included."""
    for scene in GRID:
        times = communication_points(scene)
        runs = [run(fmu, scene, times, settings) for fmu in pair]
        assert same(*runs) <= 1e-12, scene


def test_runge_kutta_is_that_of_the_python_fmu(pair: tuple[Instance, Instance]) -> None:
    """Thirty periods of some scenes, as Python takes its time for these."""
    for scene in GRID[::15]:
        points = communication_points(scene)
        fastest = max(scene.eta_plus, scene.eta_minus, scene.u1, scene.u2)
        times = [10.0 / fastest * t / points[-1] for t in points]
        runs = [run(fmu, scene, times, {"solver": 2}) for fmu in pair]
        assert same(*runs) <= 1e-12, scene


def test_some_scenes_at_fifty_digits(pair: tuple[Instance, Instance]) -> None:
    for scene in GRID[::30]:
        times = communication_points(scene)
        assert max(relative_errors(scene, simulate(pair[1], scene, times), times)) <= 1e-9, scene


@pytest.mark.parametrize("settings", [{}, {"solver": 1}, {"other_mode": 1}, {"solver": 2}], ids=str)
def test_changes_between_steps_are_those_of_the_python_fmu(
    pair: tuple[Instance, Instance], settings: Mapping[str, Any]
) -> None:
    """Parameters, drive frequencies and the input are changed on the way."""
    changes: list[dict[str, Any]] = [{"u1": 1.02e5}, {"theta": 0.3, "d1": 2e3}, {"A2": 0.0}]
    changes += [{"eta_minus": 1.1e5, "g2": -1.0}] + ([] if "solver" in settings else [{"b": 1e9}])
    rows = []
    for fmu in pair:
        fmu.slave.reset()
        fmu.start(**LIVELY, **settings)
        found, now = [], 0.0
        for k, time in enumerate(TIMES):
            fmu.set(**(changes[k // 3] if k % 3 == 0 and k // 3 < len(changes) else {}))
            assert fmu.step(now, time - now) == OK, fmu.messages
            now = time
            found.append(fmu.outputs())
        rows.append(([OK], found, list(fmu.messages)))
    assert same(rows[0], rows[1]) <= 1e-12


# --- the same words ------------------------------------------------------------------------------

MISUSE: Mapping[str, Callable[[Instance], Any]] = {
    "before initialisation": lambda fmu: fmu.step(0.0, 1e-5),
    "an output set": lambda fmu: fmu.set(q1=1.0),
    "another type": lambda fmu: fmu.slave.setReal([15], [1.0]),
    "no such variable": lambda fmu: fmu.slave.getReal([0, 9999]),
    "a wrong integer": lambda fmu: fmu.slave.getInteger([0]),
    "a wrong string": lambda fmu: fmu.slave.getString([0]),
    "fixed": lambda fmu: fmu.start().set(solver=2),
    "fixed, a truth value": lambda fmu: fmu.start().set(periodic_start=True),
    "fixed, a number": lambda fmu: fmu.start().set(rk4_substep=1.5e-9),
    "not where it ended": lambda fmu: fmu.start().step(5e-5, 1e-5),
    "backwards": lambda fmu: fmu.start().step(0.0, -1e-5),
    "no end": lambda fmu: fmu.start().step(0.0, math.inf),
    "no start": lambda fmu: fmu.start(math.nan),
    "never begun": lambda fmu: fmu.slave.exitInitializationMode(),
    "refused earlier": lambda fmu: fmu.slave.setReal([15], [1.0]) or fmu.start().status_message(),
    "no number": lambda fmu: fmu.start().set(b=math.nan),
    "no such solver": lambda fmu: fmu.start(solver=7),
    "no such mode": lambda fmu: fmu.start(other_mode=-3),
    "no time": lambda fmu: fmu.start(rk4_substep=-1e-20),
    "too long a substep": lambda fmu: fmu.start(solver=2, rk4_substep=1e-6).step(0.0, 1e-2),
    "overdamped": lambda fmu: fmu.start(d1=2e7),
    "overdamped alone": lambda fmu: fmu.start(d1=2e7, d2=3e7, other_mode=1),
    "input in a frame": lambda fmu: fmu.start(solver=1, b=0.1),
    "no frame": lambda fmu: fmu.start(solver=1, u1=0.0, u2=0.0),
    "growing": lambda fmu: fmu.start(d1=-1e5, d2=-1e5).step(0.0, 1.0),
    "no lambda": lambda fmu: fmu.start(theta=0.3).outputs(),
}


#: What is said without a failure.
SAID_ALONE = ("no lambda",)


@pytest.mark.parametrize("case", [*MISUSE, *(r.label for r in REFUSALS)])
def test_refusals_are_those_of_the_python_fmu(pair: tuple[Instance, Instance], case: str) -> None:
    """The same sentences to the logger and in status_message, the same statuses, the same NaN."""
    refused = {r.label: r.values for r in REFUSALS}
    said = []
    for fmu in pair:
        fmu.slave.reset()
        fmu.messages.clear()
        answer = MISUSE[case](fmu) if case in MISUSE else fmu.start(**refused[case])
        status = fmu.step(0.0, 1e-5)
        found = [str(x) for x in fmu.outputs().values()] if status != OK else []
        kept = answer if isinstance(answer, int | list) else None
        said.append((str(kept), status, found, fmu.status_message(), fmu.messages[:]))
    assert said[1] == said[0]
    assert said[1][4] != []  # something was said
    if case not in SAID_ALONE:
        assert said[1][1] == DISCARD


def test_numbers_in_sentences_are_written_as_python_writes_them(twin: Unpacked) -> None:
    with Instance(twin) as fmu:
        for value in (
            -1e-5,
            -1.5e16,
            -0.1,
            -123456789.125,
            -1e22,
            -5e-324,
            -1.7976931348623157e308,
        ):
            fmu.slave.reset()
            fmu.start(eta_plus=value)
            assert f"eta_plus = {value!r} Hz" in fmu.status_message()


def test_model_exchange_is_refused_with_a_reason(twin: Unpacked) -> None:
    with Instance(twin) as fmu:
        words = twin.description.guid.encode(), b"", ctypes.byref(fmu.slave.callbacks), False, False
        assert fmu.slave.fmi2Instantiate(b"x", MODEL_EXCHANGE, *words) is None
        [(status, said)] = fmu.messages
        assert status == ERROR
        assert "co-simulation" in said


# --- the same description, the same bytes --------------------------------------------------------


def description(fmu: Path) -> Element:
    with zipfile.ZipFile(fmu) as archive:
        return fromstring(archive.read("modelDescription.xml"))


def test_the_description_is_that_of_the_python_fmu(twin_fmu: Path, oscillator_fmu: Path) -> None:
    """But for what a binary of its own changes."""
    native, python = description(twin_fmu), description(oscillator_fmu)
    assert native.find("CoSimulation").get("needsExecutionTool") == "false"  # type: ignore[union-attr]
    for root in (native, python):
        for name in ("guid", "generationTool"):
            root.attrib.pop(name)
        for name in ("needsExecutionTool", "providesDirectionalDerivative"):
            root.find("CoSimulation").attrib.pop(name, None)  # type: ignore[union-attr]
    assert [(e.tag, e.attrib) for e in native.iter()] == [(e.tag, e.attrib) for e in python.iter()]


def test_the_same_sources_give_the_same_bytes(twin_fmu: Path, tmp_path: Path) -> None:
    """In another process and another folder, from the FMU itself."""
    command = [sys.executable, build_fmu.__file__, "--like", str(twin_fmu), "--out", "here"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=MOST_S)
    assert (done.returncode, done.stderr) == (0, "")
    built = tmp_path / "here" / "CoupledOscillator.fmu"
    assert built.read_bytes() == twin_fmu.read_bytes()


def test_another_name_and_start_value_give_another_fmu(
    twin_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = tuple("-O0" if word == "-O2" else word for word in native_binary.COMPILE)
    monkeypatch.setattr(native_binary, "COMPILE", quick)  # nothing here is computed by it
    words = ["--like", str(twin_fmu), "--out", str(tmp_path), "--set", "theta=0.75"]
    assert build_fmu.main([*words, "--name", "Sensor", "--history", "Fitted."]) == 0
    other = tmp_path / "Sensor.fmu"
    assert build_fmu.built_from(other) == ("CoupledOscillator", {"theta": 0.75}, [], 2)
    assert description(other).get("guid") != description(twin_fmu).get("guid")
    assert description(other).get("modelName") == "Sensor"
    with Instance(unpack(other, tmp_path / "unpacked")) as fmu:
        assert fmu.start().get("theta") == [0.75]


def test_what_cannot_be_compiled_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--native", "--out", str(tmp_path), "--model"]
    assert build_fmu.main([*words, "CoupledOscillator", "--platforms", "amiga"]) == 2
    assert "'amiga': there are linux64" in capsys.readouterr().err
    assert build_fmu.main(["--platforms", "win64"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "--platforms: " in said
    assert "--native" in said
    monkeypatch.setenv("PATH", str(tmp_path))
    assert build_fmu.main([*words, "CoupledOscillator"]) == 2
    assert "C compiler 'cc'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_compilers_complaint_is_passed_on(tmp_path: Path) -> None:
    need_compiler()
    [tool] = native_binary.toolchains(())
    with pytest.raises(BuildError, match=r"C compiler .*error: "):
        native_binary.compiled(tmp_path, [], {"broken.c": "int main(void) { return x; }\n"}, tool)


# --- state, and many at once ---------------------------------------------------------------------


def test_a_state_goes_on_bit_for_bit_in_another_instance(twin: Unpacked) -> None:
    def tail(fmu: Instance) -> list[list[float]]:
        fmu.set(theta=2.2, b=1e9)
        return [[fmu.step(t, 1e-5), *fmu.outputs().values()] for t in (1e-5, 2e-5, 3e-5)]

    with Instance(twin, "one") as one, Instance(twin, "other") as other:
        one.start(**LIVELY).step(0.0, 1e-5)
        state = one.slave.getFMUState()
        kept = one.slave.serializeFMUState(state)
        rows = tail(one)
        one.slave.freeFMUState(state)
        taken = other.slave.deSerializeFMUstate(kept)
        other.slave.setFMUState(taken)
        assert tail(other) == rows
        other.slave.freeFMUState(taken)
        for wrong in (kept[:-1], kept[:-1] + b"!", b"(" + kept[1:], b""):
            with pytest.raises(Exception, match="fmi2DeSerializeFMUstate"):
                other.slave.deSerializeFMUstate(wrong)
        assert {status for status, _ in other.messages} == {ERROR}


def test_threads_do_not_disturb_each_other(twin: Unpacked) -> None:
    """Instances in threads of one process, at once, have the bits of runs one by one."""
    scenes = [dict(LIVELY) | {"theta": 0.3 * k, "solver": k % 3} for k in range(6)]

    def steps(values: Mapping[str, Any]) -> list[list[float]]:
        with Instance(twin) as fmu:
            return fmu.start(**values).run(TIMES, "q1_hybrid", "q2", "q1_hybrid_X_u1")

    alone = [steps(values) for values in scenes]
    found: dict[int, list[list[float]]] = {}
    together = [
        threading.Thread(target=lambda k=k: found.update({k: steps(scenes[k])}))
        for k in range(len(scenes))
    ]
    for thread in together:
        thread.start()
    for thread in together:
        thread.join()
    assert [found[k] for k in range(len(scenes))] == alone


# --- other platforms -----------------------------------------------------------------------------


def test_a_macs_binary_of_two_processors_names_both() -> None:
    """Apple's fat header: big-endian, each part at a multiple of its alignment."""
    parts = [
        struct.pack("<III", 0xFEEDFACF, kind, 3) + b"x" * 40 for kind in (0x1000007, 0x100000C)
    ]
    made = native_binary._universal(parts)
    mark, count = struct.unpack_from(">II", made)
    assert (mark, count) == (0xCAFEBABE, 2)
    for k, part in enumerate(parts):
        kind, _, place, size, power = struct.unpack_from(">IIIII", made, 8 + 20 * k)
        assert place % 2**power == 0
        assert made[place : place + size] == part
        assert kind == struct.unpack_from("<I", part, 4)[0]


def test_other_platforms_export_what_a_host_calls(tmp_path: Path) -> None:
    """What cannot be run here: the kind of each file, its processor, the names that it exports."""
    pytest.importorskip("ziglang", reason="compiles for other platforms")
    platforms = ("aarch64-linux", "darwin64", "win64")
    fmu = build_fmu.build("CoupledOscillator", tmp_path, native=platforms)
    with zipfile.ZipFile(fmu) as archive:
        held = {
            name.split("/")[1]: archive.read(name)
            for name in archive.namelist()
            if name.startswith("binaries/")
        }
    assert sorted(held) == sorted(platforms)
    elf, mac, windows = (held[name] for name in platforms)
    assert (elf[:4], struct.unpack_from("<H", elf, 18)) == (b"\x7fELF", (183,))  # AArch64
    assert struct.unpack_from(">II", mac) == (0xCAFEBABE, 2)
    [header] = struct.unpack_from("<I", windows, 60)
    assert windows[header : header + 6] == b"PE\0\0\x64\x86"  # x86-64
    for name in ("fmi2Instantiate", "fmi2DoStep", "fmi2GetReal", "fmi2SerializeFMUstate"):
        assert f"\0{name}\0".encode() in elf
        assert f"\0{name}\0".encode() in windows
        assert mac.count(f"_{name}\0".encode()) >= 2  # one for each processor
    assert not any(b"Py_Initialize" in binary for binary in held.values())
