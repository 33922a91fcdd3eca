"""What people may choose from, by name: known before any library is loaded."""

from __future__ import annotations

from fitting.text.choices import (
    BUDGET,
    CRITERIA,
    ESTIMATORS,
    EVALUATIONS,
    FORMATS,
    INTERACTIVE,
    MISFITS,
    PAPER,
    STYLES,
    usual_budget,
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
