"""Draws from a posterior as page, lines and file: whether they are enough, their intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.extension.report import (
    Figure,
    Table,
    exact_text,
    phrase,
    printed_lines,
    table,
    write_page,
)
from fitting.posterior.summary import CONVERGED, PosteriorSummary
from fitting.text.arrays import FloatArray
from fitting.text.notation import unit_text, with_unit
from fitting.text.tables import csv_text


def write_report(summary: PosteriorSummary, figure: Figure, folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        summary: of the draws.
        figure: The corner figure.
        folder: Where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    facts = {
        "walkers": str(summary.walkers),
        "steps": f"{summary.steps}, of which the first {summary.discarded} are discarded",
        "evaluations of the model": str(summary.evaluations),
        "accepted proposals": f"{100.0 * summary.accepted:.0f} %",
        "seed": str(summary.seed),
        **summary.provenance,
    }
    return write_page(
        folder,
        "posterior/page.html.j2",
        title=summary.title,
        kind="posterior",
        status=summary.status,
        message=phrase("posterior/text", "ending", summary),
        mark="" if summary.status == CONVERGED else "bad",
        synthetic=summary.synthetic,
        figures=[figure],
        posterior=summary,
        tables=tables_of(summary),
        facts=facts,
    )


def tables_of(summary: PosteriorSummary, *, short: bool = False) -> list[Table]:
    """Parameters, derived outputs and minima, those that there are.

    Args:
        summary: of the draws.
        short: whether the first one has no columns on convergence.
    """
    rows, outputs = summary.values, summary.derived
    known = [any(math.isfinite(v.truth) for v in each.values()) for each in (rows, outputs)]
    tables = [table("posterior/posterior", rows=rows, title="Values", truth=known[0], short=short)]
    if outputs:
        missing = any(v.missing for v in outputs.values())
        more = {"title": "Derived outputs", "truth": known[1], "outputs": True, "missing": missing}
        tables.append(table("posterior/posterior", rows=outputs, **more))
    return (
        [*tables, table("posterior/minima", posterior=summary)]
        if len(summary.modes) > 1
        else tables
    )


def draws_csv(
    summary: PosteriorSummary, draws: FloatArray, outputs: Mapping[str, FloatArray]
) -> str:
    """Draws that are nearly independent as CSV, a row each, with derived outputs.

    Args:
        summary: of the draws.
        draws: (k, n) in the parameters' units.
        outputs: Derived outputs at these, (k,) each.
    """
    units = {name: v.unit for name, v in summary.values.items()}
    units |= {name: summary.derived[name].unit for name in outputs}
    heads = [with_unit(name, unit_text(unit)) for name, unit in units.items()]
    rows = np.column_stack([draws, *outputs.values()]).tolist()
    cells = ([exact_text(v) if math.isfinite(v) else "" for v in row] for row in rows)
    return csv_text([heads, *cells])


def screen_lines(
    summary: PosteriorSummary, files: Sequence[Path] = (), *, again: str = "", verbose: bool = False
) -> list[str]:
    """What `fmu-fit posterior` prints: values with intervals, and how to continue.

    Args:
        summary: the draws, summarised.
        files: that were written, the report last.
        again: the command that continues; empty where there are enough draws.
        verbose: whether convergence, outputs and minima are printed.
    """
    short, tables = tables_of(summary, short=True)[0], tables_of(summary)
    return printed_lines("posterior/text", "screen", summary, short, tables, verbose, again, files)
