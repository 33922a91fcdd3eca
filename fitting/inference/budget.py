"""Stages of an inference and what it may cost by default; known before any library is loaded."""

from __future__ import annotations

from enum import StrEnum

#: Simulation runs at most; runs that points of a batch share count once.
BUDGET = 500_000
#: Evaluations that a budget lasts for at least, where each takes many runs.
EVALUATIONS = 3_000


def usual_budget(runs_each: float) -> int:
    """Simulation runs that an inference may take, at most about, where nobody says.

    Args:
        runs_each: of an evaluation.
    """
    return max(BUDGET, round(EVALUATIONS * runs_each))


class Stage(StrEnum):
    """What is being looked for; the words say so."""

    MINIMA = "other minima"
    SCANS = "scans"
    DIRECTIONS = "what has no effect"
    REFITS = "refits of the bootstrap"
