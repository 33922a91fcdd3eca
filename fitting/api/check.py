"""A doctor for FMUs."""

from __future__ import annotations

import importlib
from pathlib import Path

from fitting.api.fmu import Fmu, held_fmu
from fitting.api.written import CHECK_FILES
from fitting.campaign import Campaign
from fitting.campaign.check import Check, check_fmu
from fitting.measurements.kinds import read_campaign
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder


def check(
    fmu: Fmu | str | Path,
    campaign: str | Path | Campaign | None = None,
    *,
    step_s: float | None = None,
) -> Check:
    """Look at an FMU as a doctor does: what is wrong is told, not raised.

    Args:
        fmu: The FMU, its path, or the name of a model of this project.
        campaign: A campaign that it may suit; its start values hold for the trial run.
        step_s: Length of the trial step, s, above zero; None: the FMU's own, four of a fixed one of
            its solver, else 1 ms.

    Returns:
        ``sound`` sums it up; ``findings`` (by severity), ``failure`` and ``unsuited``
        say what is wrong, ``examination`` holds what was tried and measured.

    Raises:
        BadInput: no FMU that this machine can run, a campaign that cannot be read, no time.
    """
    if step_s is not None and not step_s > 0.0:
        raise BadInput(f"step_s: found {step_s!r}, wanted a positive time")
    held = held_fmu(fmu)
    if campaign is not None and not isinstance(campaign, Campaign):
        campaign = read_campaign(campaign)
    return check_fmu(held.workers, campaign, step_s)


def write_check(found: Check, out: str | Path) -> Path:
    """Write what was found as a page, report.html with its figure.

    Args:
        found: What `check` returned.
        out: Folder, made where there is none.

    Returns:
        The path of the page.

    Raises:
        BadInput: the folder cannot be written, or holds files of these names that are not ours.
    """
    # matplotlib takes a second to import: only where something is drawn
    report = importlib.import_module("fitting.report.check")
    with results_folder(Path(out), "check", CHECK_FILES):
        page: Path = report.write_report(found, Path(out))
        remove_earlier(Path(out), CHECK_FILES)
    return page
