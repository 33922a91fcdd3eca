"""The work of ``fmu-fit reconstruct``, once its words are read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import fitting as ff
from fitting.api.cost import expected
from fitting.api.early import RESULT_FILES
from fitting.api.fitted import Spent, Valued, kept_levels, search_options
from fitting.api.jobs import check_style, draw_report
from fitting.api.problem import Campaign
from fitting.api.progress import status_line
from fitting.cli.running.campaigns import command_again, command_line, fmu_for
from fitting.cli.running.interrupts import to_the_end
from fitting.cli.running.output import hand_over
from fitting.cli.running.remaining import Remaining, counted
from fitting.report.screen import line_item, printed_lines
from fitting.report.summary import detail_lines, result_lines
from fitting.result.assembly import without_profiles
from fitting.result.external import check_external, with_external
from fitting.result.result import Result, write_result
from fitting.text.choices import LIKELIHOOD, STYLES, usual_budget
from fitting.text.errors import NoScale, OutOfBudget
from fitting.text.results_folder import remove_earlier
from fitting.text.scratch import Scratch

NAME = "reconstruct"
#: Exit code by how the fit ended; any other ending is 1.
EXIT_CODES = {"converged": 0, "does not describe the data": 4}
#: What goes with the result that it belongs to.
PASSING = (*RESULT_FILES, "fmu/*.fmu")


def reconstruct(args: argparse.Namespace, out: Path) -> int:
    """Reconstruct and write; 0 if converged, 4 if the data are not described, else 1.

    Args:
        args: of the command.
        out: folder of the results.

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
    with fmu_for(campaigns, out, args.workers, isolate=args.isolate, native=args.native) as fmu:
        problem = ff.Problem.of(campaigns, fmu, accuracy=args.accuracy, start=args.start)
        record, variables = problem.record, fmu.variables
        units = {p.name: p.unit for p in record.parameters if not p.experiments}
        units |= {name: variables[name].unit or "" for name in record.outputs}
        check_external(args.external, units)
        # the finished levels of this very job, or none yet
        method, starts = _method(args, problem), _starts(args)
        options = search_options(problem, method, starts, args.seed)
        memory = kept_levels(out, problem, options, resume=args.resume)
        if args.resume:
            print(memory.resumed())
        profiles, refits = not args.no_profiles, args.bootstrap or 0
        whole = expected(record, options, profiles=profiles, refits=refits)
        remaining = Remaining(whole, drawn=not args.no_report)
        try:
            with status_line(NAME, lambda: counted(remaining, fmu.workers.counts.runs)) as show:
                show("planning")
                fitted = ff.fit(
                    problem,
                    method,
                    starts=starts,
                    seed=args.seed,
                    progress=lambda state: show(remaining.searching(state)),
                    memory=memory,
                )
                fitted.command = command_line(args)
                with to_the_end():
                    outcome = Outcome(fitted, fitted.result, fitted.status != "interrupted")
                if profiles and outcome.is_complete:
                    outcome = _profiled(
                        args, out, fitted, lambda spent: show(remaining.profiling(spent))
                    )
        except NoScale as refused:
            named = ", ".join(str(path) for path in args.campaign)
            raise ff.BadInput(f"{named}: {refused}") from None
        except (KeyboardInterrupt, ff.FmuFailure) as failure:
            kept = f"{len(memory)} finished levels are kept, go on with: {command_again(args)}"
            if isinstance(failure, KeyboardInterrupt):
                raise KeyboardInterrupt(f"interrupted; {kept}" if len(memory) else "") from None
            if len(memory):
                failure.add_note(kept)
            raise
    _report(args, out, outcome)
    if not outcome.is_complete:
        return 1
    memory.remove()  # when all is done that may be killed
    return EXIT_CODES.get(outcome.result.status, 1)


class Outcome(NamedTuple):
    """What was fitted, its result, and whether all that was asked for is done."""

    valued: Valued
    result: Result
    is_complete: bool


def _profiled(
    args: argparse.Namespace, out: Path, fitted: ff.Fit, progress: Callable[[Spent], None]
) -> Outcome:
    """Profiles of a fit, which is written before them: they take most of the time."""
    outcome = Outcome(fitted, fitted.result, False)
    try:
        with to_the_end():
            outcome = Outcome(fitted, without_profiles(fitted.result, "pending"), False)
            write_result(outcome.result, out)
        inferred = ff.profile(
            fitted, budget=args.budget, bootstrap=args.bootstrap or 0, progress=progress
        )
        with to_the_end():
            outcome = Outcome(inferred, inferred.result, inferred.profiled)
    except OutOfBudget:  # all there is to it: to go on would take as much again
        outcome = Outcome(fitted, without_profiles(fitted.result, "budget"), True)
    except KeyboardInterrupt:  # what there is by now is reported
        pass
    return outcome


def _report(args: argparse.Namespace, out: Path, outcome: Outcome) -> None:
    """Files, first screen and report of a result."""
    result = outcome.result
    files = write_result(result, out)  # before anything else that may fail
    if args.external:
        result = with_external(result, args.external)
        write_result(result, out)
    hand_over(args, result)
    print(*result_lines(result), sep="\n")
    if args.verbose:
        print("", *detail_lines(result), "", sep="\n")
    if not outcome.is_complete:
        print(line_item("continue", command_again(args)))
    elif args.no_report:
        print(line_item("results", str(files[0])))
    else:
        with status_line(NAME) as show:
            show("figures and report")
            page = draw_report(
                outcome.valued,
                result,
                out,
                args.style or STYLES[0],
                lambda done, of: show(f"figure {done + 1} of {of}" if done < of else "report"),
                args.formats,
            )
        hint = "" if args.verbose else "   (--verbose prints all that was found)"
        print(line_item("report", f"{page}{hint}"))
    remove_earlier(out, PASSING)


def _print_cost(args: argparse.Namespace, campaigns: Sequence[Campaign]) -> int:
    """What the job will cost; a model of this project is built where it does not stay."""
    with (
        Scratch() as folder,
        fmu_for(campaigns, folder, args.workers, isolate=args.isolate, native=args.native) as fmu,
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
