"""What commands share: FMU, the fit they start from, errors about options, the command itself."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import fitting as ff
from fitting.cli.words.options import default_workers

if TYPE_CHECKING:
    from fitting.api.problem import Campaign
    from fitting.result.result import Result

#: Options about what is printed, which change no result.
PRINTING = ("quiet", "verbose", "log", "json")
#: Options by the arguments of the library that they give.
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
#: An error of the library about one of its arguments, and perhaps about one name in it.
ARGUMENT = re.compile(rf"^({'|'.join(OPTIONS)})(?: '([^']*)')?: ")


@contextmanager
def complaints_of_options() -> Iterator[None]:
    """Errors about arguments of the library name the options that gave them."""
    try:
        yield
    except ff.BadInput as error:

        def option(match: re.Match[str]) -> str:
            return f"{OPTIONS[match[1]]} {match[2] or ''}".rstrip() + ": "

        raise ff.BadInput(*(ARGUMENT.sub(option, str(each)) for each in error.args)) from error


def fmu_of(args: argparse.Namespace) -> ff.Fmu:
    """The FMU that a command is given, with one worker.

    Args:
        args: of the command, with ``fmu``, ``interface``, ``timeout``, ``isolate``, ``native``.

    Raises:
        BadInput: no such file or model, or no FMU that this machine can run.
    """
    how = {"isolate": args.isolate, "interface": args.interface, "native": args.native}
    return ff.Fmu(args.fmu, 1, args.timeout, "--timeout", **how)


def fmu_for(
    campaigns: Sequence[Campaign],
    out: Path,
    workers: int | None,
    *,
    isolate: bool | Literal["strict"] = False,
    native: bool = False,
) -> ff.Fmu:
    """The FMU that campaigns name; a model of this project is built into a folder of the results.

    Args:
        campaigns: that are fitted together.
        out: folder of the results.
        workers: processes, None for one per processor, up to 8.
        isolate: whether they run isolated.
        native: whether a model is compiled, whatever the campaigns state.

    Raises:
        BadInput: they name different ones, or one that is not there.
    """
    from fitting.api.problem import fmu_of  # takes libraries along, help does not

    count = workers or default_workers()
    return fmu_of(campaigns, out / "fmu", count, isolate=isolate, native=native)


def fit_at(args: argparse.Namespace) -> Result | None:
    """The fit that ``--at`` names; None where none is named.

    Args:
        args: of the command, with ``at`` and ``changed_data``.

    Raises:
        BadInput: it cannot be read.
    """
    # the work takes libraries along, help does not
    from fitting.result.provenance import of_any_data
    from fitting.result.result import read_result

    if args.at is None:
        return None
    result = read_result(args.at)
    return of_any_data(result) if args.changed_data else result


def command_line(args: argparse.Namespace, *without: str) -> str:
    """The command as a result records it: its positional arguments, then all that differs.

    Args:
        args: of the command.
        *without: names of options that are left out, next to those about what is printed.
    """
    return _typed(args, (*without, *PRINTING))


def command_again(args: argparse.Namespace, **changes: object) -> str:
    """The command to continue with: every option of it, and ``--resume``.

    Args:
        args: of the command.
        **changes: values of options that are to be others, by name.
    """
    return _typed(argparse.Namespace(**{**vars(args), **changes, "resume": True}))


def _typed(args: argparse.Namespace, without: Collection[str] = ()) -> str:
    """A command as it might be typed, with the options whose values are not the usual ones."""
    parser: argparse.ArgumentParser = args.parser
    words, options = parser.prog.split(), list[str]()
    for action in parser._actions:
        value = getattr(args, action.dest, action.default)
        if value == action.default or action.dest in without:
            continue
        each = value if isinstance(value, list) else [value]
        texts = [v.as_posix() if isinstance(v, Path) else str(v) for v in each]
        name = next(iter(action.option_strings), "")
        if not name:
            words += texts
        elif action.nargs == 0:  # several flags may set one value
            options += [name] if value == action.const else []
        elif isinstance(action, argparse._AppendAction):
            options += [word for text in texts for word in (name, text)]
        else:
            options += [name, *texts]
    return shlex.join([*words, *options])
