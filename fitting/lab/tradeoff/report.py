"""A study of accuracy against cost as page and tables: choices, Pareto fronts, every setting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fitting.extension.report import (
    Figure,
    Table,
    csv_text,
    markdown_lines,
    printed_lines,
    render,
    table,
    write_page,
)
from fitting.lab.names import QUANTITIES, WIDTH_SWEEP
from fitting.lab.tradeoff.front import Choice, choices, pareto
from fitting.lab.tradeoff.records import COHERENT, TOLERANCE, Measurement, Setting, Study
from fitting.text.notation import number, prefixed

TEMPLATE = "lab/tradeoff/page.html.j2"


def write_report(study: Study, figures: Sequence[Figure], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        study: errors and costs of every setting.
        figures: saved for the page.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    return write_page(folder, TEMPLATE, **_content(study, figures))


def page_of(study: Study, figures: Sequence[Figure]) -> str:
    """The page as HTML text.

    Args:
        study: errors and costs of every setting.
        figures: saved for the page.
    """
    return render(TEMPLATE, **_content(study, figures))


def _content(study: Study, figures: Sequence[Figure]) -> dict[str, Any]:
    missed = [
        f"{choice.quantity}: the plan's setting for {choice.accuracy:g} has an error of "
        f"{error_text(choice.planned)}."
        for choice in choices(study)
        if choice.kept is False
    ]
    failed = dict.fromkeys(m.note for m in study.measurements if m.failed and m.note)
    described = f"{study.description[0].upper()}{study.description[1:]}"
    return {
        "title": f"{study.title}: accuracy against cost",
        "kind": "trade-off",
        "status": study.status,
        "message": f"{described}. {study.message}",
        "mark": "" if study.status == "finished" else "bad",
        "synthetic": study.synthetic,
        "warnings": [*missed, *(f"A setting failed: {text}" for text in failed)],
        "figures": figures,
        "study": study,
        "choices": choice_tables(study),
        "fronts": [
            table("lab/tradeoff/front", quantity=q, rows=pareto(study.of(q)), w=globals())
            for q in QUANTITIES
            if study.of(q)
        ],
    }


def words(setting: Setting) -> str:
    """A setting in words.

    Args:
        setting: of the simulation: solver, settling, samples.
    """
    parts = [setting.solver]
    if setting.resolution_kind == TOLERANCE:
        parts.append(f"tolerance {number(setting.resolution, 3)}")
    elif setting.resolution_kind:
        parts.append(f"{number(setting.resolution, 4)} {setting.resolution_kind}")
    if setting.periodic:
        parts.append("periodic start")
    if setting.settle_s:
        parts.append(f"settled {time_text(setting.settle_s)}")
    if setting.quantity != WIDTH_SWEEP:
        window = "whole periods" if setting.reader == COHERENT else f"window {setting.reader}"
        parts.append(f"{setting.samples} samples in {time_text(setting.window_s)}, {window}")
    if setting.sweep_points:
        parts.append(f"{setting.sweep_points} sweep points")
    if setting.iterations:
        parts.append(f"Jacobian step {number(setting.jacobian_step, 2)}")
        parts.append(f"{setting.iterations} iterations")
    return ", ".join(parts)


def time_text(seconds: float) -> str:
    """A time with a prefix, three digits; minutes and hours in s.

    Args:
        seconds: time, s.
    """
    if not math.isfinite(seconds):
        return "–"
    factor, unit = prefixed(seconds, "s") if seconds < 1.0 else (1.0, "s")
    return f"{number(seconds / factor, 3)}\u00a0{unit}"


def error_text(m: Measurement | None) -> str:
    """An error; one that is the reference's own as a bound.

    Args:
        m: error and cost, None where it was not measured.
    """
    return "–" if m is None else f"{'≤ ' if m.bounded else ''}{number(m.error, 2)}"


def cost_text(m: Measurement | None) -> str:
    """A cost; one that was not run is called so.

    Args:
        m: error and cost, None where it was not measured.
    """
    if m is None:
        return "–"
    return time_text(m.cost_s) + (" (extrapolated)" if m.extrapolated else "")


def reference_sentence(study: Study, quantity: str) -> str:
    """What errors of a quantity are measured from.

    Args:
        study: errors and costs of every setting.
        quantity: what is measured of a response.
    """
    for reference in study.references:
        if reference.quantity == quantity:
            return f"Errors from: {reference.source}; its own error {number(reference.error, 2)}."
    return ""


def csv_of(study: Study) -> str:
    """A row per setting; cells that have no number are empty.

    Args:
        study: errors and costs of every setting.
    """
    fronts = {id(m) for quantity in QUANTITIES for m in pareto(study.of(quantity))}
    order = QUANTITIES.index
    rows = sorted(study.measurements, key=lambda m: (order(m.setting.quantity), m.cost_s))
    return csv_text(
        table("lab/tradeoff/settings_csv", study=study, rows=[(m, id(m) in fronts) for m in rows])
    )


def choice_tables(study: Study) -> dict[str, Table]:
    """For this accuracy: these settings, by quantity; the plan's where it was used.

    Args:
        study: errors and costs of every setting.
    """
    rows: dict[str, list[Choice]] = {}
    for choice in choices(study):
        rows.setdefault(choice.quantity, []).append(choice)
    return {
        quantity: table(
            "lab/tradeoff/choices", study=study, quantity=quantity, rows=each, w=globals()
        )
        for quantity, each in rows.items()
    }


def markdown(study: Study) -> str:
    """All tables as Markdown, a heading per quantity.

    Args:
        study: errors and costs of every setting.
    """
    lines = [f"# {study.title}: accuracy against cost", "", f"{study.description}.", ""]
    if study.synthetic:
        lines += ["Synthetic: simulated, not measured on a device.", ""]
    lines += [f"Cost: {study.cost_kind} time.", ""]
    tables = choice_tables(study).items()
    return "\n".join([*lines, *markdown_lines((f"{q[0].upper()}{q[1:]}", t) for q, t in tables)])


def screen_lines(study: Study, files: Sequence[Path] = ()) -> list[str]:
    """What `fmu-fit tradeoff` prints: for each accuracy the cheapest settings, and the plan's.

    Args:
        study: errors and costs of every setting.
        files: that were written.
    """
    return printed_lines("lab/tradeoff/text", "screen", study, choice_tables(study), files)
