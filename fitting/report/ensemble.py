"""Many fits as page, tables and document: coverage of their intervals, values, failures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fitting.measurements.figure import Figure
from fitting.report.page import write_page
from fitting.report.table import Table, csv_text, markdown_lines, table
from fitting.result.ensemble import FINISHED, Ensemble, Share
from fitting.text.records import to_plain


def write_report(found: Ensemble, figures: Sequence[Figure], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        found: many fits.
        figures: saved for the page.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    good = found.status == FINISHED and not found.failures
    return write_page(
        folder,
        "ensemble.html.j2",
        title=found.title,
        kind="ensemble",
        status=found.status,
        message=f"{found.message}.",
        mark="" if good else "bad",
        synthetic=found.synthetic,
        figures=figures,
        published=True,
        ensemble=found,
    )


def document(found: Ensemble) -> dict[str, Any]:
    """The record with the coverage of its values, for other programs.

    Args:
        found: many fits.
    """
    coverage = [
        {
            **{k: v for k, v in to_plain(c).items() if k not in ("pulls", "held68", "held95")},
            "pull_mean": c.pull_mean,
            "pull_std": c.pull_std,
            "held68": _share(c.held68),
            "held95": _share(c.held95),
        }
        for c in found.coverage
    ]
    names = ("title", "synthetic", "status", "message", "total", "statuses", "rows", "provenance")
    plain = {name: getattr(found, name) for name in names}
    return {**{name: plain[name] for name in names[:6]}, "coverage": coverage, **plain}


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval
    return {"count": share.count, "total": share.total, "low95": low, "high95": high}


def csv_of(found: Ensemble) -> str:
    """A row per item and value; an item without a fit has a row with the reason.

    Args:
        found: many fits.
    """
    return csv_text(table("ensemble_csv", ensemble=found))


def tables_of(found: Ensemble) -> dict[str, Table]:
    """All tables that have rows, by name, coverage first.

    Args:
        found: many fits.
    """
    names = ("coverage", "fitted", "statuses", "failures")
    tables = {name: table(name, ensemble=found) for name in names}
    return {name: made for name, made in tables.items() if made.rows}


def markdown(found: Ensemble) -> str:
    """All tables as Markdown.

    Args:
        found: many fits.
    """
    lines = [f"# {found.title}", "", f"{found.message}.", ""]
    if found.synthetic:
        lines += ["Synthetic: simulated, not measured on a device.", ""]
    return "\n".join([*lines, *markdown_lines((t.caption, t) for t in tables_of(found).values())])
