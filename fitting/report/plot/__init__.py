"""Plots into given axes, one thing each: they compute and save nothing and keep any style.

Every function takes records of this program, draws into `ax` (pyplot's current axes if none is
given) with labelled artists, so that ``ax.legend()`` names them, and returns the axes.
"""

from __future__ import annotations

from fitting.report.plot.design import candidates, expected_errors
from fitting.report.plot.fit import (
    objective_path,
    output_by_experiment,
    output_path,
    parameter_path,
)
from fitting.report.plot.inference import (
    against_prior,
    discrepancy,
    l_curve,
    output,
    profile,
    together,
)
from fitting.report.plot.measurement import panel
from fitting.report.plot.simulate import (
    amplitude_spectrum,
    beating,
    drive_envelope,
    drive_periods,
    periods,
    swept_tone,
)
from fitting.report.plot.sweep import frequency_response, response_residuals
from fitting.report.plot.tones import (
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
    "response_residuals",
    "swept_tone",
    "together",
]
