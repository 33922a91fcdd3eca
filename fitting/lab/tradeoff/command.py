"""``fmu-fit tradeoff``: accuracy of a campaign's simulation and fit against its cost, measured."""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.extension.command import command_line, fmu_for, status_line, writes
from fitting.lab.names import SCENES, USUAL_SCENE
from fitting.lab.tradeoff import FILES
from fitting.text.results_folder import remove_earlier

NAME = "tradeoff"
#: Options of 0.2.0 that are read, and do nothing.
GONE = ("only", "workers", "scheduler", "seed")
EXAMPLE = "fmu-fit tradeoff --scene string --out out/tradeoff --quick"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument(
        "--campaign", type=Path, metavar="CAMPAIGN.toml", help="any campaign, through its own FMU"
    )
    kind.add_argument(
        "--scene", choices=tuple(SCENES), help=f"a synthetic campaign ({USUAL_SCENE})"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--fit", action="store_true", help="fit with every setting, too")
    parser.add_argument("--quick", action="store_true", help="few accuracies")
    parser.add_argument("--resume", action="store_true", help="continue from the finished settings")
    parser.add_argument(
        "--accuracies", metavar="X,X,...", help="accuracies of plans (1e-1,1e-2,1e-3,1e-4,1e-6)"
    )
    for name in GONE:
        parser.add_argument(f"--{name}", help=argparse.SUPPRESS)


@writes(NAME, *FILES)
def run(args: argparse.Namespace) -> int:
    """Measure and write; returns 0, or 1 if interrupted once there was a reference.

    Raises:
        BadInput: campaign or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    from fitting.lab.tradeoff.api import campaign_of
    from fitting.lab.tradeoff.report import screen_lines
    from fitting.text.scratch import Scratch

    for name in GONE:
        if getattr(args, name) is not None:
            text = f"tradeoff: --{name} has no effect any more and goes with 0.4"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
    accuracies = () if args.accuracies is None else _accuracies(args.accuracies)
    options = ff.StudyOptions(accuracies=accuracies, quick=args.quick, fit=args.fit)
    with Scratch() as scratch:
        campaign = campaign_of(args.campaign or args.scene or USUAL_SCENE, scratch)
        with fmu_for([campaign], args.out, 1) as fmu, status_line(NAME) as tell:
            study = ff.tradeoff(
                campaign, fmu, options=options, out=args.out, resume=args.resume, progress=tell
            )
    study = replace(study, provenance={**study.provenance, "command": command_line(args, "resume")})
    files = ff.write_tradeoff(study, args.out)
    remove_earlier(args.out, ("fmu/*.fmu",))
    print(*screen_lines(study, files), sep="\n")
    return 0 if study.status == "finished" else 1


def _accuracies(text: str) -> tuple[float, ...]:
    result = []
    for word in text.split(","):
        try:
            value = float(word)
        except ValueError:
            value = 0.0
        if not 0.0 < value < 1.0:
            raise ff.BadInput(
                f"--accuracies: found {word.strip()!r}, wanted numbers between 0 and 1"
            )
        result.append(value)
    return tuple(sorted(set(result), reverse=True))
