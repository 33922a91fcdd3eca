"""``fmu-fit ensemble``: many independent fits, of virtual laboratories or of campaigns."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitting.api.choices import CURVES, SERIES, TRUTH_NAME
from fitting.api.written import ENSEMBLE_FILES, ITEMS_FILE
from fitting.cli.running.results import writes
from fitting.cli.words.values import seed, whole_number, worker_count
from fitting.text.errors import BadInput

NAME = "ensemble"
DOCUMENT = "ensemble.json"
EXAMPLE = "fmu-fit ensemble --series q1 --laboratories 100 --value width_plus --out out/many"
#: Laboratories where nothing is said.
USUAL = 100


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaigns",
        type=Path,
        metavar="CAMPAIGNS",
        nargs="*",
        help="a campaign file, a folder with campaigns anywhere below it, or a table (CSV) with a "
        "column 'campaign' of their paths; each campaign is fitted by itself",
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
        help=f"how many; with --resume more than before adds to them ({USUAL})",
    )
    parser.add_argument(
        "--seed", type=seed(), help="seed of the first laboratory, the others' follow it (1)"
    )
    parser.add_argument(
        "--change",
        action="append",
        default=[],
        metavar="NAME=NUMBER",
        help="another number of the laboratories, as noise_scale=0.5; may be repeated",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    place = parser.add_mutually_exclusive_group()
    place.add_argument(
        "--workers",
        type=worker_count(),
        help="processes of this machine, an item at a time in each (one per processor, up to 8)",
    )
    place.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="a dask scheduler whose workers do the items, as tcp://10.0.0.1:8786",
    )
    parser.add_argument("--resume", action="store_true", help="continue from the finished items")
    parser.add_argument(
        "--fmu",
        metavar="FMU",
        help="fit by this FMU, a file or a model's name (the one that each campaign names)",
    )
    parser.add_argument(
        "--value",
        action="append",
        default=[],
        metavar="NAME",
        help="profile this parameter or derived output alone; may be repeated (all)",
    )
    parser.add_argument(
        "--starts", type=whole_number(1), help="starts followed; 1: no search (each campaign's)"
    )
    parser.add_argument("--quick", action="store_true", help="one start, looser tolerances")
    parser.add_argument(
        "--no-profiles", action="store_true", help="1σ from the covariance; no profiles"
    )
    parser.add_argument("--no-report", action="store_true", help="neither figures nor report.html")
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="only print the expected cost, by the plan of the first item; nothing is written",
    )


def _written_to(args: argparse.Namespace) -> Path | None:
    out: Path = args.out
    return None if args.dry_run else out


@writes(NAME, *ENSEMBLE_FILES, ITEMS_FILE, to=_written_to)
def run(args: argparse.Namespace) -> int:
    """Fit all and write; 0 if every item has a fit, 1 if not, or if interrupted.

    Raises:
        BadInput: nothing to do, no such laboratory, scheduler or FMU, or finished items of another
            ensemble.
    """
    # the work takes libraries along, help does not
    from fitting.cli.running.ensemble import fit_all, tell_cost

    _refuse_mixed(args)
    return tell_cost(args) if args.dry_run else fit_all(args)


def _refuse_mixed(args: argparse.Namespace) -> None:
    """Laboratories or campaigns, and only what means something for them.

    Raises:
        BadInput: both, neither, or an option of the other.
    """
    virtual = args.series is not None or args.like is not None
    if virtual and args.campaigns:
        raise BadInput("ensemble: found campaigns and --series or --like, wanted one of both")
    if not virtual and not args.campaigns:
        raise BadInput("ensemble: found nothing to fit, wanted campaigns, --series or --like")
    for option in ("laboratories", "seed", "change"):
        if not virtual and getattr(args, option) not in (None, []):
            raise BadInput(f"--{option}: has no meaning here, only with --series or --like")
    if args.no_profiles and args.value:
        raise BadInput("--value: has no meaning with --no-profiles")
