"""The plan of a result as a table: what was decided, what it may cost, and why."""

from __future__ import annotations

import math

from fitting.report.tables import Cell, Table
from fitting.simulate.budget import Decision, PlanRecord, told
from fitting.text.notation import number

HEADS = ("what", "choice", "bound", "why")


def plan_table(plan: PlanRecord) -> Table:
    """A row per decision, the sum of the bounds against the wanted accuracy below."""
    rows = [_row(decision) for decision in plan.decisions]
    kept = plan.promised <= plan.wanted
    rows.append(
        (
            Cell("sum", head=True),
            Cell("kept" if kept else "more than was wanted"),
            Cell(_bound(plan.promised), plan.promised),
            Cell(f"wanted were {number(plan.wanted, 3)}", mark="words"),
        )
    )
    note = (
        "Bounds are relative errors of a simulated amplitude, and add up. What was not taken costs "
        "nothing; its bound is what it would have cost."
    )
    heads = tuple(Cell(head) for head in HEADS)
    return Table("Decisions and their bounds", heads, tuple(rows), note)


def remarks(plan: PlanRecord | None, sentences: tuple[str, ...]) -> tuple[str, ...]:
    """Sentences of a plan that its table does not hold."""
    if plan is None:
        return sentences
    held = {told(decision).lower() for decision in plan.decisions}
    return tuple(
        text
        for text in sentences
        if text.lower().removesuffix(".") not in held and not text.startswith("In all: ")
    )


def plan_line(plan: PlanRecord) -> str:
    """The plan in one line for a terminal."""
    taken = ", ".join(f"{d.subject} {d.choice}" for d in plan.decisions if d.taken)
    return f"plan: amplitudes within {plan.promised:.1e}, wanted {plan.wanted:.1e} ({taken})"


def _row(decision: Decision) -> tuple[Cell, ...]:
    marks = ["as asked for"] if decision.forced and decision.taken else []
    marks += [] if decision.taken else ["forbidden" if decision.forced else "not taken"]
    choice = f"{decision.choice} ({', '.join(marks)})" if marks else decision.choice
    return (
        Cell(decision.subject, head=True),
        Cell(choice, mark="words"),
        Cell(_bound(decision.bound), None if math.isnan(decision.bound) else decision.bound),
        Cell(decision.sentence, mark="words"),
    )


def _bound(bound: float) -> str:
    return number(bound, 2)
