"""Tables of campaigns that were fitted together."""

from __future__ import annotations

import math
from collections.abc import Callable

from fitting.inference.joint_result import SeriesPart
from fitting.report.table import Column, Table, symbol, tabulate
from fitting.result.result import Result
from fitting.text.notation import quantity

SERIES: tuple[Column[SeriesPart], ...] = (
    Column("campaign", lambda part: part.name, role="name"),
    Column("scale by", lambda part: part.scale_kind),
    Column("χ", lambda part: part.chi, digits=6),
    Column("rows", lambda part: part.rows),
    Column("numbers determined", lambda part: part.determined),
    Column("χ² in the joint fit", lambda part: part.chi_square_joint, digits=4),
    Column("χ² alone", lambda part: part.chi_square_alone, digits=4),
    Column("noise widened by", lambda part: part.inflation, digits=3),
)


def joint_tables(result: Result) -> tuple[Table, ...]:
    """Campaigns of a joint fit: scale and fit of each, and what each determines alone.

    Args:
        result: of a reconstruction.
    """
    if result.joint is None:
        return ()
    series = result.joint.series
    together = tabulate(
        "Campaigns of the joint fit",
        SERIES,
        series,
        "χ² and numbers are those of the problem linearised at the joint solution, drift offsets "
        "included; the noise of a campaign is widened first where its residuals exceed it.",
    )
    units = {name: p.unit for name, p in result.parameters.items()}
    units |= {name: d.unit for name, d in result.derived.items()}
    columns: list[Column[str]] = [Column("value", symbol, role="name")]
    columns += [Column(f"{part.name} alone", _alone(part, units)) for part in series]
    alone = tabulate(
        "What each campaign determines by itself",
        columns,
        series[0].alone,
        "A dash where that campaign's data do not determine the value.",
    )
    return (together, alone)


def _alone(part: SeriesPart, units: dict[str, str]) -> Callable[[str], str]:
    """What a campaign says of a value by itself."""

    def words(name: str) -> str:
        found = part.alone.get(name)
        if found is None or not math.isfinite(found.std):
            return "–"
        return quantity(found.value, found.std, units.get(name, ""))

    return words
