"""A plan in sentences, as the tests read it."""

from __future__ import annotations

from fitting.simulate.budget import Budget
from fitting.simulate.words import decision_in_words, sum_in_words


def plan_in_words(budget: Budget, of: str = "themselves") -> tuple[str, ...]:
    """A line per decision, and the sum.

    Args:
        budget: what the decisions of a plan promise together.
        of: what errors are relative to.
    """
    return (*map(decision_in_words, budget.decisions), sum_in_words(budget, of))
