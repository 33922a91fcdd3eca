"""Phases that were read another way than they were written: each reading is fitted and compared."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fitting.fit.likelihood.descent import most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import noise_of
from fitting.fit.solution import Solution
from fitting.measurements.complex.tones import ComplexTones
from fitting.text.finding import Finding, Kind

#: Factors on phases that a mistake makes, and what their numbers are then.
READINGS = {-1.0: "reversed", 180.0 / math.pi: "radian", math.pi / 180.0: "degree"}
#: Residuals, in their noise or as a share where nobody knows it, from which phases are suspected.
SUSPECT, SUSPECT_SHARE = 3.0, 0.1
#: Share of chi square that a reading may leave to be named.
LEFT = 0.1


def phase_findings(solution: Solution) -> Iterator[Finding]:
    """Phases that the model follows far better if they are read another way.

    Args:
        solution: with the start and the end of the fit.
    """
    data = solution.objective.data
    for k, m in enumerate(data.measurements):
        if not isinstance(m, ComplexTones):
            continue
        rows = solution.final.residuals[data.slices[k]]
        limit = np.where(m.sigma > 0.0, SUSPECT * m.sigma, SUSPECT_SHARE)
        if float(np.mean((rows / limit) ** 2)) < 1.0:
            continue
        as_is = _chi_square(solution, k, m)
        for factor, reading in READINGS.items():
            other = _chi_square(solution, k, m.read_as(factor))
            if other < LEFT * as_is:
                yield Finding(
                    kind=Kind.phases_misread,
                    severity="warning",
                    subject=m.series,
                    numbers={"improvement": as_is / other},
                    names={"reading": (reading,)},
                )


def _chi_square(solution: Solution, k: int, read: ComplexTones) -> float:
    """Least chi square of the data with measurement k read so, noise as it is at the solution."""
    objective = solution.objective
    measurements = list(objective.data.measurements)
    measurements[k] = read
    data = replace(objective.data, measurements=tuple(measurements))
    noise = noise_of(objective, solution.final)
    likelihood = likelihood_of(replace(objective, data=data), noise.sigma, noise.common)
    begins = [solution.final.x, solution.initial.x]
    return most_likely(LikelihoodEvaluator(likelihood), begins).chi_square
