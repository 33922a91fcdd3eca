"""``fmu-fit check``: will an FMU load, validate, run, survive a reset, and suit a campaign."""

from __future__ import annotations

import argparse
from pathlib import Path

import fitting as ff
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import status_line
from fitting.cli.words.drive import add_fmu, add_timeout, fmu_of
from fitting.cli.words.values import positive_time

NAME = "check"
DOCUMENT = "what was found"
EXAMPLE = "fmu-fit check CoupledOscillator --campaign string_q1/campaign.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    add_fmu(parser)
    parser.add_argument("--campaign", type=Path, metavar="CAMPAIGN.toml", help="also: does it suit")
    parser.add_argument(
        "--step",
        type=positive_time("--step"),
        metavar="TIME",
        help='length of the trial step, as "1 ms" (one that suits the FMU, else 0.001 s)',
    )
    add_timeout(parser, 60.0, "longest run")


def run(args: argparse.Namespace) -> int:
    """Check and tell; returns 0.

    Raises:
        BadInput: the FMU cannot be read, or does not suit the campaign.
        FmuFailure: the trial run failed.
    """
    from fitting.report.documents import check_document
    from fitting.report.words.check import check_lines, description_lines

    with fmu_of(args) as fmu:
        print(*description_lines(fmu.description), sep="\n")
        with status_line(NAME) as tell:
            tell("trial run and resets")
            found = ff.check(fmu, args.campaign, step_s=args.step)
    hand_over(args, check_document(found))
    for line in check_lines(found):
        print(line)
    if found.failure is not None:
        raise found.failure
    if found.unsuited:
        raise ff.BadInput(*found.unsuited)
    return 0
