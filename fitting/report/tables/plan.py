"""The plan of a result as a table: what was decided, what it may cost, and why."""

from __future__ import annotations

from collections.abc import Callable

from fitting.report.table import Cell, Column, Table, tabulate
from fitting.simulate.budget import Decision, PlanRecord
from fitting.simulate.words import decision_in_words
from fitting.text.notation import number
from fitting.text.rendering import blocks


def _of(macro: str) -> Callable[[Decision], str]:
    """What a macro of the plan's template prints of a decision."""
    return lambda decision: str(getattr(blocks("plan"), macro)(decision))


DECISIONS: tuple[Column[Decision], ...] = (
    Column("what", _of("subject"), role="name"),
    Column("choice", _of("chosen"), role="words"),
    Column("bound", lambda decision: decision.bound, digits=2),
    Column("why", _of("reason"), role="words"),
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
        Cell("kept" if kept else "more than requested"),
        Cell(number(plan.promised, 2), value=plan.promised),
        Cell(f"requested: {number(plan.wanted, 3)}", mark="words"),
    )
    return Table(caption=made.caption, heads=made.heads, rows=(*made.rows, total), note=made.note)


def remarks(plan: PlanRecord | None, sentences: tuple[str, ...]) -> tuple[str, ...]:
    """Sentences of a plan that its table does not hold.

    Args:
        plan: settings, settling and windows, with what they promise.
        sentences: as they are shown.
    """
    if plan is None:
        return sentences
    held = {decision_in_words(decision).lower() for decision in plan.decisions}
    return tuple(
        text
        for text in sentences
        if text.lower().removesuffix(".") not in held and not text.startswith("In all: ")
    )
