"""The native twin in tests: built once for all test processes; where that cannot be, why."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import filelock
import fmpy
import pytest

import build_fmu
from fmu_src import native_binary
from tests.support.processes import MOST_S

STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")


def need_compiler() -> None:
    """Skip where the twin cannot be built."""
    if shutil.which("cc") is None:
        pytest.skip("this machine has no C compiler")


def shared_folder(factory: pytest.TempPathFactory, name: str) -> Path:
    """A folder that the test processes of this session have in common."""
    base = factory.getbasetemp()
    # with pytest-xdist each process has a folder of its own in that of the session
    folder = (base.parent if base.name.startswith("popen-") else base) / name
    folder.mkdir(exist_ok=True)
    return folder


def twin_of(model: str, factory: pytest.TempPathFactory, fmi: int = 2) -> Path:
    """The native FMU of a model as ``build_fmu.py --native`` makes it."""
    need_compiler()
    folder = shared_folder(factory, "twins" if fmi == 2 else f"twins_fmi{fmi}")
    variant = build_fmu.Variant(fmi=fmi)
    with filelock.FileLock(folder / f"{model}.lock", timeout=MOST_S):
        path = folder / f"{model}.fmu"
        return path if path.exists() else build_fmu.build(model, folder, variant=variant, native=())


def swift_model(model: str, factory: pytest.TempPathFactory) -> Path:
    """The twin, which answers in a fifth of the time; without a compiler the Python FMU."""
    if shutil.which("cc") is None:
        return build_fmu.build(model, factory.mktemp("model"))
    return twin_of(model, factory)


@contextmanager
def swiftly_built(factory: pytest.TempPathFactory) -> Iterator[None]:
    """A model that is named, not given as a file, is its twin for as long as the context lasts.

    In this process: a command that is started beside it builds the Python FMU.
    """

    def build(model: str, native: bool, folder: Path) -> Path:
        return Path(shutil.copy(swift_model(model, factory), folder))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fitting.fmu.models._build", build)
        yield


def checked_binary(folder: Path, fmu: Path, *options: str) -> Path:
    """Compile an FMU's binary anew, with all warnings as errors and further options; its path."""
    made = build_fmu.built_from(fmu)
    module = build_fmu.module_of(made.model)
    model_class = getattr(importlib.import_module(f"fmu_src.{module}"), made.model)
    [tool] = native_binary.toolchains(())
    tool = replace(
        tool,
        command=(*tool.command, *options),
        compile=(*tool.compile, "-O1", *STRICT),
        link=tuple(word for word in tool.link if word != "-s"),
    )
    objects = native_binary.compiled(
        folder / "objects",
        native_binary.needed_sources(build_fmu.SOURCE / native_binary.FOLDER, module, made.fmi),
        native_binary.written(model_class, module, made.start_values),
        tool,
    )
    guid = fmpy.read_model_description(str(fmu)).guid
    [(name, content)] = native_binary.binaries([objects], made.model, guid, made.fmi)
    path = folder / Path(name).name
    path.write_bytes(content)
    return path


def shipped_binary(folder: Path) -> Path:
    """The binary of an unpacked FMU that has one."""
    [path] = [path for path in (folder / "binaries").glob("*/*") if path.is_file()]
    return path
