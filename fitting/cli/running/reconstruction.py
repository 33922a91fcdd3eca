"""The work of ``fmu-fit reconstruct``, once its words are read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import fitting as ff
from fitting.api.choices import STYLES, usual_budget
from fitting.api.cost import expected_of
from fitting.api.fitted import KeptLevels, Valued, kept_levels, search_options
from fitting.api.jobs import check_style, draw_report
from fitting.api.problem import Campaign
from fitting.api.written import RESULT_FILES
from fitting.cli.running.campaign_fmu import fmu_for
from fitting.cli.running.interrupts import to_the_end
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import Laps, status_line
from fitting.cli.running.remaining import Remaining, counted
from fitting.cli.words.again import command_again, command_line
from fitting.report.details import detail_lines
from fitting.report.screen import line_item, printed_lines
from fitting.report.summary import result_lines
from fitting.result.assembly import without_profiles
from fitting.result.external import check_external, with_external
from fitting.result.result import Result, write_result
from fitting.text.choices import LIKELIHOOD
from fitting.text.errors import NoScale, OutOfBudget
from fitting.text.results_folder import remove_earlier
from fitting.text.scratch import Scratch

NAME = "reconstruct"
#: Exit code by how the fit ended; any other ending is 1.
EXIT_CODES = {"converged": 0, "does not describe the data": 4}
#: Options that a result records, those with a value and those without.
RECORDED = (
    *("out", "workers", "accuracy", "misfit", "estimator", "seed", "starts", "bootstrap"),
    *("start", "style", "budget"),
)
FLAGS = ("quick", "no_path", "global_path", "no_profiles", "no_report", "isolate", "resume")
#: What goes with the result that it belongs to.
PASSING = (*RESULT_FILES, "fmu/*.fmu")


@dataclass(frozen=True)
class _Job:
    """What is solved and how, where finished levels are kept, and who follows the work."""

    args: argparse.Namespace
    out: Path
    problem: ff.Problem
    method: ff.Tikhonov
    memory: KeptLevels
    remaining: Remaining
    laps: Laps


def reconstruct(args: argparse.Namespace, out: Path, laps: Laps) -> int:
    """Reconstruct and write; 0 if converged, 4 if the data are not described, else 1.

    Args:
        args: of the command.
        out: folder of the results.
        laps: the clock of the command.

    Raises:
        BadInput: campaign, data or FMU are not what they should be.
        FmuFailure: the FMU failed.
        KeyboardInterrupt: before there was a result; names the command that goes on.
    """
    check_external(args.external)
    check_style("--style", args.style or STYLES[0])
    campaigns = [ff.read_campaign(path) for path in args.campaign]
    if args.dry_run:
        return _print_cost(args, campaigns)
    with fmu_for(campaigns, out, args.workers, isolate=args.isolate) as fmu:
        job = _job(args, campaigns, fmu, out, laps)
        try:
            workers = fmu.workers
            with status_line(NAME, lambda: counted(job.remaining, workers.counts.runs)) as show:
                valued, result, is_complete = _fit(job, show)
        except KeyboardInterrupt:
            way_on = _way_on(job)
            raise KeyboardInterrupt(f"interrupted; {way_on}" if way_on else "") from None
        except NoScale as refused:
            named = ", ".join(str(path) for path in args.campaign)
            raise ff.BadInput(f"{named}: {refused}") from None
        except ff.FmuFailure as failure:
            if way_on := _way_on(job):
                failure.add_note(way_on)
            raise
    return _report(job, valued, result, is_complete=is_complete)


def _job(
    args: argparse.Namespace,
    campaigns: Sequence[Campaign],
    fmu: ff.Fmu,
    out: Path,
    laps: Laps,
) -> _Job:
    """The problem, its method, and the finished levels of this very job, or none yet."""
    problem = ff.Problem.of(campaigns, fmu, accuracy=args.accuracy, start=args.start)
    record, variables = problem.record, fmu.variables
    units = {p.name: p.unit for p in record.parameters if not p.experiments}
    check_external(
        args.external, units | {name: variables[name].unit or "" for name in record.outputs}
    )
    laps.end("to begin")
    method = _method(args, problem)
    options = search_options(problem, method, _starts(args), args.seed)
    memory = kept_levels(out, problem, options, _command(args), resume=args.resume)
    if args.resume:
        print(memory.resumed())
    expected = expected_of(
        problem,
        method,
        _starts(args),
        profiles=not args.no_profiles,
        refits=args.bootstrap or 0,
    )
    remaining = Remaining(expected, drawn=not args.no_report)
    return _Job(args, out, problem, method, memory, remaining, laps)


def _fit(job: _Job, show: Callable[[str], None]) -> tuple[Valued, Result, bool]:
    """What was found, its result, and whether all that was asked for is done.

    The fit is written before profiles are scanned, which take most of the time.
    """
    args = job.args
    show("planning")
    fitted = ff.fit(
        job.problem,
        job.method,
        starts=_starts(args),
        seed=args.seed,
        progress=lambda state: show(job.remaining.searching(state)),
        memory=job.memory,
    )
    fitted.command = _command(args)
    with to_the_end():
        result = fitted.result
    job.laps.end("to fit")
    interrupted = fitted.status == "interrupted"
    if args.no_profiles or interrupted:
        return fitted, result, not interrupted
    valued: Valued = fitted
    is_complete = False
    try:
        with to_the_end():
            result = without_profiles(result, "pending")
            write_result(result, job.out)
        inferred = ff.profile(
            fitted,
            budget=args.budget,
            bootstrap=args.bootstrap or 0,
            progress=lambda spent: show(job.remaining.walking(spent)),
        )
        with to_the_end():
            valued, result, is_complete = inferred, inferred.result, inferred.profiled
    except OutOfBudget:  # all there is to it: to go on would take as much again
        is_complete = True
        result = without_profiles(fitted.result, "budget")
    except KeyboardInterrupt:
        pass
    job.laps.end("for the profiles")
    return valued, result, is_complete


def _report(job: _Job, valued: Valued, result: Result, *, is_complete: bool) -> int:
    """Files, first screen and report of a result; the exit code."""
    args, out = job.args, job.out
    files = write_result(result, out)  # before anything else that may fail
    if args.external:
        result = with_external(result, args.external)
        write_result(result, out)
    hand_over(args, result)
    print(*result_lines(result), sep="\n")
    if args.verbose:
        print("", *detail_lines(result), "", sep="\n")
    if not is_complete:
        remove_earlier(out, PASSING)
        print(line_item("continue", command_again(args)))
        return 1
    if args.no_report:
        print(line_item("results", str(files[0])))
    else:
        with status_line(NAME, job.remaining.left) as show:
            show(job.remaining.report())
            page = draw_report(
                valued,
                result,
                out,
                args.style or STYLES[0],
                lambda done, of: show(job.remaining.drawing(done, of)),
                args.formats,
            )
        hint = "" if args.verbose else "   (--verbose prints all that was found)"
        print(line_item("report", f"{page}{hint}"))
        job.laps.end("for the report")
    remove_earlier(out, PASSING)
    job.memory.remove()  # when all is done that may be killed
    if args.verbose:
        print(job.laps.words)
    return EXIT_CODES.get(result.status, 1)


def _print_cost(args: argparse.Namespace, campaigns: Sequence[Campaign]) -> int:
    """What the job will cost; a model of this project is built where it does not stay."""
    with (
        Scratch() as folder,
        fmu_for(campaigns, folder, args.workers, isolate=args.isolate) as fmu,
        status_line(NAME, lambda: f"{fmu.workers.counts.runs} runs") as show,
    ):
        show("planning")
        problem = ff.Problem.of(campaigns, fmu, accuracy=args.accuracy, start=args.start)
        cost = ff.cost(
            problem,
            _method(args, problem),
            starts=_starts(args),
            profiles=not args.no_profiles,
            bootstrap=args.bootstrap or 0,
        )
    hand_over(args, cost)
    budget = args.budget or usual_budget(cost.runs_each)
    shown = budget if not args.no_profiles and budget < cost.runs[1] else 0
    title = problem.record.title
    print(*printed_lines("cost", "reconstruct", title, cost, shown, args.verbose), sep="\n")
    return 0


def _way_on(job: _Job) -> str:
    """How to go on from the finished levels that are kept; empty without any."""
    count = len(job.memory)
    again = command_again(job.args)
    return f"{count} finished levels are kept, go on with: {again}" if count else ""


def _method(args: argparse.Namespace, problem: ff.Problem) -> ff.Tikhonov:
    """As the campaign states, but for what the options change."""
    changes = {name: getattr(args, name) for name in ("misfit", "estimator") if getattr(args, name)}
    method = replace(ff.Tikhonov.of(problem.options), **changes)
    if args.no_path and (args.global_path or method.estimator != LIKELIHOOD):
        option = "--global-path" if args.global_path else f"--estimator {method.estimator}"
        raise ff.BadInput(f"--no-path: contradicts {option}, which needs the levels of ν")
    path = method.path and not (args.no_path or args.quick)
    return replace(method, path=path, global_path=args.global_path)


def _starts(args: argparse.Namespace) -> int | None:
    return 1 if args.quick and args.starts is None else args.starts


def _command(args: argparse.Namespace) -> str:
    words = [NAME, *(path.as_posix() for path in args.campaign)]
    return command_line(args, words, RECORDED, ("external", "formats"), FLAGS)
