"""What people may choose from, by name: known before any library is loaded."""

from __future__ import annotations

from fitting.inference.budget import BUDGET, EVALUATIONS, usual_budget
from fitting.lab.names import (
    BENCHES,
    CROSSING,
    CURVES,
    PUMPED,
    QUANTITIES,
    SCENES,
    SUBHARMONIC,
    TRUTH_NAME,
)
from fitting.text.choices import CRITERIA, ESTIMATORS, INTERACTIVE, MISFITS, PAPER, STYLES

__all__ = [
    "BUDGET",
    "CRITERIA",
    "CROSSING",
    "CURVES",
    "ESTIMATORS",
    "EVALUATIONS",
    "INTERACTIVE",
    "LEAST_STEPS",
    "LEAST_WALKERS",
    "MISFITS",
    "PAPER",
    "PUMPED",
    "QUANTITIES",
    "SCENES",
    "SERIES",
    "STYLES",
    "SUBHARMONIC",
    "TRUTH_NAME",
    "usual_budget",
]

#: Of draws from a posterior: steps of every walker, and walkers, an even number.
LEAST_STEPS, LEAST_WALKERS = 200, 4
#: Series of the virtual laboratory.
SERIES = (*BENCHES, PUMPED, SUBHARMONIC)
