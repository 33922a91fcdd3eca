"""``fmu-fit simulate``: one drive through an FMU, to CSV and figures."""

from __future__ import annotations

import argparse
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.cli.drive_options import first_output, other_tones, start_values
from fitting.cli.options import (
    positive_quantity,
    positive_time,
    quantity,
    relative_accuracy,
    whole_number,
)
from fitting.cli.progress import status_line
from fitting.cli.results import writes
from fitting.fmu import FmuDescription, FmuWorkers
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.signal.combinations import combination_name
from fitting.simulate.budget import Kind
from fitting.simulate.drive import Drive
from fitting.simulate.response import (
    USUAL_ACCURACY,
    DriveResponse,
    Shown,
    plan_drive,
    respond,
)
from fitting.simulate.words import (
    plan_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
    warnings_in_words,
)
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.notation import hertz
from fitting.text.units import convert, same_kind

NAME = "simulate"
EXAMPLE = 'fmu-fit simulate build/CoupledOscillator.fmu --set u1="6.94018 MHz" --out out/two-tone'

WRITTEN = (
    *(f"{name}.csv" for name in ("carrier", "spectrum", "peaks", "beating", "lines")),
    *(f"{name}.{kind}" for name in ("trace", "spectrum") for kind in ("png", "svg")),
)
DEFAULT_TONES = ("u1", "u2")
MOST_MIXED = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument("fmu", type=Path, metavar="FMU", help="the file (FMI 2.0 or 3.0)")
    parser.add_argument("--out", type=Path, help="folder for CSV files and figures")
    _add_plan_arguments(parser)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help='start value of a variable, as u1="6.94016 MHz"; a plain number is in its unit',
    )
    parser.add_argument("--outputs", help="outputs, comma between (the first continuous one)")
    parser.add_argument(
        "--tones",
        help="FMU parameters that hold the drive frequencies, comma between "
        f"({' and '.join(DEFAULT_TONES)} where the FMU has them)",
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
    parser.add_argument("--settle", metavar="TIME", help="time before sampling (found)")
    parser.add_argument(
        "--window",
        type=positive_time("--window"),
        metavar="TIME",
        help="time sampled (some common periods)",
    )
    parser.add_argument(
        "--samples", type=whole_number(1), help="samples in the window (by the band)"
    )
    parser.add_argument(
        "--timeout",
        type=positive_time("--timeout"),
        default=60.0,
        metavar="TIME",
        help="longest run (60 s)",
    )


def _add_plan_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--accuracy",
        type=relative_accuracy("--accuracy"),
        default=USUAL_ACCURACY,
        help="wanted relative accuracy of every amplitude: plans settling, window, solver and "
        f"model, and says what it may be off by ({USUAL_ACCURACY:g})",
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


@writes(NAME, *WRITTEN)
def run(args: argparse.Namespace) -> int:
    """Simulate and write; returns 0, or 1 if the accuracy could not be promised.

    Raises:
        BadInput: names, values, units or times do not fit the FMU or each other.
        FmuFailure: the FMU failed.
    """
    if args.out is None and not args.plan:
        raise BadInput("--out: is missing, wanted a folder (or --plan, which writes nothing)")
    with FmuWorkers(args.fmu, timeout_s=args.timeout, timeout_name="--timeout") as workers:
        description = workers.description
        drive = _drive(args, description)
        shown = Shown(args.window, args.samples)
        with status_line(NAME) as tell:
            tell("planning")
            plan = plan_drive(
                workers,
                drive,
                args.accuracy,
                settle_s=None if args.settle is None else _settling(args.settle),
                annotation=AccuracyAnnotation(force=tuple(args.force), forbid=tuple(args.forbid)),
                shown=shown,
            )
        print(*plan_in_words(plan.budget), sep="\n")
        if args.plan:
            return 0 if plan.budget.kept else 1
        with status_line(NAME) as tell:
            tell("spectrum and trace")
            response = respond(workers, plan, shown)
    names = _names_of_tones(args, description)
    for path in _write(response, description, args.out, names):
        print(path)
    print(*_summary(response, description), *_mixed(response, names, description), sep="\n")
    for warning in workers.warnings:
        print(f"the FMU warns: {warning}")
    for text in warnings_in_words(plan.budget):
        print(f"warning: {text}")
    if response.steady:
        return 0
    print(*_advice(args, response, description), sep="\n")
    return 1


def _drive(args: argparse.Namespace, description: FmuDescription) -> Drive:
    values = start_values(args.set, description)
    outputs = _listed(args.outputs) or first_output(description)
    if (args.input is None) != (args.drive is None):
        raise BadInput("--input and --drive: found one of them, wanted both or none")
    level = 1.0
    if args.input is not None:
        texts = _listed(args.drive)
        tones = tuple(quantity(text, "Hz", where="--drive") for text in texts)
        unit = description.variable(args.input).unit or "1"
        if args.level is not None:
            level = positive_quantity(args.level, unit, where="--level")
    elif args.level is not None:
        raise BadInput("--level: is for --input, wanted --set with the amplitudes of the tones")
    else:
        tones = _tones(_tone_names(args, description), values, description)
    return Drive(
        start_values=values,
        tones_hz=tones,
        outputs=outputs,
        input=args.input,
        amplitude=level,
        steps_per_period=args.steps_per_period,
    )


def _listed(text: str | None) -> tuple[str, ...]:
    return tuple(word.strip() for word in (text or "").split(",") if word.strip())


def _settling(text: str) -> float:
    time_s = quantity(text, "s", where="--settle")
    if time_s < 0.0:
        raise BadInput(f"--settle: found {text!r}, wanted a time of at least 0")
    return time_s


def _tone_names(args: argparse.Namespace, description: FmuDescription) -> tuple[str, ...]:
    names = _listed(args.tones)
    if names:
        return names
    if not all(name in description.variables for name in DEFAULT_TONES):
        raise BadInput(
            f"{description.path}: has no parameters {' and '.join(DEFAULT_TONES)}, wanted "
            "--tones with the names of those that hold the drive frequencies, or --input"
        )
    return DEFAULT_TONES


def _tones(
    names: tuple[str, ...], values: Mapping[str, Scalar], description: FmuDescription
) -> tuple[float, ...]:
    """Frequencies in Hz that the parameters hold."""
    tones = []
    for name in names:
        variable = description.variable(name)
        unit = variable.unit or "1"
        if variable.kind != "Real" or not same_kind(unit, "Hz"):
            raise BadInput(f"--tones {name}: its unit is {variable.unit!r}, wanted a frequency")
        value = values.get(name, variable.start)
        if value is None:
            raise BadInput(f"--tones {name}: has no start value, wanted --set {name}=...")
        tones.append(convert(float(value), unit, "Hz", where=f"--tones {name}"))
    return tuple(tones)


def _names_of_tones(args: argparse.Namespace, description: FmuDescription) -> tuple[str, ...]:
    """What the tones are called in a combination of them."""
    if args.input is None:
        return _tone_names(args, description)
    return tuple(f"f{k}" for k in range(1, len(_listed(args.drive)) + 1))


def _write(
    response: DriveResponse, description: FmuDescription, out: Path, names: Sequence[str]
) -> list[Path]:
    from fitting.report.figures.simulate import save_figures  # workers import this file, too

    drive, spectrum, beating = response.drive, response.spectrum, response.beating
    units = [description.variables[name].unit or "1" for name in drive.outputs]
    columns = [f"{name} ({unit})" for name, unit in zip(drive.outputs, units, strict=True)]
    tables: list[tuple[str, list[str], list[FloatArray]]] = [
        ("carrier.csv", ["time (s)"], [response.carrier.times_s, response.carrier.values]),
        ("spectrum.csv", ["frequency (Hz)"], [spectrum.frequencies_hz, spectrum.amplitudes]),
        ("peaks.csv", ["frequency (Hz)"], [np.array(drive.tones_hz), response.peaks]),
    ]
    if beating is not None:
        tables.append(("beating.csv", ["time (s)"], [beating.times_s, beating.values]))
    paths = []
    titles = [combination_name(line.factors, names) for line in response.lines]
    if response.lines:
        numbers = [[line.frequency_hz, *line.amplitudes.tolist()] for line in response.lines]
        rows = [[t, *map(repr, row)] for t, row in zip(titles, numbers, strict=True)]
        head = ["combination", "frequency (Hz)", *columns]
        write_whole(out / "lines.csv", "".join(",".join(row) + "\n" for row in [head, *rows]))
        paths.append(out / "lines.csv")
    for name, first, arrays in tables:
        write_whole(out / name, _csv(first + columns, np.column_stack(arrays)))
        paths.append(out / name)
    named = list(zip(titles, response.lines, strict=True))
    return paths + save_figures(response, description.model_name, units, out, named)


def _csv(header: list[str], rows: FloatArray) -> str:
    text = io.StringIO()
    text.write(",".join(header) + "\n")
    text.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())
    return text.getvalue()


def _summary(response: DriveResponse, description: FmuDescription) -> list[str]:
    remainder = remainder_in_words(response.remainder)
    lines = [
        spectrum_in_words(response.spectrum),
        settling_in_words(response.plan),
        remainder if response.remainder.explained else f"warning: {remainder}",
    ]
    tones = response.drive.tones_hz
    for name, peaks in zip(response.drive.outputs, response.peaks.T, strict=True):
        unit = description.variables[name].unit or ""
        if name in response.constants:
            lines.append(f"{name}: constant, {response.constants[name]:.9g} {unit}".rstrip())
            continue
        lines += [
            f"{name}: {peak:.9g} {unit} peak at {hertz(tone, digits=10)}"
            for tone, peak in zip(tones, peaks, strict=True)
        ]
    return lines


def _mixed(response: DriveResponse, names: Sequence[str], description: FmuDescription) -> list[str]:
    """The largest lines at combinations of the tones, as a response has that is not linear."""
    mixed, said = response.lines, []
    for k, name in enumerate(response.drive.outputs):
        if name in response.constants:
            continue
        unit = description.variables[name].unit or ""
        sizes = sorted((m.amplitudes[k] for m in mixed), reverse=True)[:MOST_MIXED]
        shown = [m for m in mixed if m.amplitudes[k] in sizes]
        said += [
            f"{name}: {m.amplitudes[k]:.9g} {unit} at {combination_name(m.factors, names)} = "
            f"{hertz(m.frequency_hz, digits=10)}"
            for m in shown
        ]
        if len(mixed) > len(shown):
            said.append(f"{name}: {len(mixed) - len(shown)} smaller lines are in lines.csv")
    return said


def _advice(
    args: argparse.Namespace, response: DriveResponse, description: FmuDescription
) -> list[str]:
    """What may help where a response is not steady."""
    lines = []
    settling = response.plan.budget.of(Kind.SETTLING)[0]
    if not response.remainder.explained or settling.bound > response.plan.budget.wanted:
        lines.append(
            "not steady: wanted more damping, or a longer time before sampling by --settle TIME"
        )
    if response.drive.input is None:
        names = _tone_names(args, description)
        lines += [
            f"{name} is not among the tones {', '.join(names)}: if the FMU drives with it as well, "
            f"wanted it in --tones, or --set {amplitude}=0"
            for name, amplitude in other_tones(names, response.drive.start_values, description)
        ]
    return lines
