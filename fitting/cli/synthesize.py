"""``fmu-fit synthesize``: a campaign with known truth, noise and drift, made without the FMU."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from fitting.cli.options import whole_number
from fitting.lab.duffing import DuffingBench, duffing_bench, measure_duffing, with_level
from fitting.lab.duffing_synthesis import duffing_files, is_duffing, read_duffing_bench
from fitting.lab.string import SERIES_THETA, Bench, measure, string_bench
from fitting.lab.synthesis import CAMPAIGN_NAME, TRUTH_NAME, campaign_files, read_bench
from fitting.lab.synthesis_cross import cross_files
from fitting.lab.synthesis_plan import planned_files
from fitting.text.errors import BadInput
from fitting.text.files import write_all

NAME = "synthesize"
SUMMARY = "a virtual laboratory: a campaign with known truth, noise and drift"
EXAMPLE = "fmu-fit synthesize --series q1 --seed 7 --out mine"
DUFFING = "duffing"

#: option -> (field of the bench, or of its modes, what it is)
BENCH_OPTIONS = {
    "noise-scale": ("noise_scale", "factor on every source of randomness; 0 makes exact data"),
    "drift": ("drift_hz", "linear drift of both eigenfrequencies over the series, Hz"),
    "curvature": ("curvature_hz", "departure from linear drift at the middle, Hz"),
    "crest": ("crest_v", "height of the sweep's maximum, V"),
}
MODE_OPTIONS = {
    "theta": ("theta_rad", "angle of the orthogonal matrix, rad"),
    "d1": ("d1_hz", "damping of the first uncoupled mode, Hz"),
    "d2": ("d2_hz", "damping of the second uncoupled mode, Hz"),
    "eta-plus": ("eta_plus_hz", "lower eigenfrequency at the middle of the series, Hz"),
    "eta-minus": ("eta_minus_hz", "upper eigenfrequency at the middle of the series, Hz"),
}
#: option of the string driven hard -> (field of its cubic terms, what it is)
CUBIC_OPTIONS = {
    "alpha1": ("alpha1", "duffing: cubic coefficient of the first mode, 1/(m^2 s^2)"),
    "alpha2": ("alpha2", "duffing: cubic coefficient of the second mode, 1/(m^2 s^2)"),
    "kappa": ("kappa", "duffing: cubic coefficient between the modes, 1/(m^2 s^2)"),
}
#: further options of the string driven hard -> what they are
LEVEL_OPTIONS = {
    "level": "duffing: strongest drive of each tone, the others in proportion, m/s^2",
    "weak-level": "duffing: drive of the sweep that sets the scale, m/s^2",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        "--series",
        choices=[*sorted(SERIES_THETA), DUFFING],
        help="one of the paper's two series, or the q1 string driven until it is nonlinear",
    )
    kind.add_argument(
        "--like",
        type=Path,
        metavar="CAMPAIGN.toml",
        help=f"a synthetic campaign; its {TRUTH_NAME} beside it is the truth again",
    )
    kind.add_argument(
        "--plan",
        type=Path,
        metavar="CAMPAIGN.toml",
        help="a campaign that fmu-fit design proposed, to be measured; wants --truth",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="TRUTH.toml",
        help=f"with --plan: the {TRUTH_NAME} of the laboratory that measures it",
    )
    parser.add_argument(
        "--seed", type=whole_number(0), default=1, help="seed of all noise (default 1)"
    )
    parser.add_argument(
        "--cross-mode",
        action="store_true",
        help="record the other mode at every drive pair too, by lock-in amplifiers",
    )
    parser.add_argument(
        "--noise",
        type=float,
        metavar="X",
        help="with --cross-mode: relative noise of every amplitude (default 0.01)",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the campaign")
    for option, text in _numbers().items():
        parser.add_argument(f"--{option}", type=float, metavar="X", help=text)
    parser.add_argument(
        "--reflection",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="the reflection form of the orthogonal matrix",
    )


def run(args: argparse.Namespace) -> int:
    """Write the campaign; returns exit code 0.

    Raises:
        BadInput: no truth beside the campaign named, an impossible value, or a folder that holds
            a campaign which is not synthetic.
    """
    folder: Path = args.out
    _refuse_measured(folder)
    if args.seed < 0:
        raise BadInput(f"--seed: found {args.seed}, wanted zero or more")
    if (args.plan is None) != (args.truth is None):
        raise BadInput("synthesize: --plan and --truth are wanted together")
    _check_cross(args)
    if _is_duffing(args):
        hard = _duffing_bench(args)
        try:
            files = duffing_files(measure_duffing(hard, args.seed), _command(args))
        except ValueError as error:
            raise BadInput(f"synthesize: {error}") from error
        pairs = len(hard.levels)
    else:
        bench = _bench(args)
        if args.plan is not None:
            write_all(folder, planned_files(args.plan, bench, args.seed, _command(args)))
            print(f"{folder / CAMPAIGN_NAME}: synthetic, seed {args.seed}, the plan {args.plan}")
            return 0
        series = measure(bench, args.seed)
        files = (
            cross_files(series, 0.01 if args.noise is None else args.noise, _command(args))
            if args.cross_mode
            else campaign_files(series, _command(args))
        )
        pairs = len(bench.pairs_hz)
    write_all(folder, files)
    print(f"{folder / CAMPAIGN_NAME}: synthetic, seed {args.seed}, {pairs} drive pairs")
    return 0


def _check_cross(args: argparse.Namespace) -> None:
    if args.cross_mode and (args.plan is not None or args.series == DUFFING):
        raise BadInput("--cross-mode: has no meaning here, only with --series q1|q2 or --like")
    if args.noise is not None and not args.cross_mode:
        raise BadInput("--noise: has no meaning here, only with --cross-mode")
    if args.noise is not None and not 0.0 < args.noise < 0.5:
        raise BadInput(f"--noise: found {args.noise}, wanted a share between 0 and 0.5")


def _is_duffing(args: argparse.Namespace) -> bool:
    """Whether the string is driven hard; options for that alone are refused otherwise."""
    hard = args.series == DUFFING or (args.like and is_duffing(args.like.parent / TRUTH_NAME))
    for option in () if hard else (*CUBIC_OPTIONS, *LEVEL_OPTIONS):
        if getattr(args, option.replace("-", "_")) is not None:
            raise BadInput(f"--{option}: has no meaning here, only with --series {DUFFING}")
    return bool(hard)


def _duffing_bench(args: argparse.Namespace) -> DuffingBench:
    base = read_duffing_bench(args.like.parent / TRUTH_NAME) if args.like else duffing_bench()
    bench = _changed(base.bench, args)
    try:
        lab = replace(base, bench=bench, cubic=replace(base.cubic, **_given(args, CUBIC_OPTIONS)))
        if args.level is not None:
            lab = with_level(lab, args.level)
        return lab if args.weak_level is None else replace(lab, weak_level=args.weak_level)
    except ValueError as error:
        raise BadInput(f"synthesize: {error}") from error


def _bench(args: argparse.Namespace) -> Bench:
    if args.series:
        base = string_bench(args.series)
    else:
        base = read_bench(args.truth or args.like.parent / TRUTH_NAME)
    return _changed(base, args)


def _changed(base: Bench, args: argparse.Namespace) -> Bench:
    """The bench with what the options change."""
    try:
        modes = replace(base.modes, **_given(args, MODE_OPTIONS))
        if args.reflection is not None:
            modes = replace(modes, reflection=args.reflection)
        return replace(base, modes=modes, **_given(args, BENCH_OPTIONS))
    except ValueError as error:
        raise BadInput(f"synthesize: {error}") from error


def _given(args: argparse.Namespace, options: dict[str, tuple[str, str]]) -> dict[str, Any]:
    values = {field: getattr(args, name.replace("-", "_")) for name, (field, _) in options.items()}
    return {field: value for field, value in values.items() if value is not None}


def _numbers() -> dict[str, str]:
    """Options with a number -> what they are."""
    fields = {**BENCH_OPTIONS, **MODE_OPTIONS, **CUBIC_OPTIONS}
    return {option: text for option, (_, text) in fields.items()} | LEVEL_OPTIONS


def _command(args: argparse.Namespace) -> str:
    """The command without --out: the same data made elsewhere are the same bytes."""
    words = ["fmu-fit", NAME]
    for option in ("series", "like", "plan", "truth"):
        value = getattr(args, option)
        if value is not None:
            words += [f"--{option}", value.as_posix() if isinstance(value, Path) else value]
    words += ["--seed", str(args.seed)]
    for option in _numbers():
        value = getattr(args, option.replace("-", "_"))
        if value is not None:
            words += [f"--{option}", repr(value)]
    words += ["--cross-mode"] if args.cross_mode else []
    words += ["--noise", repr(args.noise)] if args.noise is not None else []
    if args.reflection is not None:
        words.append("--reflection" if args.reflection else "--no-reflection")
    return shlex.join(words)


def _refuse_measured(folder: Path) -> None:
    present = folder / CAMPAIGN_NAME
    if present.is_file() and not present.read_bytes().startswith(b"# synthetic"):
        raise BadInput(
            f"{present}: is there and not synthetic; wanted another --out, nothing was written"
        )
