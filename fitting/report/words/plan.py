"""The decisions of a plan in words."""

from __future__ import annotations

from fitting.simulate.budget import Decision, PlanRecord
from fitting.simulate.words import choice_in_words, decision_in_words, subject_in_words


def choice_words(decision: Decision) -> str:
    """What was chosen, and whether the user asked for it or forbade it.

    Args:
        decision: of the plan.
    """
    marks = ["as asked for"] if decision.forced and decision.taken else []
    marks += [] if decision.taken else ["forbidden" if decision.forced else "not taken"]
    choice = choice_in_words(decision)
    return f"{choice} ({', '.join(marks)})" if marks else choice


def plan_line(plan: PlanRecord) -> str:
    """The plan in one line for a terminal.

    Args:
        plan: settings, settling and windows, with what they promise.
    """
    decisions = (d for d in plan.decisions if d.taken)
    taken = ", ".join(f"{subject_in_words(d)} {choice_in_words(d)}" for d in decisions)
    return f"plan: amplitudes within {plan.promised:.1e}, wanted {plan.wanted:.1e} ({taken})"


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
