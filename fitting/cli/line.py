"""``fmu-fit line``: one resonance of one file: frequency, width, Q with errors; no campaign."""

from __future__ import annotations

import argparse
from pathlib import Path

import fitting as ff
from fitting.cli.running.output import hand_over
from fitting.cli.running.results import writes
from fitting.cli.words.columns import add_columns, columns_of
from fitting.cli.words.values import positive_quantity

NAME = "line"
EXAMPLE = "fmu-fit line afm_sensor/afm_sensor_sweep.dat --out out/line"
DOCUMENT = "the line"
FILES = ("line.json", "line.csv", "line.png", "line.svg")
WIRINGS = (
    "transmission",
    "fano",
    "sloped",
    "notch",
    "reflection",
    "offset",
    "floor",
    "rice",
    "single",
    "tail",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="a sweep, as an instrument wrote it"
    )
    parser.add_argument("--from", dest="low", metavar="F", help='first frequency, as "30.26 kHz"')
    parser.add_argument("--to", dest="high", metavar="F", help='last frequency, as "30.3 kHz"')
    parser.add_argument(
        "--wiring", choices=WIRINGS, help="what stands beside the line (found by comparing)"
    )
    add_columns(parser)
    parser.add_argument(
        "--out", type=Path, help="folder for line.json, line.csv and figure (none is written)"
    )


@writes(NAME, *FILES)
def run(args: argparse.Namespace) -> int:
    """Find the line and tell it; returns 0.

    Raises:
        BadInput: a file that is not read, or without one resonance that it holds whole.
    """
    from fitting.api.line import write_line
    from fitting.report.table import terminal_text, text_lines, wrapped
    from fitting.report.words.line import answer, forms_table, sentences

    low, high = _range(args)
    found = ff.line(
        args.file, within_hz=(low, high), wiring=args.wiring or "", columns=columns_of(args)
    )
    hand_over(args, found)
    for line in answer(found):
        print(terminal_text(line))
    for line in sentences(found):
        print(*wrapped(line), sep="\n")
    print(*text_lines(forms_table(found)), sep="\n")
    if args.out is not None:
        print(*write_line(found, args.out), sep="\n")
    return 0


def _range(args: argparse.Namespace) -> tuple[float | None, float | None]:
    low, high = (
        None if text is None else positive_quantity(text, "Hz", where=option)
        for text, option in ((args.low, "--from"), (args.high, "--to"))
    )
    if low is not None and high is not None and not low < high:
        raise ff.BadInput(f"--from {args.low!r} and --to {args.high!r}: wanted a rising range")
    return low, high
