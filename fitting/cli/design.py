"""``fmu-fit design``: which measurement next, to know a chosen value better."""

from __future__ import annotations

import argparse
import importlib
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.cli.options import default_workers, seed, whole_number, worker_count
from fitting.cli.progress import status_line
from fitting.cli.results import writes
from fitting.design.campaign import CAMPAIGN_NAME, EXPERIMENTS_NAME, SWEEP_NAME, campaign_files
from fitting.design.candidates import Limits
from fitting.design.choice import CRITERIA
from fitting.design.goal import goal_of, start_of, variable_of
from fitting.design.limits import limits_of, read_design_table
from fitting.design.proposal import propose
from fitting.design.result import Design, design_csv, write_design
from fitting.design.weighing import weigh
from fitting.fmu import FmuWorkers
from fitting.fmu.models import provide_fmu
from fitting.result.result import read_result
from fitting.text.errors import BadInput
from fitting.text.files import write_all, write_whole
from fitting.text.notation import hertz, number, prefixed

NAME = "design"
EXAMPLE = "fmu-fit design data/string_q1/campaign.toml --target lambda --out out/next_q1"
CAMPAIGN_FOLDER, TABLE_NAME = "campaign", "design.csv"
WRITTEN = (
    "design.json",
    TABLE_NAME,
    "report.html",
    *(f"{CAMPAIGN_FOLDER}/{name}" for name in (CAMPAIGN_NAME, EXPERIMENTS_NAME, f"{SWEEP_NAME}.*")),
    "figures/[0-9]*_*.*",
)


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
    return args.out or Path("out") / f"next_{args.campaign.resolve().parent.name}"


@writes(NAME, *WRITTEN, to=_out)
def run(args: argparse.Namespace) -> int:
    """Propose and write; returns 0.

    Raises:
        BadInput: campaign, limits, result or target are not what they should be.
        FmuFailure: the FMU failed.
    """
    campaign = read_campaign(args.campaign)
    others = [read_campaign(path) for path in args.also]
    for other in others:
        if (other.file.fmu.model, other.file.fmu.file) != (
            campaign.file.fmu.model,
            campaign.file.fmu.file,
        ):
            raise BadInput(f"{other.path}: [fmu]: wanted the FMU of {campaign.path}")
    out = _out(args)
    design_table = read_design_table(args.candidates or args.campaign)
    fitted = read_result(args.at) if args.at is not None else None
    fmu = provide_fmu(campaign.file.fmu, out / "fmu")
    count = args.workers or default_workers()
    with FmuWorkers(fmu, workers=count, timeout_s=campaign.file.fmu.timeout_s) as workers:
        description = workers.description
        bound = bind(campaign, description.variables)
        read = campaign.file.drive.lines
        limits = limits_of(bound, description.variables, design_table, read)
        if args.number is not None:
            limits = replace(limits, number=args.number)
        goal = goal_of(bound, design_table.keys, args.target or "", args.criterion or "")
        goal = replace(goal, seed=args.seed)
        if fitted is not None:
            goal = replace(goal, start=start_of(fitted, bound, str(args.at)))
        also = [bind(other, description.variables) for other in others]
        with status_line(NAME) as told:
            weighed = weigh(bound, workers, limits, goal, told, also)
        variable = description.variables[variable_of(bound, goal.target)]
        provenance = {
            "command": _command(args),
            "FMU": description.model_name,
            "FMU sha256": description.sha256,
            "seed": str(args.seed),
        }
        design = propose(bound, weighed, limits, goal, variable.unit or "", provenance)
    _write(design, bound, limits, out, args)
    return 0


def _write(
    design: Design, bound: BoundCampaign, limits: Limits, out: Path, args: argparse.Namespace
) -> None:
    written = [write_design(design, out), out / TABLE_NAME]
    write_whole(out / TABLE_NAME, design_csv(design))
    folder = out / CAMPAIGN_FOLDER
    write_all(folder, campaign_files(design, bound, limits, folder, _command(args)))
    print("\n".join(table(design)))
    print(f"\nwritten: {', '.join(str(path) for path in written)}")
    print(f"for the laboratory: {folder / 'campaign.toml'}, peaks to be filled in")
    if not args.no_report:
        # matplotlib takes a second to import: only where something is drawn
        plots = importlib.import_module("fitting.report.figures.design")
        figures = plots.save_figures(design, out / "figures")
        page = importlib.import_module("fitting.report.design").write_report(design, figures, out)
        print(f"report: {page}")


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME, *(path.as_posix() for path in (args.campaign, *args.also))]
    for name in ("out", "at", "candidates", "target", "criterion", "number"):
        value = getattr(args, name)
        if value is not None:
            words += [f"--{name}", value.as_posix() if isinstance(value, Path) else str(value)]
    if args.seed != 1:
        words += ["--seed", str(args.seed)]
    return shlex.join(words)


def table(design: Design) -> list[str]:
    """The design as lines of text.

    Args:
        design: the proposed next measurement.
    """
    marked = design.synthetic and "synthetic" not in design.title.lower()
    factor, unit = prefixed(design.before.mean, design.unit)

    def shown(value: float) -> str:
        return "-" if np.isnan(value) else number(value / factor, 3)

    lines = [design.title + (" [synthetic]" if marked else ""), ""]
    lines.append(
        f"expected standard deviation of {design.target} ({unit}): at the point given, on "
        "(geometric) average and at worst over points that fit as well"
    )
    lines.append(f"{'':52} {'here':>8} {'mean':>8} {'worst':>8}")
    before = design.before
    lines.append(
        f"{'so far':52} {shown(before.at):>8} {shown(before.mean):>8} {shown(before.worst):>8}"
    )
    for p in design.proposals:
        tones = ", ".join(f"{f - p.centre_hz:+.4g}" for f in p.tones_hz)
        level = f" x{p.level:g}" if p.level != 1.0 else ""
        more = "".join(f" {name}={value}" for name, value in p.settings.items())
        what = f"{p.rank} {p.output} at {hertz(p.centre_hz, digits=6)} ({tones} Hz){level}{more}"
        what += f" avg {p.repeats}" if p.repeats > 1 else ""
        e = p.expected
        lines.append(f"{what:52} {shown(e.at):>8} {shown(e.mean):>8} {shown(e.worst):>8}")
    lines += [
        "",
        f"{design.improvement:.3g} times better on that average; {design.candidates} "
        f"candidates, criterion {design.criterion}",
    ]
    lines += [f"note: {text}" for text in design.sentences]
    return lines
