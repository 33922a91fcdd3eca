"""The work of ``fmu-fit posterior``, once its words are read."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.api.posterior import truth_beside
from fitting.cli.posterior import NAME
from fitting.cli.running.campaign_fmu import fmu_for
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import status_line
from fitting.cli.words.again import command_again
from fitting.cli.words.drive import flag
from fitting.cli.words.earlier_fit import fit_at
from fitting.report.screen import printed_lines
from fitting.report.screens import posterior_lines
from fitting.result.result import Result
from fitting.text.results_folder import remove_earlier
from fitting.text.scratch import Scratch


def draw(args: argparse.Namespace, out: Path) -> int:
    """Draw and write; 0 if there are enough draws, else 1.

    Args:
        args: of the command.
        out: folder of the results.

    Raises:
        BadInput: campaign, fit or FMU are not what they should be, or emcee is missing.
        FmuFailure: the FMU failed where the fit ended.
        KeyboardInterrupt: before there was a result; says how to go on from what is kept.
    """
    at, asked = _fit(args), _sampling(args)
    campaigns = [ff.read_campaign(path) for path in args.campaign]
    with (
        fmu_for(campaigns, out, args.workers, isolate=args.isolate) as fmu,
        status_line(NAME, lambda: f"{fmu.workers.counts.runs} runs") as tell,
    ):
        tell("planning")
        problem = ff.Problem.of(campaigns, fmu)
        truth = truth_beside(problem, at)
        try:
            found = ff.posterior(problem, at, asked, truth=truth, out=out, progress=tell)
        except KeyboardInterrupt as end:  # there is no result, but there may be a chain
            way_on = f"{end}, go on with: {command_again(args)}" if str(end) else ""
            raise KeyboardInterrupt(way_on) from None
        command = {"command": _command(args), "fit": args.at.as_posix()}
        provenance = {**command, **found.summary.provenance}
        found = replace(found, summary=replace(found.summary, provenance=provenance))
        tell("tables, figure and report")
        files = ff.write_posterior(found, out, drawn=not args.no_report)
    remove_earlier(out, ("fmu/*.fmu",))
    hand_over(args, found.summary)
    done = found.status == "converged"
    enough = args.steps if found.summary.steps < args.steps else 4 * args.steps
    again = "" if done else command_again(args, steps=enough)
    lines = posterior_lines(found.summary, files, again=again, verbose=args.verbose)
    print(*lines, sep="\n")
    return 0 if done else 1


def tell_cost(args: argparse.Namespace) -> int:
    """Tell how many evaluations draws will take, and how long; nothing is written.

    Args:
        args: of the command.

    Raises:
        BadInput: as `draw`.
        FmuFailure: likewise.
    """
    at, asked = _fit(args), _sampling(args)
    campaigns = [ff.read_campaign(path) for path in args.campaign]
    with (
        Scratch() as folder,
        fmu_for(campaigns, folder, args.workers, isolate=args.isolate) as fmu,
        status_line(NAME, lambda: f"{fmu.workers.counts.runs} runs") as tell,
    ):
        tell("planning")
        found = ff.posterior_cost(ff.Problem.of(campaigns, fmu), at, asked)
    hand_over(args, found)
    print(*printed_lines("cost", "posterior", at.title, found), sep="\n")
    return 0


def _fit(args: argparse.Namespace) -> Result:
    found = fit_at(args)
    if found is None:
        raise RuntimeError("the parser requires a fit")
    return found


def _sampling(args: argparse.Namespace) -> ff.Sampling:
    return ff.Sampling(walkers=args.walkers, steps=args.steps, seed=args.seed, resume=args.resume)


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME, *(path.as_posix() for path in args.campaign)]
    for name in ("at", "out", "walkers"):
        value = getattr(args, name)
        if value is not None:
            words += [f"--{name}", value.as_posix() if isinstance(value, Path) else str(value)]
    words += ["--steps", str(args.steps), "--seed", str(args.seed)]
    flags = [name for name in ("isolate", "changed_data", "resume") if getattr(args, name)]
    return shlex.join([*words, *(flag(name, getattr(args, name)) for name in flags)])
