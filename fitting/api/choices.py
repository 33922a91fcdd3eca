"""What people may choose from, by name: known before any library is loaded."""

from __future__ import annotations

from fitting.inference.budget import BUDGET, EVALUATIONS, usual_budget
from fitting.lab.names import BENCHES, CROSSING, CURVES, PUMPED, QUANTITIES, SCENES, TRUTH_NAME
from fitting.text.choices import CRITERIA, ESTIMATORS, MISFITS, STYLES

__all__ = [
    "BUDGET",
    "CRITERIA",
    "CROSSING",
    "CURVES",
    "ESTIMATORS",
    "EVALUATIONS",
    "MISFITS",
    "PUMPED",
    "QUANTITIES",
    "SCENES",
    "SERIES",
    "STYLES",
    "TRUTH_NAME",
    "usual_budget",
]

#: Series of the virtual laboratory.
SERIES = (*BENCHES, PUMPED)
