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


def write_report(ensemble: Ensemble, figures: Sequence[Figure], folder: Path) -> Path:
    """Write `report.html` into a folder, whole or not at all, and return its path.

    Args:
        ensemble: many fits.
        figures: saved for the page.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    good = ensemble.status == FINISHED and not ensemble.failures
    return write_page(
        folder,
        "ensembles/page.html.j2",
        title=ensemble.title,
        kind="ensemble",
        status=ensemble.status,
        message=f"{ensemble.message}.",
        mark="" if good else "bad",
        synthetic=ensemble.synthetic,
        figures=figures,
        published=True,
        ensemble=ensemble,
    )


def document(ensemble: Ensemble) -> dict[str, Any]:
    """The record with the coverage of its values, for other programs.

    Args:
        ensemble: many fits.
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
        for c in ensemble.coverage
    ]
    names = ("title", "synthetic", "status", "message", "total", "statuses", "rows", "provenance")
    plain = {name: getattr(ensemble, name) for name in names}
    return {**{name: plain[name] for name in names[:6]}, "coverage": coverage, **plain}


def csv_of(ensemble: Ensemble) -> str:
    """A row per item and value; an item without a fit has a row with the reason.

    Args:
        ensemble: many fits.
    """
    return csv_text(table("ensembles/ensemble_csv", ensemble=ensemble))


def tables_of(ensemble: Ensemble) -> dict[str, Table]:
    """All tables that have rows, by name, coverage first.

    Args:
        ensemble: many fits.
    """
    names = ("coverage", "fitted", "statuses", "failures")
    tables = {name: table(f"ensembles/{name}", ensemble=ensemble) for name in names}
    return {name: made for name, made in tables.items() if made.rows}


def markdown(ensemble: Ensemble) -> str:
    """All tables as Markdown.

    Args:
        ensemble: many fits.
    """
    lines = [f"# {ensemble.title}", "", f"{ensemble.message}.", ""]
    if ensemble.synthetic:
        lines += ["Synthetic: simulated, not measured on a device.", ""]
    return "\n".join(
        [*lines, *markdown_lines((t.caption, t) for t in tables_of(ensemble).values())]
    )


def screen_lines(
    ensemble: Ensemble, files: Sequence[Path] = (), *, resumed: int = 0, again: str = ""
) -> list[str]:
    """What `fmu-fit ensemble` prints: coverage where the truth is known, else values.

    Args:
        ensemble: many fits.
        files: that were written, the report last.
        resumed: items that an earlier run had finished.
        again: the command that continues; empty where all items have ended.
    """
    first = table(f"ensembles/{'coverage' if ensemble.coverage else 'fitted'}", ensemble=ensemble)
    return printed_lines("ensembles/text", "screen", ensemble, first, resumed, again, files)
