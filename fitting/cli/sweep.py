"""``fmu-fit sweep``: the FRF of an FMU, upwards, downwards or both, as CSV and figure.

The tone is moved while the FMU runs, so that a branch is followed to its end.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import fitting as ff
from fitting.api.written import SWEEP_FILES
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
from fitting.cli.words.values import positive_quantity, whole_number

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
    add_fmu(parser)
    parser.add_argument("--from", dest="low", required=True, metavar="F", help='as "6.94 MHz"')
    parser.add_argument("--to", dest="high", required=True, metavar="F", help='as "6.941 MHz"')
    parser.add_argument(
        "--points", type=whole_number(2), default=101, help="evenly spaced frequencies (101)"
    )
    parser.add_argument("--direction", choices=DIRECTIONS, default="up", help="which way (up)")
    add_start_values(parser, 'A1="0.3 m/s2"')
    parser.add_argument("--tone", default="u1", help="tunable FMU parameter that is moved (u1)")
    parser.add_argument("--output", help="output to read (the first continuous one)")
    add_settle(parser, "time at each point")
    parser.add_argument(
        "--accuracy",
        type=_accuracy,
        help="of the amplitudes, relative to the largest: plans settling, solver and samples "
        "(1e-4)",
    )
    add_work(parser)
    add_timeout(parser, 600.0, "longest run, that is all points one way")
    add_isolate(parser)
    parser.add_argument("--out", type=Path, required=True, help="folder for CSV file and figure")


@writes(NAME, *SWEEP_FILES)
def run(args: argparse.Namespace) -> int:
    """Sweep and write; returns 0, or 1 if the response did not become steady.

    Raises:
        BadInput: names, values, units or frequencies do not fit the FMU or each other.
        FmuFailure: the FMU failed.
    """
    from fitting.report.documents import sweep_document
    from fitting.report.screens import Ran, sweep_lines

    with fmu_of(args) as fmu, complaints_of_options():
        values = start_values(args.set, fmu)
        directions = DIRECTIONS[args.direction]
        with status_line(NAME) as show:
            show(f"{args.points} points, {' and '.join(directions)}")
            response = fmu.sweep(
                _frequencies_hz(args),
                values,
                tone=args.tone,
                output=args.output or "",
                directions=directions,
                accuracy=ff.Accuracy(args.accuracy, settle_s=args.settle, work=args.work),
            )
        files = fmu.write(response, args.out)
        output = response.sweep.output
        unit = units_of(fmu, [output])[output]
        hand_over(args, sweep_document(response, unit))
        ran = Ran(
            model=fmu.description.model_name,
            warnings=fmu.warnings,
            others=fmu.other_tones((args.tone,), values),
            files=files,
        )
        print(*sweep_lines(response, unit, ran, verbose=args.verbose), sep="\n")
    return 0 if response.steady else 1


def _frequencies_hz(args: argparse.Namespace) -> list[float]:
    """Evenly spaced, in decimals: what is given in MHz is not to be off by a rounding."""
    low, high = (
        positive_quantity(text, "Hz", where=option)
        for text, option in ((args.low, "--from"), (args.high, "--to"))
    )
    if not low < high:
        raise ff.BadInput(
            f"--from {args.low!r} and --to {args.high!r}: wanted a rising range "
            "(--direction down takes it downwards)"
        )
    step = (high - low) / (args.points - 1)
    return [float(f"{min(low + k * step, high):.12g}") for k in range(args.points)]


def _accuracy(text: str) -> float:
    """An argparse type: a relative accuracy that doubles can keep."""
    try:
        accuracy = float(text)
    except ValueError:
        accuracy = 0.0
    if not 1e-12 <= accuracy < 1.0:
        raise ff.BadInput(f"--accuracy: found {text!r}, wanted 1e-12 to 1")
    return accuracy
