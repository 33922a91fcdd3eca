"""What draws from a posterior say, as tables, lines and a file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from fitting.inference.posterior.summary import (
    CONVERGED,
    Drawn,
    PosteriorMode,
    PosteriorOutput,
    PosteriorSummary,
    PosteriorValue,
)
from fitting.report.table import (
    Cell,
    Column,
    Table,
    csv_text,
    symbol,
    tabulate,
    terminal_text,
    text_lines,
    wrapped,
)
from fitting.text.arrays import FloatArray
from fitting.text.notation import number, settings_words, span, unit_text

NOTE = (
    "The intervals are central: 2.5 % (16 %) of the draws lie beyond either end. Of a value with "
    "several minima they hold what lies between these, too. "
    "R is 1 where all walkers agree; τ is the correlation time in steps, and so many independent "
    "draws are worth as much as these."
)
OUTPUT_NOTE = (
    "Read from the model at draws that are nearly independent. Where the model has no value of an "
    "output (a λ that is not real) its numbers are those of the other draws."
)

MODE_NOTE = (
    "The most likely minimum stands first; ln p is that of the posterior, less its value there. A "
    "draw counts for the minimum that it is nearest to, by the linearised errors there: a broad "
    "minimum may have more draws than a narrow one that is more likely."
)

D = TypeVar("D", bound=Drawn)


def value_table(found: PosteriorSummary) -> Table:
    """Every value with its intervals, beside the fit's.

    Args:
        found: What the draws say.
    """
    columns: tuple[Column[tuple[str, PosteriorValue]], ...] = (
        *_drawn(PosteriorValue),
        Column("R", lambda row: Cell(f"{row[1].rhat:.3f}", value=row[1].rhat)),
        Column("τ", lambda row: Cell(f"{row[1].tau:.1f}", value=row[1].tau)),
        Column("draws", lambda row: Cell(f"{row[1].effective:.0f}", value=row[1].effective)),
    )
    table = tabulate("Values", columns, found.values.items(), NOTE)
    return table if _has_truth(found.values) else table.without("truth")


def output_table(found: PosteriorSummary) -> Table:
    """Every derived output with its intervals, beside the fit's.

    Args:
        found: What the draws say.
    """
    columns: tuple[Column[tuple[str, PosteriorOutput]], ...] = (
        *_drawn(PosteriorOutput),
        Column("no value", lambda row: Cell(f"{100.0 * row[1].missing:.1f} %")),
        Column("draws", lambda row: Cell(str(row[1].draws), value=row[1].draws)),
    )
    table = tabulate("Derived outputs", columns, found.derived.items(), OUTPUT_NOTE)
    table = table if _has_truth(found.derived) else table.without("truth")
    return table if any(v.missing for v in found.derived.values()) else table.without("no value")


def _drawn(_: type[D]) -> tuple[Column[tuple[str, D]], ...]:
    """What draws, the fit and the truth say of a number of that kind."""
    return (
        Column("value", lambda row: symbol(row[0]), role="name"),
        Column("unit", lambda row: unit_text(row[1].unit)),
        Column("median", lambda row: _of(row[1].median, row[1].std)),
        Column("std", lambda row: _of(row[1].std, row[1].std)),
        Column("68 %", lambda row: _between(row[1].interval68)),
        Column("95 %", lambda row: _between(row[1].interval95)),
        Column("95 % of the fit", lambda row: _between(row[1].profile95)),
        Column("truth", lambda row: _of(row[1].truth, row[1].std)),
    )


def _has_truth(values: Mapping[str, Drawn]) -> bool:
    return any(math.isfinite(v.truth) for v in values.values())


def mode_table(found: PosteriorSummary) -> Table:
    """The minima, the most likely first, with the share of the draws that are nearest to each.

    Args:
        found: What the draws say.
    """
    shown = [name for name, v in found.values.items() if v.shared]
    columns: list[Column[PosteriorMode]] = [
        Column("minimum", lambda m: m.origin, role="name"),
        Column("ln p", _below),
        Column("share of draws", _share),
        *(_place(name, unit_text(found.values[name].unit)) for name in shown),
    ]
    return tabulate(
        "Minima",
        columns,
        found.modes,
        MODE_NOTE,
    )


def _place(name: str, unit: str) -> Column[PosteriorMode]:
    return Column(name, lambda m: m.parameters[name], unit=unit, symbol=True)


def _below(mode: PosteriorMode) -> Cell:
    return Cell(f"−{mode.below:.2f}" if mode.below >= 0.005 else "0", value=-mode.below)


def _share(mode: PosteriorMode) -> Cell:
    if math.isnan(mode.share):
        return Cell("–")
    error = "" if math.isnan(mode.share_error) else f" ± {100.0 * mode.share_error:.1f}"
    return Cell(f"{100.0 * mode.share:.1f}{error} %", value=mode.share)


def _of(value: float, std: float) -> Cell:
    """A number to the third digit of its error, as far as it has one."""
    if math.isnan(value):
        return Cell("–")
    if not std > 0.0:
        return Cell(number(value, 8), value=value)
    place = math.floor(math.log10(std)) - 2
    text = f"{value:.{-place}f}" if -12 <= place < 0 else number(value, 8)
    return Cell(text.replace("-", "−"), value=value)


def _between(ends: tuple[float, float]) -> Cell:
    return Cell("–" if math.isnan(ends[0] + ends[1]) else span(*ends))


def posterior_lines(found: PosteriorSummary) -> list[str]:
    """All of it for a terminal, the answer first.

    Args:
        found: What the draws say.
    """
    lines = [found.title, "", *wrapped(ending(found)), ""]
    lines += text_lines(value_table(found))
    if found.derived:
        lines += ["", *text_lines(output_table(found))]
    if len(found.modes) > 1:
        lines += ["", *text_lines(mode_table(found))]
    lines += ["", *(line for note in found.notes for line in wrapped(note))]
    return [terminal_text(line) for line in lines]


def ending(found: PosteriorSummary) -> str:
    """How it ended, in a sentence.

    Args:
        found: What the draws say.
    """
    kept = found.steps - found.discarded
    words = f"{found.status}: {found.walkers} walkers, {kept} steps each"
    words += f" after {found.discarded} that are left out; {found.message}"
    if found.status != CONVERGED:
        words += "; no interval is told"
    if found.alternative:
        words += f"; {settings_words(found.alternative)}"
    return f"{words}."


def draws_csv(found: PosteriorSummary, draws: FloatArray, outputs: Mapping[str, FloatArray]) -> str:
    """Draws that are nearly independent as CSV, a row each, with derived outputs.

    Args:
        found: What they say.
        draws: (k, n) in the parameters' units.
        outputs: Derived outputs at these, (k,) each.
    """

    def column(k: int, name: str, unit: str) -> Column[Sequence[float]]:
        return Column(name, lambda row: float(row[k]), unit=unit)

    units = {name: v.unit for name, v in found.values.items()}
    units |= {name: found.derived[name].unit for name in outputs}
    columns = [column(k, name, unit) for k, (name, unit) in enumerate(units.items())]
    rows = np.column_stack([draws, *outputs.values()])
    return csv_text(tabulate("Draws", columns, rows.tolist()))
