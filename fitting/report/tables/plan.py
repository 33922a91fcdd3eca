"""The plan of a result as a table: what was decided, what it may cost, and why."""

from __future__ import annotations

from fitting.report.table import Cell, Column, Table, tabulate
from fitting.report.words.plan import choice_words
from fitting.simulate.budget import Decision, PlanRecord
from fitting.simulate.words import reason_in_words, subject_in_words
from fitting.text.notation import number

DECISIONS: tuple[Column[Decision], ...] = (
    Column("what", subject_in_words, role="name"),
    Column("choice", choice_words, role="words"),
    Column("bound", lambda decision: decision.bound, digits=2),
    Column("why", reason_in_words, role="words"),
)


def plan_table(plan: PlanRecord) -> Table:
    """A row per decision, the sum of the bounds against the wanted accuracy below.

    Args:
        plan: settings, settling and windows, with what they promise.
    """
    kept = plan.promised <= plan.wanted
    made = tabulate(
        "Decisions and their bounds",
        DECISIONS,
        plan.decisions,
        "Bounds are relative errors of a simulated amplitude, and add up. What was not taken costs "
        "nothing; its bound is what it would have cost.",
    )
    total = (
        Cell("sum", head=True),
        Cell("kept" if kept else "more than was wanted"),
        Cell(number(plan.promised, 2), value=plan.promised),
        Cell(f"wanted were {number(plan.wanted, 3)}", mark="words"),
    )
    return Table(caption=made.caption, heads=made.heads, rows=(*made.rows, total), note=made.note)
