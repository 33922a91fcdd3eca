"""Options of the commands: how their values are read, and the table of those that several have.

What an option cannot mean is refused at once, before a library is loaded.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import fitting as ff
from fitting.text.choices import BUDGET, EVALUATIONS, INTERFACES, MOST, MOST_SEED, MOST_WORKERS
from fitting.text.errors import BadInput, shown
from fitting.text.units import Written, checked_accuracy, in_unit

LARGEST = 1e60
Number = TypeVar("Number", int, float)

# --- values --------------------------------------------------------------------------------------


def _number_of(
    read: Callable[[str], Number], *rules: tuple[Callable[[Number], bool], str]
) -> Callable[[str], Number]:
    """An argparse type: a number for which all rules hold, each with what is wanted.

    Args:
        read: the text as a number; the first rule states what is wanted where it is none.
        *rules: whether a number is allowed, and what is wanted, in words.
    """

    def number(text: str) -> Number:
        try:
            value = read(text)
            wanted = next((words for holds, words in rules if not holds(value)), "")
        except ValueError:
            wanted = rules[0][1]
        if wanted:
            raise argparse.ArgumentTypeError(f"found {shown(text)}, wanted {wanted}")
        return value

    return number


def whole_number(least: int, most: int = MOST, *, even: bool = False) -> Callable[[str], int]:
    """An argparse type: a whole number from ``least`` to ``most``.

    Args:
        least: of them.
        most: of them.
        even: whether odd ones are refused.
    """
    kind = "an even" if even else "a whole"
    return _number_of(
        int,
        (lambda value: value >= least, f"{kind} number of at least {least}"),
        (lambda value: value <= most, f"{kind} number of at most {most}"),
        (lambda value: not (even and value % 2), f"{kind} number"),
    )


#: An argparse type: a number that can be squared and cubed.
bounded_number = _number_of(
    float, (lambda value: abs(value) <= LARGEST, f"a number from {-LARGEST:g} to {LARGEST:g}")
)
#: An argparse type: how many steps, as "2e6".
number_of_steps = _number_of(
    float, (lambda value: 1.0 <= value < math.inf, "a number of at least 1")
)


def default_workers() -> int:
    """Worker processes where none are asked for: one per processor, up to 8."""
    return min(os.cpu_count() or 1, 8)


def positive_time(option: str) -> Callable[[str], float]:
    """An argparse type: a time above zero in s, as "2 ms"; a plain number is in s.

    Args:
        option: name of the option, for errors.
    """
    return partial(positive_quantity, unit="s", where=option)


def positive_quantity(text: str, unit: str, *, where: str) -> float:
    """A written quantity above zero in ``unit``, in which a plain number is taken.

    Args:
        text: as it was written.
        unit: of the values.
        where: file, row or key, for errors.

    Raises BadInput, beginning with ``where``.
    """
    value = quantity(text, unit, where=where)
    if not value > 0.0:
        raise BadInput(f"{where}: found {shown(text)}, wanted a positive number")
    return value


def quantity(text: str, unit: str, *, where: str) -> float:
    """A written quantity in ``unit``, in which a plain number is taken.

    Args:
        text: as it was written.
        unit: of the values.
        where: file, row or key, for errors.

    Raises BadInput, beginning with ``where``.
    """
    return in_unit(Written(text, None, where), unit)


def rising_range(
    args: argparse.Namespace, unit: str, remark: str = ""
) -> tuple[float | None, float | None]:
    """The values of ``--from`` and ``--to`` in a unit, None where one is not given.

    Args:
        args: of the command, with ``low`` and ``high`` as they were written.
        unit: Hz or s.
        remark: what an error of a falling range ends with.

    Raises:
        BadInput: no quantity, or a range that does not rise.
    """
    low, high = (
        None if text is None else positive_quantity(text, unit, where=option)
        for text, option in ((args.low, "--from"), (args.high, "--to"))
    )
    if low is not None and high is not None and not low < high:
        raise BadInput(f"--from {args.low!r} and --to {args.high!r}: wanted a rising range{remark}")
    return low, high


def folder_names(*paths: Path) -> str:
    """Names of the folders of some files, each once, as the user sees them: links not followed.

    Args:
        *paths: of the files, which need not be there.
    """
    return "+".join(dict.fromkeys(Path(os.path.abspath(path)).parent.name for path in paths))


def assigned(option: str, texts: Sequence[str]) -> dict[str, str]:
    """Values by name, from words NAME=VALUE.

    Args:
        option: whose words they are.
        texts: of the command line.

    Raises:
        BadInput: a word without a name or a value.
    """
    result = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if not (name and value):
            raise BadInput(f"{option} {text}: wanted NAME=VALUE")
        result[name] = value
    return result


# --- the table -----------------------------------------------------------------------------------

#: What an option takes, as arguments of argparse; a text alone is its help.
Options = Mapping[str, str | Mapping[str, Any]]


def value(
    text: str, metavar: str | None = None, read: Callable[[str], Any] | None = None, **further: Any
) -> dict[str, Any]:
    """An option with a value.

    Args:
        text: its help.
        metavar: what the value is called; None: as the option.
        read: makes the value of a word; None: it is text.
        **further: arguments of argparse.
    """
    return {"help": text, "metavar": metavar, "type": read, **further}


def several(text: str, metavar: str, **further: Any) -> dict[str, Any]:
    """An option that may be repeated.

    Args:
        text: its help.
        metavar: what a value is called.
        **further: arguments of argparse.
    """
    return value(text, metavar, action="append", default=[], **further)


def one_of(choices: Collection[str], text: str, **further: Any) -> dict[str, Any]:
    """An option with one of some words.

    Args:
        choices: the words.
        text: its help.
        **further: arguments of argparse.
    """
    return {"choices": choices, "help": text, **further}


#: An option without a value.
FLAG: Mapping[str, Any] = {"action": "store_true"}
#: Options that several commands have: what a command does not state of one is taken from here.
SHARED: Options = {
    "campaign": {"type": Path, "metavar": "CAMPAIGN.toml", "help": "campaign file"},
    "fmu": value("the file (FMI 2.0 or 3.0), or a model as CoupledOscillator", "FMU"),
    "--accuracy": {
        "type": lambda text: checked_accuracy(quantity(text, "1", where="--accuracy"), "--accuracy")
    },
    "--at": {"type": Path, "metavar": "RESULT.json"},
    "--bootstrap": {"type": whole_number(2), "metavar": "N"},
    "--budget": {"type": whole_number(1), "metavar": "N"},
    "--demodulated-at": value(
        'of a demodulated ringdown: the frequency of the lock-in, as "1.2 MHz"', "F"
    ),
    "--interface": one_of(
        INTERFACES, f"by which the FMU is run ({INTERFACES[0]} where it offers that)"
    ),
    "--out": {"type": Path},
    "--seed": {"type": whole_number(0, MOST_SEED)},
    "--starts": {"type": whole_number(1)},
    "--workers": value(
        "worker processes (one per processor, up to 8)", read=whole_number(1, MOST_WORKERS)
    ),
    "--no-profiles": "1σ from the covariance; no profiles",
    "--no-report": "neither figures nor report.html",
    "--changed-data": "use a fit of other or changed data files",
    "--isolate": "run the FMU with limits of memory, time and files, without network",
    "--isolate=strict": {
        "action": "store_const",
        "const": "strict",
        "dest": "isolate",
        "help": "the same, an error if this system cannot enforce all",
    },
    "--native": "compile a model of this project from C: the same numbers, faster (without a "
    "compiler Python's runs)",
    "--settle": {"type": partial(quantity, unit="s", where="--settle"), "metavar": "TIME"},
    "--work": value(
        "steps of the FMU that a run may take, at most (2e6)", "STEPS", number_of_steps
    ),
    "--timeout": {"type": positive_time("--timeout"), "metavar": "TIME"},
}
#: Help of ``--set``, with an example.
START_VALUE = "start value of a variable, as {}; a plain number is in its unit"
#: How an FMU is run.
ISOLATE: Options = {"--isolate": {}, "--isolate=strict": {}}
#: How many runs profiles may take, for the help of ``--budget``.
USUAL_BUDGET = f"{BUDGET:,}, or {EVALUATIONS:,} evaluations where these take more"


def declare(parser: argparse._ActionsContainer, options: Options) -> None:
    """Declare options of a command, in this order.

    Args:
        parser: of the command, or a group of its options.
        options: by name, as `SHARED` has them; a text alone is the help of an option, which has no
            value unless `SHARED` has one.
    """
    for name, given in options.items():
        own = {"help": given} if isinstance(given, str) else given
        usual = SHARED.get(name, FLAG if isinstance(given, str) else {})
        usual = {**FLAG, "help": usual} if isinstance(usual, str) else usual
        parser.add_argument(name, **{**usual, **own})


# --- the columns of a file -----------------------------------------------------------------------

#: Columns that a file may not name, and units that it may not state: fields of `fitting.Columns`.
COLUMNS: Mapping[str, str] = {
    "frequency": "column of frequencies",
    "amplitude": "column of amplitudes, or of complex values",
    "phase": "column of phases",
    "real": "column of real parts (X)",
    "imaginary": "column of imaginary parts (Y)",
    "time": "column of times, of a recording over time",
    "unit-frequency": "unit of the frequencies, as Hz or MHz",
    "unit-amplitude": "unit of amplitudes or parts, as mV or dB",
    "unit-phase": "unit of the phases, deg or rad",
    "unit-time": "unit of the times, as s or ms",
}
#: Which part of the file is read, and how: fields as well.
PARTS: Options = {
    "--trace": value("which of the file's traces, from 1 (the first)", read=whole_number(1)),
    "--chunk": value("which of the file's sweeps, as LabOne numbers them", read=whole_number(0)),
    "--drop-missing": "leave out rows of a sweep that lack a number",
    "--average": "average readings of a sweep at the same frequency",
    "--header-row": value(
        "row of the columns' names in a text file (the last above the numbers)",
        "N",
        whole_number(1),
    ),
}


def add_columns(parser: argparse.ArgumentParser) -> None:
    """Declare the options about a file's columns.

    Args:
        parser: of the command.
    """
    group = parser.add_argument_group("input columns")
    for name, words in COLUMNS.items():
        metavar = "UNIT" if name.startswith("unit") else "COLUMN"
        group.add_argument(f"--{name}", metavar=metavar, help=words)
    declare(group, PARTS)


def columns_of(args: argparse.Namespace) -> ff.Columns:
    """What the options state of a file's columns.

    Args:
        args: of the command, see `add_columns`.

    Raises:
        BadInput: an option that is empty.
    """
    for name, words in COLUMNS.items():
        text = getattr(args, name.replace("-", "_"))
        if text is not None and not text.strip():
            raise BadInput(f"--{name}: is empty, wanted {words}")
    names = (name.removeprefix("--").replace("-", "_") for name in (*COLUMNS, *PARTS))
    given = {name: getattr(args, name) for name in names}
    return ff.Columns(**{name: value for name, value in given.items() if value is not None})


def listed(text: str | None) -> Sequence[str]:
    """Words of an option that takes several, comma between.

    Args:
        text: as it was written; None: the option was not given.
    """
    return tuple(word.strip() for word in (text or "").split(",") if word.strip())
