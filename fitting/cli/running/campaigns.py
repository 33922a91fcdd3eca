"""What commands on campaigns share: FMU, the fit they start from, the command as it is recorded."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fitting.cli.words.options import default_workers

if TYPE_CHECKING:
    from fitting.api.fmu import Fmu
    from fitting.api.problem import Campaign
    from fitting.result.result import Result

#: Options about what is printed, which change no result.
PRINTING = ("quiet", "verbose", "log", "json")


def fmu_for(
    campaigns: Sequence[Campaign],
    out: Path,
    workers: int | None,
    *,
    isolate: bool | Literal["strict"] = False,
    native: bool = False,
) -> Fmu:
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
