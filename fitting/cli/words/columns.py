"""What a file of measurements does not state, as options: its columns, their units, which part."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

import fitting as ff
from fitting.cli.words.values import whole_number
from fitting.text.errors import BadInput

#: Options with what they name; the fields of `fitting.Columns` are called alike.
COLUMNS: Mapping[str, str] = {
    "frequency": "column of frequencies",
    "amplitude": "column of amplitudes, or of complex values",
    "phase": "column of phases",
    "real": "column of real parts (X)",
    "imaginary": "column of imaginary parts (Y)",
}
UNITS: Mapping[str, str] = {
    "unit-frequency": "unit of the frequencies, as Hz or MHz",
    "unit-amplitude": "unit of amplitudes or parts, as mV or dB",
    "unit-phase": "unit of the phases, deg or rad",
}
#: The same of a recording over time.
TIME_COLUMNS: Mapping[str, str] = {"time": "column of times, of a recording over time"}
TIME_UNITS: Mapping[str, str] = {"unit-time": "unit of the times, as s or ms"}


def add_columns(parser: argparse.ArgumentParser, *, over_time: bool = False) -> None:
    """Declare the options about a file's columns.

    Args:
        parser: of the command.
        over_time: whether a file may hold a recording over time.
    """
    group = parser.add_argument_group("input columns")
    for name, words in ({**COLUMNS, **TIME_COLUMNS} if over_time else COLUMNS).items():
        group.add_argument(f"--{name}", metavar="COLUMN", help=words)
    for name, words in ({**UNITS, **TIME_UNITS} if over_time else UNITS).items():
        group.add_argument(f"--{name}", metavar="UNIT", help=words)
    group.add_argument(
        "--trace", type=whole_number(1), help="which of the file's traces, from 1 (the first)"
    )
    group.add_argument(
        "--chunk", type=whole_number(0), help="which of the file's sweeps, as LabOne numbers them"
    )
    if over_time:
        group.add_argument(
            "--drop-missing",
            action="store_true",
            default=None,
            help="leave rows of a sweep out that lack a number",
        )
        group.add_argument(
            "--average",
            action="store_true",
            default=None,
            help="average readings of a sweep at the same frequency",
        )
    group.add_argument(
        "--header-row",
        type=whole_number(1),
        metavar="N",
        help="row of a text file that holds the names of its columns (the last one above them)",
    )


def columns_of(args: argparse.Namespace) -> ff.Columns:
    """What the options state of a file's columns.

    Args:
        args: of the command, see `add_columns`.

    Raises:
        BadInput: an option that is empty.
    """
    wanted = {**COLUMNS, **TIME_COLUMNS, **UNITS, **TIME_UNITS}
    values = {
        name: getattr(args, name, None)
        for name in (
            *(option.replace("-", "_") for option in wanted),
            "trace",
            "chunk",
            "header_row",
            "drop_missing",
            "average",
        )
    }
    for name, value in values.items():
        if isinstance(value, str) and not value.strip():
            option = name.replace("_", "-")
            raise BadInput(f"--{option}: is empty, wanted {wanted[option]}")
    given = {name: value for name, value in values.items() if value is not None}
    return ff.Columns(**given)
