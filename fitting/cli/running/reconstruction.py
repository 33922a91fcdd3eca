"""The work of ``fmu-fit reconstruct``, once its words are read."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import fitting as ff
from fitting.api.choices import STYLES, usual_budget
from fitting.api.cost import expected_of
from fitting.api.fitted import KeptLevels, Valued, kept_levels, search_options
from fitting.api.jobs import DrawnBeside, check_style, draw_report, drawn_beside
from fitting.api.problem import Campaign
from fitting.api.written import RESULT_FILES
from fitting.cli.running.campaign_fmu import fmu_for
from fitting.cli.running.interrupts import to_the_end
from fitting.cli.running.laps import Laps
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import status_line
from fitting.cli.running.remaining import Remaining, counted
from fitting.cli.words.again import command_again
from fitting.cli.words.drive import flag
from fitting.report.details import detail_lines
from fitting.report.screen import line_item, printed_lines
from fitting.report.summary import result_lines
from fitting.result.assembly import without_profiles
from fitting.result.external import check_external, with_external
from fitting.result.result import Result, write_result
from fitting.text.errors import NoScale, OutOfBudget
from fitting.text.results_folder import remove_earlier
from fitting.text.scratch import Scratch

NAME = "reconstruct"
#: Exit code by how the fit ended; any other ending is 1.
EXIT_CODES = {"converged": 0, "does not describe the data": 4}
#: What goes with the result that it belongs to.
PASSING = (*RESULT_FILES, "fmu/*.fmu")


def reconstruct(args: argparse.Namespace, out: Path, laps: Laps) -> int:
    """Reconstruct and write; 0 if converged, 4 if the data are not described, else 1.

    Args:
        args: of the command.
        out: folder of the results.
        laps: of the command, which is told where its parts end.

    Raises:
        BadInput: campaign, data or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    check_external(args.external)
    check_style("--style", args.style or STYLES[0])
    campaigns = [ff.read_campaign(path) for path in args.campaign]
    if args.dry_run:
        return _tell_cost(args, campaigns)
    # in another style this process draws alone
    with drawn_beside(not args.no_report and args.style in (None, STYLES[0])) as drawing:
        return _reconstructed(args, campaigns, out, _Course(laps, drawing))


class _Course(NamedTuple):
    """What goes along with the work: the clock of the command, and who draws beside it."""

    laps: Laps
    drawing: DrawnBeside | None


class _Solved(NamedTuple):
    """How it ended, the finished levels of the search, and what a drawing of it takes yet."""

    ended: _Ending
    memory: KeptLevels
    remaining: Remaining


def _reconstructed(
    args: argparse.Namespace, campaigns: Sequence[Campaign], out: Path, course: _Course
) -> int:
    ended, memory, remaining = _solved(args, campaigns, out, course)
    result = ended.result
    files = write_result(result, out)  # before anything else that may fail
    if args.external:
        result = with_external(result, args.external)
        write_result(result, out)
    hand_over(args, result)
    print("\n".join(result_lines(result)))
    if args.verbose:
        print("", *detail_lines(result), "", sep="\n")
    if not ended.done:
        remove_earlier(out, PASSING)
        print(line_item("continue", command_again(args)))
        return 1
    if args.no_report:
        print(line_item("results", str(files[0])))
    else:
        with status_line(NAME, remaining.left) as tell:
            tell(remaining.report())
            page = draw_report(
                ended.found,
                result,
                out,
                args.style or STYLES[0],
                lambda done, of: tell(remaining.drawing(done, of)),
                course.drawing,
            )
        hint = "" if args.verbose else "   (--verbose prints all that was found)"
        print(line_item("report", f"{page}{hint}"))
        course.laps.end("for the report")
    remove_earlier(out, PASSING)
    memory.remove()  # when all is done that may be killed
    if args.verbose:
        print(course.laps.words)
    return EXIT_CODES.get(result.status, 1)


def _solved(
    args: argparse.Namespace, campaigns: Sequence[Campaign], out: Path, course: _Course
) -> _Solved:
    """The fit and its inference.

    Raises:
        KeyboardInterrupt: before there was a result; says how to go on from what is kept.
    """
    with fmu_for(campaigns, out, args.workers, isolate=args.isolate) as fmu:
        problem = ff.Problem.of(campaigns, fmu, accuracy=args.accuracy, start=args.start)
        check_external(args.external, _units(problem))
        course.laps.end("to begin")
        memory, remaining = _memory(args, problem, out), _remaining(args, problem)
        try:
            with status_line(NAME, lambda: counted(remaining, fmu.workers.counts.runs)) as tell:
                job = _Reconstruction(problem, out, memory, tell, remaining, course)
                return _Solved(_ending(args, job), memory, remaining)
        except KeyboardInterrupt:
            way_on = _way_on(args, memory)
            raise KeyboardInterrupt(f"interrupted{way_on}" if way_on else "") from None
        except NoScale as refused:
            named = ", ".join(str(path) for path in args.campaign)
            raise ff.BadInput(f"{named}: {refused}") from None
        except ff.FmuFailure as failure:
            if way_on := _way_on(args, memory):
                failure.add_note(way_on.removeprefix("; "))
            raise


def _tell_cost(args: argparse.Namespace, campaigns: Sequence[Campaign]) -> int:
    """What the job will cost; a model of this project is built where it does not stay."""
    with (
        Scratch() as folder,
        fmu_for(campaigns, folder, args.workers, isolate=args.isolate) as fmu,
        status_line(NAME, lambda: f"{fmu.workers.counts.runs} runs") as tell,
    ):
        tell("planning")
        problem = ff.Problem.of(campaigns, fmu, accuracy=args.accuracy, start=args.start)
        found = ff.cost(
            problem,
            _method(args, problem),
            starts=_starts(args),
            profiles=not args.no_profiles,
            bootstrap=args.bootstrap or 0,
        )
    hand_over(args, found)
    budget = args.budget or usual_budget(found.runs_each)
    shown = budget if not args.no_profiles and budget < found.runs[1] else 0
    title = problem.record.title
    print(*printed_lines("cost", "reconstruct", title, found, shown, args.verbose), sep="\n")
    return 0


def _units(problem: ff.Problem) -> dict[str, str]:
    """Units of the values that there will be, by name."""
    record, variables = problem.record, problem.fmu.description.variables
    shared = {p.name: p.unit for p in record.parameters if not p.experiments}
    return shared | {name: variables[name].unit or "" for name in record.outputs}


@dataclass(frozen=True)
class _Reconstruction:
    """What is solved, where results and finished levels go, who is told of it, what goes along."""

    problem: ff.Problem
    out: Path
    memory: KeptLevels
    tell: Callable[[str], None]
    remaining: Remaining
    course: _Course


class _Ending(NamedTuple):
    """What was found, the result of it, and whether all that was asked for is done."""

    found: Valued
    result: Result
    done: bool


def _way_on(args: argparse.Namespace, memory: KeptLevels) -> str:
    """Where finished levels are kept: how to go on from them."""
    count = len(memory)
    return f"; {count} finished levels are kept, go on with: {command_again(args)}" * (count > 0)


def _method(args: argparse.Namespace, problem: ff.Problem) -> ff.Tikhonov:
    """As the campaign says, but for what the options change."""
    method = replace(ff.Tikhonov.of(problem.options), quick=args.quick)
    asked = {name: getattr(args, name) for name in ("misfit", "estimator")}
    return replace(method, **{name: value for name, value in asked.items() if value is not None})


def _starts(args: argparse.Namespace) -> int | None:
    return 1 if args.quick and args.starts is None else args.starts


def _remaining(args: argparse.Namespace, problem: ff.Problem) -> Remaining:
    expected = expected_of(
        problem,
        _method(args, problem),
        _starts(args),
        profiles=not args.no_profiles,
        refits=args.bootstrap or 0,
    )
    return Remaining(expected, drawn=not args.no_report)


def _memory(args: argparse.Namespace, problem: ff.Problem, out: Path) -> KeptLevels:
    """Finished levels of this very job: those of an interrupted run, or none yet."""
    options = search_options(problem, _method(args, problem), _starts(args), args.seed)
    memory = kept_levels(out, problem, options, _command(args), resume=args.resume)
    if args.resume:
        print(memory.resumed("levels"))
    return memory


def _ending(args: argparse.Namespace, job: _Reconstruction) -> _Ending:
    """Fit and infer; the fit is written before profiles are walked, which take most of the time."""
    job.tell("planning")
    method = _method(args, job.problem)
    found: Valued
    found = fitted = ff.fit(
        job.problem,
        method,
        starts=_starts(args),
        seed=args.seed,
        progress=lambda state: job.tell(job.remaining.searching(state)),
        memory=job.memory,
    )
    fitted.command = _command(args)
    with to_the_end():
        result = fitted.result
    job.course.laps.end("to fit")
    interrupted = fitted.status == "interrupted"
    if args.no_profiles or interrupted:
        return _Ending(found, result, not interrupted)
    done = False
    if job.course.drawing is not None:
        job.course.drawing.begin(fitted)
    try:
        with to_the_end():
            result = without_profiles(result, "pending")
            write_result(result, job.out)
        inferred = ff.profile(
            fitted,
            budget=args.budget,
            bootstrap=args.bootstrap or 0,
            progress=lambda spent: job.tell(job.remaining.walking(spent)),
        )
        with to_the_end():
            found, result, done = inferred, inferred.result, inferred.profiled
    except OutOfBudget:  # all there is to it: to go on would take as much again
        done = True
        result = without_profiles(fitted.result, "budget")
    except KeyboardInterrupt:
        pass
    job.course.laps.end("for the profiles")
    return _Ending(found, result, done)


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME, *(path.as_posix() for path in args.campaign)]
    for name in (
        "out",
        "workers",
        "accuracy",
        "misfit",
        "estimator",
        "seed",
        "starts",
        "bootstrap",
        "start",
        "style",
        "budget",
    ):
        value = getattr(args, name)
        if value is not None:
            words += [f"--{name}", str(value)]
    for text in args.external:
        words += ["--external", text]
    flags = ("quick", "no_profiles", "no_report", "isolate", "resume")
    words += [flag(name, getattr(args, name)) for name in flags if getattr(args, name)]
    return shlex.join(words)
