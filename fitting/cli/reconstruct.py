"""``fmu-fit reconstruct``: from a laboratory campaign to the coefficients, through the FMU."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitting.api.choices import BUDGET, ESTIMATORS, EVALUATIONS, FORMATS, MISFITS, STYLES
from fitting.api.written import LEVELS_FILE, RESULT_FILES
from fitting.cli.running.progress import Laps
from fitting.cli.running.results import writes
from fitting.cli.words.drive import add_isolate
from fitting.cli.words.values import (
    joint_name,
    relative_accuracy,
    seed,
    whole_number,
    worker_count,
)

NAME = "reconstruct"
DOCUMENT = "result.json"
EXAMPLE = "fmu-fit reconstruct string_q1/campaign.toml --out out/string_q1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaign",
        type=Path,
        metavar="CAMPAIGN.toml",
        nargs="+",
        help="campaign file; several of one sample are fitted together",
    )
    parser.add_argument("--out", type=Path, help="folder for results (out/<campaign's folder>)")
    parser.add_argument(
        "--workers", type=worker_count(), help="worker processes (one per processor, up to 8)"
    )
    add_isolate(parser)
    parser.add_argument(
        "--resume", action="store_true", help="continue after the last finished level"
    )
    parser.add_argument(
        "--accuracy",
        type=relative_accuracy("--accuracy"),
        help="wanted relative accuracy of simulated amplitudes (the campaign's)",
    )
    parser.add_argument(
        "--external",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help='a value from elsewhere to test, as lambda="0.8604 MHz" or "0.8604 MHz +- 1 kHz"',
    )
    parser.add_argument("--misfit", choices=MISFITS, help="form of the misfit (the campaign's)")
    parser.add_argument(
        "--estimator",
        choices=ESTIMATORS,
        help="whose estimate is reported; errors are the likelihood's (the campaign's)",
    )
    parser.add_argument("--seed", type=seed(), help="seed of the search (the campaign's)")
    parser.add_argument(
        "--starts",
        type=whole_number(1),
        help="1: search the bounds only if the start's fit is not explained by noise; more: always "
        "(the campaign's)",
    )
    parser.add_argument(
        "--start",
        type=Path,
        metavar="SET.ssv",
        help="start at the values of a parameter set (the campaign's)",
    )
    parser.add_argument(
        "--no-path", action="store_true", help="leave out the levels of ν (Algorithm 2)"
    )
    parser.add_argument(
        "--global-path",
        action="store_true",
        help="minimise every level of ν over the whole bounds, too, by a multistart (slow)",
    )
    parser.add_argument("--quick", action="store_true", help="one start, no levels of ν")
    parser.add_argument(
        "--no-profiles", action="store_true", help="1σ from the covariance; no profiles"
    )
    parser.add_argument(
        "--budget",
        type=whole_number(1),
        metavar="N",
        help="about so many runs of the FMU for profiles; incomplete searches are marked "
        f"({BUDGET:,}, or {EVALUATIONS:,} evaluations where these take more)",
    )
    parser.add_argument(
        "--bootstrap",
        type=whole_number(2),
        metavar="N",
        help="refit N synthetic data sets drawn at the solution (none)",
    )
    parser.add_argument("--no-report", action="store_true", help="neither figures nor report.html")
    parser.add_argument(
        "--style",
        choices=STYLES,
        help="paper: figures as PDF for print, too, 3.4 and 7 in wide; interactive: figures of the "
        "report can be zoomed and read off, which needs fmu-fit[interactive]",
    )
    parser.add_argument(
        "--formats",
        nargs="+",
        choices=FORMATS,
        default=[],
        help="further files of each figure (SVG and CSV alone)",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="only print the expected cost: runs, seconds, memory; nothing is written",
    )


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / joint_name(args.campaign)


@writes(NAME, *RESULT_FILES, LEVELS_FILE, to=_out)
def run(args: argparse.Namespace) -> int:
    """Reconstruct and write; 0 if converged, 4 if the data are not described, else 1.

    Raises:
        BadInput: campaign, data or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    laps = Laps()
    # the work takes libraries along, help does not
    from fitting.api.ahead import built_ahead

    with built_ahead(args.campaign):
        from fitting.cli.running.reconstruction import reconstruct

        return reconstruct(args, _out(args), laps)
