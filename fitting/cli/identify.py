"""``fmu-fit identify``: what a campaign's data determine, before or after a fit."""

from __future__ import annotations

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.api.progress import status_line
from fitting.cli.running.campaigns import command_line, fit_at, fmu_for
from fitting.cli.running.output import hand_over, writes
from fitting.cli.words.options import (
    USUAL_BUDGET,
    Options,
    assigned,
    declare,
    folder_names,
    several,
)
from fitting.text.results_folder import remove_earlier

NAME = "identify"
EXAMPLE = "fmu-fit identify string_q1/campaign.toml --out out/identify_q1"
JSON_NAME = "identify.json"
DOCUMENT = JSON_NAME
FILES = (JSON_NAME, "report.html", "figures/[0-9]*_*.*")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    alone = "also by measurements at this setting alone, as depth=0; may be repeated"
    options: Options = {
        "campaign": {},
        "--out": "folder for results (out/identify_<its folder>)",
        "--at": "a fit to start from (the campaign's start and reference values)",
        "--changed-data": {},
        "--expected": "instead of the measured the expected data there, with their noise",
        "--bootstrap": "refit N synthetic data sets (none)",
        "--beside": several(alone, "NAME=VALUE"),
        "--seed": {"default": 1, "help": "seed of starts and bootstrap (1)"},
        "--budget": f"FMU runs for profiles, about; incomplete ones are marked ({USUAL_BUDGET})",
        "--workers": {},
        "--no-report": {},
    }
    declare(parser, options)


def _out(args: argparse.Namespace) -> Path:
    return args.out or Path("out") / f"identify_{folder_names(args.campaign)}"


@writes(NAME, *FILES, to=_out)
def run(args: argparse.Namespace) -> int:
    """Identify and write; returns 0.

    Raises:
        BadInput: campaign, result or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    from fitting.api.cost import expected, own_profiled
    from fitting.api.fitted import search_options
    from fitting.cli.running.remaining import Remaining, counted
    from fitting.report.identification import identification_lines, write_report
    from fitting.text.records import write_json

    settings: dict[str, float | str] = {**assigned("--beside", args.beside)}
    for name, text in settings.items():
        with suppress(ValueError):  # else it is no number; one is in the unit of the column
            settings[name] = float(text)
    campaign = ff.read_campaign(args.campaign)
    out = _out(args)
    fitted = fit_at(args)
    bootstrap = args.bootstrap or 0
    with fmu_for([campaign], out, args.workers) as fmu:
        problem = ff.Problem.of(campaign, fmu)
        # no search, but profiles of all values
        record, options = problem.record, search_options(problem, None, 1, None)
        own = own_profiled(record)
        whole = expected(record, options, profiles=True, refits=bootstrap, own=own)
        remaining = Remaining(whole, drawn=not args.no_report)
        with status_line(NAME, lambda: counted(remaining, fmu.workers.counts.runs)) as show:
            result = ff.identify(
                problem,
                fitted,
                expected=args.expected,
                seed=args.seed,
                budget=args.budget,
                bootstrap=bootstrap,
                settings=settings,
                progress=lambda spent: show(remaining.profiling(spent)),
            )
    result = replace(
        result,
        at=result.at if fitted is None else args.at.as_posix(),
        provenance={"command": command_line(args), **result.provenance},
    )
    write_json(out / JSON_NAME, result)
    hand_over(args, result)
    files = [out / JSON_NAME]
    if not args.no_report:
        with status_line(NAME) as show:
            show("figures and report")
            files.append(write_report(result, out))
    print(*identification_lines(result, files, verbose=args.verbose), sep="\n")
    remove_earlier(out, (*FILES, "fmu/*.fmu"))
    return 0
