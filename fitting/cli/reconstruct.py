"""``fmu-fit reconstruct``: from a laboratory campaign to the coefficients, through the FMU."""

from __future__ import annotations

import argparse
import importlib
import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fitting.campaign import Campaign, ContinuationSettings, bind, read_campaign
from fitting.cli.options import default_workers, relative_accuracy, whole_number
from fitting.fit import checkpoint
from fitting.fit.fit import Hooks, Progress
from fitting.fit.options import Options, options_of
from fitting.fit.problem import Problem, problem_of
from fitting.fit.solver.evaluator import MISFITS
from fitting.fmu import FmuWorkers
from fitting.fmu.models import provide_fmu
from fitting.inference.sweep_line import line_sentences
from fitting.report.shown import shown_problem
from fitting.report.table import text_lines
from fitting.report.tables.values import values_table
from fitting.report.words.agreement import agreement_sentences
from fitting.report.words.inference import knowledge_lines
from fitting.report.words.plan import plan_line
from fitting.result.external import check_external, with_external
from fitting.result.provenance import job_of
from fitting.result.reconstruction import ReconstructionOptions, identify_fmu, reconstruct_through
from fitting.result.result import Result, write_result
from fitting.text.errors import BadInput

NAME = "reconstruct"
SUMMARY = "the main job: Algorithms 1 and 2 through the FMU, to tables, figures and a report"
EXAMPLE = "fmu-fit reconstruct data/string_q1/campaign.toml --out out/string_q1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "campaign",
        type=Path,
        metavar="CAMPAIGN.toml",
        nargs="+",
        help="campaign file, as the README tells; several of one sample are fitted together",
    )
    parser.add_argument("--out", type=Path, help="folder for results (out/<campaign's folder>)")
    parser.add_argument(
        "--workers", type=whole_number(1), help="worker processes (one per processor, up to 8)"
    )
    parser.add_argument("--resume", action="store_true", help="go on from the last finished level")
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
    parser.add_argument("--seed", type=whole_number(0), help="seed of the starts (the campaign's)")
    parser.add_argument("--starts", type=whole_number(1), help="number of starts (the campaign's)")
    parser.add_argument("--quick", action="store_true", help="one start, looser tolerances")
    parser.add_argument(
        "--no-profiles", action="store_true", help="linearised errors only: no profile likelihood"
    )
    parser.add_argument(
        "--bootstrap",
        type=whole_number(2),
        metavar="N",
        help="refit N synthetic data sets drawn at the solution (none)",
    )
    parser.add_argument("--no-report", action="store_true", help="neither figures nor report.html")


def run(args: argparse.Namespace) -> int:
    """Reconstruct and write; returns 0 if converged, else 1.

    Raises:
        BadInput: campaign, data or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    check_external(args.external)
    campaigns = [read_campaign(path) for path in args.campaign]
    campaign = one_fmu(campaigns)
    folders = [path.resolve().parent.name for path in args.campaign]
    out: Path = args.out or Path("out") / "+".join(dict.fromkeys(folders))
    fmu = provide_fmu(campaign.file.fmu, out / "fmu")
    count = args.workers or default_workers()
    with FmuWorkers(fmu, workers=count, timeout_s=campaign.file.fmu.timeout_s) as workers:
        problem = _problem(args, campaigns, workers)
        check_external(args.external, [*(p.name for p in problem.parameters), *problem.outputs])
        identity = identify_fmu(workers.description, _command(args))
        options = _options(args, campaigns[0].file.continuation)
        job = job_of(problem, identity, options)
        memory = checkpoint.resume(out, job) if args.resume else checkpoint.begin(out, job)
        if args.resume:
            print(memory.resumed("levels"))
        shown = _Line(sys.stderr.isatty())
        try:
            request = ReconstructionOptions(
                options=options,
                hooks=Hooks(progress=shown, memory=memory),
                profiles=not args.no_profiles,
                bootstrap=args.bootstrap or 0,
            )
            result = reconstruct_through(workers, problem, identity, request)
        except KeyboardInterrupt:
            shown.end()
            print("interrupted before the first level was finished: nothing to report")
            return 1
        shown.end()
    result = with_external(result, args.external)
    files = write_result(result, out)
    print("\n".join(table(result)))
    print(f"\nwritten: {', '.join(str(path) for path in files)}")
    if result.status == "interrupted":
        print(f"go on with: {_command(args)}{'' if args.resume else ' --resume'}")
        return 1
    memory.remove()
    if not args.no_report:
        _report(result, problem, out)
    return 0 if result.status == "converged" else 1


def _problem(
    args: argparse.Namespace, campaigns: Sequence[Campaign], workers: FmuWorkers
) -> Problem:
    """The campaigns together, in the units of the FMU."""
    bounds = [bind(campaign, workers.description.variables) for campaign in campaigns]
    if args.accuracy is not None:
        bounds = [
            replace(bound, setup=replace(bound.setup, accuracy=args.accuracy)) for bound in bounds
        ]
    return problem_of(bounds)


def one_fmu(campaigns: Sequence[Campaign]) -> Campaign:
    """The first campaign; raises BadInput where another one wants another FMU.

    Args:
        campaigns: campaigns as they were read.
    """
    first = campaigns[0]
    for other in campaigns[1:]:
        one, two = first.file.fmu, other.file.fmu
        if (one.model, one.file and one.file.resolve()) != (
            two.model,
            two.file and two.file.resolve(),
        ):
            raise BadInput(
                f"{other.path}: [fmu]: {two.model or two.file}, but {first.path} has "
                f"{one.model or one.file}; wanted the same in campaigns that are fitted together"
            )
    return first


def _options(args: argparse.Namespace, chosen: ContinuationSettings) -> Options:
    options = options_of(chosen, quick=args.quick)
    schedule = options.schedule
    if args.seed is not None:
        schedule = replace(schedule, seed=args.seed)
    if args.starts is not None:
        schedule = replace(schedule, starts=args.starts)
    solve = options.solve if args.misfit is None else replace(options.solve, misfit=args.misfit)
    return replace(options, schedule=schedule, solve=solve)


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME, *(path.as_posix() for path in args.campaign)]
    for name in ("out", "workers", "accuracy", "misfit", "seed", "starts", "bootstrap"):
        value = getattr(args, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    for text in args.external:
        words += ["--external", text]
    flags = [
        name for name in ("resume", "quick", "no_profiles", "no_report") if getattr(args, name)
    ]
    words += [f"--{name.replace('_', '-')}" for name in flags]
    return shlex.join(words)


def _report(result: Result, problem: Problem, out: Path) -> None:
    # matplotlib takes a second to import: only where something is drawn
    report = importlib.import_module("fitting.report.reconstruction")
    print(f"report: {report.write_report(result, shown_problem(problem), out)}")


class _Line:
    """One line of progress on a terminal, nothing in a pipe."""

    def __init__(self, terminal: bool) -> None:
        self.terminal = terminal

    def __call__(self, state: Progress) -> None:
        if not self.terminal:
            return
        left = "" if state.left_s != state.left_s else f", about {state.left_s:.0f} s left"
        text = (
            f"alternative {state.alternative + 1}/{state.alternatives}, "
            f"start {state.start + 1}/{state.starts}, nu = {state.nu:.0e}, "
            f"J = {state.j_fit + state.j_reg:.5g}, {state.evaluations} evaluations, "
            f"{state.elapsed_s:.0f} s{left}"
        )
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()

    def end(self) -> None:
        """Leave the line."""
        if self.terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def table(result: Result) -> list[str]:
    """The result as lines of text.

    Args:
        result: of a reconstruction.
    """
    marked = result.synthetic and "synthetic" not in result.title.lower()
    lines = [result.title + (" [synthetic]" if marked else ""), ""]
    lines += text_lines(values_table(result))
    agreement = agreement_sentences(result)
    lines += ["", *agreement] if agreement else []
    before, after = result.deviations.initial.mean, result.deviations.final.mean
    lines += ["", f"mean deviation {before:.4g} -> {after:.4g}, J_fit = {result.j_fit:.6g}"]
    for other in result.alternatives:
        if not other.settings:  # the campaign names no alternatives
            continue
        shown = ", ".join(f"{k} = {v}" for k, v in other.settings.items())
        mark = "reported" if other.reported else ("equal" if other.equal_to_best else "worse")
        lines.append(f"alternative {shown}: J_fit = {other.j_fit:.6g} ({mark})")
    if result.line is not None:
        lines += line_sentences(result.line)
    if result.knowledge is not None:
        lines += ["", *knowledge_lines(result.knowledge), ""]
    cost = result.evaluations
    lines.append(
        f"{cost.objective} evaluations, {cost.jacobians} Jacobians, {cost.fmu_runs} FMU runs, "
        f"{result.seconds:.1f} s"
    )
    if result.plan is not None:
        lines.append(plan_line(result.plan))
    lines += ["", f"{result.status}: {result.message}"]
    lines += [f"warning: {text}" for text in result.warnings]
    return lines
