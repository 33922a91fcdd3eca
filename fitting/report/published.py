"""The values as files for a publication: CSV with exact numbers, LaTeX with rounded ones."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from fitting.report.screen import phrase
from fitting.report.summary import by_line
from fitting.report.table import csv_text, environment, table
from fitting.report.tables import is_reported, values
from fitting.result.result import Result
from fitting.signal.student import ratio95
from fitting.text.estimate import NOWHERE, FittedEstimate, Verdict
from fitting.text.notation import rounded_alike, span, symbol, unit_text, with_error
from fitting.text.results_folder import write_whole

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
_SIGNS = {"±": r"$\pm$", "−": "$-$", "×": r"$\times$", "\u00a0": "~", "µ": r"\textmu{}"}
_GREEK = re.compile(r"[\u0370-\u03ff]")
#: Exponents as they are written here and in units, for which LaTeX has its own way.
_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺", "0123456789-+")
_RAISED = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+")
_POWER = re.compile(r"\*\*\(?(-?[\d.]+)\)?")

#: A value for print and the source of its numbers; NaN is what there is not.
Row = tuple[FittedEstimate, str]


def write_values(result: Result, folder: Path) -> tuple[Path, Path]:
    """Write `values.csv` and `values.tex` into a folder; their paths.

    Args:
        result: of a reconstruction.
        folder: where the files go.

    Raises:
        BadInput: the folder cannot be written.
    """
    rows = list(rows_of(result))
    paths = folder / CSV_NAME, folder / LATEX_NAME
    write_whole(paths[0], csv_text(table("published", rows=rows)))
    write_whole(paths[1], latex(rows))
    return paths


def rows_of(result: Result) -> Iterator[Row]:
    """Every value of the fit, by its own line too where the sweep by itself gives a better one.

    Args:
        result: of a reconstruction.
    """
    for name, _, e, _ in values(result):
        row, source = replace(e, name=name), "fit"
        if not e.is_most_likely:
            source = "Algorithm 2, std and interval of the likelihood"
            row = replace(row, most_likely=math.nan, ci68=NOWHERE)  # error bars are another's
        if not is_reported(e):
            row = replace(row, value=math.nan, std=math.nan, ci68=NOWHERE)
        yield row, source
        line = None if e.role == "offset" else by_line(name, e, result.line)
        if line is not None and result.line is not None:
            best, std = line
            half = std * ratio95(result.line.dof)
            better = replace(
                row, value=best, std=std, ci68=NOWHERE, ci95=(best - half, best + half)
            )
            better = replace(better, status=Verdict.DETERMINED, active_bounds=(), period=None)
            yield better, "line of the sweep alone"


def latex(rows: Sequence[Row]) -> str:
    """The rows as a LaTeX tabular, which needs no package but textcomp.

    Args:
        rows: of the table.
    """
    templates = environment(escaped=False)
    templates.filters |= {"latex": latex_text, "name": latex_name, "value": _value, "ends": _ends}
    return templates.get_template("values.tex.j2").render(rows=rows)


def _value(e: FittedEstimate) -> str:
    """A value with its error, or with both where they differ: 235^{+128}_{-89}."""
    bars, unit = e.bars, unit_text(e.unit)
    if not math.isfinite(e.value):
        return "--"
    if bars.is_even:
        return latex_text(with_error(e.value, e.std, unit))
    least = min(bars.below, bars.above)
    written = rounded_alike(e.value, bars.below, bars.above, error=least)
    value, below, above = (latex_text(part).replace("$", "") for part in written)
    return f"${value}^{{+{above}}}_{{-{below}}}$" + (f"~{latex_text(unit)}" if unit else "")


def _ends(e: FittedEstimate) -> str:
    """The 95 % interval in words."""
    if e.is_all_round:
        return phrase("values", "period", e)
    return span(*e.ci95, unit_text(e.unit)) if math.isfinite(e.ci95[0]) else "--"


def latex_name(name: str) -> str:
    """A name as LaTeX sets it: a symbol as such, others as words.

    Args:
        name: of a quantity.
    """
    parts = symbol(name)
    if parts is None:
        return latex_text(name)
    letter, index = parts
    if _GREEK.fullmatch(letter):  # by its command
        size, _, word = unicodedata.name(letter).removeprefix("GREEK ").partition(" LETTER ")
        word = word.lower().replace("lamda", "lambda")
        letter = f"\\{word.capitalize() if size == 'CAPITAL' else word}"
    return f"${letter}_{{{index.replace('−', '-')}}}$" if index else f"${letter}$"


def latex_text(text: str) -> str:
    """Text with the letters that LaTeX takes for commands written out.

    Args:
        text: as it was written.
    """
    written = "".join(_LATEX.get(letter, letter) for letter in text)
    for sign, there in _SIGNS.items():
        written = written.replace(sign, there)
    written = _RAISED.sub(lambda match: f"$^{{{match[0].translate(_LOWERED)}}}$", written)
    return _POWER.sub(r"$^{\1}$", written).replace("*", r"$\cdot$")
