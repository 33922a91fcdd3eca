"""``fmu-fit posterior``: draws from the posterior of a fit."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitting.api.choices import LEAST_STEPS, LEAST_WALKERS
from fitting.api.written import CHAIN_FILE, POSTERIOR_FILES
from fitting.cli.running.results import writes
from fitting.cli.words.drive import add_isolate
from fitting.cli.words.earlier_fit import add_at
from fitting.cli.words.values import even_number, joint_name, seed, whole_number, worker_count

NAME = "posterior"
DOCUMENT = "posterior.json"
EXAMPLE = (
    "fmu-fit posterior string_q1/campaign.toml --at out/string_q1/result.json --out out/posterior"
)
#: Steps where nothing is said, at most.
USUAL = 5000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaign",
        type=Path,
        metavar="CAMPAIGN.toml",
        nargs="+",
        help="campaign file; several of one sample together, as they were fitted",
    )
    add_at(
        parser,
        "the fit of these campaigns: walkers start at all of its minima",
        required=True,
    )
    parser.add_argument("--out", type=Path, help="folder for results (out/posterior_<its folder>)")
    parser.add_argument(
        "--walkers",
        type=even_number(LEAST_WALKERS),
        metavar="N",
        help="walkers, an even number, at least twice the parameters (24, or 2 n + 2 for n "
        "parameters where these are more)",
    )
    parser.add_argument(
        "--steps",
        type=whole_number(LEAST_STEPS),
        default=USUAL,
        metavar="N",
        help=f"most steps of every walker, {LEAST_STEPS} at least; it ends before where draws are "
        f"enough ({USUAL})",
    )
    parser.add_argument("--seed", type=seed(), default=1, help="seed of the draws (1)")
    parser.add_argument(
        "--workers", type=worker_count(), help="worker processes (one per processor, up to 8)"
    )
    add_isolate(parser)
    parser.add_argument(
        "--resume", action="store_true", help=f"continue the {CHAIN_FILE} in the folder"
    )
    parser.add_argument("--no-report", action="store_true", help="neither figure nor report.html")
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="only print the expected evaluations and time; nothing is written",
    )


def _written_to(args: argparse.Namespace) -> Path | None:
    return None if args.dry_run else _out(args)


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / f"posterior_{joint_name(args.campaign)}"


@writes(NAME, *POSTERIOR_FILES, CHAIN_FILE, to=_written_to)
def run(args: argparse.Namespace) -> int:
    """Draw and write; 0 if there are enough draws, else 1.

    Raises:
        BadInput: campaign, fit or FMU are not what they should be, or emcee is missing.
        FmuFailure: the FMU failed where the fit ended.
    """
    # the work takes libraries along, help does not
    from fitting.cli.running.posterior import draw, tell_cost

    return tell_cost(args) if args.dry_run else draw(args, _out(args))
