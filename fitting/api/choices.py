"""What people may choose from, by name: known before any library is loaded."""

from __future__ import annotations

from fitting.inference.budget import BUDGET, EVALUATIONS, usual_budget
from fitting.text.choices import (
    CRITERIA,
    ESTIMATORS,
    FORMATS,
    INTERACTIVE,
    MISFITS,
    PAPER,
    STYLES,
)

__all__ = [
    "BUDGET",
    "CRITERIA",
    "ESTIMATORS",
    "EVALUATIONS",
    "FORMATS",
    "INTERACTIVE",
    "MISFITS",
    "PAPER",
    "STYLES",
    "usual_budget",
]
