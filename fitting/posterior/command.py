"""``fmu-fit posterior``: draws from the posterior of a fit."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.extension.command import (
    ISOLATE,
    Options,
    command_again,
    command_line,
    declare,
    fit_at,
    fmu_for,
    folder_names,
    hand_over,
    status_line,
    whole_number,
    writes,
)
from fitting.posterior import CHAIN_FILE, FILES, LEAST_STEPS, LEAST_WALKERS
from fitting.text.results_folder import remove_earlier

NAME = "posterior"
DOCUMENT = "posterior.json"
EXAMPLE = (
    "fmu-fit posterior string_q1/campaign.toml --at out/string_q1/result.json --out out/posterior"
)
#: Steps where no number is given, at most.
USUAL = 5000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    several = "campaign file; several of one sample together, as they were fitted"
    at = "the fit of these campaigns: walkers start at all of its minima"
    options: Options = {
        "campaign": {"nargs": "+", "help": several},
        "--at": {"required": True, "help": at},
        "--changed-data": {},
        "--out": "folder for results (out/posterior_<its folder>)",
    }
    declare(parser, options)
    parser.add_argument(
        "--walkers",
        type=whole_number(LEAST_WALKERS, even=True),
        metavar="N",
        help="walkers, even, at least twice the n parameters (24, or 2 n + 2 if that is more)",
    )
    parser.add_argument(
        "--steps",
        type=whole_number(LEAST_STEPS),
        default=USUAL,
        metavar="N",
        help=f"most steps of a walker, at least {LEAST_STEPS}; fewer if draws are enough ({USUAL})",
    )
    options = {
        "--seed": {"default": 1, "help": "seed of the draws (1)"},
        "--workers": {},
        **ISOLATE,
        "--resume": f"continue the {CHAIN_FILE} in the folder",
        "--no-report": "neither figure nor report.html",
        "--dry-run": "only print the expected evaluations and time; nothing is written",
    }
    declare(parser, options)


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / f"posterior_{folder_names(*args.campaign)}"


@writes(NAME, *FILES, CHAIN_FILE, to=_out)
def run(args: argparse.Namespace) -> int:
    """Draw and write; 0 if there are enough draws, else 1. With ``--dry-run`` only the cost.

    Raises:
        BadInput: campaign, fit or FMU are not what they should be, or emcee is missing.
        FmuFailure: the FMU failed where the fit ended.
        KeyboardInterrupt: before there was a result; states how to continue from what is kept.
    """
    # the work takes libraries along, help does not
    from fitting.extension.report import printed_lines
    from fitting.posterior.api import screen_lines
    from fitting.text.scratch import Scratch

    at, out = fit_at(args), _out(args)
    if at is None:
        raise RuntimeError("the parser requires a fit")
    sampling = ff.Sampling(
        walkers=args.walkers, steps=args.steps, seed=args.seed, resume=args.resume
    )
    campaigns = [ff.read_campaign(path) for path in args.campaign]
    with (
        Scratch() as scratch,
        fmu_for(
            campaigns, scratch if args.dry_run else out, args.workers, isolate=args.isolate
        ) as fmu,
        status_line(NAME, lambda: f"{fmu.workers.counts.runs} runs") as tell,
    ):
        tell("planning")
        problem = ff.Problem.of(campaigns, fmu)
        if args.dry_run:
            cost = ff.posterior_cost(problem, at, sampling)
        else:
            try:
                drawn = ff.posterior(problem, at, sampling, out=out, progress=tell)
            except KeyboardInterrupt as end:  # there is no result, but there may be a chain
                way_on = f"{end}, go on with: {command_again(args)}" if str(end) else ""
                raise KeyboardInterrupt(way_on) from None
            command = {"command": command_line(args), "fit": args.at.as_posix()}
            provenance = {**command, **drawn.summary.provenance}
            drawn = replace(drawn, summary=replace(drawn.summary, provenance=provenance))
            tell("tables, figure and report")
            files = ff.write_posterior(drawn, out, drawn=not args.no_report)
    if args.dry_run:
        hand_over(args, cost)
        print(*printed_lines("posterior/text", "cost", at.title, cost), sep="\n")
        return 0
    remove_earlier(out, ("fmu/*.fmu",))
    hand_over(args, drawn.summary)
    done = drawn.status == "converged"
    enough = args.steps if drawn.summary.steps < args.steps else 4 * args.steps
    again = "" if done else command_again(args, steps=enough)
    print(*screen_lines(drawn.summary, files, again=again, verbose=args.verbose), sep="\n")
    return 0 if done else 1
