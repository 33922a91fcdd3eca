"""A study of accuracy against cost as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.lab.tradeoff.front import Choice, pareto
from fitting.lab.tradeoff.records import Study
from fitting.lab.tradeoff.tables import (
    HEADS,
    by_quantity,
    choice_cells,
    cost_text,
    error_text,
    failures,
    reference_sentence,
    time_text,
    words,
)
from fitting.report.figures.style import FigureFile
from fitting.report.page import Page, Section, Status, write_page
from fitting.report.table import Cell, Head, Table, pairs_table


def write_report(study: Study, figures: Sequence[FigureFile], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(page_of(study, figures), folder)


def page_of(study: Study, figures: Sequence[FigureFile]) -> Page:
    """The report as a page."""
    sections = [_accuracies(study), _picture(figures), _fronts(study)]
    if study.notes:
        sections.append(Section("plan", "What the plan says", points=study.notes))
    sections.append(_origin(study))
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
        f"{quantity}: the plan's setting for {choice.accuracy:g} has an error of "
        f"{error_text(choice.planned)}."
        for quantity, rows in by_quantity(study).items()
        for choice in rows
        if choice.planned is not None and choice.kept is False
    ]
    return missed + [f"A setting failed: {text}" for text in failures(study.measurements)]


def _accuracies(study: Study) -> Section:
    tables = []
    for quantity, rows in by_quantity(study).items():
        planned = any(row.planned for row in rows)
        heads = HEADS if planned else HEADS[:4]
        tables.append(
            Table(
                f"For this accuracy: these settings ({quantity})",
                tuple(Head(head) for head in heads),
                tuple(_row(row, len(heads)) for row in rows),
                reference_sentence(study, quantity),
            )
        )
    text = (
        "For every accuracy the cheapest of all settings that were tried and, where the plan was "
        "asked, what it chose. The ratio is the plan's cost over the cheapest. Errors are "
        "relative, the largest of all tones; “≤” marks one that the reference cannot tell from "
        "none."
    )
    return Section("accuracies", "For this accuracy: these settings", (text,), tables=tuple(tables))


def _row(choice: Choice, cells: int) -> tuple[Cell, ...]:
    texts = choice_cells(choice)[:cells]
    shown = [Cell(texts[0], head=True)]
    for place, text in enumerate(texts[1:], 1):
        mark = "words" if place in (1, 4) else ""
        if place == 5 and choice.kept is not None:
            mark = "yes" if choice.kept else "no"
        shown.append(Cell(text, mark=mark))
    return tuple(shown)


def _picture(figures: Sequence[FigureFile]) -> Section:
    return Section("figure", "The whole trade", figures=tuple(figures))


def _fronts(study: Study) -> Section:
    tables = []
    heads = tuple(
        Head(t) for t in ("error", "cost", "wall time", "FMU runs", "doStep", "getReal", "settings")
    )
    for quantity in by_quantity(study):
        rows = tuple(
            (
                Cell(error_text(m)),
                Cell(cost_text(m)),
                Cell(time_text(m.seconds)),
                Cell(str(m.runs)),
                Cell(str(m.steps)),
                Cell(str(m.reads)),
                Cell(words(m.setting), mark="words"),
            )
            for m in pareto(study.of(quantity))
        )
        tables.append(Table(f"Pareto front ({quantity})", heads, rows))
    text = (
        "Settings that no other one beats in error and cost. Every setting that was tried is a row "
        "of tradeoff.csv."
    )
    return Section("front", "Pareto front", (text,), tables=tuple(tables))


def _origin(study: Study) -> Section:
    table = pairs_table("Provenance", ("what", "value"), study.provenance)
    return Section("origin", "Where this comes from", tables=(table,))
