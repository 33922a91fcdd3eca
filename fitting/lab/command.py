"""``fmu-fit synthesize``: a campaign with known truth, noise and drift, made without the FMU."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import fitting as ff
from fitting.extension.command import bounded_number, command_line, declare, writes
from fitting.lab.names import (
    CROSSING,
    CURVES,
    PUMPED,
    SERIES,
    SUBHARMONIC,
    TRUTH_NAME,
    VOLTAGE,
)

if TYPE_CHECKING:
    from fitting.lab.instruments import LockIns

NAME = "synthesize"
EXAMPLE = "fmu-fit synthesize --series q1 --seed 7 --out mine"

#: option -> (field of the bench or of its sample, what it is)
OPTIONS = {
    "noise-scale": ("noise_scale", "factor on every source of randomness; 0 makes exact data"),
    "drift": ("drift_hz", "linear drift of both eigenfrequencies over the series, Hz"),
    "curvature": ("curvature_hz", "departure from linear drift at the middle, Hz"),
    "crest": ("crest_v", "height of the sweep's maximum, V"),
    "theta": ("theta_rad", "angle of the orthogonal matrix, rad"),
    "d1": ("d1_hz", "damping of the first uncoupled mode, Hz"),
    "d2": ("d2_hz", "damping of the second uncoupled mode, Hz"),
    "eta-plus": ("eta_plus_hz", "lower eigenfrequency at the middle of the series, Hz"),
    "eta-minus": ("eta_minus_hz", "upper eigenfrequency at the middle of the series, Hz"),
    "alpha1": ("alpha1", "duffing: cubic coefficient of the first mode, 1/(m²·s²)"),
    "alpha2": ("alpha2", "duffing: cubic coefficient of the second mode, 1/(m²·s²)"),
    "kappa": ("kappa", "duffing: cubic coefficient between the modes, 1/(m²·s²)"),
    "level": ("level", "duffing: strongest drive of each tone, m/s²"),
    "weak-level": ("weak_level", "duffing: drive of the sweep that sets the scale, m/s²"),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument(
        "--series",
        choices=(*SERIES, *CURVES),
        help="the paper's two series; the string driven nonlinearly or under pumps; one mode in "
        "a network analyser; spectra over a voltage; a string over time: decay, chirp, "
        "lock-in, or levels of an analyser",
    )
    kind.add_argument(
        "--like",
        type=Path,
        metavar="CAMPAIGN.toml",
        help=f"a synthetic campaign, whose {TRUTH_NAME} is used",
    )
    kind.add_argument(
        "--plan",
        type=Path,
        metavar="CAMPAIGN.toml",
        help="a campaign by fmu-fit design to measure; needs --truth",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="TRUTH.toml",
        help=f"with --plan: {TRUTH_NAME} of the laboratory",
    )
    declare(parser, {"--seed": "seed of all noise (1)"})
    parser.add_argument(
        "--cross-mode",
        action="store_true",
        help="also record the other mode at every drive pair, by lock-in amplifiers",
    )
    parser.add_argument(
        "--phases",
        action="store_true",
        help="record X and Y of every tone, or every point of a crossing",
    )
    parser.add_argument(
        "--modes",
        type=int,
        choices=(2, 3),
        help="with --series crossing: modes, each coupled to the next (default 2)",
    )
    parser.add_argument(
        "--reference",
        action="store_true",
        help="with --series crossing: also a sweep at the first voltage, for the scale of tones",
    )
    parser.add_argument(
        "--restart",
        type=int,
        action="append",
        default=[],
        metavar="N",
        help="with --phases: restart the instrument before drive pair N, from 2; may be repeated",
    )
    parser.add_argument(
        "--noise",
        type=bounded_number,
        metavar="X",
        help="with --cross-mode or --phases: relative noise of every quadrature (0.01); else over "
        "the largest value",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for the campaign")
    for option, (_, text) in OPTIONS.items():
        parser.add_argument(f"--{option}", type=bounded_number, metavar="X", help=text)
    for option, form in (("reflection", "reflection"), ("no-reflection", "rotation")):
        text, value = f"the {form} form of the orthogonal matrix", form == "reflection"
        parser.add_argument(
            f"--{option}", dest="reflection", action="store_const", const=value, help=text
        )


@writes(NAME)
def run(args: argparse.Namespace) -> int:
    """Write the campaign; returns exit code 0.

    Raises:
        BadInput: no truth next to the campaign named, an impossible value, or a folder that holds
            a campaign which is not synthetic.
    """
    from fitting.extension.report import printed_lines

    if (args.plan is None) != (args.truth is None):
        raise ff.BadInput("synthesize: --plan and --truth are wanted together")
    _refuse_meaningless(args)
    args.seed = 1 if args.seed is None else args.seed  # is part of the command that files state
    changes = {field: _value(args, option) for option, (field, _) in OPTIONS.items()}
    changes["reflection"] = args.reflection
    instrument = None
    if args.series in CURVES:
        changes |= {"noise": args.noise, "modes": args.modes}
        changes |= {name: getattr(args, name) or None for name in ("phases", "reference")}
    elif args.phases or args.cross_mode:
        instrument = _lock_ins(args)
    made = ff.synthesize(
        args.series or args.like or args.truth,
        seed=args.seed,
        instrument=instrument,
        plan=args.plan,
        # without --out: the same data made elsewhere are the same bytes
        command=command_line(args, "out"),
        **{field: value for field, value in changes.items() if value is not None},
    )
    path = made.write(args.out)
    # the campaign that was written, and the next command
    what = f"the plan {args.plan}" if args.plan else _measured(made.measured)
    command = shlex.join(["fmu-fit", "reconstruct", str(path)])
    title, status, entries = "Synthetic campaign", f"seed {args.seed}", [("measured", what)]
    print(*printed_lines("files", "campaign", title, status, entries, path, command), sep="\n")
    return 0


def _refuse_meaningless(args: argparse.Namespace) -> None:
    """Refuse options that what is measured does not have."""
    crossing, curve = args.series == CROSSING, args.series in CURVES
    given = {
        "cross-mode": args.cross_mode,
        "restart": args.restart,
        "phases": args.phases,
        "modes": args.modes is not None,
        "reference": args.reference,
        "reflection": args.reflection is not None,
        **{option: _value(args, option) is not None for option in OPTIONS},
    }
    others, reason = set(), ""
    if curve:
        others = given.keys() - ({"phases", "modes", "reference"} if crossing else set())
    elif args.series in (PUMPED, SUBHARMONIC, VOLTAGE):
        others = {"phases", "cross-mode"}
        reason = ", whose sweeps of one line are recorded as amplitudes; wanted none"
    for option, is_given in given.items():
        if is_given and option in others:
            raise ff.BadInput(f"--{option}: has no meaning with --series {args.series}{reason}")
    lock_ins = args.cross_mode or args.phases
    for option, wanted, is_wrong in (
        ("modes", "--series crossing", given["modes"] and not crossing),
        ("reference", "--series crossing", args.reference and not crossing),
        ("noise", "--cross-mode or --phases", args.noise is not None and not (curve or lock_ins)),
        ("restart", "--phases", args.restart and not args.phases),
    ):
        if is_wrong:
            raise ff.BadInput(f"--{option}: has no meaning here, only with {wanted}")


def _measured(measured: Any) -> str:
    """What was measured, in words."""
    from fitting.lab.curve import Curve
    from fitting.lab.pumped import PumpedSweeps

    if isinstance(measured, Curve):
        return str(measured.kind)
    if isinstance(measured, PumpedSweeps):
        return f"{len(measured.amplitude_v)} sweeps"
    return f"{len(measured.bench.pairs_hz)} drive pairs"


def _lock_ins(args: argparse.Namespace) -> LockIns:
    from fitting.lab.instruments import LockIns

    noise = {} if args.noise is None else {"noise": args.noise}
    if not args.phases:
        return LockIns(**noise)
    restarts = tuple(sorted({n - 1 for n in args.restart}))
    return LockIns(both=args.cross_mode, phases=True, restarts=restarts, **noise)


def _value(args: argparse.Namespace, option: str) -> Any:
    return getattr(args, option.replace("-", "_"))
