"""Many fits as page, tables and document: coverage of their intervals, values, failures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fitting.ensembles.result import FINISHED, Ensemble
from fitting.extension.report import (
    Figure,
    Table,
    csv_text,
    markdown_lines,
    printed_lines,
    table,
    write_page,
)
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
        "ensembles/page.html.j2",
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
            **{
                name: {
                    "count": share.count,
                    "total": share.total,
                    "low95": share.interval[0],
                    "high95": share.interval[1],
                }
                for name, share in (("held68", c.held68), ("held95", c.held95))
            },
        }
        for c in found.coverage
    ]
    names = ("title", "synthetic", "status", "message", "total", "statuses", "rows", "provenance")
    plain = {name: getattr(found, name) for name in names}
    return {**{name: plain[name] for name in names[:6]}, "coverage": coverage, **plain}


def csv_of(found: Ensemble) -> str:
    """A row per item and value; an item without a fit has a row with the reason.

    Args:
        found: many fits.
    """
    return csv_text(table("ensembles/ensemble_csv", ensemble=found))


def tables_of(found: Ensemble) -> dict[str, Table]:
    """All tables that have rows, by name, coverage first.

    Args:
        found: many fits.
    """
    names = ("coverage", "fitted", "statuses", "failures")
    tables = {name: table(f"ensembles/{name}", ensemble=found) for name in names}
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


def screen_lines(
    found: Ensemble, files: Sequence[Path] = (), *, resumed: int = 0, again: str = ""
) -> list[str]:
    """What `fmu-fit ensemble` prints: coverage where the truth is known, else values.

    Args:
        found: many fits.
        files: that were written, the report last.
        resumed: items that an earlier run had finished.
        again: the command that continues; empty where all items have ended.
    """
    first = table(f"ensembles/{'coverage' if found.coverage else 'fitted'}", ensemble=found)
    return printed_lines("ensembles/text", "screen", found, first, resumed, again, files)
