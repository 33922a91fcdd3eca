"""A design as one self-contained HTML file: what to measure next, and the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.design.result import Design, Ways
from fitting.extension.report import Figure, Table, phrase, printed_lines, table, write_page


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
        "design/page.html.j2",
        title=f"Next measurement: {design.title}",
        kind="next measurement",
        status=f"{len(design.proposals)} measurements proposed",
        message=phrase("design/text", "promise", design),
        synthetic=design.synthetic,
        figures=figures,
        design=design,
    )


def proposal_table(design: Design) -> Table:
    """A row per proposed measurement, under one for the data so far.

    Args:
        design: the proposed next measurement.
    """
    return table("design/proposals", design=design)


def screen_lines(design: Design, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints: a row for each proposed measurement.

    Args:
        design: the proposed next measurements.
        files: design.json, design.csv, the campaign to be filled in, the report if there is one.
        verbose: whether candidates, points of equal fit and assumptions are printed.
    """
    rows = table("design/expected", of=design, rows=design.proposals)
    return printed_lines("design/text", "screen", design, rows, verbose, files)


def ways_lines(ways: Ways, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints of several kinds of measurements that are compared.

    Args:
        ways: to spend the same time, the least expected error first.
        files: ways.json, and the campaigns to be filled in.
        verbose: whether the times of each kind are printed.
    """
    rows = table("design/expected", of=ways, rows=ways.ways, takes=True)
    return printed_lines("design/text", "ways", ways, rows, verbose, files)
