"""``fmu-fit line``: one resonance of a sweep, a ringdown or a noise spectrum."""

from __future__ import annotations

import argparse
import contextlib
import math
import warnings
from pathlib import Path
from typing import Any

import fitting as ff
from fitting.api.early import LINE_FILES, LINES_FILES
from fitting.api.progress import reading
from fitting.cli.running.output import hand_over, writes
from fitting.cli.words.options import (
    Options,
    add_columns,
    columns_of,
    declare,
    one_of,
    positive_quantity,
    rising_range,
    value,
)

NAME = "line"
EXAMPLE = "fmu-fit line string_q1/sweep.csv --out out/line"
DOCUMENT = "the line"
#: Prefixes that a number without a unit may have been meant with: of frequencies, and of times.
LARGE = {"k": 1e3, "M": 1e6, "G": 1e9}
SMALL = {"m": 1e-3, "u": 1e-6, "n": 1e-9}
#: Kinds of a file; those over frequency may be named.
NOISE, SWEEP = KINDS = ("noise", "sweep")
RINGDOWN = "ringdown"
#: Options that a kind of file does not go with, in the order in which they are refused, and why.
MODEL_OPTIONS = ("wiring", "shape", "background", "noise", "delay")
REFUSED = {
    SWEEP: (("demodulated_at",), "is of a ringdown, and {} is a sweep; wanted it without"),
    RINGDOWN: (
        (*MODEL_OPTIONS, "kind"),
        "is of a sweep, and {} is a recording over time; wanted it without",
    ),
    NOISE: (
        ("demodulated_at", *MODEL_OPTIONS),
        "{} is a noise spectrum, which has none; wanted it without, or --kind sweep",
    ),
}
#: Options about the model of a sweep, their values, and what each is.
MODEL = {
    "shape": {
        "lorentzian": "damped",
        "fano": "on a complex constant",
        "duffing": "its frequency follows the amplitude",
        "notch": "next to a feed line",
        "reflection": "at the end of a line",
    },
    "background": {
        "none": "the line alone",
        "constant": "an added constant",
        "slope": "both",
        "tail": "of a line beyond the points",
    },
    "noise": {
        "normal": "as the points scatter",
        "power": "averaged, with that of the noise",
        "amplitude": "averaged, in noise of X and Y (Rice)",
        "readings": "single, in noise of X and Y (Rice)",
    },
    "delay": {"yes": "of a cable in phases", "no": "none"},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    options: Options = {
        "files": value(
            "sweep, ringdown or noise spectrum of an instrument; several: a table over the "
            "control in their names or heads",
            "FILE",
            Path,
            nargs="+",
        ),
        "--from": value(
            'first frequency, as "30.26 kHz", or time of a ringdown, as "2 ms" (a number '
            "alone is in Hz or s)",
            "F",
            dest="low",
        ),
        "--to": value('last frequency, as "30.3 kHz", or last time', "F", dest="high"),
    }
    declare(parser, options)
    group = parser.add_argument_group(
        "model of a sweep",
        "without these, forms are compared and selected by AIC; with some, the others are plain",
    )
    for name, values in MODEL.items():
        words = "; ".join(f"{value}: {text}" for value, text in values.items())
        group.add_argument(f"--{name}", choices=tuple(values), help=words)
    options = {
        "--wiring": value(argparse.SUPPRESS),
        "--lines": value(
            "lines of each sweep, fitted together, a row each; auto: as many as the points "
            "show (1)",
            "N",
        ),
        "--demodulated-at": {},
        "--kind": one_of(
            KINDS,
            "kind of a file over frequency (by unit and name)",
        ),
    }
    declare(parser, options)
    add_columns(parser)
    out = "folder for line.json, line.csv and figure, or lines.csv of several files (no folder)"
    declare(parser, {"--out": out})


@writes(NAME, *LINE_FILES, *LINES_FILES)
def run(args: argparse.Namespace) -> int:
    """Find the line and print it; returns 0.

    Raises:
        BadInput: a file that is not read, or without one resonance that it holds whole.
    """
    from fitting.api.line import kind_of_file
    from fitting.text.errors import SeveralSweeps

    columns, kind = columns_of(args), ""
    with reading(NAME, args.files):
        if len(args.files) == 1 and args.lines in (None, "1"):
            with contextlib.suppress(SeveralSweeps):  # each of them has a row
                kind = kind_of_file(args.files[0], columns, args.kind or "")
        result = _one(args, columns, kind) if kind else _many(args, columns)
    if isinstance(result, ff.Lines):
        hand_over(args, result.to_dict())
        print(result)
        files = () if args.out is None else ff.write_lines(result, args.out)
    else:
        hand_over(args, result)
        print(result.fit_report() if args.verbose else result)
        files = () if args.out is None else ff.write_line(result, args.out)
    for file in files:
        print(file)
    return 0


def _one(
    args: argparse.Namespace, columns: ff.Columns, kind: str
) -> ff.Line | ff.Ringdown | ff.NoiseLine:
    """The line of one file, for whose kind every option has to mean something."""
    [file] = args.files
    over_time = kind == RINGDOWN
    _refuse_bare(args, file, columns, over_time=over_time)
    options, why = REFUSED[kind]
    for name in options:
        if getattr(args, name) is not None:
            raise ff.BadInput(f"--{name.replace('_', '-')}: {why.format(file)}")
    ends = rising_range(args, "s" if over_time else "Hz")
    if over_time:
        at_hz = _demodulated_at(args)
        return ff.ringdown(file, within_s=ends, demodulated_at_hz=at_hz, columns=columns)
    if kind == NOISE:
        return ff.noise_line(file, within_hz=ends, columns=columns)
    return ff.line(file, within_hz=ends, columns=columns, **_model(args))


def _many(args: argparse.Namespace, columns: ff.Columns) -> ff.Lines:
    """The table of several files, sweeps or lines."""
    from fitting.api.line import kind_of_file

    count: int | str = 1 if args.lines is None else args.lines
    if isinstance(count, str) and count != "auto":
        if not count.isdecimal() or int(count) < 1:
            raise ff.BadInput(f"--lines {count}: wanted a number of lines, as 2, or auto")
        count = int(count)
    ends: tuple[float | None, float | None] = (None, None)
    if args.low is not None or args.high is not None:  # in the unit of the first file
        kind = kind_of_file(args.files[0], columns, args.kind or "")
        ends = rising_range(args, "s" if kind == RINGDOWN else "Hz")
    return ff.lines(
        args.files,
        kind=args.kind or "",
        within=ends,
        **_model(args),
        demodulated_at_hz=_demodulated_at(args),
        count=count,
        columns=columns,
    )


def _model(args: argparse.Namespace) -> dict[str, Any]:
    """What the line of a sweep is asked to be, as arguments of `fitting.line`."""
    if args.wiring is not None:
        text = "line: --wiring is --shape, --background and --noise now; it goes with 0.4"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
    made: dict[str, Any] = {name: getattr(args, name) or "" for name in MODEL_OPTIONS}
    return made | {"delay": None if args.delay is None else args.delay == "yes"}


def _demodulated_at(args: argparse.Namespace) -> float | None:
    at = args.demodulated_at
    return None if at is None else positive_quantity(at, "Hz", where="--demodulated-at")


def _refuse_bare(
    args: argparse.Namespace, file: Path, columns: ff.Columns, *, over_time: bool
) -> None:
    """Refuse numbers without a unit that lie in the file only with a prefix before Hz or s."""
    given, bare = {"--from": args.low, "--to": args.high}, dict[str, float]()
    for option, text in given.items():
        with contextlib.suppress(ValueError, TypeError):  # with a unit, or not given
            bare[option] = float(text)
    if not any(map(math.isfinite, bare.values())):
        return
    from fitting.api.line import ends_of
    from fitting.text.notation import prefixed

    low, high = ends_of(file, columns, over_time=over_time)
    unit, prefixes = ("s", SMALL) if over_time else ("Hz", LARGE)
    sides = ("before", "behind") if over_time else ("below", "above")
    errors = []
    for option, number in bare.items():
        meant = next((p for p, size in prefixes.items() if low <= number * size <= high), None)
        if meant is None or low <= number <= high:
            continue
        factor, shown = prefixed(max(abs(low), abs(high)), unit)
        errors.append(
            f"{option} {given[option]}: {number:g} {unit} lies {sides[number > high]} {file}, "
            f"{low / factor:.6g} to {high / factor:.6g} {shown}; wanted a unit, as "
            f"{number:g}{meant}{unit}"
        )
    if errors:
        raise ff.BadInput(*errors)
