"""The models that this project ships, built where a campaign names one.

What was built is kept in the user's cache folder, by what it was built from: sources, libraries,
compiler. The build is reproducible, so that what is driven is what the sources are.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from platformdirs import user_cache_path

from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.files import shipped
from fitting.text.results_folder import write_whole
from fitting.text.scratch import Scratch
from fitting.text.toml import read_toml

BUILDER, SOURCES = "build_fmu.py", "fmu_src"
#: Where FMUs that were built are kept instead; empty: nowhere.
CACHE = "FMU_FIT_CACHE"
#: Models that are built before they are asked for, by name and whether they are compiled.
_ahead: dict[tuple[str, bool], Future[Path]] = {}
_log = logging.getLogger(__name__)


def built_model(model: str, cache: Path, *, native: bool = False) -> Path:
    """Path of the FMU of a model of this project, built into `cache`.

    Args:
        model: its name.
        cache: folder for FMUs that are built.
        native: whether it is compiled, where there is a compiler.

    Raises:
        BadInput: the builder is not there, or the builder's own complaint.
    """
    # in a thread, because an interrupt within a start of a process would leave that process running
    with Scratch() as folder, ThreadPoolExecutor(1) as thread:
        ahead = _ahead.get((model, native))
        built = (ahead or thread.submit(_build, model, native, folder)).result()
        write_whole(cache / built.name, built.read_bytes())
        return cache / built.name


@contextmanager
def built_ahead(campaigns: Sequence[Path], *, native: bool = False) -> Iterator[None]:
    """Build the models that campaigns name while whoever reads them loads; for `built_model`.

    Args:
        campaigns: their files; who reads them finds what is wrong with one.
        native: whether models are compiled, whatever the campaigns state.

    Raises:
        BadInput: no folder for temporary files.
    """
    models = set()
    for path in campaigns:
        with suppress(BadInput):
            fmu = read_toml(path).get("fmu")
            if isinstance(fmu, dict) and isinstance(fmu.get("model"), str):
                models.add((fmu["model"], native or fmu.get("native") is True))
    with Scratch() as folder, ThreadPoolExecutor(1) as thread:
        _ahead.update({each: thread.submit(_build, *each, folder) for each in sorted(models)})
        try:
            yield
        finally:
            _ahead.clear()


def rebuilt(
    fmu: Path, out: Path, name: str, history: str, start_values: Mapping[str, Scalar]
) -> Path | None:
    """Build the model of an FMU again with other start values; None if it is none of this project.

    An FMU is one of this project only if its builder makes the very same bytes of it.

    Args:
        fmu: path of an FMU.
        out: folder for the new one.
        name: of the new one.
        history: of its start values, a sentence.
        start_values: of the new one, by variable.

    Raises:
        BadInput: a start value that the model refuses, in the builder's words.
    """
    with Scratch() as folder, ThreadPoolExecutor(1) as thread:
        like = ["--like", str(fmu)]
        try:
            same = thread.submit(_builder, like, folder).result()
        except BadInput:  # another builder's, or of sources that are not here
            return None
        if same.read_bytes() != fmu.read_bytes():
            return None
        words = [*like, "--name", name, "--history", history, *["--set"] * bool(start_values)]
        for variable, value in start_values.items():
            text = str(value).lower() if isinstance(value, bool) else repr(value)
            words.append(f"{variable}={text}")
        built = thread.submit(_builder, words, folder).result()
        write_whole(out / built.name, built.read_bytes())
        return out / built.name


def _build(model: str, native: bool, folder: Path) -> Path:
    """The FMU of a model; Python's where it is to be compiled and cannot."""
    if native:
        try:
            return _kept_or_built(model, folder, native=True)
        except BadInput as error:  # the digits are those of Python's
            _log.info("the model is not compiled, Python's runs: %s", error)
    try:
        return _kept_or_built(model, folder, native=False)
    except BadInput as error:
        raise BadInput(f"model {model!r} could not be built: {error}") from error


def _kept_or_built(model: str, folder: Path, *, native: bool) -> Path:
    """The FMU of an earlier build from the same, else one that is built into a folder."""
    kept = _place(native=native)
    if kept is not None and (kept / f"{model}.fmu").is_file():
        return kept / f"{model}.fmu"
    built = _builder([*["--native"] * native, "--model", model], folder)
    if kept is not None:
        with suppress(BadInput, OSError):  # without it the next one takes as long
            write_whole(kept / built.name, built.read_bytes())
    return built


def _place(*, native: bool) -> Path | None:
    """Folder of the FMUs that were built from the present sources; None where none are kept."""
    named = os.environ.get(CACHE)
    if named == "":
        return None
    sources = shipped(SOURCES)
    state = hashlib.sha256(shipped(BUILDER).read_bytes())
    for path in sorted(p for p in sources.rglob("*") if p.is_file() and p.suffix != ".pyc"):
        state.update(f"{path.relative_to(sources)}\n".encode())
        state.update(path.read_bytes())
    state.update(f"{sys.executable} {sys.version}".encode())
    for package in ("pythonfmu", "fmpy", "ziglang"):
        with suppress(PackageNotFoundError):
            state.update(f"{package} {version(package)}".encode())
    compiler = shutil.which("cc") if native else None
    if compiler is not None:
        built = Path(compiler).resolve().stat()
        state.update(f"{compiler} {built.st_size} {built.st_mtime_ns}".encode())
    folder = Path(named) if named else user_cache_path("fmu-fit", appauthor=False)
    return folder / f"{state.hexdigest()[:32]}{'-native' * native}"


def _builder(words: Sequence[str], folder: Path) -> Path:
    """Run the builder into a folder; the path of the FMU, or its own complaint."""
    command = [sys.executable, str(shipped(BUILDER)), *words, "--out", str(folder)]
    built = subprocess.run(  # noqa: S603
        command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        # what a builder leaves that is killed goes with the folder
        env={**os.environ, **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))},
    )
    lines = built.stdout.strip().splitlines()
    if built.returncode != 0 or not lines:
        raise BadInput((built.stderr.strip().splitlines() or ["no message"])[-1])
    return Path(lines[-1])
