"""What commands on campaigns share: FMU, the fit they start from, the command as it is recorded."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from fitting.cli.words.options import default_workers

if TYPE_CHECKING:
    from fitting.api.fmu import Fmu
    from fitting.api.problem import Campaign
    from fitting.result.result import Result

#: Fewer letters name no option.
SHORTEST = len("--x")


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


def command_line(
    args: argparse.Namespace,
    words: Sequence[str],
    options: Sequence[str],
    repeated: Sequence[str] = (),
    flags: Sequence[str] = (),
) -> str:
    """The command as a result records it: the options that differ from their defaults.

    Args:
        args: of the command.
        words: the command and its positional arguments.
        options: names of options with a value, None where it is the default.
        repeated: names of options that may be repeated.
        flags: names of options without a value, or with one word.
    """
    given = [(name, getattr(args, name)) for name in options]
    given += [(name, value) for name in repeated for value in getattr(args, name)]
    made = ["fmu-fit", *words]
    for name, value in given:
        if value is not None:
            made += [f"--{name}", value.as_posix() if isinstance(value, Path) else str(value)]
    for name in flags:
        value = getattr(args, name)
        written = f"--{name.replace('_', '-')}"
        made += [written if value is True else f"{written}={value}"] if value else []
    return shlex.join(made)


def command_again(args: argparse.Namespace, *, steps: int | None = None) -> str:
    """The command as it was typed, every option of it, with ``--resume``.

    Args:
        args: of the command, as the parser made them.
        steps: what `--steps` is now; None: as it was.
    """
    kept, skip = [], False
    for word in args.given:
        # however it was written: with its value behind it or after "=", and cut short
        name, equals, _ = word.partition("=")
        is_steps = steps is not None and len(name) >= SHORTEST and "--steps".startswith(name)
        if word != "--resume" and not (skip or is_steps):
            kept.append(word)
        skip = is_steps and not equals
    kept += [] if steps is None else ["--steps", str(steps)]
    return shlex.join(["fmu-fit", *kept, "--resume"])
