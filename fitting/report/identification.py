"""The report of an identification: what data determine, before or after a fit."""

from __future__ import annotations

from pathlib import Path

from fitting.inference.likelihood.knowledge import Identification
from fitting.report.figures.inference import knowledge_figures
from fitting.report.figures.numbers import of_identification
from fitting.report.figures.style import save, style
from fitting.report.page import Page, Section, Status, write_page
from fitting.report.reconstruction import knowledge_section
from fitting.report.table import pairs_table
from fitting.report.tables.inference import part_table
from fitting.report.words.identification import part_sentences
from fitting.report.words.inference import open_values_sentence
from fitting.text.estimate import Verdict

FIGURES = "figures"


def _part(found: Identification) -> Section | None:
    if found.part is None:
        return None
    return Section(
        "part",
        "A part of the measurements alone",
        paragraphs=part_sentences(found, found.part),
        tables=(part_table(found, found.part),),
    )


def write_report(found: Identification, out_dir: Path) -> Path:
    """Draw the figures (`out_dir`/figures), write `report.html` and return its path.

    Args:
        found: what the data determine.
        out_dir: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    with style():
        planned = of_identification(
            knowledge_figures(found, found.title, synthetic=found.synthetic)
        )
        figures = tuple(save(p.drawing(), out_dir / FIGURES, for_page=True) for p in planned)
    origin = pairs_table(
        "Origin", ("what", "which"), {**found.provenance, "set out from": found.at}
    )
    made = (
        knowledge_section(found, figures),
        _part(found),
        Section("provenance", "Provenance", tables=(origin,)),
    )
    open_ = any(p.status is not Verdict.DETERMINED for p in found.profiled.values())
    page = Page(
        title=found.title,
        kind="what the data determine",
        status=Status("Identified", open_values_sentence(found), not open_),
        sections=tuple(section for section in made if section is not None),
        synthetic=found.synthetic,
    )
    return write_page(page, out_dir)
