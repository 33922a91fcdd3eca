"""The command line in this process: as a subprocess, for the price of the command alone."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

from fitting.cli.main import main


@dataclass(frozen=True)
class Told:
    """How a command ended: exit code, standard output, standard error."""

    code: int
    out: str
    err: str


def told(*words: str | Path) -> Told:
    """Run ``fmu-fit`` with these words.

    Args:
        words: of the command line.
    """
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            code = main([str(word) for word in words])
        except SystemExit as ending:  # --help and --version end so
            code = int(ending.code or 0)
    return Told(code, output.getvalue(), errors.getvalue())
