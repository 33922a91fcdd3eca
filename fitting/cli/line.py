"""``fmu-fit line``: one resonance of a sweep, a ringdown or a noise spectrum."""

from __future__ import annotations

import argparse
import math
import warnings
from pathlib import Path
from typing import Any

import fitting as ff
from fitting.cli.running.output import hand_over
from fitting.cli.running.progress import reading
from fitting.cli.running.results import writes
from fitting.cli.words.columns import add_columns, columns_of
from fitting.cli.words.values import positive_quantity

NAME = "line"
EXAMPLE = "fmu-fit line string_q1/sweep.csv --out out/line"
DOCUMENT = "the line"
FILES = ("line.json", "line.csv", "line.png", "line.svg", "lines.csv", "lines.png", "lines.svg")
#: Prefixes that a number without a unit may have been meant with: of frequencies, and of times.
LARGE = {"k": 1e3, "M": 1e6, "G": 1e9}
SMALL = {"m": 1e-3, "u": 1e-6, "n": 1e-9}
#: Kinds of a file; those over frequency may be named.
NOISE, SWEEP = KINDS = ("noise", "sweep")
RINGDOWN = "ringdown"
#: Options that a kind of file does not go with, in the order in which they are refused, and why.
REFUSED = {
    SWEEP: (("demodulated_at",), "is of a ringdown, and {} is a sweep; wanted it without"),
    RINGDOWN: (
        ("wiring", "shape", "background", "noise", "delay", "kind"),
        "is of a sweep, and {} is a recording over time; wanted it without",
    ),
    NOISE: (
        ("demodulated_at", "wiring", "shape", "background", "noise", "delay"),
        "{} is a noise spectrum, which has none; wanted it without, or --kind sweep",
    ),
}
#: Options about the model of a sweep, their values, and what each is.
MODEL = {
    "shape": {
        "lorentzian": "a damped mode",
        "fano": "a mode on a complex constant",
        "duffing": "a mode whose frequency follows its amplitude",
        "notch": "a resonator next to a feed line",
        "reflection": "a resonator at the end of a line",
    },
    "background": {
        "none": "the line alone",
        "constant": "an added constant",
        "slope": "a constant and a slope",
        "tail": "the tail of a line beyond the points",
    },
    "noise": {
        "normal": "as the points scatter",
        "power": "averaged powers, to which noise adds its own",
        "amplitude": "averaged amplitudes in the noise of X and Y (Rice)",
        "readings": "single readings in the noise of X and Y (Rice)",
    },
    "delay": {"yes": "phases have the delay of a cable", "no": "they have none"},
}
#: Values of --wiring, which goes with 0.4.
WIRINGS = (
    "transmission",
    "fano",
    "sloped",
    "duffing",
    "duffing_offset",
    "notch",
    "reflection",
    "offset",
    "floor",
    "rice",
    "single",
    "tail",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "files",
        type=Path,
        nargs="+",
        metavar="FILE",
        help="a sweep, a ringdown or a noise spectrum, as an instrument wrote it; of several files "
        "a table over the control that their names or heads have",
    )
    parser.add_argument(
        "--from",
        dest="low",
        metavar="F",
        help='first frequency, as "30.26 kHz"; of a ringdown the first time, as "2 ms" (a number '
        "alone is in Hz or s; refused where it lies outside of the file, and inside with a prefix)",
    )
    parser.add_argument(
        "--to", dest="high", metavar="F", help='last frequency, as "30.3 kHz", or last time'
    )
    group = parser.add_argument_group(
        "model of a sweep",
        "without these, forms are compared and selected by AIC; with some, the others are plain",
    )
    for name, values in MODEL.items():
        words = "; ".join(f"{value}: {text}" for value, text in values.items())
        group.add_argument(f"--{name}", choices=tuple(values), help=words)
    parser.add_argument("--wiring", choices=WIRINGS, help=argparse.SUPPRESS)
    parser.add_argument(
        "--lines",
        metavar="N",
        help="number of lines of each sweep, which are fitted together and have a row each; auto: "
        "as many as the points show (default: one)",
    )
    parser.add_argument(
        "--demodulated-at",
        metavar="F",
        help='of a demodulated ringdown: the frequency of the lock-in, as "1.2 MHz"',
    )
    parser.add_argument(
        "--kind",
        choices=KINDS,
        help="of a file over frequency: a noise spectrum or a sweep (default: by unit and name)",
    )
    add_columns(parser, over_time=True)
    parser.add_argument(
        "--out",
        type=Path,
        help="folder for line.json, line.csv and figure, of several files for lines.csv and figure "
        "(none is written)",
    )


@writes(NAME, *FILES)
def run(args: argparse.Namespace) -> int:
    """Find the line and print it; returns 0.

    Raises:
        BadInput: a file that is not read, or without one resonance that it holds whole.
    """
    if len(args.files) > 1 or args.lines not in (None, "1"):
        return _of_many(args)
    from fitting.api.line import kind_of_file, write_line
    from fitting.text.errors import SeveralSweeps

    columns = columns_of(args)
    [args.file] = args.files
    result: ff.Line | ff.Ringdown | ff.NoiseLine
    with reading(NAME, [args.file]):
        try:
            kind = kind_of_file(args.file, columns, args.kind or "")
        except SeveralSweeps:
            return _of_many(args)
        over_time = kind == RINGDOWN
        _refuse_bare(args, columns, over_time=over_time)
        options, why = REFUSED[kind]
        for name in options:
            if getattr(args, name) is not None:
                raise ff.BadInput(f"--{name.replace('_', '-')}: {why.format(args.file)}")
        ends = _range(args, "s" if over_time else "Hz")
        if over_time:
            at_hz = _demodulated_at(args)
            result = ff.ringdown(args.file, within_s=ends, demodulated_at_hz=at_hz, columns=columns)
        elif kind == NOISE:
            result = ff.noise_line(args.file, within_hz=ends, columns=columns)
        else:
            result = ff.line(args.file, within_hz=ends, columns=columns, **_model(args))
    hand_over(args, result)
    print(result.fit_report() if args.verbose else result)
    if args.out is not None:
        print(*write_line(result, args.out), sep="\n")
    return 0


def _of_many(args: argparse.Namespace) -> int:
    """The table of several files, sweeps or lines; returns 0 where one has a line at least."""
    from fitting.api.line import RINGDOWN, kind_of_file

    count: int | str = 1 if args.lines is None else args.lines
    if isinstance(count, str) and count != "auto":
        if not count.isdecimal() or int(count) < 1:
            raise ff.BadInput(f"--lines {count}: wanted a number of lines, as 2, or auto")
        count = int(count)
    columns = columns_of(args)
    with reading(NAME, args.files):
        ends: tuple[float | None, float | None] = (None, None)
        if args.low is not None or args.high is not None:  # in the unit of the first file
            over_time = kind_of_file(args.files[0], columns, args.kind or "") == RINGDOWN
            ends = _range(args, "s" if over_time else "Hz")
        result = ff.lines(
            args.files,
            kind=args.kind or "",
            within=ends,
            **_model(args),
            demodulated_at_hz=_demodulated_at(args),
            count=count,
            columns=columns,
        )
    hand_over(args, result.to_dict())
    print(result)
    if args.out is not None:
        print(*ff.write_lines(result, args.out), sep="\n")
    return 0


def _model(args: argparse.Namespace) -> dict[str, Any]:
    """What the line of a sweep is asked to be, as arguments of `fitting.line`."""
    if args.wiring is not None:
        text = "line: --wiring is --shape, --background and --noise now; it goes with 0.4"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
    names = ("wiring", "shape", "background", "noise")
    made: dict[str, Any] = {name: getattr(args, name) or "" for name in names}
    return made | {"delay": None if args.delay is None else args.delay == "yes"}


def _demodulated_at(args: argparse.Namespace) -> float | None:
    at = args.demodulated_at
    return None if at is None else positive_quantity(at, "Hz", where="--demodulated-at")


def _refuse_bare(args: argparse.Namespace, columns: ff.Columns, *, over_time: bool) -> None:
    """Complain of numbers without a unit that lie in the file only with a prefix before Hz or s."""
    given = {"--from": args.low, "--to": args.high}
    bare = {option: float(text) for option, text in given.items() if _is_bare(text)}
    if not bare:
        return
    from fitting.api.line import ends_of
    from fitting.text.notation import prefixed

    low, high = ends_of(args.file, columns, over_time=over_time)
    unit, prefixes = ("s", SMALL) if over_time else ("Hz", LARGE)
    sides = ("before", "behind") if over_time else ("below", "above")
    complaints = []
    for option, value in bare.items():
        meant = next((p for p, size in prefixes.items() if low <= value * size <= high), None)
        if meant is None or low <= value <= high:
            continue
        factor, shown = prefixed(max(abs(low), abs(high)), unit)
        where = sides[value > high]
        complaints.append(
            f"{option} {given[option]}: {value:g} {unit} lies {where} {args.file}, "
            f"{low / factor:.6g} to {high / factor:.6g} {shown}; wanted a unit, as "
            f"{value:g}{meant}{unit}"
        )
    if complaints:
        raise ff.BadInput(*complaints)


def _is_bare(text: str | None) -> bool:
    try:
        return text is not None and math.isfinite(float(text))
    except ValueError:
        return False


def _range(args: argparse.Namespace, unit: str) -> tuple[float | None, float | None]:
    low, high = (
        None if text is None else positive_quantity(text, unit, where=option)
        for text, option in ((args.low, "--from"), (args.high, "--to"))
    )
    if low is not None and high is not None and not low < high:
        raise ff.BadInput(f"--from {args.low!r} and --to {args.high!r}: wanted a rising range")
    return low, high
