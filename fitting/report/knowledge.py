"""The report's section on what the data determine: sentences, tables, figures."""

from __future__ import annotations

import math
from collections.abc import Sequence

from fitting.fit.result import IDENTIFIABLE
from fitting.inference.knowledge import Knowledge, NuChoice, Profile
from fitting.report.figures.style import FigureFile
from fitting.report.tables import Cell, Table
from fitting.text.notation import markup, number, on_log_axis, span, unit_text

#: File names of the figures that belong here.
FIGURES = ("9_profiles", "10_together", "11_outputs", "12_nu")
ENDS = {
    "crossed": "ended by the data",
    "bound": "bound of the box",
    "round": "goes round",
    "lost": "nothing found beyond",
    "cost": "cut for its cost",
}


def knowledge_words(knowledge: Knowledge) -> tuple[str, ...]:
    """Paragraphs of the section."""
    first = (
        "Intervals and verdicts below come from the profile likelihood: every value is moved away "
        "from the most likely point, all other parameters follow it as well as they can, until the "
        "data object (Δχ² = 1 for 68 %, 3.84 for 95 %) or the box ends."
    )
    if not knowledge.data:
        first += (
            " No data were used: the measurements are taken to be those of the reference "
            "parameters, so that this is what such a campaign could determine."
        )
    extra = () if knowledge.nu is None else knowledge.nu.sentences
    return (first, *(_typeset(said) for said in (*knowledge.sentences, *extra)))


def _typeset(said: str) -> str:
    """A sentence of the terminal with the signs of print."""
    for plain, printed in (("chi^2", "χ²"), (" sigma", " σ"), (" nu ", " ν "), (" nu:", " ν:")):
        said = said.replace(plain, printed)
    return said


def knowledge_tables(knowledge: Knowledge) -> tuple[Table, ...]:
    """Profiles, directions, equivalent minima, choice of nu, bootstrap: those that exist."""
    made = [profile_table(knowledge), direction_table(knowledge), equivalent_table(knowledge)]
    if knowledge.nu is not None and knowledge.nu.rows:
        made.append(nu_table(knowledge.nu))
    made.append(bootstrap_table(knowledge))
    return tuple(table for table in made if table is not None)


def take_figures(figures: Sequence[FigureFile]) -> tuple[FigureFile, ...]:
    """Those figures that belong to this section, in its order."""
    return tuple(figure for name in FIGURES for figure in figures if figure.name == name)


def profile_table(knowledge: Knowledge) -> Table:
    """A row per parameter and output: intervals, how they end, shrinkage, verdict."""
    rows = tuple(_profile_row(name, p) for name, p in knowledge.profiles.items())
    heads = (
        "value",
        "unit",
        "most likely",
        "68 %",
        "95 %",
        "without data",
        "ends below",
        "ends above",
        "shrinkage",
        "verdict",
    )
    return Table(
        "Profile likelihood",
        tuple(Cell(text) for text in heads),
        rows,
        "Shrinkage is 1 − (width of the 95 % interval over the width without data)²: 0, the data "
        "say nothing; 1, they say all. Where a value is not determined, the 95 % interval is the "
        "range that the box leaves and the most likely value is only where the search stood.",
    )


def _profile_row(name: str, p: Profile) -> tuple[Cell, ...]:
    marks = dict(zip(IDENTIFIABLE, ("yes", "partly", "no"), strict=True))
    best = number(p.best, 8) if p.verdict != IDENTIFIABLE[2] else "–"
    return (
        Cell(markup(name), html=True, head=True),
        Cell(unit_text(p.unit)),
        Cell(best, p.best if best != "–" else None),
        _interval(p.interval68),
        _interval(p.interval95),
        _interval(p.box),
        Cell(ENDS.get(p.ends[0], p.ends[0])),
        Cell(ENDS.get(p.ends[1], p.ends[1])),
        Cell(number(p.shrinkage, 3), p.shrinkage),
        Cell(p.verdict, mark=marks.get(p.verdict, "")),
    )


def _interval(bounds: tuple[float, float]) -> Cell:
    return Cell(span(*bounds)) if all(map(math.isfinite, bounds)) else Cell("–")


def direction_table(knowledge: Knowledge) -> Table | None:
    """Singular values with their directions; what was tried along those that nothing sees."""
    if not knowledge.directions:
        return None
    names = list(knowledge.directions[0].vector)
    rows = tuple(
        (
            Cell(str(k + 1), head=True),
            Cell(number(d.singular, 3), d.singular),
            Cell(number(d.share, 3), d.share),
            *(Cell(number(d.vector[name], 3), d.vector[name]) for name in names),
            Cell(_typeset(d.sentence) or "seen", mark="words"),
        )
        for k, d in enumerate(knowledge.directions)
    )
    heads = (
        Cell("direction"),
        Cell("σ per unit of x"),
        Cell("σ per box"),
        *(Cell(markup(name), html=True) for name in names),
        Cell("what was tried"),
    )
    return Table(
        "Singular values of the sensitivities",
        heads,
        rows,
        "x = (p − reference)/scale. A direction whose singular value is far below one per box "
        "changes nothing that was measured; the change in the last column was simulated.",
    )


def equivalent_table(knowledge: Knowledge) -> Table | None:
    """Other points that fit as well; None without any."""
    if not knowledge.equivalents:
        return None
    rows = tuple(
        (
            Cell(str(k + 1), head=True),
            Cell(other.origin),
            Cell(number(other.delta, 2)),
            Cell(other.sentence, mark="words"),
        )
        for k, other in enumerate(knowledge.equivalents)
    )
    heads = tuple(Cell(text) for text in ("minimum", "found from", "Δχ²", "where"))
    return Table("Equivalent minima", heads, rows)


def nu_table(nu: NuChoice) -> Table:
    """The result at every nu, with what the criteria say of it."""
    names = list(nu.rows[0].parameters)
    outputs = list(nu.rows[0].derived)
    rows = []
    for row in nu.rows:
        chosen = [
            word
            for word, at in (
                ("L-curve", nu.corner),
                ("discrepancy", nu.discrepancy),
                ("schedule", nu.last),
            )
            if row.nu == at
        ]
        rows.append(
            (
                Cell(on_log_axis(row.nu), row.nu),
                Cell(number(row.j_fit, 6), row.j_fit),
                Cell(number(row.distance, 4), row.distance),
                Cell(number(row.chi_square, 4), row.chi_square),
                *(_value(row.parameters.get(name, math.nan)) for name in names),
                *(_value(row.derived.get(name, math.nan)) for name in outputs),
                Cell(", ".join(chosen)),
            )
        )
    heads = (
        Cell("ν"),
        Cell("J_fit"),
        Cell("|x|"),
        Cell("χ²"),
        *(Cell(markup(name), html=True) for name in (*names, *outputs)),
        Cell("chosen by"),
    )
    return Table(
        "The result at every ν, and what would choose it",
        heads,
        tuple(rows),
        f"χ² is held against {number(nu.allowed, 4)}, which noise stays below in 95 % of cases.",
    )


def _value(value: float) -> Cell:
    return Cell(number(value, 8), value if math.isfinite(value) else None)


def bootstrap_table(knowledge: Knowledge) -> Table | None:
    """Percentile intervals of the bootstrap beside those of the profiles; None without one."""
    found = knowledge.bootstrap
    if found is None or not found.values:
        return None
    profiles = knowledge.profiles
    rows = tuple(
        (
            Cell(markup(name), html=True, head=True),
            Cell(unit_text(profiles[name].unit)),
            _value(value.median),
            Cell(number(value.std, 2), value.std),
            _interval(value.interval95),
            _interval(profiles[name].interval95),
        )
        for name, value in found.values.items()
    )
    heads = ("value", "unit", "median", "std", "95 %, bootstrap", "95 %, profile")
    return Table("Parametric bootstrap", tuple(Cell(text) for text in heads), rows, found.sentence)
