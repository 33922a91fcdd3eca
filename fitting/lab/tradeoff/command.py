"""``fmu-fit tradeoff``: accuracy against cost, measured here: every way of setting a simulation."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path

import fitting as ff
from fitting.extension.command import fmu_for, seed, status_line, worker_count, writes
from fitting.lab.names import QUANTITIES, SCENES
from fitting.lab.tradeoff import FILES
from fitting.text.results_folder import remove_earlier

NAME = "tradeoff"
EXAMPLE = "fmu-fit tradeoff --scene string --out out/tradeoff --quick"

#: What `--only` measures.
ONLY = {"amplitudes": QUANTITIES[:1], "widths": QUANTITIES[1:]}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--scene", choices=SCENES, help=f"what is simulated ({SCENES[0]})")
    kind.add_argument(
        "--campaign", type=Path, metavar="CAMPAIGN.toml", help="a campaign, through its own FMU"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--quick", action="store_true", help="a coarse grid")
    parser.add_argument("--resume", action="store_true", help="continue from the finished settings")
    place = parser.add_mutually_exclusive_group()
    place.add_argument(
        "--workers",
        type=worker_count(),
        default=1,
        help="processes of this machine, a setting at a time in each (1: fair wall times, too)",
    )
    place.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="a dask scheduler whose workers measure the settings, as tcp://10.0.0.1:8786; costs "
        "are those of its machines",
    )
    parser.add_argument(
        "--accuracies",
        default="1e-2,1e-3,1e-4,1e-6,1e-9",
        metavar="X,X,...",
        help="accuracies of the table (1e-2,1e-3,1e-4,1e-6,1e-9)",
    )
    parser.add_argument("--only", choices=sorted(ONLY), help="amplitudes, or line widths (both)")
    parser.add_argument("--seed", type=seed(), default=1, help="order of the settings (1)")


@writes(NAME, *FILES)
def run(args: argparse.Namespace) -> int:
    """Measure and write; returns 0, or 1 if interrupted once there was a reference.

    Raises:
        BadInput: scene, campaign, FMU or scheduler are not what they should be.
        FmuFailure: the FMU failed.
    """
    from fitting.lab.tradeoff.api import fmu_of, memory_of
    from fitting.lab.tradeoff.report import screen_lines

    options = ff.StudyOptions(
        accuracies=_accuracies(args.accuracies),
        seed=args.seed,
        quick=args.quick,
        quantities=ONLY.get(args.only, QUANTITIES),
    )
    scene = args.scene or SCENES[0]
    campaign = ff.read_campaign(args.campaign) if args.campaign else None
    subject = campaign or scene
    with fmu_for([campaign], args.out, 1) if campaign else fmu_of(scene) as fmu:
        memory = memory_of(args.out, subject, fmu, options)
        if args.resume:
            memory.resume()
            print(memory.resumed("settings"))
        with status_line(NAME) as tell:
            study = ff.tradeoff(
                subject,
                fmu,
                options=options,
                memory=memory,
                progress=tell,
                executor=args.scheduler or (args.workers if args.workers > 1 else None),
            )
    study = replace(study, provenance={**study.provenance, "command": _command(args)})
    files = ff.write_tradeoff(study, args.out)
    remove_earlier(args.out, ("fmu/*.fmu",))
    print(*screen_lines(study, files), sep="\n")
    return 0 if study.status == "finished" else 1


def _accuracies(text: str) -> tuple[float, ...]:
    found = []
    for word in text.split(","):
        try:
            value = float(word)
        except ValueError:
            value = 0.0
        if not 0.0 < value < 1.0:
            raise ff.BadInput(
                f"--accuracies: found {word.strip()!r}, wanted numbers between 0 and 1"
            )
        found.append(value)
    return tuple(sorted(set(found), reverse=True))


def _command(args: argparse.Namespace) -> str:
    words = ["fmu-fit", NAME]
    if args.campaign:
        words += ["--campaign", args.campaign.as_posix()]
    else:
        words += ["--scene", args.scene or SCENES[0]]
    words += ["--out", args.out.as_posix()]
    words += ["--only", args.only] if args.only else []
    words += ["--quick"] if args.quick else []
    return shlex.join(words)
