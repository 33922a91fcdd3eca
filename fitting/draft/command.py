"""``fmu-fit init``: a commented campaign that runs as it is, from files of measurements and an FMU.

What no file contains is asked on a terminal, unless options give it; --yes takes the defaults.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import fitting as ff
from fitting.extension.command import add_columns, columns_of, declare, reading, writes

if TYPE_CHECKING:
    from fitting.draft.api import Question

NAME = "init"
EXAMPLE = "fmu-fit init string_q1/sweep.csv --out mine --yes"
CAMPAIGN = "campaign.toml"
LIST = "spectra.csv"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "files",
        type=Path,
        nargs="*",
        default=[],
        metavar="FILE",
        help="sweeps or noise spectra; or a table of experiments, its spectra, and a sweep; or "
        "spectra over a control, in one table or a file each; or ringdowns; or with --fmu "
        "recordings over time; one may be the FMU, which alone gives a skeleton",
    )
    parser.add_argument(
        "--fmu", help="the FMU, or a model of this project (one mode: CoupledModes1)"
    )
    parser.add_argument("--out", type=Path, default=Path(), help="folder for campaign.toml (here)")
    parser.add_argument("--yes", action="store_true", help="ask nothing, take the defaults")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--peak", action="store_true", help="amplitudes are peak values")
    kind.add_argument("--rms", action="store_true", help="amplitudes are rms values")
    parser.add_argument(
        "--kind",
        choices=("noise", "sweep"),
        help="of amplitudes over frequency (by unit, name and scatter)",
    )
    declare(parser, {"--demodulated-at": {}})
    parser.add_argument(
        "--control",
        metavar="NAME[=VALUES]",
        help='quantity that differs between sweeps, as "Vg": a column of a map, or in names or '
        'heads of files; or with its values, as "Vg=-6:6:1 V" or "T=4,10,20 K"',
    )
    parser.add_argument(
        "--output",
        metavar="[COLUMN=]NAME",
        help="observed output of the FMU; of a recording with its column, as y=x",
    )
    declare(parser, {"--interface": {}})
    parser.add_argument("--tone", metavar="NAME", help="parameter of the FMU that holds the tone")
    parser.add_argument(
        "--input",
        metavar="[COLUMN=]NAME",
        help="driven input of the FMU; of a recording with its column, as u=F",
    )
    parser.add_argument(
        "--fit", nargs="+", metavar="NAME", action="extend", help="parameters that are fitted"
    )
    add_columns(parser)


@writes(NAME, CAMPAIGN, LIST)
def run(args: argparse.Namespace) -> int:
    """Write the campaign and tell what was guessed; returns 0.

    Raises:
        BadInput: files or an FMU that cannot be used, or do not suit each other.
        FmuFailure: the FMU failed with its own start values, or where the campaign starts.
    """
    from fitting.draft.api import drafted, measurements_and_fmu
    from fitting.extension.report import printed_lines

    same = ("output", "tone", "input", "fit", "kind", "interface", "control")
    given = {name: getattr(args, name) for name in same}
    given["demodulated-at"] = args.demodulated_at
    given["amplitudes"] = "peak" if args.peak else "rms" if args.rms else None
    ask = None if args.yes or not sys.stdin.isatty() else _ask
    # questions and a line that lives on the terminal do not go together
    with reading(NAME, args.files) if ask is None and args.files else nullcontext():
        path, made = drafted(
            args.files,
            args.fmu,
            out=args.out,
            columns=columns_of(args),
            told={name: value for name, value in given.items() if value is not None},
            ask=ask,
        )
    measured, fmu = measurements_and_fmu(args.files, args.fmu)
    command = f"fmu-fit reconstruct {shlex.quote(str(path))}"
    if not measured:
        named = "--fmu " * (args.fmu is not None) + shlex.quote(str(fmu))
        command = f"fmu-fit init {named} FILE --out {shlex.quote(str(args.out))}"
    without = bool(measured and made.undescribed)
    texts = (*made.notes, made.undescribed)
    if made.failure is not None:
        command = ""
    lines = printed_lines("draft/text", "drafted", texts, path, without, command, not measured)
    print(*lines, sep="\n")
    if made.failure is not None:
        raise made.failure
    return 0


def _ask(question: Question) -> Sequence[str] | None:
    """Ask at the terminal; nothing typed is the default."""
    options = f" ({', '.join(question.options[:12])})" if question.options else ""
    print(f"{question.words}{options}")
    try:
        default = f" [{' '.join(question.default)}]" if question.default else ""
        typed = input(f"{question.key}{default}: ")
    except EOFError:
        raise ff.BadInput(f"--{question.key}: no answer was given, wanted one, or --yes") from None
    return typed.replace(",", " ").split() or None
