"""The page of a check of an FMU: what it is, findings, what was run."""

from __future__ import annotations

from pathlib import Path

from fitting.campaign.check import Check
from fitting.fmu.findings import Severity
from fitting.report.figures.check import draw_repeats
from fitting.report.figures.style import save, style
from fitting.report.page import write_page
from fitting.report.screen import phrase, phrases
from fitting.report.screens import CHECKED, variables_of


def write_report(found: Check, out_dir: Path) -> Path:
    """Draw the figure (`out_dir`/figures), write `report.html` and return its path.

    Args:
        found: of the FMU.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    d, examination = found.description, found.examination
    figures = []
    with style():
        repeats = examination.repeats
        drawing = None if repeats is None else draw_repeats(repeats, d.model_name)
        if drawing is not None:
            figures.append(save(drawing, out_dir / "figures", for_page=True))
    costs = "" if examination.costs is None else phrase("check", "costs", examination.costs)
    status, message, mark = _status(found)
    return write_page(
        out_dir,
        "check.html.j2",
        title=d.model_name,
        kind="check of an FMU",
        status=status,
        message=message,
        mark=mark,
        warnings=found.warnings,
        figures=figures,
        cost=costs,
        findings=[phrase("check", "finding", f) for f in found.findings],
        tried=[
            *(() if found.suits is None else (phrase("check", "suits", found.suits),)),
            *found.unsuited,
            *phrases("check", "examination", found, CHECKED),
        ],
        variables=variables_of(d),
        origin={
            "file": str(d.path),
            "FMI": d.fmi_version,
            "platforms": ", ".join(d.platforms),
            "guid": d.guid,
            "sha256": d.sha256,
            "made by": phrase("check", "tool", d),
            "further": "; ".join(phrases("check", "further", d)) or "nothing",
        },
    )


def _status(found: Check) -> tuple[str, str, str]:
    if found.failure is not None:
        return "Fails", str(found.failure), "bad"
    if found.unsuited:
        return "Runs, does not suit", found.unsuited[0], "bad"
    careful = sum(f.count for f in found.findings if f.severity is Severity.CAREFUL)
    if careful:
        return "Runs", f"Warnings: {careful}.", "doubt"
    return "Sound", "It runs, repeats, and violates no rule that matters.", ""
