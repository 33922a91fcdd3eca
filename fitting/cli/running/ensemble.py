"""The work of ``fmu-fit ensemble``, once its words are read."""

from __future__ import annotations

import argparse
import shlex
import time
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.api.ensemble import Progress, finished_items, first_campaign
from fitting.cli.ensemble import NAME, USUAL
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import status_line
from fitting.cli.words.again import command_again
from fitting.cli.words.drive import complaints_of_options
from fitting.cli.words.values import bounded_number, default_workers
from fitting.report.ensemble import document
from fitting.report.screen import printed_lines
from fitting.report.screens import ensemble_lines
from fitting.result.ensemble import FINISHED
from fitting.text.results_folder import remove_earlier
from fitting.text.scratch import Scratch


def fit_all(args: argparse.Namespace) -> int:
    """Fit all items and write; 0 if every item has a fit, else 1.

    Args:
        args: of the command.

    Raises:
        BadInput: see `fitting.api.ensemble.ensemble`.
    """
    last: list[Progress] = []
    begun = time.monotonic()
    with status_line(NAME) as tell, complaints_of_options():

        def follow(state: Progress) -> None:
            last[:] = [state]
            tell(_where(state, time.monotonic() - begun))

        found = ff.ensemble(
            _of(args),
            args.fmu,
            _options(args),
            executor=args.scheduler or args.workers,
            out=args.out,
            progress=follow,
        )
        tell("tables, figure and report")
        found = replace(found, provenance={**found.provenance, "command": _command(args)})
        # who asks for an end waits for no figure
        drawn = found.status == FINISHED and not args.no_report
        files = ff.write_ensemble(found, args.out, drawn=drawn)
    remove_earlier(args.out, ("fmu/*.fmu",))
    hand_over(args, document(found))
    ended = found.status == FINISHED
    lines = ensemble_lines(
        found,
        files,
        resumed=last[-1].resumed if args.resume and last else 0,
        again="" if ended else command_again(args),
    )
    print(*lines, sep="\n")
    return 1 if found.failures or not ended else 0


def tell_cost(args: argparse.Namespace) -> int:
    """Tell what the ensemble will cost, by the plan of its first item; nothing is written.

    Args:
        args: of the command.

    Raises:
        BadInput: the first item cannot be planned.
        FmuFailure: the FMU failed.
    """
    done = 0
    with Scratch() as folder, status_line(NAME) as tell:
        tell("planning the first item")
        path, fmu, count = first_campaign(_of(args), args.fmu, folder)
        with fmu:
            problem = ff.Problem.of(path, fmu)
            method = replace(ff.Tikhonov.of(problem.options), quick=args.quick)
            starts = 1 if args.quick and args.starts is None else args.starts
            cost = ff.cost(problem, method, starts=starts, profiles=not args.no_profiles)
        if args.resume:
            done = finished_items(_of(args), args.fmu, _options(args), args.out, folder)
    hand_over(args, cost)
    left = count - done
    whole, workers = None, 1
    if left and args.scheduler is None:
        workers = min(args.workers or default_workers(), left)
        whole = tuple(left * seconds / workers for seconds in cost.seconds)
    fewer = bool(args.value)
    print(*printed_lines("cost", "ensemble", cost, count, done, fewer, whole, workers), sep="\n")
    return 0


def _of(args: argparse.Namespace) -> ff.Laboratories | list[Path]:
    truth = args.series or args.like
    if truth is None:
        campaigns: list[Path] = args.campaigns
        return campaigns
    first = 1 if args.seed is None else args.seed
    return ff.Laboratories(truth, args.laboratories or USUAL, first, _changes(args.change))


def _changes(words: list[str]) -> dict[str, float]:
    """Numbers of the laboratories by name; whole ones stay whole."""
    changes: dict[str, float] = {}
    for word in words:
        name, _, text = word.partition("=")
        try:
            value = bounded_number(text)
        except argparse.ArgumentTypeError as error:
            raise ff.BadInput(f"--change {word}: {error}; wanted NAME=NUMBER") from None
        changes[name.strip()] = int(value) if text.strip().lstrip("+-").isdigit() else value
    return changes


def _options(args: argparse.Namespace) -> ff.EnsembleOptions:
    return ff.EnsembleOptions(
        values=args.value,
        profiles=not args.no_profiles,
        starts=args.starts,
        quick=args.quick,
        resume=args.resume,
    )


def _where(state: Progress, passed_s: float) -> str:
    """How far it is, and at this pace how long it still takes."""
    words = f"{state.done} of {state.total} items"
    words += f", {state.failed} without a fit" if state.failed else ""
    now = state.done - state.resumed
    left = state.total - state.done
    if now and left:
        seconds = passed_s / now * left
        words += (
            f", about {seconds:.0f} s left"
            if seconds < 120.0
            else (f", about {seconds / 60.0:.0f} min left")
        )
    return words


def _command(args: argparse.Namespace) -> str:
    """The command without where it runs: the same fits made elsewhere are the same bytes."""
    words = ["fmu-fit", NAME, *(path.as_posix() for path in args.campaigns)]
    for name in ("series", "like", "laboratories", "seed", "fmu", "starts"):
        value = getattr(args, name)
        if value is not None:
            words += [f"--{name}", value.as_posix() if isinstance(value, Path) else str(value)]
    for change in args.change:
        words += ["--change", change]
    for name in args.value:
        words += ["--value", name]
    words += ["--quick"] if args.quick else []
    words += ["--no-profiles"] if args.no_profiles else []
    return shlex.join(words)
