"""``fmu-fit tradeoff``: accuracy against cost, measured here: every way of setting a simulation."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import shlex
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import fitting
from fitting.campaign import bind, read_campaign
from fitting.cli.options import seed, worker_count
from fitting.cli.progress import status_line
from fitting.cli.results import writes
from fitting.fmu import FmuDescription, FmuWorkers
from fitting.fmu.models import provide_fmu
from fitting.lab.tradeoff.campaign import scene_of_campaign
from fitting.lab.tradeoff.records import QUANTITIES, Study
from fitting.lab.tradeoff.scenes import BUILT_IN, Scene, scene_named
from fitting.lab.tradeoff.study import CHECKPOINT_NAME, Memory, StudyOptions, run_study
from fitting.report.tables.tradeoff import csv_of, markdown, terminal
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.records import to_plain

NAME = "tradeoff"
EXAMPLE = "fmu-fit tradeoff --scene string --out out/tradeoff --quick"

#: What `--only` measures.
ONLY = {"amplitudes": QUANTITIES[:1], "widths": QUANTITIES[1:]}
QUICK_LONGEST_S, LONGEST_S = 2.0, 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--scene", choices=BUILT_IN, help=f"what is simulated ({BUILT_IN[0]})")
    kind.add_argument(
        "--campaign", type=Path, metavar="CAMPAIGN.toml", help="a campaign, through its own FMU"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder for results")
    parser.add_argument("--quick", action="store_true", help="a coarse grid, under a minute")
    parser.add_argument("--resume", action="store_true", help="go on from the finished settings")
    parser.add_argument(
        "--workers", type=worker_count(), default=1, help="worker processes (1: fair timings)"
    )
    parser.add_argument(
        "--accuracies",
        default="1e-2,1e-3,1e-4,1e-6,1e-9",
        metavar="X,X,...",
        help="accuracies of the table (1e-2,1e-3,1e-4,1e-6,1e-9)",
    )
    parser.add_argument("--only", choices=sorted(ONLY), help="amplitudes, or line widths (both)")
    parser.add_argument("--seed", type=seed(), default=1, help="order of the settings (1)")


@writes(NAME, "tradeoff.csv", "tradeoff.md", "report.html", CHECKPOINT_NAME, "figures/tradeoff_*.*")
def run(args: argparse.Namespace) -> int:
    """Measure and write; returns 0, or 1 if interrupted with something to show.

    Raises:
        BadInput: scene, campaign or FMU are not what they should be.
        FmuFailure: the FMU failed.
    """
    options = StudyOptions(
        accuracies=_accuracies(args.accuracies),
        seed=args.seed,
        quick=args.quick,
        longest_s=QUICK_LONGEST_S if args.quick else LONGEST_S,
        quantities=ONLY.get(args.only, QUANTITIES),
    )
    campaign = read_campaign(args.campaign) if args.campaign else None
    scene = scene_named(args.scene or BUILT_IN[0])
    choice = campaign.file.fmu if campaign else scene.fmu
    fmu = provide_fmu(choice, args.out / "fmu")
    with FmuWorkers(fmu, workers=args.workers, timeout_s=choice.timeout_s) as workers:
        description = workers.description
        if campaign is not None:
            bound = bind(campaign, description.variables)
            scene = scene_of_campaign(bound, choice, description.variables)
        job = _job(scene, options, description)
        memory = Memory(args.out, job)
        if args.resume:
            memory.resume()
            print(memory.resumed("settings"))
        with status_line(NAME) as tell:
            study = run_study(scene, workers, options, memory, tell)
        provenance = _provenance(args, description, workers.reuse_note, study.cost_kind)
        study = replace(study, provenance=provenance)
    for path in _write(study, args.out):
        print(path)
    print("\n".join(["", *terminal(study)]))
    if study.status != "finished":
        print(f"{study.status}: {study.message}")
        return 1
    memory.remove()
    return 0


def _accuracies(text: str) -> tuple[float, ...]:
    found = []
    for word in text.split(","):
        try:
            value = float(word)
        except ValueError:
            value = 0.0
        if not 0.0 < value < 1.0:
            raise BadInput(f"--accuracies: found {word.strip()!r}, wanted numbers between 0 and 1")
        found.append(value)
    return tuple(sorted(set(found), reverse=True))


def _job(scene: Scene, options: StudyOptions, description: FmuDescription) -> str:
    """Fingerprint of everything that a finished setting depends on."""
    content = {
        "scene": repr(scene),
        "order": to_plain(replace(options, accuracies=())),
        "fmu": description.sha256,
        "versions": {name: version(name) for name in ("numpy", "scipy", "mpmath")},
        "version": fitting.__version__,
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _provenance(
    args: argparse.Namespace, description: FmuDescription, reuse: str, cost_kind: str
) -> dict[str, str]:
    words = ["fmu-fit", NAME]
    if args.campaign:
        words += ["--campaign", args.campaign.as_posix()]
    else:
        words += ["--scene", args.scene or BUILT_IN[0]]
    words += ["--out", args.out.as_posix()]
    words += ["--only", args.only] if args.only else []
    words += ["--quick"] if args.quick else []
    cost = (
        "processor time of this process and the FMU's; medians"
        if cost_kind == "processor"
        else f"wall time, {args.workers} worker processes; medians"
    )
    return {
        "command": shlex.join(words),
        "FMU": f"{description.model_name}, {description.path.name}, SHA-256 {description.sha256}",
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}",
        "versions": f"fmu-fit {fitting.__version__}, Python {platform.python_version()}",
        "instances": reuse,
        "cost": cost,
    }


def _write(study: Study, out: Path) -> list[Path]:
    from fitting.report.figures.tradeoff import save_figures  # matplotlib takes its time
    from fitting.report.tradeoff import write_report

    write_whole(out / "tradeoff.csv", csv_of(study))
    write_whole(out / "tradeoff.md", markdown(study))
    figures = save_figures(study, out / "figures")
    page = write_report(study, figures, out)
    drawn = [path for figure in figures for path in (figure.png, figure.svg)]
    return [out / "tradeoff.csv", out / "tradeoff.md", *drawn, page]
