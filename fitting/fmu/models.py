"""The models that this project ships: which FMU a campaign means, built where it names a model."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.scratch import Scratch
from fitting.text.shipped import shipped

BUILDER = "build_fmu.py"


class FmuSource(Protocol):
    """An FMU as a campaign names it: a file, or else a model of this project."""

    @property
    def model(self) -> str | None:
        """Name of a model that is built on demand."""

    @property
    def file(self) -> Path | None:
        """Path of an FMU file."""


def provide_fmu(source: FmuSource, cache: Path) -> Path:
    """Path of the campaign's FMU: the file it names, or the model it names, built into `cache`.

    The build is reproducible and takes a second, so it is made anew every time: what is driven is
    what the sources say.

    Args:
        source: what the campaign says of its FMU.
        cache: folder for FMUs that are built.

    Raises:
        BadInput: the builder is not there, or the builder's own complaint.
    """
    if source.file is not None:
        return source.file
    # in a thread, because an interrupt within a start of a process would leave that process running
    with Scratch() as folder, ThreadPoolExecutor(1) as thread:
        built = thread.submit(_build, str(source.model), folder).result()
        write_whole(cache / built.name, built.read_bytes())
        return cache / built.name


def _build(model: str, folder: Path) -> Path:
    builder = shipped(BUILDER)
    command = [sys.executable, str(builder), "--model", model, "--out", str(folder)]
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
        said = built.stderr.strip().splitlines() or ["no message"]
        raise BadInput(f"model {model!r} could not be built: {said[-1]}")
    return Path(lines[-1])
