"""The page of a posterior: whether the draws are enough, what they say, the corner figure."""

from __future__ import annotations

from pathlib import Path

from fitting.inference.posterior.summary import CONVERGED, PosteriorSummary
from fitting.report.figures.file import FigureFile
from fitting.report.page import Page, Section, Status, write_page
from fitting.report.table import pairs_table
from fitting.report.tables.posterior import ending, mode_table, output_table, value_table

LATER = "derived outputs of the fit stand beside them once there are enough draws"


def write_report(found: PosteriorSummary, figure: FigureFile, folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        found: What the draws say.
        figure: The corner figure.
        folder: Where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    tables = [value_table(found)]
    if found.derived:
        tables.append(output_table(found))
    if len(found.modes) > 1:
        tables.append(mode_table(found))
    facts = {
        "walkers": str(found.walkers),
        "steps": f"{found.steps}, of which the first {found.discarded} are left out",
        "evaluations of the model": str(found.evaluations),
        "proposals taken": f"{100.0 * found.accepted:.0f} %",
        "seed": str(found.seed),
        **found.provenance,
    }
    origin = pairs_table("Provenance", ("what", "value"), facts)
    kept = "chain.npz holds every step, draws.csv draws that are nearly independent"
    # they are read from the model at enough draws alone
    kept += "." if found.status == CONVERGED else f"; {LATER}."
    sections = (
        Section(
            "values", "Values", paragraphs=found.notes, tables=tuple(tables), figures=(figure,)
        ),
        Section("origin", "Where this comes from", paragraphs=(kept,), tables=(origin,)),
    )
    page = Page(
        title=found.title,
        kind="posterior",
        status=Status(found.status, ending(found), found.status == CONVERGED),
        sections=sections,
        synthetic=found.synthetic,
    )
    return write_page(page, folder)
