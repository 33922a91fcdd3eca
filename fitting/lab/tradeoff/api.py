"""Accuracy against cost of a campaign's simulation, measured on this machine."""

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
from fitting.extension.fmu import fmu_of
from fitting.extension.problem import one_thread
from fitting.extension.records import Campaign, read_campaign
from fitting.lab.names import SCENES, USUAL_SCENE
from fitting.lab.synthesis import synthesize, synthesize_curves
from fitting.lab.tradeoff import FILES, ROWS_NAME
from fitting.lab.tradeoff.records import Row, Study
from fitting.lab.tradeoff.report import csv_of, markdown
from fitting.lab.tradeoff.study import StudyOptions, run_study
from fitting.text.errors import BadInput
from fitting.text.journal import Journal
from fitting.text.results_folder import remove_earlier, results_folder, write_whole
from fitting.text.scratch import Scratch

__all__ = ["Study", "StudyOptions", "tradeoff", "write_tradeoff"]


def tradeoff(
    subject: str | Path | Campaign = USUAL_SCENE,
    fmu: Fmu | None = None,
    *,
    options: StudyOptions | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Study:
    """Measure accuracy and cost of every way to simulate a campaign, of any kind and FMU.

    Args:
        subject: A campaign, its path, or the name of a synthetic one ("string", ...).
        fmu: The FMU; None: the campaign's, with one worker for fair times.
        options: Accuracies, and whether to fit; None: the usual accuracies, no fits.
        out: Folder for rows as they are measured; None: not kept.
        resume: Whether rows of an interrupted study there are kept.
        progress: Called with a line at every step.

    Returns:
        A row per setting with processor time and errors, or the reason of its failure.

    Raises:
        BadInput: no such campaign, a campaign that does not fit the FMU, rows of another study.
        FmuFailure: the FMU failed for every reference.
    """
    requested = options or StudyOptions()
    with Scratch() as scratch, one_thread():
        campaign = campaign_of(subject, scratch)
        if fmu is None:
            with fmu_of([campaign], workers=1) as own:
                return _studied(campaign, own, requested, Path(out or scratch), resume, progress)
        return _studied(campaign, fmu, requested, Path(out or scratch), resume, progress)


def campaign_of(subject: str | Path | Campaign, folder: Path) -> Campaign:
    """A campaign, read, or synthesized into a folder where it is the name of a synthetic one.

    Args:
        subject: A campaign or its path, or the name of a synthetic one.
        folder: Where that is written.

    Raises:
        BadInput: no such campaign.
    """
    if isinstance(subject, Campaign):
        return subject
    if str(subject) not in SCENES:
        return read_campaign(Path(subject))
    kind, series = SCENES[str(subject)]
    (synthesize if kind == "series" else synthesize_curves)(series, out=folder)
    return read_campaign(folder / "campaign.toml")


def _studied(
    campaign: Campaign,
    fmu: Fmu,
    options: StudyOptions,
    folder: Path,
    resume: bool,
    progress: Callable[[str], None],
) -> Study:
    content = {
        "campaign": repr(campaign.file),
        "files": [hashlib.sha256(file.read_bytes()).hexdigest() for file in campaign.files],
        "fit": options.fit,
        "fmu": fmu.description.sha256,
        "versions": {name: version(name) for name in ("numpy", "scipy")},
        "version": fitting.__version__,
    }
    job = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    journal = Journal(folder / ROWS_NAME, job, Row)
    known = {row.setting.name: row for row in journal.resume()} if resume else {}
    study = run_study(campaign, fmu, options, journal, known, progress)
    return replace(study, provenance=_provenance(fmu))


def write_tradeoff(study: Study, out: str | Path) -> list[Path]:
    """Write tables and figure, as the command does.

    Args:
        study: Of `tradeoff`.
        out: Folder, made where there is none.

    Returns:
        The files.

    Raises:
        BadInput: the folder cannot be written, or holds other files of these names.
    """
    # matplotlib takes a second to import: only where something is drawn
    drawn = importlib.import_module("fitting.lab.tradeoff.figure")
    folder = Path(out)
    with results_folder(folder, "tradeoff", FILES):
        tables = [folder / "tradeoff.csv", folder / "tradeoff.md"]
        for path, text in zip(tables, (csv_of(study), markdown(study)), strict=True):
            write_whole(path, text)
        figures = drawn.save_figures(study, folder / "figures")
        remove_earlier(folder, [name for name in FILES if name != ROWS_NAME])
        if study.status == "finished":
            (folder / ROWS_NAME).unlink(missing_ok=True)
    return [*tables, *(path for figure in figures for path in figure.files)]


def _provenance(fmu: Fmu) -> dict[str, str]:
    d = fmu.description
    if len(fmu.workers.pids) > 1:
        raise BadInput(f"fmu: has {len(fmu.workers.pids)} workers, wanted one: fair times")
    return {
        "command": "fitting.tradeoff",
        "FMU": f"{d.model_name}, {d.path.name}, SHA-256 {d.sha256}",
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}",
        "versions": f"fmu-fit {fitting.__version__}, Python {platform.python_version()}",
        "cost": "processor time of the thread that asks and of the FMU's process; medians",
    }
