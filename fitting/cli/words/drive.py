"""The FMU that a command is given, and its errors in the words of the command line."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from contextlib import contextmanager

import fitting as ff

#: An error of the library about one of its arguments, and perhaps about one name in it.
ARGUMENT = re.compile(r"(\w+)(?: '([^']*)')?: ", re.ASCII)
OPTIONS = {
    "start_values": "--set",
    "tones": "--tones",
    "drive": "--input",
    "outputs": "--outputs",
    "tone": "--tone",
    "output": "--output",
    "accuracy": "--accuracy",
    "settle_s": "--settle",
    "window_s": "--window",
    "samples": "--samples",
    "scheduler": "--scheduler",
}


def fmu_of(args: argparse.Namespace) -> ff.Fmu:
    """The FMU that a command is given, with one worker.

    Args:
        args: of the command, with ``fmu``, ``interface``, ``timeout``, ``isolate``, ``native``.

    Raises:
        BadInput: no such file or model, or no FMU that this machine can run.
    """
    how = {"isolate": args.isolate, "interface": args.interface, "native": args.native}
    return ff.Fmu(args.fmu, 1, args.timeout, "--timeout", **how)


@contextmanager
def complaints_of_options() -> Iterator[None]:
    """Errors about arguments of the library name the options that gave them."""
    try:
        yield
    except ff.BadInput as error:
        lines = []
        for line in map(str, error.args):
            match = ARGUMENT.match(line)
            if match is not None and match[1] in OPTIONS:
                name = f" {match[2]}" if match[2] else ""
                line = f"{OPTIONS[match[1]]}{name}: {line[match.end() :]}"
            lines.append(line)
        raise ff.BadInput(*lines) from error
