"""``fmu-fit simulate``: one drive through an FMU, to CSV and figures."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import fitting as ff
from fitting.api.written import DRIVE_FILES
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import status_line
from fitting.cli.running.results import writes
from fitting.cli.words.drive import (
    add_fmu,
    add_isolate,
    add_settle,
    add_start_values,
    add_timeout,
    add_work,
    complaints_of_options,
    fmu_of,
    start_values,
    units_of,
)
from fitting.cli.words.values import (
    positive_quantity,
    positive_time,
    quantity,
    relative_accuracy,
    whole_number,
)

NAME = "simulate"
DOCUMENT = "the response, or the plan,"
EXAMPLE = 'fmu-fit simulate CoupledOscillator --set u1="6.94018 MHz" --out out/two-tone'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    add_fmu(parser)
    parser.add_argument("--out", type=Path, help="folder for CSV files and figures")
    _add_plan_arguments(parser)
    add_start_values(parser, 'u1="6.94016 MHz"')
    parser.add_argument("--outputs", help="outputs, comma between (the first continuous one)")
    parser.add_argument(
        "--tones",
        help="FMU parameters that hold the drive frequencies, comma between "
        "(u1 and u2 where the FMU has them)",
    )
    parser.add_argument("--input", help="FMU input to drive, where no parameters hold the tones")
    parser.add_argument("--drive", help='drive frequencies for --input, as "280 Hz, 281 Hz"')
    parser.add_argument(
        "--level", help='amplitude of each tone of --input, as "2 N" (1 in the unit of the input)'
    )
    parser.add_argument(
        "--steps-per-period",
        type=whole_number(4),
        default=100,
        help="held steps of --input in a period (100)",
    )
    add_settle(parser, "time before sampling")
    parser.add_argument(
        "--window",
        type=positive_time("--window"),
        metavar="TIME",
        help="time sampled (some common periods)",
    )
    parser.add_argument(
        "--samples", type=whole_number(1), help="samples in the window (by the band)"
    )
    add_work(parser)
    add_timeout(parser, 60.0, "longest run")
    add_isolate(parser)


def _add_plan_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--accuracy",
        type=relative_accuracy("--accuracy"),
        help="wanted relative accuracy of the amplitudes at the tones: plans settling, window, "
        "solver and model, and prints the error that is admitted (1e-6)",
    )
    parser.add_argument("--plan", action="store_true", help="only print the plan")
    for name, what in (("force", "take"), ("forbid", "do not take")):
        parser.add_argument(
            f"--{name}",
            action="append",
            default=[],
            metavar="NAME",
            help=f"{what} this reduction of the model, whatever it costs",
        )


@writes(NAME, *DRIVE_FILES)
def run(args: argparse.Namespace) -> int:
    """Simulate and write; returns 0, or 1 if the accuracy could not be promised.

    Raises:
        BadInput: names, values, units or times do not fit the FMU or each other.
        FmuFailure: the FMU failed.
    """
    from fitting.report.documents import drive_document, plan_document
    from fitting.report.screens import Ran, drive_lines, plan_lines, unsteady_words

    if args.out is None and not args.plan:
        raise ff.BadInput("--out: is missing, wanted a folder (or --plan, which writes nothing)")
    with fmu_of(args) as fmu, complaints_of_options():
        values = start_values(args.set, fmu)
        requested = _requested(args, fmu)
        model = fmu.description.model_name
        if args.plan:
            with status_line(NAME):
                plan = fmu.plan(values, **requested)
            hand_over(args, plan_document(plan))
            print(*plan_lines(model, plan, verbose=args.verbose), sep="\n")
            return 0 if plan.budget.kept else 1
        with status_line(NAME):
            response = fmu.simulate(values, **requested)
        files = fmu.write(response, args.out)
        units = units_of(fmu, response.drive.outputs)
        hand_over(args, drive_document(response, units))
        advice, named = "", not response.steady and args.input is None
        if not (response.steady or (response.remainder.explained and response.plan.settles)):
            sideband = fmu.sideband(response)
            undamped = () if sideband is not None else fmu.missing_damping(response)
            advice = unsteady_words(response, sideband, list(fmu.variables), undamped)
        others = fmu.other_tones(response.drive.names, response.drive.start_values)
        ran = Ran(model=model, warnings=fmu.warnings, others=others if named else (), files=files)
        lines = drive_lines(response, units, ran, advice=advice, verbose=args.verbose)
        print(*lines, sep="\n")
    return 0 if response.steady else 1


def _requested(args: argparse.Namespace, fmu: ff.Fmu) -> dict[str, Any]:
    """The arguments of `Fmu.simulate` but for the start values."""
    if (args.input is None) != (args.drive is None):
        raise ff.BadInput("--input and --drive: found one of them, wanted both or none")
    requested: dict[str, Any] = {
        "outputs": _listed(args.outputs),
        "accuracy": ff.Accuracy(
            args.accuracy,
            settle_s=args.settle,
            window_s=args.window,
            samples=args.samples,
            force=args.force,
            forbid=args.forbid,
            work=args.work,
        ),
    }
    if args.input is not None:
        requested["drive"] = _drive(args, fmu)
        requested["tones"] = [quantity(f, "Hz", where="--drive") for f in _listed(args.drive)]
    elif args.level is not None:
        raise ff.BadInput("--level: is for --input, wanted --set with the amplitudes of the tones")
    elif _listed(args.tones):
        requested["tones"] = _listed(args.tones)
    return requested


def _drive(args: argparse.Namespace, fmu: ff.Fmu) -> ff.Drive:
    unit = fmu.description.variable(args.input).unit or "1"
    level = 1.0 if args.level is None else positive_quantity(args.level, unit, where="--level")
    return ff.Drive(input=args.input, amplitude=level, samples_per_period=args.steps_per_period)


def _listed(text: str | None) -> tuple[str, ...]:
    return tuple(word.strip() for word in (text or "").split(",") if word.strip())
