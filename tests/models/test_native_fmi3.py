"""The native twin of FMI 3.0: the same core, so the same bits as that of FMI 2.0."""

from __future__ import annotations

import ctypes
import math
import subprocess
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self
from xml.etree import ElementTree

import fmpy
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import (
    FMU3Slave,
    fmi3ClockUpdateCallback,
    fmi3LockPreemptionCallback,
    fmi3UnlockPreemptionCallback,
)
from fmpy.validation import validate_fmu

import build_fmu
from fitting.fmu.accuracy import read_accuracy_annotation
from fitting.fmu.description import read_description
from fmu_src import native_binary
from fmu_src.coupled_oscillator import CoupledOscillator
from fmu_src.start_values import BuildError
from tests.support.fmus import DISCARD, ERROR, LIVELY, OK, REFUSALS, Instance, unpack
from tests.support.processes import MOST_S
from tests.support.twins import STRICT, twin_of

RK4 = 2


class Instance3:
    """One instance of an FMU of FMI 3.0, by the calls of ``Instance``; statuses are kept."""

    def __init__(self, folder: Path) -> None:
        self.messages: list[tuple[int, str]] = []
        self._description = fmpy.read_model_description(str(folder))
        self.variables = {v.name: v for v in self._description.modelVariables}
        self.slave = FMU3Slave(
            guid=self._description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=self._description.coSimulation.modelIdentifier,
            instanceName="instance",
        )
        self.slave.instantiate(loggingOn=True, logMessage=self._log)

    def _log(self, _environment: Any, status: int, _category: Any, text: bytes) -> None:
        self.messages.append((status, text.decode()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.slave.freeInstance()

    def status(self, name: str, *arguments: Any) -> int:
        """Make a call and return its status."""
        try:
            getattr(self.slave, name)(*arguments)
        except FMICallException as error:
            return int(error.status)
        return OK

    def set(self, **values: Any) -> list[int]:
        return [
            self.status(
                f"set{self.variables[name].type}", [self.variables[name].valueReference], [x]
            )
            for name, x in values.items()
        ]

    def start(self, **values: Any) -> list[int]:
        """Reset, set start values and initialise; every status."""
        self.slave.reset()
        self.messages.clear()
        statuses = self.set(**values)
        statuses.append(self.status("enterInitializationMode"))
        return [*statuses, self.status("exitInitializationMode")]

    def get(self, *names: str) -> list[float]:
        return list(self.slave.getFloat64([self.variables[name].valueReference for name in names]))


@pytest.fixture(scope="module")
def fmi3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return twin_of("CoupledOscillator", tmp_path_factory, fmi=3)


@pytest.fixture(scope="module")
def folder(fmi3: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fmi3")
    fmpy.extract(str(fmi3), unzipdir=str(folder))
    return folder


@pytest.fixture(scope="module")
def new(folder: Path) -> Iterator[Instance3]:
    with Instance3(folder) as made:
        yield made


@pytest.fixture(scope="module")
def old(twin_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Instance]:
    with Instance(unpack(twin_fmu, tmp_path_factory.mktemp("fmi2"))) as made:
        yield made


def outputs(fmu: Instance3) -> list[str]:
    return [
        v.name for v in fmu.variables.values() if v.causality == "output" and v.type == "Float64"
    ]


TIMES = (1e-5, 2.5e-5, 3.1e-5, 9e-5)
RUNS: Sequence[Mapping[str, Any]] = [
    {},
    {"periodic_start": True},
    {"solver": 1},
    {"solver": RK4},
    {"other_mode": 1},
    {"reflection": True, "b": 1e9},
]


def test_runs_are_those_of_fmi_2_bit_for_bit(new: Instance3, old: Instance) -> None:
    names = outputs(new)
    assert names == list(old.outputs())
    for values in RUNS:
        assert set(new.start(**{**LIVELY, **values})) == {OK}
        old.slave.reset()
        old.start(**{**LIVELY, **values})
        for before, time in zip((0.0, *TIMES), TIMES, strict=False):
            if before == TIMES[1]:
                assert new.set(theta=2.2, d1=5e3) == [OK, OK]
                old.set(theta=2.2, d1=5e3)
            assert new.slave.doStep(before, time - before)[3] == before + (time - before)
            assert old.step(before, time - before) == OK
            assert new.get(*names) == list(old.outputs().values()), values
            assert new.get("time", "q1") == [before + (time - before), old.get("q1")[0]]


@pytest.mark.parametrize("case", REFUSALS, ids=lambda r: r.label)
def test_refusals_are_errors_with_the_same_words(new: Instance3, old: Instance, case: Any) -> None:
    statuses = new.start(**case.values)
    assert statuses[-1] == ERROR
    assert set(statuses[:-1]) == {OK}
    assert new.status("doStep", 0.0, 1e-5) == ERROR
    old.slave.reset()
    old.messages.clear()
    old.start(**case.values)
    assert new.messages == old.messages
    reference = new.variables["status_message"].valueReference
    assert new.slave.getString([reference]) == [old.status_message()]
    assert not any(x == x for x in new.get("q1", "q1_hybrid_X_u1"))


def test_misuse_is_an_error(new: Instance3) -> None:
    """Another type, an output, a value too few, a fixed parameter, an event mode."""
    reference = {name: v.valueReference for name, v in new.variables.items()}
    for name, arguments in {
        "getInt32": ([reference["theta"]],),
        "setFloat64": ([reference["q1"]], [1.0]),
        "setInt32": ([reference["solver"]], [1]),
        "getFloat64": ([reference["theta"]], 2),
        "setBoolean": ([reference["periodic_start"]], [True]),
        "setString": ([reference["status_message"]], ["no"]),
        "enterEventMode": (),
    }.items():
        assert set(new.start(**LIVELY)) == {OK}
        assert new.status(name, *arguments) == ERROR, name
    assert new.start(**LIVELY)[-1] == OK


def test_a_failure_before_initialisation_stays_one(new: Instance3) -> None:
    """Every further call says so, until a reset."""
    for failing in ([], [("setFloat64", [new.variables["solver"].valueReference], [1.0])]):
        new.slave.reset()
        for name, *arguments in failing:
            assert new.status(name, *arguments) == ERROR
            assert new.status("enterInitializationMode") == ERROR
        assert new.status("exitInitializationMode") == ERROR
        assert new.status("doStep", 0.0, 1e-5) == ERROR
    assert set(new.start(**LIVELY)) == {OK}


def test_a_state_that_cannot_be_is_an_error(new: Instance3) -> None:
    new.start(**LIVELY)
    assert new.set(theta=math.nan) == [OK]
    assert new.status("getFMUState") == ERROR
    assert "theta = nan" in new.messages[-1][1]


def test_an_output_may_be_set_to_the_text_that_it_has(new: Instance3) -> None:
    """As hosts do that set every start value."""
    reference = new.variables["status_message"].valueReference
    new.slave.reset()
    assert new.status("setString", [reference], [""]) == OK
    assert new.status("setString", [reference], ["no"]) == ERROR


def test_a_host_is_told_why_it_gets_no_instance(folder: Path) -> None:
    """Of model exchange, of scheduled execution, with events, with intermediate updates."""
    with Instance3(folder) as made:
        slave, messages = made.slave, made.messages
        first = b"x", slave.guid.encode(), b"", False, False
        last = None, slave.logMessage
        clocks = (
            fmi3ClockUpdateCallback(),
            fmi3LockPreemptionCallback(),
            fmi3UnlockPreemptionCallback(),
        )
        more = *last, slave.intermediateUpdate
        updated = (ctypes.c_uint * 1)(0)
        for found, said in (
            (slave.fmi3InstantiateModelExchange(*first, *last), "co-simulation alone"),
            (slave.fmi3InstantiateScheduledExecution(*first, *last, *clocks), "simulation alone"),
            (slave.fmi3InstantiateCoSimulation(*first, True, False, None, 0, *more), "event mode"),
            (
                slave.fmi3InstantiateCoSimulation(*first, False, False, updated, 1, *more),
                "no intermediate updates",
            ),
        ):
            assert found is None
            assert messages[0][0] == ERROR
            assert said in messages.pop(0)[1]
        assert messages == []


def test_a_state_goes_on_bit_for_bit_in_another_instance(folder: Path) -> None:
    def tail(fmu: Instance3) -> list[list[float]]:
        fmu.set(theta=2.2, b=1e9)
        return [
            [fmu.status("doStep", t, 1e-5), *fmu.get(*outputs(fmu))] for t in (1e-5, 2e-5, 3e-5)
        ]

    with Instance3(folder) as one, Instance3(folder) as other:
        one.start(**LIVELY)
        one.slave.doStep(0.0, 1e-5)
        state = one.slave.getFMUState()
        kept = one.slave.serializeFMUState(state)
        rows = tail(one)
        one.slave.setFMUState(state)
        assert tail(one) == rows
        one.slave.freeFMUState(state)
        taken = other.slave.deserializeFMUState(kept)
        other.slave.setFMUState(taken)
        assert tail(other) == rows
        other.slave.freeFMUState(taken)
        for wrong in (kept[:-1], kept[:-1] + b"!", b"(" + kept[1:]):
            assert other.status("deserializeFMUState", wrong) == ERROR


def test_directional_derivatives_are_those_of_fmi_2(new: Instance3, old: Instance) -> None:
    new.start(**LIVELY)
    new.slave.doStep(0.0, 7e-5)
    old.slave.reset()
    old.start(**LIVELY)
    old.step(0.0, 7e-5)
    wanted = [new.variables[name].valueReference for name in outputs(new)]
    along = [new.variables[name].valueReference for name in ("theta", "d1", "u2", "b")]
    seed = [0.1, 20.0, -3.0, 1e8]
    found = new.slave.getDirectionalDerivative(wanted, along, seed)
    assert found == old.slave.getDirectionalDerivative(wanted, along, seed)
    assert any(found)
    solver = new.variables["solver"].valueReference
    assert new.status("getDirectionalDerivative", wanted, [solver], [1.0]) == DISCARD
    assert new.status("doStep", 7e-5, 1e-5) == OK


def test_fmpy_finds_no_problem_and_runs_it(fmi3: Path) -> None:
    assert validate_fmu(str(fmi3)) == []
    found = fmpy.simulate_fmu(
        str(fmi3), stop_time=1e-6, output_interval=1e-7, start_values={"theta": 1.9}
    )
    assert len(found) == 11
    assert abs(found["q1"][-1]) > 0.0


def test_the_description_is_that_of_fmi_2(fmi3: Path, twin_fmu: Path) -> None:
    ours, theirs = (fmpy.read_model_description(str(path)) for path in (fmi3, twin_fmu))
    assert (ours.fmiVersion, theirs.fmiVersion) == ("3.0", "2.0")
    assert ours.guid != theirs.guid
    assert ours.modelVariables[-1].causality == "independent"
    facts = ["name", "valueReference", "causality", "variability", "initial", "description"]
    facts += ["unit", "min", "max", "nominal"]
    for x, y in zip(ours.modelVariables[:-1], theirs.modelVariables, strict=True):
        assert [getattr(x, name) for name in facts] == [getattr(y, name) for name in facts]
        assert x.start == y.start or x.type == "String"
    # fmpy 0.3 looks for FMI 2.0's name of this one
    with zipfile.ZipFile(fmi3) as archive:
        told = ElementTree.fromstring(archive.read("modelDescription.xml")).find("CoSimulation")
    assert told is not None
    assert told.get("providesDirectionalDerivatives") == "true"
    assert not ours.coSimulation.needsExecutionTool
    assert len(ours.outputs) == len(theirs.outputs)
    accuracy = [read_accuracy_annotation(read_description(path)) for path in (fmi3, twin_fmu)]
    assert accuracy[0] == accuracy[1]


def test_a_build_like_it_would_be_of_fmi_3(fmi3: Path) -> None:
    assert build_fmu.built_from(fmi3) == ("CoupledOscillator", {}, [], 3)


def test_every_function_of_fmi_3_is_there(folder: Path) -> None:
    """A host that links by name finds them all: the official header's list."""
    [binary] = (folder / "binaries").glob("*/CoupledOscillator.*")
    library = ctypes.CDLL(str(binary))
    header = (native_binary.headers() / "fmi3Functions.h").read_text()
    names = [line.split()[-1].strip(";") for line in header.splitlines() if "TYPE " in line]
    assert len(names) > 70
    assert [name for name in names if not hasattr(library, name)] == []


def test_the_interface_compiles_without_a_warning(fmi3: Path, tmp_path: Path) -> None:
    sources = native_binary.needed_sources(
        build_fmu.SOURCE / native_binary.FOLDER, "coupled_oscillator", 3
    )
    for name, text in native_binary.written(CoupledOscillator, "coupled_oscillator", {}).items():
        (tmp_path / name).write_text(text)
    for path in sources:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    [tool] = native_binary.toolchains(())
    words = [*tool.command, "-std=c11", *STRICT, "-fsyntax-only", "-I."]
    words += [f"-I{native_binary.headers()}", "fmi3.c", "fmi3_refused.c", "stored.c"]
    subprocess.run(words, cwd=tmp_path, check=True, timeout=MOST_S)


def test_fmi_3_is_native_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert build_fmu.main(["--fmi", "3", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "--fmi 3: " in said
    assert "--native" in said
    with pytest.raises(BuildError, match="FMI 3: "):
        build_fmu.build("CoupledOscillator", tmp_path, variant=build_fmu.Variant(fmi=3))
    assert list(tmp_path.iterdir()) == []


def test_binaries_lie_where_fmi_3_looks_for_them() -> None:
    """A folder for each processor and system, as its specification names them."""
    pytest.importorskip("ziglang", reason="compiles for other platforms")
    tools = native_binary.toolchains(tuple(native_binary.TARGETS))
    assert sorted(tool.folder(3) for tool in tools) == [
        "aarch64-darwin",
        "aarch64-linux",
        "x86_64-darwin",
        "x86_64-linux",
        "x86_64-windows",
    ]
