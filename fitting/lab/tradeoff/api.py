"""Accuracy against cost, measured on this machine: every way of setting a simulation."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import platform
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import fitting
from fitting import Fmu
from fitting.extension.fmu import Where, named_fmu, one_fmu
from fitting.extension.problem import one_thread
from fitting.extension.records import Campaign, bind
from fitting.lab.names import SCENES
from fitting.lab.tradeoff import FILES
from fitting.lab.tradeoff.campaign import scene_of_campaign
from fitting.lab.tradeoff.records import Study
from fitting.lab.tradeoff.report import csv_of, markdown, write_report
from fitting.lab.tradeoff.scenes import Scene, scene_named
from fitting.lab.tradeoff.study import CHECKPOINT_NAME, Memory, StudyOptions, run_study
from fitting.text.files import write_whole
from fitting.text.records import to_plain
from fitting.text.results_folder import remove_earlier, results_folder
from fitting.text.scratch import Scratch

__all__ = ["Study", "StudyOptions", "tradeoff", "write_tradeoff"]


def fmu_of(subject: str | Campaign, workers: int = 1) -> Fmu:
    """The FMU of a built-in scene, or the one that a campaign names.

    Args:
        subject: Name of the scene, or the campaign.
        workers: Number of processes; of several, no fair times are measured.

    Raises:
        BadInput: no such scene, file or model.
    """
    named = one_fmu([subject]) if isinstance(subject, Campaign) else scene_named(subject).fmu
    return named_fmu(named, workers)


def memory_of(folder: Path, subject: str | Campaign, fmu: Fmu, options: StudyOptions) -> Memory:
    """Finished settings of this very study in a file of a folder, to go on from.

    Args:
        folder: Where the file is.
        subject: Name of a built-in scene, or a campaign.
        fmu: Its FMU.
        options: What is asked.

    Raises:
        BadInput: no such scene, or a campaign that does not fit the FMU.
    """
    content = {
        "scene": repr(_scene(subject, fmu)),
        "order": to_plain(replace(options, accuracies=())),
        "fmu": fmu.description.sha256,
        "versions": {name: version(name) for name in ("numpy", "scipy", "mpmath")},
        "version": fitting.__version__,
    }
    job = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return Memory(folder, job)


def tradeoff(
    subject: str | Campaign = SCENES[0],
    fmu: Fmu | None = None,
    *,
    options: StudyOptions | None = None,
    memory: Memory | None = None,
    progress: Callable[[str], None] = lambda _: None,
    executor: Where | None = None,
) -> Study:
    """Measure how accurate and how expensive every way of setting a simulation is.

    Errors of what is run do not depend on where settings are measured. Costs are those of the
    machine that did: processor time of the one thread that measures a setting and of its FMU's
    process.

    Args:
        subject: Name of a built-in scene ("string", "low-q", "duffing", "duffing-string"), or a
            campaign, which is studied through its own FMU.
        fmu: The FMU; None: the scene's or the campaign's, with one worker: fair times.
        options: Accuracies, quantities, how coarse; None: all of them, the fine grid.
        memory: Finished settings of an interrupted study; None: none, and none are kept.
        progress: Is called with a line of what is under way.
        executor: Where settings are measured: a number of processes of this machine, the address
            of a dask scheduler as "tcp://10.0.0.1:8786", which gets the FMU to its workers, or an
            executor, whose workers find the FMU by its path; None: one after the other, by ``fmu``.
            References, plans and the second timing of the cheapest are always done here.

    Returns:
        A measurement per setting, in the same order wherever it was measured, with its error and
        its cost.

    Raises:
        BadInput: no such scene or scheduler, or names and values that do not fit the FMU.
        FmuFailure: the FMU failed for the reference.
    """
    asked = options or StudyOptions()
    if fmu is None:
        with fmu_of(subject) as own:
            return tradeoff(
                subject, own, options=asked, memory=memory, progress=progress, executor=executor
            )
    with Scratch() as folder, one_thread():
        # an empty memory counts as false
        kept = memory_of(folder, subject, fmu, asked) if memory is None else memory
        study = run_study(_scene(subject, fmu), fmu.workers, asked, kept, progress, executor)
    return replace(study, provenance=_provenance(fmu, study, executor))


def write_tradeoff(study: Study, out: str | Path) -> list[Path]:
    """Write what the command line writes: tables, figure, report; a checkpoint is removed then.

    Args:
        study: What was measured.
        out: Folder, made where there is none.

    Returns:
        The paths of all files.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names of others.
    """
    # matplotlib takes a second to import: only where something is drawn
    drawn = importlib.import_module("fitting.lab.tradeoff.figure")
    folder = Path(out)
    with results_folder(folder, "tradeoff", FILES):
        tables = [folder / "tradeoff.csv", folder / "tradeoff.md"]
        for path, text in zip(tables, (csv_of(study), markdown(study)), strict=True):
            write_whole(path, text)
        figures = drawn.save_figures(study, folder / "figures")
        report = write_report(study, figures, folder)
        remove_earlier(folder, [name for name in FILES if name != CHECKPOINT_NAME])
        if study.status == "finished":
            (folder / CHECKPOINT_NAME).unlink(missing_ok=True)
    pictures = [path for figure in figures for path in figure.files]
    return [*tables, *pictures, report]


def _scene(subject: str | Campaign, fmu: Fmu) -> Scene:
    if isinstance(subject, str):
        return scene_named(subject)
    bound = bind(subject, fmu.variables)
    return scene_of_campaign(bound, subject.file.fmu, fmu.variables)


def _provenance(fmu: Fmu, study: Study, where: Where | None) -> dict[str, str]:
    d = fmu.description
    cost = (
        "processor time of the thread that asks and of the FMU's process; medians"
        if study.cost_kind == "processor"
        else f"wall time, {len(fmu.workers.pids)} worker processes; medians"
    )
    return {
        "command": "fitting.tradeoff",
        "FMU": f"{d.model_name}, {d.path.name}, SHA-256 {d.sha256}",
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}",
        "versions": f"fmu-fit {fitting.__version__}, Python {platform.python_version()}",
        "instances": fmu.workers.reuse_note,
        "cost": cost,
        **({} if where is None else {"settings": f"measured by {_place_in_words(where)}"}),
    }


def _place_in_words(where: Where) -> str:
    here = "the cheapest and the plan's once more by this machine alone"
    if isinstance(where, str):
        return f"the workers of {where}; {here}"
    if isinstance(where, int):
        return f"{where} process{'es' if where > 1 else ''} of this machine; {here}"
    return f"the workers of an executor, {type(where).__name__}; {here}"
