"""The report on campaigns that were fitted together, and on values from elsewhere."""

from __future__ import annotations

import math

from fitting.fit.result import Result
from fitting.report.tables import Cell, Table
from fitting.text.notation import markup, number, quantity


def joint_sentences(result: Result) -> tuple[str, ...]:
    """Whether campaigns agree with each other, and with values from elsewhere."""
    told = [t.sentence for t in result.joint.tensions] if result.joint is not None else []
    return (*told, *(test.sentence for test in result.external))


def joint_tables(result: Result) -> tuple[Table, ...]:
    """Campaigns of a joint fit: scale and fit of each, and what each determines alone."""
    if result.joint is None:
        return ()
    heads = (
        "campaign",
        "scale by",
        "χ",
        "rows",
        "numbers determined",
        "χ² in the joint fit",
        "χ² alone",
        "noise widened by",
    )
    rows = tuple(
        (
            Cell(part.name, head=True),
            Cell(part.scale_kind),
            Cell(number(part.chi), part.chi),
            Cell(str(part.rows)),
            Cell(str(part.determined)),
            Cell(number(part.chi_square_joint, 4), part.chi_square_joint),
            Cell(number(part.chi_square_alone, 4), part.chi_square_alone),
            Cell(number(part.inflation, 3), part.inflation),
        )
        for part in result.joint.series
    )
    note = (
        "χ² and numbers are those of the problem linearised at the joint solution, drift offsets "
        "included; the noise of a campaign is widened first where its residuals exceed it."
    )
    table = Table("Campaigns of the joint fit", _heads(heads), rows, note)
    return (table, _alone(result))


def _alone(result: Result) -> Table:
    assert result.joint is not None  # noqa: S101 - the caller asked
    series = result.joint.series
    units = {name: p.unit for name, p in result.parameters.items()}
    units |= {name: d.unit for name, d in result.derived.items()}
    rows = []
    for name in series[0].alone:
        cells = [Cell(markup(name), html=True, head=True)]
        for part in series:
            found = part.alone.get(name)
            known = found is not None and math.isfinite(found.std)
            shown = (
                quantity(found.value, found.std, units.get(name, "")) if known and found else "–"
            )
            cells.append(Cell(shown))
        rows.append(tuple(cells))
    heads = ("value", *(f"{part.name} alone" for part in series))
    note = "A dash where that campaign's data do not determine the value."
    return Table("What each campaign determines by itself", _heads(heads), tuple(rows), note)


def _heads(texts: tuple[str, ...]) -> tuple[Cell, ...]:
    return tuple(Cell(text) for text in texts)
