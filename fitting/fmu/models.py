"""The models that this project ships, built where a campaign names one."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.files import shipped
from fitting.text.results_folder import write_whole
from fitting.text.scratch import Scratch
from fitting.text.toml import read_toml

BUILDER = "build_fmu.py"
#: Models that are built before they are asked for, by name and whether they are compiled.
_ahead: dict[tuple[str, bool], Future[Path]] = {}
_log = logging.getLogger(__name__)


def built_model(model: str, cache: Path, *, native: bool = False) -> Path:
    """Path of the FMU of a model of this project, built into `cache`.

    The build is reproducible and takes a second, so it is made anew every time: what is driven is
    what the sources are.

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
    if native:
        try:
            return _builder(["--native", "--model", model], folder)
        except BadInput as error:  # the digits are those of Python's
            _log.info("the model is not compiled, Python's runs: %s", error)
    try:
        return _builder(["--model", model], folder)
    except BadInput as error:
        raise BadInput(f"model {model!r} could not be built: {error}") from error


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
