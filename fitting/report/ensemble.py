"""The page of an ensemble: do intervals hold the truth, what was found, what failed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.report.figures.file import FigureFile
from fitting.report.page import Page, Section, Status, write_page
from fitting.report.table import pairs_table
from fitting.report.tables.ensemble import (
    coverage_table,
    failure_table,
    status_table,
    value_table,
)
from fitting.result.ensemble import FINISHED, Ensemble


def write_report(found: Ensemble, figures: Sequence[FigureFile], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        found: many fits.
        figures: figure files that are shown.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(page_of(found, figures), folder)


def page_of(found: Ensemble, figures: Sequence[FigureFile]) -> Page:
    """The report as a page.

    Args:
        found: many fits.
        figures: figure files that are shown.
    """
    sections = []
    if found.coverage:
        sections.append(
            Section("coverage", "Coverage", tables=(coverage_table(found),), figures=tuple(figures))
        )
    if any(row.values for row in found.rows):
        sections.append(Section("values", "Values", tables=(value_table(found),)))
    ends = [status_table(found), failure_table(found)]
    sections.append(
        Section("ends", "How items ended", tables=tuple(table for table in ends if table.rows))
    )
    origin = pairs_table("Provenance", ("what", "value"), found.provenance)
    told = "Every item and value is a row of ensemble.csv, and every item a line of items.jsonl."
    sections.append(
        Section("origin", "Where this comes from", paragraphs=(told,), tables=(origin,))
    )
    return Page(
        title=found.title,
        kind="ensemble",
        status=Status(
            found.status,
            f"{found.message}.",
            found.status == FINISHED and not found.failures,
        ),
        sections=tuple(sections),
        synthetic=found.synthetic,
        published=True,
    )
