"""All plots into given axes, under one name for the tests."""

from __future__ import annotations

from fitting.design.figure import candidates, expected_errors
from fitting.report.figures.fit import (
    objective_path,
    output_by_experiment,
    output_path,
    parameter_path,
)
from fitting.report.figures.inference import (
    against_prior,
    discrepancy,
    l_curve,
    output,
    profile,
    together,
)
from fitting.report.figures.measurements import frequency_response, panel
from fitting.report.figures.simulate import (
    amplitude_spectrum,
    beating,
    drive_envelope,
    drive_periods,
    periods,
    swept_tone,
)
from fitting.report.figures.tones import (
    deviations,
    deviations_by_experiment,
    improvement,
    residuals,
)

__all__ = [
    "against_prior",
    "amplitude_spectrum",
    "beating",
    "candidates",
    "deviations",
    "deviations_by_experiment",
    "discrepancy",
    "drive_envelope",
    "drive_periods",
    "expected_errors",
    "frequency_response",
    "improvement",
    "l_curve",
    "objective_path",
    "output",
    "output_by_experiment",
    "output_path",
    "panel",
    "parameter_path",
    "periods",
    "profile",
    "residuals",
    "swept_tone",
    "together",
]
