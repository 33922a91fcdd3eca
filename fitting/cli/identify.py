"""``fmu-fit identify``: what a campaign's data determine, before or after a fit."""

from __future__ import annotations

import argparse
import importlib
import shlex
from dataclasses import replace
from pathlib import Path

from fitting.api.jobs import identify
from fitting.api.problem import Problem
from fitting.campaign import read_campaign
from fitting.cli.campaign_fmu import fmu_for
from fitting.cli.options import seed, whole_number, worker_count
from fitting.cli.progress import status_line
from fitting.cli.results import writes
from fitting.inference.determine import BUDGET
from fitting.inference.likelihood.knowledge import Identification
from fitting.report.table import text_lines
from fitting.report.tables.inference import direction_table
from fitting.report.words.inference import knowledge_lines
from fitting.result.result import read_result
from fitting.text.records import write_json

NAME = "identify"
EXAMPLE = "fmu-fit identify data/string_q1/campaign.toml --out out/identify_q1"
JSON_NAME = "identify.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaign", type=Path, metavar="CAMPAIGN.toml", help="campaign file, as the README tells"
    )
    parser.add_argument("--out", type=Path, help="folder for results (out/identify_<its folder>)")
    parser.add_argument(
        "--at",
        type=Path,
        metavar="RESULT.json",
        help="a fit to set out from (the campaign's start and reference values)",
    )
    parser.add_argument(
        "--expected",
        action="store_true",
        help="not the measured data but those that the model expects there, with their noise",
    )
    parser.add_argument(
        "--bootstrap",
        type=whole_number(2),
        default=0,
        metavar="N",
        help="refit N synthetic data sets (none)",
    )
    parser.add_argument("--seed", type=seed(), default=1, help="of starts and bootstrap")
    parser.add_argument(
        "--budget",
        type=whole_number(1),
        default=BUDGET,
        metavar="N",
        help=f"evaluations at most ({BUDGET})",
    )
    parser.add_argument(
        "--workers", type=worker_count(), help="worker processes (one per processor, up to 8)"
    )
    parser.add_argument("--no-report", action="store_true", help="neither figures nor report.html")


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / f"identify_{args.campaign.resolve().parent.name}"


@writes(NAME, JSON_NAME, "report.html", "figures/[0-9]*_*.*", to=_out)
def run(args: argparse.Namespace) -> int:
    """Identify and write; returns 0.

    Raises:
        BadInput: campaign, result or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    campaign = read_campaign(args.campaign)
    out = _out(args)
    fitted = read_result(args.at) if args.at is not None else None
    with (
        fmu_for([campaign], out, args.workers) as fmu,
        status_line(NAME, lambda: f"{fmu.workers.counts.runs} runs"),
    ):
        found = identify(
            Problem.of(campaign, fmu),
            fitted,
            expected=args.expected,
            bootstrap=args.bootstrap,
            seed=args.seed,
            budget=args.budget,
        )
    found = replace(
        found,
        at=found.at if fitted is None else args.at.as_posix(),
        provenance={"command": _command(args), **found.provenance},
    )
    write_json(out / JSON_NAME, found)
    print("\n".join(table(found)))
    print(f"\nwritten: {out / JSON_NAME}")
    if not args.no_report:
        # matplotlib takes a second to import: only where something is drawn
        report = importlib.import_module("fitting.report.identification")
        print(f"report: {report.write_report(found, out)}")
    return 0


def table(found: Identification) -> list[str]:
    """What was found as lines of text.

    Args:
        found: what the data determine.
    """
    marked = found.synthetic and "synthetic" not in found.title.lower()
    kind = "measured data" if found.knowledge.data else "expected data"
    lines = [
        found.title + (" [synthetic]" if marked else ""),
        f"{kind}, set out from {found.at}",
        "",
    ]
    directions = direction_table(found.knowledge)
    if directions is not None:  # what was tried along them is told below
        lines += text_lines(directions.without("what was tried"))
    return [*lines, "", *knowledge_lines(found.knowledge)]


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME, args.campaign.as_posix()]
    for name in ("out", "at", "bootstrap", "seed", "budget", "workers"):
        value = getattr(args, name)
        if value:
            words += [f"--{name}", str(value)]
    words += [f"--{n.replace('_', '-')}" for n in ("expected", "no_report") if getattr(args, n)]
    return shlex.join(words)
