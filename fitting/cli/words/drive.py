"""What an FMU is driven with, from words on the command line: its file, start values, times."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import fitting as ff
from fitting.cli.words.values import number_of_steps, positive_time, quantity
from fitting.text.choices import INTERFACES

if TYPE_CHECKING:
    from fitting.text.arrays import Scalar

#: A complaint of the library about one of its arguments, and perhaps about one name in it.
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


def add_fmu(parser: argparse.ArgumentParser) -> None:
    """Declare the FMU that a command takes.

    Args:
        parser: of the command.
    """
    parser.add_argument(
        "fmu", metavar="FMU", help="the file (FMI 2.0 or 3.0), or a model as CoupledOscillator"
    )
    add_interface(parser)


def add_interface(parser: argparse.ArgumentParser) -> None:
    """Declare by which interface the FMU is run.

    Args:
        parser: of the command.
    """
    parser.add_argument(
        "--interface",
        choices=INTERFACES,
        help=f"by which the FMU is run ({INTERFACES[0]} where it offers that)",
    )


def add_start_values(parser: argparse.ArgumentParser, example: str) -> None:
    """Declare start values of the FMU's variables.

    Args:
        parser: of the command.
        example: of one.
    """
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help=f"start value of a variable, as {example}; a plain number is in its unit",
    )


def add_settle(parser: argparse.ArgumentParser, words: str) -> None:
    """Declare how long the FMU settles.

    Args:
        parser: of the command.
        words: what the time is.
    """
    parser.add_argument(
        "--settle", type=time_to_settle, metavar="TIME", help=f"{words} (default: until steady)"
    )


def add_work(parser: argparse.ArgumentParser) -> None:
    """Declare how many steps of the FMU a run may take.

    Args:
        parser: of the command.
    """
    parser.add_argument(
        "--work",
        type=number_of_steps,
        metavar="STEPS",
        help="steps of the FMU that a run may take, at most (2e6)",
    )


def add_timeout(parser: argparse.ArgumentParser, seconds: float, words: str) -> None:
    """Declare the longest time for a run.

    Args:
        parser: of the command.
        seconds: where none is given, s.
        words: what it is the longest time of.
    """
    parser.add_argument(
        "--timeout",
        type=positive_time("--timeout"),
        default=seconds,
        metavar="TIME",
        help=f"{words} ({seconds:g} s)",
    )


def add_isolate(parser: argparse.ArgumentParser) -> None:
    """Declare that the FMU runs isolated.

    Args:
        parser: of the command.
    """
    parser.add_argument(
        "--isolate",
        action="store_true",
        help="run the FMU with limits of memory, time, files, and without network",
    )
    parser.add_argument(
        "--isolate=strict",
        action="store_const",
        const="strict",
        dest="isolate",
        help="the same, refused where this system cannot hold all of it",
    )


def fmu_of(args: argparse.Namespace) -> ff.Fmu:
    """The FMU that a command is given, with one worker.

    Args:
        args: of the command, see `add_fmu`, `add_timeout` and `add_isolate`.

    Raises:
        BadInput: no such file or model, or no FMU that this machine can run.
    """
    how = {"isolate": args.isolate, "interface": args.interface}
    return ff.Fmu(args.fmu, 1, args.timeout, "--timeout", **how)


@contextmanager
def complaints_of_options() -> Iterator[None]:
    """Complaints about arguments of the library name the options that gave them."""
    try:
        yield
    except ff.BadInput as error:
        raise ff.BadInput(*(_of_option(str(complaint)) for complaint in error.args)) from error


def _of_option(complaint: str) -> str:
    result = ARGUMENT.match(complaint)
    if result is None or result[1] not in OPTIONS:
        return complaint
    name = f" {result[2]}" if result[2] else ""
    return f"{OPTIONS[result[1]]}{name}: {complaint[result.end() :]}"


def time_to_settle(text: str) -> float:
    """An argparse type: a time of at least zero in s, as "2 ms"; a plain number is in s."""
    settle_s = quantity(text, "s", where="--settle")
    if settle_s < 0.0:
        raise ff.BadInput(f"--settle: found {text!r}, wanted a time of at least 0")
    return settle_s


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
        name, result, value = text.partition("=")
        name = name.strip()
        if not (name and result):
            raise ff.BadInput(f"--set {text}: wanted NAME=VALUE")
        variable = fmu.description.variable(name)
        values[name] = _value(value.strip(), name, variable.kind, variable.unit or "1")
    return values


def _value(text: str, name: str, kind: str, unit: str) -> Scalar:
    where = f"--set {name}"
    if kind == "String":
        return text
    if kind == "Boolean":
        if text.lower() not in ("true", "false", "1", "0"):
            raise ff.BadInput(f"{where}: found {text!r}, wanted true or false")
        return text.lower() in ("true", "1")
    if kind == "Integer":
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not number.is_integer():
            raise ff.BadInput(f"{where}: found {text!r}, wanted a whole number")
        return int(number)
    return quantity(text, unit, where=where)


def units_of(fmu: ff.Fmu, names: Sequence[str]) -> Mapping[str, str]:
    """Units of variables by name, empty where the FMU declares none.

    Args:
        fmu: the FMU.
        names: of the variables.
    """
    return {name: fmu.variables[name].unit or "" for name in names}
