"""The page of a check of an FMU: what it is, findings, what was run."""

from __future__ import annotations

from pathlib import Path

from fitting.campaign.check import Check
from fitting.fmu.findings import Severity
from fitting.report.figures.check import draw_repeats
from fitting.report.figures.style import save, style
from fitting.report.page import write_page
from fitting.report.words.check import (
    SHOWN,
    costs_line,
    described,
    examination_lines,
    finding_words,
    suits_line,
)


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
    costs = "" if examination.costs is None else costs_line(examination.costs)
    observed = {v.name for v in d.seen}
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
        cost=f"{costs[0].upper()}{costs[1:]}." if costs else "",
        findings=[finding_words(f) for f in found.findings],
        tried=[
            *(() if found.suits is None else (suits_line(found.suits),)),
            *found.unsuited,
            *examination_lines(found),
        ],
        variables=[v for v in d.variables.values() if v.causality in SHOWN or v.name in observed],
        origin=described(d),
    )


def _status(found: Check) -> tuple[str, str, str]:
    if found.failure is not None:
        return "Fails", str(found.failure), "bad"
    if found.unsuited:
        return "Runs, does not suit", found.unsuited[0], "bad"
    careful = sum(f.count for f in found.findings if f.severity is Severity.CAREFUL)
    if careful:
        things = "thing" if careful == 1 else "things"
        return "Runs", f"{careful} {things} to be careful about.", "doubt"
    return "Sound", "It runs, repeats, and breaks no rule that matters.", ""
