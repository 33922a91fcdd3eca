"""``fmu-fit design``: which measurement next, to know a chosen value better."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.api.choices import CRITERIA
from fitting.api.written import DESIGN_FILES
from fitting.cli.running.campaign_fmu import fmu_for
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import status_line
from fitting.cli.running.results import writes
from fitting.cli.words.values import folder_name, seed, whole_number, worker_count
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
        help="further campaigns of the same FMU and parameters that have been measured",
    )
    parser.add_argument("--out", type=Path, help="folder for results (out/next_<its folder>)")
    parser.add_argument(
        "--at",
        type=Path,
        metavar="RESULT.json",
        help="a fit to set out from (the fit nearest to the references)",
    )
    parser.add_argument(
        "--candidates",
        type=Path,
        metavar="DESIGN.toml",
        help="a file with a table [design]: the instrument's limits (the campaign's own)",
    )
    parser.add_argument(
        "--target", help="what is to be known: a parameter or derived output (the first derived)"
    )
    parser.add_argument(
        "--criterion", choices=CRITERIA, help="error of the target, or D or A of all (target)"
    )
    parser.add_argument("--number", type=whole_number(1), help="measurements, at most (6)")
    parser.add_argument("--seed", type=seed(), default=1, help="of points of equal fit")
    parser.add_argument(
        "--workers", type=worker_count(), help="worker processes (one per processor, up to 8)"
    )
    parser.add_argument("--no-report", action="store_true", help="neither figures nor report")


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / f"next_{folder_name(args.campaign)}"


@writes(NAME, *DESIGN_FILES, to=_out)
def run(args: argparse.Namespace) -> int:
    """Propose and write; returns 0.

    Raises:
        BadInput: campaign, limits, result or target are not what they should be.
        FmuFailure: the FMU failed.
    """
    from fitting.report.words.design import design_lines

    campaigns = [ff.read_campaign(path) for path in (args.campaign, *args.also)]
    goal = ff.Goal(args.target or "", args.criterion or "", args.number, args.seed)
    out = _out(args)
    with fmu_for(campaigns, out, args.workers) as fmu, status_line(NAME) as tell:
        problem = ff.Problem.of(campaigns, fmu)
        found = ff.design(problem, goal, limits=args.candidates, at=args.at, progress=tell)
        provenance = {**found.design.provenance, "command": _command(args)}
        found = replace(found, design=replace(found.design, provenance=provenance))
        tell("writing")
        written = found.write(out, report=not args.no_report)
    remove_earlier(out, ("fmu/*.fmu",))
    hand_over(args, found.design)
    print("\n".join(design_lines(found.design)))
    print(f"\nwritten: {', '.join(map(str, written[:2]))}")
    what = "every point of its sweeps" if found.design.is_of_sweeps else "peaks"
    print(f"for the laboratory: {written[2]}, {what} to be filled in")
    for page in written[3:]:
        print(f"report: {page}")
    return 0


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME, *(path.as_posix() for path in (args.campaign, *args.also))]
    for name in ("out", "at", "candidates", "target", "criterion", "number"):
        value = getattr(args, name)
        if value is not None:
            words += [f"--{name}", value.as_posix() if isinstance(value, Path) else str(value)]
    if args.seed != 1:
        words += ["--seed", str(args.seed)]
    return shlex.join(words)
