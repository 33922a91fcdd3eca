"""``fmu-fit sweep``: the FRF of an FMU, upwards, downwards or both, as CSV and figure.

The tone is moved while the FMU runs, so that a branch is followed to its end.
"""

from __future__ import annotations

import argparse

import fitting as ff
from fitting.api.early import SWEEP_FILES
from fitting.api.progress import status_line
from fitting.cli.running.campaigns import complaints_of_options, fmu_of
from fitting.cli.running.output import hand_over, writes
from fitting.cli.words.options import (
    ISOLATE,
    START_VALUE,
    Options,
    assigned,
    declare,
    one_of,
    rising_range,
    several,
    value,
    whole_number,
)

NAME = "sweep"
DOCUMENT = "the response"
EXAMPLE = (
    'fmu-fit sweep DuffingOscillator --from "6.94 MHz" --to "6.9408 MHz" --points 161 '
    "--direction both --out out/sweep"
)
BOTH = ("up", "down")
DIRECTIONS = {"up": BOTH[:1], "down": BOTH[1:], "both": BOTH}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    frequency = {"required": True, "metavar": "F"}
    options: Options = {
        "fmu": {},
        "--interface": {},
        "--from": {"dest": "low", "help": 'as "6.94 MHz"', **frequency},
        "--to": {"dest": "high", "help": 'as "6.941 MHz"', **frequency},
        "--points": value("evenly spaced frequencies (101)", read=whole_number(2), default=101),
        "--direction": one_of(DIRECTIONS, "which way (up)", default="up"),
        "--set": several(START_VALUE.format('A1="0.3 m/s2"'), "NAME=VALUE"),
        "--tone": value("tunable FMU parameter that is moved (u1)", default="u1"),
        "--output": value("output to read (the first continuous one)"),
        "--settle": "time at each point (default: until steady)",
        "--accuracy": "of amplitudes over the largest, for settling, solver and samples (1e-4)",
        "--work": {},
        "--timeout": {"default": 600.0, "help": "longest run, that is all points one way (600 s)"},
        **ISOLATE,
        "--native": {},
        "--out": {"required": True, "help": "folder for CSV file and figure"},
    }
    declare(parser, options)


@writes(NAME, *SWEEP_FILES)
def run(args: argparse.Namespace) -> int:
    """Sweep and write; returns 0, or 1 if the response did not become steady.

    Raises:
        BadInput: names, values, units or frequencies do not fit the FMU or each other.
        FmuFailure: the FMU failed.
    """
    from fitting.report.simulation import Ran, sweep_document, sweep_lines

    with fmu_of(args) as fmu, complaints_of_options():
        values = assigned("--set", args.set)
        directions = DIRECTIONS[args.direction]
        ends = rising_range(args, "Hz", " (--direction down takes it downwards)")
        low, high = (end for end in ends if end is not None)  # both are required
        step = (high - low) / (args.points - 1)
        # in decimals: what is given in MHz is not to be off by a rounding
        grid_hz = [float(f"{min(low + k * step, high):.12g}") for k in range(args.points)]
        with status_line(NAME) as show:
            show(f"{args.points} points, {' and '.join(directions)}")
            response = fmu.sweep(
                grid_hz,
                values,
                tone=args.tone,
                output=args.output or "",
                directions=directions,
                accuracy=ff.Accuracy(args.accuracy, settle_s=args.settle, work=args.work),
            )
        files = fmu.write(response, args.out)
        output = response.sweep.output
        unit = fmu.variables[output].unit or ""
        hand_over(args, sweep_document(response, unit))
        given = {name: response.sweep.start_values[name] for name in values}
        ran = Ran(
            model=fmu.description.model_name,
            warnings=fmu.warnings,
            others=fmu.other_tones((args.tone,), given),
            files=files,
        )
        print(*sweep_lines(response, unit, ran, verbose=args.verbose), sep="\n")
    return 0 if response.steady else 1
