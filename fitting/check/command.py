"""``fmu-fit check``: will an FMU load, validate, run, survive a reset, and suit a campaign."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import fitting as ff
from fitting.check import FILES
from fitting.extension.command import (
    ISOLATE,
    Options,
    declare,
    fmu_of,
    hand_over,
    positive_time,
    status_line,
    value,
    writes,
)

NAME = "check"
DOCUMENT = "the findings"
EXAMPLE = "fmu-fit check CoupledOscillator --campaign string_q1/campaign.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    step = 'length of the trial step, as "1 ms" (its own, else one that resolves its response)'
    budget = 'time of all probes, as "2 min" (60 s); those that have none left are listed'
    options: Options = {
        "fmu": {},
        "--interface": {},
        "--compile": "compile its sources for this machine, write that FMU here, and check it",
        "--campaign": value("a campaign that the FMU has to suit", "CAMPAIGN.toml", Path),
        "--step": value(step, "TIME", positive_time("--step")),
        "--report": value("also write a page, FOLDER/report.html", "FOLDER", Path),
        "--budget": value(budget, "TIME", positive_time("--budget"), default=60.0),
        "--timeout": {"default": 60.0, "help": "longest run (60 s)"},
        **ISOLATE,
        "--native": {},
    }
    declare(parser, options)


def _out(args: argparse.Namespace) -> Path | None:
    out: Path | None = args.report
    return out


@writes(NAME, *FILES, to=_out)
def run(args: argparse.Namespace) -> int:
    """Check and print; returns 0.

    Raises:
        BadInput: the FMU cannot be read, or does not suit the campaign, or no page can be written.
        FmuFailure: the trial run failed.
    """
    from fitting.check.api import write_check
    from fitting.check.report import document, screen_lines
    from fitting.extension.fmu import compiled

    written = None
    if args.compile:
        args.fmu = str(compiled(Path(args.fmu), Path()))
        print(f"compiled: {args.fmu}", file=sys.stderr)
    with fmu_of(args) as fmu, status_line(NAME) as show:
        show("trial run")
        checked = ff.check(fmu, args.campaign, step_s=args.step, budget_s=args.budget, show=show)
        if args.report is not None:
            show("writing")
            written = write_check(checked, args.report)
    hand_over(args, document(checked))
    print(*screen_lines(checked, verbose=args.verbose, report=written), sep="\n")
    if checked.failure is not None:
        raise checked.failure
    if checked.unsuited:
        raise ff.BadInput(*checked.unsuited)
    return 0
