"""A fit from within: its rows and their derivatives, covariance, and what was inferred of it."""

from __future__ import annotations

from fitting.api.fitted import Valued, known_values, require_values
from fitting.campaign.parameters import (
    UNIFORM_WIDTH,
    Parameter,
    bounds,
    canonical,
    planning_points,
    scales,
    search_bounds,
    to_model,
    to_search,
)
from fitting.engine.threads import one_thread
from fitting.fit.covariance import RowCovariance
from fitting.fit.fit import curve_structure
from fitting.fit.linearisation import (
    SMALLEST_SIGMA,
    Linearisation,
    information,
    row_sigmas,
    whitened,
)
from fitting.fit.noise import fitted_noise, noise_of
from fitting.fit.objective import (
    Objective,
    Point,
    Stencil,
    answered_apart,
    central,
    evaluate_many,
    make_objective,
)
from fitting.fit.outputs import mean, output_means
from fitting.fit.problem import PlannedFmu, problem_of
from fitting.fit.problem import Problem as Record
from fitting.inference.likelihood.knowledge import Inferred, Values
from fitting.result.provenance import require_same_data
from fitting.result.result import Result, read_result
from fitting.signal.residual_tests import NOTABLE, Structure

__all__ = [
    "NOTABLE",
    "SMALLEST_SIGMA",
    "UNIFORM_WIDTH",
    "Inferred",
    "Linearisation",
    "Objective",
    "Parameter",
    "PlannedFmu",
    "Point",
    "Record",
    "Result",
    "RowCovariance",
    "Stencil",
    "Structure",
    "Valued",
    "Values",
    "answered_apart",
    "bounds",
    "canonical",
    "central",
    "curve_structure",
    "evaluate_many",
    "fitted_noise",
    "information",
    "known_values",
    "make_objective",
    "mean",
    "noise_of",
    "one_thread",
    "output_means",
    "planning_points",
    "problem_of",
    "read_result",
    "require_same_data",
    "require_values",
    "row_sigmas",
    "scales",
    "search_bounds",
    "to_model",
    "to_search",
    "whitened",
]
