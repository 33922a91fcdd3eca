"""The values as files for a publication: CSV with exact numbers, LaTeX with rounded ones."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting.report.screen import phrase
from fitting.report.summary import by_line
from fitting.report.table import Cell, Column, csv_text, tabulate
from fitting.report.tables.values import Value, values_of
from fitting.result.result import Result
from fitting.signal.student import ratio95
from fitting.text.error_bars import EVEN, ErrorBars
from fitting.text.files import write_whole
from fitting.text.notation import rounded_alike, span, symbol, unit_text, with_error

CSV_NAME, LATEX_NAME = "values.csv", "values.tex"
#: Letters that LaTeX takes for commands, and how they are written.
_LATEX = {
    "\\": r"\textbackslash{}",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{sign: f"\\{sign}" for sign in "&%$#_"},
}
_SIGNS = {
    "±": r"$\pm$",
    "−": "$-$",
    "×": r"$\times$",
    "\u00a0": "~",
    "µ": r"\textmu{}",
}
_GREEK = re.compile(r"[\u0370-\u03ff]")
#: Exponents as they are written here and in units, for which LaTeX has its own way.
_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
_RAISED = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+")
_POWER = re.compile(r"\*\*\(?(-?[\d.]+)\)?")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One value for print: NaN is what there is not; `source` says whose number it is.

    `whole` are the words for an interval that is all of a period, for print; else empty.
    """

    name: str
    value: float
    unit: str
    std: float
    low: float
    high: float
    verdict: str
    source: str = "fit"
    bars: ErrorBars = EVEN
    whole: str = ""

    @property
    def interval(self) -> str:
        """The 95 % interval in words."""
        if self.whole or not math.isfinite(self.low):
            return self.whole or "--"
        return span(self.low, self.high, self.unit)

    @property
    def sides(self) -> tuple[float, float]:
        """Ends of the 68 % interval, NaN without a value."""
        if math.isnan(self.bars.below):
            return self.value - self.std, self.value + self.std
        return self.value - self.bars.below, self.value + self.bars.above


COLUMNS: tuple[Column[Row], ...] = (
    Column("name", lambda r: r.name, role="name"),
    Column("value", lambda r: _number(r.value)),
    Column("unit", lambda r: r.unit),
    Column("std", lambda r: _number(r.std)),
    Column("ci95 low", lambda r: _number(r.low)),
    Column("ci95 high", lambda r: _number(r.high)),
    Column("by the data", lambda r: r.verdict, role="words"),
    Column("source", lambda r: r.source),
    Column("ci68 low", lambda r: _number(r.sides[0])),
    Column("ci68 high", lambda r: _number(r.sides[1])),
)


def write_values(result: Result, folder: Path) -> tuple[Path, Path]:
    """Write `values.csv` and `values.tex` into a folder; their paths.

    Args:
        result: of a reconstruction.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    rows = rows_of(result)
    table, text = folder / CSV_NAME, folder / LATEX_NAME
    write_whole(table, csv_text(tabulate("", COLUMNS, rows)))
    write_whole(text, latex(rows))
    return table, text


def rows_of(result: Result) -> list[Row]:
    """Every value of the fit; those that the sweep by itself knows better once more, by it.

    Args:
        result: of a reconstruction.
    """
    rows = []
    for value in values_of(result):
        rows.append(_row(value))
        if value.offset:
            continue
        better = by_line(value.name, value.found, result.line)
        if better is not None and result.line is not None:
            rows.append(_row_of_line(value, *better, result.line.dof))
    return rows


def _row(value: Value) -> Row:
    found = value.found
    low, high = found.ci95
    return Row(
        name=value.name,
        value=math.nan if value.open else found.value,
        unit=unit_text(found.unit),
        std=math.nan if value.open else found.std,
        low=low,
        high=high,
        verdict=f"{found.status}{found.condition}",
        source="fit" if found.is_most_likely else "Algorithm 2, std and interval of the likelihood",
        bars=found.bars if found.is_most_likely and not value.open else EVEN,
        whole=phrase("values", "period", found) if found.is_all_round else "",
    )


def _row_of_line(value: Value, best: float, std: float, freedom: float) -> Row:
    half = std * ratio95(freedom)
    return Row(
        name=value.name,
        value=best,
        unit=unit_text(value.found.unit),
        std=std,
        low=best - half,
        high=best + half,
        verdict="determined",
        source="line of the sweep alone",
    )


def latex(rows: Sequence[Row]) -> str:
    """The rows as a LaTeX tabular, which needs no package but textcomp.

    Args:
        rows: of the table.
    """
    lines = [
        "% written by fmu-fit; +- is one standard deviation, + with - holds 68 %, intervals 95 %",
        r"\begin{tabular}{lllll}",
        r"\hline",
        r"quantity & value & 95\,\% interval & by the data & from \\",
        r"\hline",
    ]
    for row in rows:
        known = math.isfinite(row.value)
        shown = _latex_value(row) if known else "--"
        words = map(latex_text, (row.interval, row.verdict, row.source))
        cells = (latex_name(row.name), shown, *words)
        lines.append(" & ".join(cells) + r" \\")
    return "\n".join([*lines, r"\hline", r"\end{tabular}", ""])


def _latex_value(row: Row) -> str:
    """A value with its error, or with both where they differ: 235^{+128}_{-89}."""
    bars = row.bars
    if bars.is_even:
        return latex_text(with_error(row.value, row.std, row.unit))
    least = min(bars.below, bars.above)
    written = rounded_alike(row.value, bars.below, bars.above, error=least)
    value, below, above = (latex_text(part).replace("$", "") for part in written)
    return f"${value}^{{+{above}}}_{{-{below}}}$" + (f"~{latex_text(row.unit)}" if row.unit else "")


def latex_name(name: str) -> str:
    """A name as LaTeX sets it: a symbol as such, others as words.

    Args:
        name: of a quantity.
    """
    parts = symbol(name)
    if parts is None:
        return latex_text(name)
    letter, index = parts
    word = _greek(letter)
    return f"${word}_{{{index.replace('−', '-')}}}$" if index else f"${word}$"


def latex_text(text: str) -> str:
    """Text with the letters that LaTeX takes for commands written out.

    Args:
        text: as it was written.
    """
    written = "".join(_LATEX.get(letter, letter) for letter in text)
    for sign, there in _SIGNS.items():
        written = written.replace(sign, there)
    written = _RAISED.sub(lambda found: f"$^{{{found[0].translate(_LOWERED)}}}$", written)
    return _POWER.sub(r"$^{\1}$", written).replace("*", r"$\cdot$")


def _greek(letter: str) -> str:
    """A Greek letter by its command; others as they are."""
    if not _GREEK.fullmatch(letter):
        return letter
    size, _, word = unicodedata.name(letter).removeprefix("GREEK ").partition(" LETTER ")
    word = word.lower().replace("lamda", "lambda")
    return f"\\{word.capitalize() if size == 'CAPITAL' else word}"


def _number(value: float) -> Cell:
    return Cell(repr(value), value=value) if math.isfinite(value) else Cell("–")
