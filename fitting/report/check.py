"""The page of a doctor: what an FMU is, what was found, what was tried."""

from __future__ import annotations

from pathlib import Path

from fitting.campaign.check import Check
from fitting.fmu import FmuVariable
from fitting.fmu.findings import Severity
from fitting.report.figures.check import draw_repeats
from fitting.report.figures.file import FigureFile
from fitting.report.figures.style import save, style
from fitting.report.page import Line, Page, Section, Status, write_page
from fitting.report.table import Column, Table, pairs_table, tabulate
from fitting.report.words.check import (
    SHOWN,
    costs_line,
    described,
    examination_lines,
    finding_words,
    suits_line,
)

FIGURES = "figures"


def write_report(found: Check, out_dir: Path) -> Path:
    """Draw the figure (`out_dir`/figures), write `report.html` and return its path.

    Args:
        found: of the FMU.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    d = found.description
    figures: tuple[FigureFile, ...] = ()
    with style():
        repeats = found.examination.repeats
        drawing = None if repeats is None else draw_repeats(repeats, d.model_name)
        if drawing is not None:
            figures = (save(drawing, out_dir / FIGURES, for_page=True),)
    costs = found.examination.costs
    page = Page(
        title=d.model_name,
        kind="what a doctor finds of an FMU",
        status=_status(found),
        answer=() if costs is None else (Line("Cost", words=_sentence(costs_line(costs))),),
        sections=tuple(s for s in _sections(found, figures) if s is not None),
        synthetic=False,
        warnings=found.warnings,
    )
    return write_page(page, out_dir)


def _status(found: Check) -> Status:
    if found.failure is not None:
        return Status("Fails", str(found.failure), good=False)
    if found.unsuited:
        return Status("Runs, does not suit", found.unsuited[0], good=False)
    careful = sum(f.count for f in found.findings if f.severity is Severity.CAREFUL)
    if careful:
        things = "thing" if careful == 1 else "things"
        return Status("Runs", f"{careful} {things} to be careful about.", good=True, doubtful=True)
    return Status("Sound", "It runs, repeats, and breaks no rule that matters.", good=True)


def _sentence(line: str) -> str:
    """A line of the terminal as a sentence."""
    return f"{line[0].upper()}{line[1:]}."


def _sections(found: Check, figures: tuple[FigureFile, ...]) -> list[Section | None]:
    suits = () if found.suits is None else (suits_line(found.suits),)
    return [
        Section(
            "findings",
            "What was found",
            paragraphs=() if found.findings else ("Nothing to be careful about.",),
            points=tuple(finding_words(f) for f in found.findings),
        ),
        Section(
            "tried",
            "What was tried",
            points=(*suits, *found.unsuited, *examination_lines(found)),
            figures=figures,
        ),
        Section("variables", "Variables", tables=(_variables(found),), folded=True),
        Section("origin", "Origin", tables=(_origin(found),), folded=True),
    ]


def _variables(found: Check) -> Table:
    d = found.description
    seen = {v.name for v in d.seen}
    shown = [v for v in d.variables.values() if v.causality in SHOWN or v.name in seen]
    columns: tuple[Column[FmuVariable], ...] = (
        Column("variable", lambda v: v.name, role="name"),
        Column("causality", lambda v: v.causality),
        Column("variability", lambda v: v.variability),
        Column("type", lambda v: v.kind),
        Column("start", lambda v: "" if v.start is None else str(v.start)),
        Column("unit", lambda v: v.unit or ""),
        Column("meaning", lambda v: v.description, role="words"),
    )
    return tabulate("Variables", columns, shown)


def _origin(found: Check) -> Table:
    return pairs_table("Origin", ("what", "which"), described(found.description))
