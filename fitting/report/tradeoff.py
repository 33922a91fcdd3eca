"""A study of accuracy against cost as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.lab.tradeoff.front import choices
from fitting.lab.tradeoff.records import Study
from fitting.report.figures.file import FigureFile
from fitting.report.page import Page, Section, Status, write_page
from fitting.report.table import pairs_table
from fitting.report.tables.tradeoff import choice_tables, error_text, front_tables


def write_report(study: Study, figures: Sequence[FigureFile], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        study: errors and costs of every setting.
        figures: figure files that are shown.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(page_of(study, figures), folder)


def page_of(study: Study, figures: Sequence[FigureFile]) -> Page:
    """The report as a page.

    Args:
        study: errors and costs of every setting.
        figures: figure files that are shown.
    """
    title = "For this accuracy: these settings"
    text = (
        "For every accuracy the cheapest of all settings that were tried and, where the plan was "
        "asked, what it chose. The ratio is the plan's cost over the cheapest. Errors are "
        "relative, the largest of all tones; “≤” marks one that the reference cannot tell from "
        "none."
    )
    sections = [
        Section(
            "accuracies", title, paragraphs=(text,), tables=tuple(choice_tables(study).values())
        ),
    ]
    if figures:
        sections.append(Section("figure", "The whole trade", figures=tuple(figures)))
    sections.append(_fronts(study))
    if study.notes:
        sections.append(Section("plan", "What the plan says", points=study.notes))
    origin = pairs_table("Provenance", ("what", "value"), study.provenance)
    sections.append(Section("origin", "Where this comes from", tables=(origin,)))
    described = f"{study.description[0].upper()}{study.description[1:]}"
    return Page(
        title=f"{study.title}: accuracy against cost",
        kind="trade-off",
        status=Status(study.status, f"{described}. {study.message}", study.status == "finished"),
        sections=tuple(sections),
        synthetic=study.synthetic,
        warnings=tuple(_warnings(study)),
    )


def _warnings(study: Study) -> list[str]:
    missed = [
        f"{choice.quantity}: the plan's setting for {choice.accuracy:g} has an error of "
        f"{error_text(choice.planned)}."
        for choice in choices(study)
        if choice.kept is False
    ]
    failed = dict.fromkeys(m.note for m in study.measurements if m.failed and m.note)
    return missed + [f"A setting failed: {text}" for text in failed]


def _fronts(study: Study) -> Section:
    text = (
        "Settings that no other one beats in error and cost. Every setting that was tried is a row "
        "of tradeoff.csv."
    )
    return Section("front", "Pareto front", paragraphs=(text,), tables=tuple(front_tables(study)))
