"""``fmu-fit synthesize``: a campaign with known truth, noise and drift, made without the FMU."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

from fitting.errors import BadInput
from fitting.files import write_all
from fitting.laboratory import SERIES_THETA, Bench, measure, string_bench
from fitting.options import whole_number
from fitting.synthesis import CAMPAIGN_NAME, TRUTH_NAME, campaign_files, read_bench
from fitting.synthesis_plan import planned_files

NAME = "synthesize"
SUMMARY = "a virtual laboratory: a campaign with known truth, noise and drift"
EXAMPLE = "fmu-fit synthesize --series q1 --seed 7 --out mine"

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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        "--series",
        choices=sorted(SERIES_THETA),
        help="one of the paper's two series",
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
    parser.add_argument("--out", type=Path, required=True, help="folder for the campaign")
    for option, (_, text) in {**BENCH_OPTIONS, **MODE_OPTIONS}.items():
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
    bench = _bench(args)
    if args.plan is not None:
        write_all(folder, planned_files(args.plan, bench, args.seed, _command(args)))
        print(f"{folder / CAMPAIGN_NAME}: synthetic, seed {args.seed}, the plan {args.plan}")
        return 0
    files = campaign_files(measure(bench, args.seed), _command(args))
    write_all(folder, files)
    print(
        f"{folder / CAMPAIGN_NAME}: synthetic, seed {args.seed}, {len(bench.pairs_hz)} drive pairs"
    )
    return 0


def _bench(args: argparse.Namespace) -> Bench:
    if args.series:
        base = string_bench(args.series)
    else:
        base = read_bench(args.truth or args.like.parent / TRUTH_NAME)
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


def _command(args: argparse.Namespace) -> str:
    """The command without --out: the same data made elsewhere are the same bytes."""
    words = ["fmu-fit", NAME]
    for option in ("series", "like", "plan", "truth"):
        value = getattr(args, option)
        if value is not None:
            words += [f"--{option}", value.as_posix() if isinstance(value, Path) else value]
    words += ["--seed", str(args.seed)]
    for option in (*BENCH_OPTIONS, *MODE_OPTIONS):
        value = getattr(args, option.replace("-", "_"))
        if value is not None:
            words += [f"--{option}", repr(value)]
    if args.reflection is not None:
        words.append("--reflection" if args.reflection else "--no-reflection")
    return shlex.join(words)


def _refuse_measured(folder: Path) -> None:
    present = folder / CAMPAIGN_NAME
    if present.is_file() and not present.read_bytes().startswith(b"# synthetic"):
        raise BadInput(
            f"{present}: is there and not synthetic; wanted another --out, nothing was written"
        )
