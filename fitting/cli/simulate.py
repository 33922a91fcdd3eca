"""``fmu-fit simulate``: one drive through an FMU, to CSV and figures."""

from __future__ import annotations

import argparse
from typing import Any

import fitting as ff
from fitting.api.early import DRIVE_FILES
from fitting.api.progress import status_line
from fitting.cli.running.campaigns import complaints_of_options, fmu_of
from fitting.cli.running.output import hand_over, writes
from fitting.cli.words.options import (
    ISOLATE,
    START_VALUE,
    Options,
    assigned,
    declare,
    listed,
    positive_quantity,
    positive_time,
    quantity,
    several,
    value,
    whole_number,
)

NAME = "simulate"
DOCUMENT = "the response, or the plan,"
EXAMPLE = 'fmu-fit simulate CoupledOscillator --set u1="6.94018 MHz" --out out/two-tone'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    options: Options = {
        "fmu": {},
        "--interface": {},
        "--out": "folder for CSV files and figures",
        "--accuracy": "relative accuracy of the amplitudes at the tones, for the plan (1e-6)",
        "--plan": "only print the plan",
        "--force": several("use this reduction of the model", "NAME"),
        "--forbid": several("do not use this reduction of the model", "NAME"),
        "--set": several(START_VALUE.format('u1="6.94016 MHz"'), "NAME=VALUE"),
        "--outputs": value("outputs, comma between (the first continuous one)"),
        "--tones": value(
            "FMU parameters of the drive frequencies, comma between (u1 and u2 if the FMU has them)"
        ),
        "--input": value("FMU input to drive instead of parameters"),
        "--drive": value('drive frequencies for --input, as "280 Hz, 281 Hz"'),
        "--level": value('amplitude of each tone of --input, as "2 N" (1 in its unit)'),
        "--steps-per-period": value(
            "held steps of --input in a period (100)", read=whole_number(4), default=100
        ),
        "--settle": "time before sampling (default: until steady)",
        "--window": value("time sampled (some common periods)", "TIME", positive_time("--window")),
        "--samples": value("samples in the window (by the band)", read=whole_number(1)),
        "--work": {},
        "--timeout": {"default": 60.0, "help": "longest run (60 s)"},
        **ISOLATE,
        "--native": {},
    }
    declare(parser, options)


@writes(NAME, *DRIVE_FILES)
def run(args: argparse.Namespace) -> int:
    """Simulate and write; returns 0, or 1 if the accuracy could not be promised.

    Raises:
        BadInput: names, values, units or times do not fit the FMU or each other.
        FmuFailure: the FMU failed.
    """
    from fitting.report.screen import phrase
    from fitting.report.simulation import (
        Ran,
        drive_document,
        drive_lines,
        plan_document,
        plan_lines,
    )

    if args.out is None and not args.plan:
        raise ff.BadInput("--out: is missing, wanted a folder (or --plan, which writes nothing)")
    with fmu_of(args) as fmu, complaints_of_options():
        values = assigned("--set", args.set)
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
        units = {name: fmu.variables[name].unit or "" for name in response.drive.outputs}
        hand_over(args, drive_document(response, units))
        advice, named = "", not response.steady and args.input is None
        if not (response.steady or (response.remainder.explained and response.plan.settles)):
            sideband = fmu.sideband(response)
            undamped = () if sideband is not None else fmu.missing_damping(response)
            names = list(fmu.variables)
            advice = phrase("simulation", "unsteady", response, sideband, names, undamped)
        others = fmu.other_tones(response.drive.names, response.drive.start_values)
        ran = Ran(model=model, warnings=fmu.warnings, others=others if named else (), files=files)
        lines = drive_lines(response, units, ran, advice=advice, verbose=args.verbose)
        print(*lines, sep="\n")
    return 0 if response.steady else 1


def _requested(args: argparse.Namespace, fmu: ff.Fmu) -> dict[str, Any]:
    """The arguments of `Fmu.simulate` but for the start values."""
    if (args.input is None) != (args.drive is None):
        raise ff.BadInput("--input and --drive: found one of them, wanted both or none")
    accuracy = ff.Accuracy(
        args.accuracy,
        settle_s=args.settle,
        window_s=args.window,
        samples=args.samples,
        force=args.force,
        forbid=args.forbid,
        work=args.work,
    )
    requested: dict[str, Any] = {"outputs": listed(args.outputs), "accuracy": accuracy}
    if args.input is None:
        if args.level is not None:
            wanted = "wanted --set with the amplitudes of the tones"
            raise ff.BadInput(f"--level: is for --input, {wanted}")
        return requested | ({"tones": listed(args.tones)} if listed(args.tones) else {})
    unit = fmu.description.variable(args.input).unit or "1"
    level = 1.0 if args.level is None else positive_quantity(args.level, unit, where="--level")
    steps = args.steps_per_period
    requested["drive"] = ff.Drive(input=args.input, amplitude=level, samples_per_period=steps)
    requested["tones"] = [quantity(f, "Hz", where="--drive") for f in listed(args.drive)]
    return requested
