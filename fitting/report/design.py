"""A design as one self-contained HTML file: what to measure next, and the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.design.result import Design, Proposal
from fitting.measurements.figure import Figure
from fitting.report.page import write_page
from fitting.report.table import Table, table
from fitting.report.words import design as design_words
from fitting.text.notation import hertz


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
        message=design_words.promise_sentence(design),
        synthetic=design.synthetic,
        figures=figures,
        design=design,
        words={**vars(design_words), **globals()},
    )


def proposal_table(design: Design) -> Table:
    """A row per proposed measurement, under one for the data so far.

    Args:
        design: the proposed next measurement.
    """
    return table("proposals", design=design, w={**vars(design_words), **globals()})


def around(p: Proposal) -> str:
    """Where a measurement is driven, and around which resonance.

    Args:
        p: a proposed measurement.
    """
    if p.points:
        return f"{design_words.driven_words(p)} around {hertz(p.centre_hz, digits=7)}"
    offsets = " and ".join(f"{f - p.centre_hz:+.4g} Hz" for f in p.tones_hz)
    return f"{offsets} from {hertz(p.centre_hz, digits=7)}"


def level(p: Proposal) -> str:
    """Drive level and settings of a measurement.

    Args:
        p: a proposed measurement.
    """
    settings = "".join(f", {name} = {value}" for name, value in p.settings.items())
    return f"{p.level:g}{settings}"
