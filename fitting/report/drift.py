"""The report's compact table of what belongs to one experiment alone: offsets from the drift."""

from __future__ import annotations

from fitting.fit.result import Result
from fitting.report.tables import Cell, Table
from fitting.text.notation import markup, number, span, unit_text


def offset_table(result: Result) -> Table | None:
    """Offset, error and prior of every state of the sample; None without fitted ones."""
    if not result.offsets:
        return None
    rows = tuple(
        (
            Cell(", ".join(o.experiments), head=True),
            Cell(", ".join(markup(name) for name in o.variables), html=True),
            Cell(number(o.value, 5), o.value),
            Cell(unit_text(o.unit)),
            Cell(number(o.std, 2), o.std),
            Cell(span(*o.ci95)),
            Cell("–" if o.prior != o.prior else f"0 ± {number(o.prior, 3)}"),
            Cell(number(o.shrinkage, 3), o.shrinkage),
            Cell(o.identifiable),
        )
        for o in result.offsets
    )
    heads = (
        "experiment",
        "added to",
        "value",
        "unit",
        "std",
        "95 % interval",
        "prior",
        "shrinkage",
        "by the data",
    )
    return Table(
        "Values of single experiments",
        tuple(Cell(text) for text in heads),
        rows,
        "Offsets are counted from the drift interpolated between the values before and after the "
        "series; the prior of a random walk is that of its last step.",
    )
