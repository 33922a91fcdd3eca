"""``fmu-fit sweep``: the FRF of an FMU, upwards, downwards or both, as CSV and figure.

The tone is moved while the FMU runs, so that a branch is followed to its end.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fitting.cli.drive_options import first_output, other_tones, start_values
from fitting.cli.options import positive_quantity, positive_time, quantity, whole_number
from fitting.cli.progress import status_line
from fitting.cli.results import writes
from fitting.fmu import FmuDescription, FmuWorkers
from fitting.simulate.budget import Kind
from fitting.simulate.frf import (
    DIRECTIONS,
    USUAL_SWEEP_ACCURACY,
    Sweep,
    SweepResponse,
    plan_sweep,
    take_sweep,
)
from fitting.simulate.words import difference_in_words, plan_in_words, warnings_in_words
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.notation import hertz
from fitting.text.units import same_kind

NAME = "sweep"
EXAMPLE = (
    'fmu-fit sweep build/DuffingOscillator.fmu --from "6.94 MHz" --to "6.9408 MHz" --points 161 '
    "--direction both --out out/sweep"
)
BOTH = "both"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument("fmu", type=Path, metavar="FMU", help="the file (FMI 2.0 or 3.0)")
    parser.add_argument("--from", dest="low", required=True, metavar="F", help='as "6.94 MHz"')
    parser.add_argument("--to", dest="high", required=True, metavar="F", help='as "6.941 MHz"')
    parser.add_argument(
        "--points", type=whole_number(2), default=101, help="evenly spaced frequencies (101)"
    )
    parser.add_argument(
        "--direction", choices=(*DIRECTIONS, BOTH), default="up", help="which way (up)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help='start value of a variable, as A1="0.3 m/s2"; a plain number is in its unit',
    )
    parser.add_argument("--tone", default="u1", help="tunable FMU parameter that is moved (u1)")
    parser.add_argument("--output", help="output to read (the first continuous one)")
    parser.add_argument("--settle", metavar="TIME", help="time at each point (found)")
    parser.add_argument(
        "--accuracy",
        type=float,
        default=USUAL_SWEEP_ACCURACY,
        help="of the amplitudes, relative to the largest: plans settling, solver and samples "
        f"({USUAL_SWEEP_ACCURACY:g})",
    )
    parser.add_argument(
        "--timeout",
        type=positive_time("--timeout"),
        default=600.0,
        metavar="TIME",
        help="longest run, that is all points one way (600 s)",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for CSV file and figure")


@writes(NAME, "sweep.csv", "sweep.png", "sweep.svg")
def run(args: argparse.Namespace) -> int:
    """Sweep and write; returns 0, or 1 if the response did not become steady.

    Raises:
        BadInput: names, values, units or frequencies do not fit the FMU or each other.
        FmuFailure: the FMU failed.
    """
    if not 1e-12 <= args.accuracy < 1.0:
        raise BadInput(f"--accuracy: found {args.accuracy!r}, wanted 1e-12 to 1")
    with FmuWorkers(args.fmu, timeout_s=args.timeout, timeout_name="--timeout") as workers:
        description = workers.description
        sweep, silenced = _sweep(args, description)
        with status_line(NAME) as tell:
            tell("planning")
            plan = plan_sweep(workers, sweep, args.accuracy, settle_s=_settling(args.settle))
            tell(f"{len(sweep.frequencies_hz)} points, {' and '.join(sweep.directions)}")
            result = take_sweep(workers, sweep, plan)
    print(*plan_in_words(plan.budget, "the largest"), sep="\n")
    for path in _write(result, description, args.out):
        print(path)
    print(*silenced, *_summary(result, description), sep="\n")
    for warning in workers.warnings:
        print(f"the FMU warns: {warning}")
    for text in warnings_in_words(plan.budget):
        print(f"warning: {text}")
    if result.steady:
        return 0
    if plan.budget.of(Kind.SETTLING)[0].bound > args.accuracy:
        print("not steady: wanted more damping, or a longer time at each point by --settle TIME")
    return 1


def _sweep(args: argparse.Namespace, description: FmuDescription) -> tuple[Sweep, list[str]]:
    """What to simulate, and what is to be said about it."""
    values = start_values(args.set, description)
    tone = description.variable(args.tone)
    unit = tone.unit or "1"
    if tone.kind != "Real" or not same_kind(unit, "Hz"):
        raise BadInput(f"--tone {tone.name}: its unit is {tone.unit!r}, wanted a frequency")
    if tone.name in values:
        raise BadInput(f"--set {tone.name}: is the tone that is moved, wanted --from and --to")
    low, high = (
        positive_quantity(text, "Hz", where=option)
        for text, option in ((args.low, "--from"), (args.high, "--to"))
    )
    if not low < high:
        raise BadInput(
            f"--from {args.low!r} and --to {args.high!r}: wanted a rising range "
            "(--direction down takes it downwards)"
        )
    silenced = _silence_others(tone.name, values, description)
    _settling(args.settle)
    output = args.output or first_output(description)[0]
    directions = DIRECTIONS if args.direction == BOTH else (args.direction,)
    grid = tuple(float(f"{f:.12g}") for f in np.linspace(low, high, args.points))
    return Sweep(
        start_values=values,
        tone=tone.name,
        tone_unit=unit,
        frequencies_hz=grid,
        output=output,
        directions=directions,
    ), silenced


def _settling(text: str | None) -> float | None:
    if text is None:
        return None
    settle_s = quantity(text, "s", where="--settle")
    if settle_s < 0.0:
        raise BadInput(f"--settle: found {text!r}, wanted a time of at least 0")
    return settle_s


def _silence_others(tone: str, values: dict[str, Scalar], description: FmuDescription) -> list[str]:
    """Other tones of the FMU do not drive in a sweep; refused where their amplitude was set."""
    said = []
    for name, amplitude in other_tones((tone,), values, description):
        if amplitude in values:
            raise BadInput(
                f"--set {amplitude}={values[amplitude]!r}: {name} would drive beside {tone}; "
                "wanted 0 in a sweep of one tone"
            )
        values[amplitude] = 0.0
        said.append(f"{amplitude} = 0: {name} does not drive in a sweep of {tone}")
    return said


def _write(result: SweepResponse, description: FmuDescription, out: Path) -> list[Path]:
    from fitting.report.figures.simulate import save_frf  # worker processes import this file, too

    sweep = result.sweep
    unit = description.variables[sweep.output].unit or "1"
    head = ["frequency (Hz)", *(f"{sweep.output} {c.direction} ({unit})" for c in result.curves)]
    table = np.column_stack([sweep.frequencies_hz, *(c.amplitudes for c in result.curves)])
    lines = [",".join(head), *(",".join(map(repr, row)) for row in table.tolist())]
    write_whole(out / "sweep.csv", "\n".join(lines) + "\n")
    return [out / "sweep.csv", *save_frf(result, description.model_name, unit, out)]


def _summary(result: SweepResponse, description: FmuDescription) -> list[str]:
    sweep = result.sweep
    unit = description.variables[sweep.output].unit or ""
    lines = []
    for curve in result.curves:
        top = int(np.argmax(curve.amplitudes))
        lines.append(
            f"{curve.direction}ward: largest {curve.amplitudes[top]:.9g} {unit} at "
            f"{hertz(sweep.frequencies_hz[top], digits=10)}"
        )
    lines.append(difference_in_words(result))
    lines += [
        f"{jump.direction}ward jump: {0.5 * (jump.low_hz + jump.high_hz):.10g} Hz +- "
        f"{0.5 * (jump.high_hz - jump.low_hz):.3g} Hz"
        for jump in result.jumps
    ]
    return lines
