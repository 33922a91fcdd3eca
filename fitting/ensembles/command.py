"""``fmu-fit ensemble``: many independent fits, of virtual laboratories or of campaigns."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import fitting as ff
from fitting.ensembles import FILES, ITEMS_FILE
from fitting.extension.command import (
    Options,
    bounded_number,
    command_again,
    command_line,
    complaints_of_options,
    declare,
    default_workers,
    hand_over,
    status_line,
    whole_number,
    writes,
)
from fitting.lab.names import CURVES, SERIES, TRUTH_NAME
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier

if TYPE_CHECKING:
    from fitting.ensembles.api import Progress

NAME = "ensemble"
DOCUMENT = "ensemble.json"
EXAMPLE = "fmu-fit ensemble --series q1 --laboratories 100 --value width_plus --out out/many"
#: Laboratories where no number is given.
USUAL = 100
#: Options that are not recorded: the same fits made elsewhere are the same bytes.
ELSEWHERE = ("out", "workers", "scheduler", "resume", "no_report")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaigns",
        type=Path,
        metavar="CAMPAIGNS",
        nargs="*",
        help="campaign files, folders with campaigns below, or tables (CSV) with their paths in "
        "a column 'campaign'",
    )
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument(
        "--series",
        choices=(*SERIES, *CURVES),
        help="virtual laboratories of this kind, see fmu-fit synthesize",
    )
    kind.add_argument(
        "--like",
        type=Path,
        metavar="CAMPAIGN.toml",
        help=f"virtual laboratories like this synthetic campaign, with its {TRUTH_NAME}",
    )
    parser.add_argument(
        "--laboratories",
        type=whole_number(1),
        metavar="N",
        help=f"number, with --resume also more than before ({USUAL})",
    )
    declare(parser, {"--seed": "seed of the first laboratory (1)"})
    parser.add_argument(
        "--change",
        action="append",
        default=[],
        metavar="NAME=NUMBER",
        help="a number of the laboratories, as noise_scale=0.5; may be repeated",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    place = parser.add_mutually_exclusive_group()
    workers = "worker processes (one per processor, up to 8)"
    declare(place, {"--workers": workers})
    place.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of dask, whose workers fit the items, as tcp://10.0.0.1:8786",
    )
    parser.add_argument("--resume", action="store_true", help="continue from the finished items")
    parser.add_argument(
        "--fmu",
        metavar="FMU",
        help="FMU of all items (each campaign's)",
    )
    parser.add_argument(
        "--value",
        action="append",
        default=[],
        metavar="NAME",
        help="profile this parameter or derived output; may be repeated (all)",
    )
    cost = "only print the expected cost, by the plan of the first item; nothing is written"
    options: Options = {
        "--starts": "starts followed; 1: no search (each campaign's)",
        "--quick": "one start",
        "--no-profiles": {},
        "--no-report": {},
        "--dry-run": cost,
    }
    declare(parser, options)


@writes(NAME, *FILES, ITEMS_FILE)
def run(args: argparse.Namespace) -> int:
    """Fit all and write; 0 if every item has a fit, 1 if not, or if interrupted.

    Raises:
        BadInput: nothing to do, no such laboratory, scheduler or FMU, or finished items of another
            ensemble.
    """
    # the work takes libraries along, help does not
    from fitting.ensembles.report import document, screen_lines
    from fitting.ensembles.result import FINISHED

    of, options = _of(args), _options(args)
    if args.dry_run:
        return _print_cost(args, of, options)
    last: list[Progress] = []
    started = time.monotonic()
    with status_line(NAME) as tell, complaints_of_options():

        def follow(state: Progress) -> None:
            last[:] = [state]
            words = f"{state.done} of {state.total} items"
            words += f", {state.failed} without a fit" if state.failed else ""
            now, left = state.done - state.resumed, state.total - state.done
            if now and left:
                seconds = (time.monotonic() - started) / now * left
                words += f", about {seconds:.0f} s left" * (seconds < 120.0)
                words += f", about {seconds / 60.0:.0f} min left" * (seconds >= 120.0)
            tell(words)

        ensemble = ff.ensemble(
            of,
            args.fmu,
            options,
            executor=args.scheduler or args.workers,
            out=args.out,
            progress=follow,
        )
        tell("tables, figure and report")
        command = command_line(args, *ELSEWHERE)
        ensemble = replace(ensemble, provenance={**ensemble.provenance, "command": command})
        ended = ensemble.status == FINISHED
        # who asks for an end waits for no figure
        files = ff.write_ensemble(ensemble, args.out, drawn=ended and not args.no_report)
    remove_earlier(args.out, ("fmu/*.fmu",))
    hand_over(args, document(ensemble))
    resumed = last[-1].resumed if args.resume and last else 0
    again = "" if ended else command_again(args)
    print(*screen_lines(ensemble, files, resumed=resumed, again=again), sep="\n")
    return 1 if ensemble.failures or not ended else 0


def _print_cost(
    args: argparse.Namespace, of: ff.Laboratories | list[Path], options: ff.EnsembleOptions
) -> int:
    """What the ensemble will cost, by the plan of its first item; nothing is written."""
    from fitting.ensembles.api import finished_items, first_campaign
    from fitting.extension.report import printed_lines
    from fitting.text.scratch import Scratch

    done = 0
    with Scratch() as folder, status_line(NAME) as tell:
        tell("planning the first item")
        path, fmu, count = first_campaign(of, args.fmu, folder)
        with fmu:
            problem = ff.Problem.of(path, fmu)
            method = replace(ff.Tikhonov.of(problem.options), path=False)
            starts = 1 if args.quick and args.starts is None else args.starts
            cost = ff.cost(problem, method, starts=starts, profiles=not args.no_profiles)
        if args.resume:
            done = finished_items(of, args.fmu, options, args.out, folder)
    hand_over(args, cost)
    left = count - done
    whole, workers = None, 1
    if left and args.scheduler is None:
        workers = min(args.workers or default_workers(), left)
        whole = tuple(left * seconds / workers for seconds in cost.seconds)
    records = (cost, count, done, bool(args.value), whole, workers)
    print(*printed_lines("ensembles/text", "cost", *records), sep="\n")
    return 0


def _of(args: argparse.Namespace) -> ff.Laboratories | list[Path]:
    """What is fitted: laboratories or campaigns, with what means something for them alone.

    Raises:
        BadInput: both, neither, or an option of the other.
    """
    truth = args.series or args.like
    if truth is not None and args.campaigns:
        raise BadInput("ensemble: found campaigns and --series or --like, wanted one of both")
    if truth is None and not args.campaigns:
        raise BadInput("ensemble: found nothing to fit, wanted campaigns, --series or --like")
    for option in ("laboratories", "seed", "change"):
        if truth is None and getattr(args, option) not in (None, []):
            raise BadInput(f"--{option}: has no meaning here, only with --series or --like")
    if args.no_profiles and args.value:
        raise BadInput("--value: has no meaning with --no-profiles")
    if truth is None:
        campaigns: list[Path] = args.campaigns
        return campaigns
    changes: dict[str, float] = {}
    for word in args.change:
        name, _, text = word.partition("=")
        try:
            value = bounded_number(text)
        except argparse.ArgumentTypeError as error:
            raise BadInput(f"--change {word}: {error}; wanted NAME=NUMBER") from None
        # whole numbers stay whole
        changes[name.strip()] = int(value) if text.strip().lstrip("+-").isdigit() else value
    first = 1 if args.seed is None else args.seed
    return ff.Laboratories(truth, args.laboratories or USUAL, first, changes)


def _options(args: argparse.Namespace) -> ff.EnsembleOptions:
    return ff.EnsembleOptions(
        values=args.value,
        profiles=not args.no_profiles,
        starts=args.starts,
        quick=args.quick,
        resume=args.resume,
    )
