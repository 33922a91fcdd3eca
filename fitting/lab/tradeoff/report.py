"""A study as tables and on the screen: a row per setting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from fitting.extension.report import markdown_lines, printed_lines, table
from fitting.lab.tradeoff.records import Row, Study
from fitting.text.notation import number, with_prefix
from fitting.text.tables import csv_text

HEADS = (
    "setting",
    "mark",
    "evaluation_s",
    "runs",
    "steps",
    "promised",
    "error",
    "error_sigma",
    "fit_s",
    "largest_shift_sigma",
    "failed",
)


def csv_of(study: Study) -> str:
    """All rows as CSV, the reference first, with the shift of every value.

    Args:
        study: what was measured.
    """
    names = list(dict.fromkeys(name for row in study.rows for name in row.shifts))
    rows = [
        [*_cells(study, row), *(_text(row.shifts.get(name, math.nan)) for name in names)]
        for row in (study.reference, *study.rows)
    ]
    return csv_text([[*HEADS, *(f"shift_{name}_sigma" for name in names)], *rows])


def markdown(study: Study) -> str:
    """The study as a page of Markdown.

    Args:
        study: what was measured.
    """
    made = table("lab/tradeoff/rows", study=study, w=globals())
    lines = [f"# {study.title}: accuracy against cost", "", *markdown_lines([("Settings", made)])]
    lines += ["", *(f"- {name}: {value}" for name, value in study.provenance.items()), ""]
    return "\n".join(lines)


def screen_lines(study: Study, files: Sequence[Path]) -> list[str]:
    """What `fmu-fit tradeoff` prints.

    Args:
        study: what was measured.
        files: that were written.
    """
    made = table("lab/tradeoff/rows", study=study, w=globals())
    return printed_lines("lab/tradeoff/text", "screen", study, made, files)


def off_text(row: Row) -> str:
    """Its largest shift or error in standard deviations.

    Args:
        row: of a study.
    """
    return number(row.off, 2) if math.isfinite(row.off) else "–"


def time_text(seconds: float) -> str:
    """A time, or a dash where there is none.

    Args:
        seconds: processor time, s.
    """
    return with_prefix(seconds, "s", 2) if math.isfinite(seconds) else "–"


def error_text(error: float) -> str:
    """A relative error, or a dash where there is none.

    Args:
        error: relative.
    """
    return f"{error:.1e}" if not math.isnan(error) else "–"


def _cells(study: Study, row: Row) -> list[str]:
    shift = max(map(abs, row.shifts.values()), default=math.nan)
    numbers = (row.evaluation_s, row.runs, row.steps, row.promised, row.error, row.error_sigma)
    texts = [_text(float(value)) for value in (*numbers, row.fit_s, shift)]
    return [row.setting.name, study.mark(row), *texts, row.failed]


def _text(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}"
