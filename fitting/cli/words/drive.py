"""What an FMU is driven with, from words on the command line: start values, options in errors."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import fitting as ff
from fitting.cli.words.options import quantity

if TYPE_CHECKING:
    from fitting.text.arrays import Scalar

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


def start_values(assignments: Sequence[str], fmu: ff.Fmu) -> dict[str, Scalar]:
    """Start values from texts "NAME=VALUE" with written units, in the FMU's units.

    Args:
        assignments: words NAME=VALUE of the command line.
        fmu: the FMU.

    Raises:
        BadInput: no such word, variable or value.
    """
    values: dict[str, Scalar] = {}
    for text in assignments:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals):
            raise ff.BadInput(f"--set {text}: wanted NAME=VALUE")
        variable, where = fmu.description.variable(name), f"--set {name}"
        if variable.kind == "String":
            values[name] = value
        elif variable.kind == "Boolean":
            if value.lower() not in ("true", "false", "1", "0"):
                raise ff.BadInput(f"{where}: found {value!r}, wanted true or false")
            values[name] = value.lower() in ("true", "1")
        elif variable.kind == "Integer":
            try:
                number = float(value)
            except ValueError:
                number = math.nan
            if not number.is_integer():
                raise ff.BadInput(f"{where}: found {value!r}, wanted a whole number")
            values[name] = int(number)
        else:
            values[name] = quantity(value, variable.unit or "1", where=where)
    return values
