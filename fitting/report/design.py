"""A design as one self-contained HTML file: what to measure next, and the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.design.result import Design
from fitting.measurements.figure import Figure
from fitting.report.page import write_page
from fitting.report.screen import phrase
from fitting.report.table import Table, table


def write_report(design: Design, figures: Sequence[Figure], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        design: the proposed next measurement.
        figures: saved for the page.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(
        folder,
        "design.html.j2",
        title=f"Next measurement: {design.title}",
        kind="next measurement",
        status=f"{len(design.proposals)} measurements proposed",
        message=phrase("design", "promise", design),
        synthetic=design.synthetic,
        figures=figures,
        design=design,
    )


def proposal_table(design: Design) -> Table:
    """A row per proposed measurement, under one for the data so far.

    Args:
        design: the proposed next measurement.
    """
    return table("proposals", design=design)
