"""``fmu-fit design``: which measurement next, to know a chosen value better."""

from __future__ import annotations

import argparse
from pathlib import Path

import fitting as ff
from fitting.design import FILES
from fitting.extension.command import (
    Options,
    command_line,
    declare,
    fit_at,
    fmu_for,
    folder_names,
    hand_over,
    positive_time,
    status_line,
    whole_number,
    writes,
)
from fitting.text.choices import CRITERIA
from fitting.text.results_folder import remove_earlier

NAME = "design"
DOCUMENT = "design.json"
EXAMPLE = "fmu-fit design string_q1/campaign.toml --target lambda --out out/next_q1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaign", type=Path, metavar="CAMPAIGN.toml", help="the campaign that is to be continued"
    )
    parser.add_argument(
        "also",
        type=Path,
        metavar="MORE.toml",
        nargs="*",
        help="further measured campaigns of the same FMU and parameters",
    )
    options: Options = {
        "--out": "folder for results (out/next_<its folder>)",
        "--at": "a fit to start from (the fit nearest to the priors)",
        "--changed-data": {},
    }
    declare(parser, options)
    parser.add_argument(
        "--candidates",
        type=Path,
        metavar="DESIGN.toml",
        help="a file with a table [design]: the instrument's limits (the campaign's own)",
    )
    parser.add_argument(
        "--time",
        type=positive_time("--time"),
        metavar="TIME",
        help="of the laboratory for all measurements, as 10min (no limit)",
    )
    parser.add_argument(
        "--target", help="parameter or derived output to determine (the first derived)"
    )
    parser.add_argument(
        "--criterion", choices=CRITERIA, help="error of the target, or D or A of all (target)"
    )
    parser.add_argument("--number", type=whole_number(1), help="measurements, at most (6)")
    options = {
        "--seed": {"default": 1, "help": "of points of equal fit"},
        "--workers": {},
        "--no-report": "neither figures nor report",
    }
    declare(parser, options)


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / f"next_{folder_names(args.campaign)}"


@writes(NAME, *FILES, to=_out)
def run(args: argparse.Namespace) -> int:
    """Propose and write; returns 0.

    Raises:
        BadInput: campaign, limits, result or target are not what they should be.
        FmuFailure: the FMU failed.
    """
    campaigns = [ff.read_campaign(path) for path in (args.campaign, *args.also)]
    goal = ff.Goal(args.target or "", args.criterion or "", args.number, args.seed, args.time)
    # the fit by its file, which complaints name; itself where its data may be others
    out, at = _out(args), fit_at(args) if args.changed_data else args.at
    command = command_line(args)
    with fmu_for(campaigns, out, args.workers) as fmu, status_line(NAME) as tell:
        from fitting.design.api import screen_lines

        problem = ff.Problem.of(campaigns, fmu)
        made = ff.design(problem, goal, limits=args.candidates, at=at, progress=tell)
        made = made.made_by(command)
        tell("writing")
        written = made.write(out, report=not args.no_report)
        hand_over(args, made.design)
        lines = screen_lines(made.design, written, verbose=args.verbose)
    remove_earlier(out, ("fmu/*.fmu",))
    print("\n".join(lines))
    return 0
