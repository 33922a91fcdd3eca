"""Which values of a fit are those of the line that its sweep shows by itself."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.inference.values import DerivedResult, ParameterResult
from fitting.measurements.sweep import Sweep
from fitting.signal.peaks import fit_resonance
from fitting.text.errors import BadInput
from fitting.text.units import convert

#: A value is the line's where both agree to this share: of the width, or of the quality.
NEAR = 1e-3


def values_of_line(
    problem: Problem, solution: Solution, values: Mapping[str, ParameterResult | DerivedResult]
) -> dict[str, str]:
    """Names of values that are the line's "frequency", "width" or "q".

    The line is fitted to the sweep *as simulated* at the end of Algorithm 2: a value that is there
    what that line shows is this line's, whatever its name. Empty where the sweep is fitted with the
    rest (its information is in the values), or where there is none, or no line in it.

    Args:
        problem: with its sweep.
        solution: end of the fit.
        values: parameters and outputs, by name.
    """
    sweep = problem.sweep
    if problem.is_joint or sweep is None:
        return {}
    [k] = [k for k, m in enumerate(problem.measurements) if isinstance(m, Sweep)]
    if problem.measurements[k].rows:
        return {}
    try:
        simulated = np.abs(solution.final.scaled[k])
        own = fit_resonance(sweep.frequency_hz, simulated)
    except BadInput:
        return {}
    shown = {
        "frequency": (own.eta_hz, "Hz", own.width_hz),
        "width": (own.width_hz, "Hz", own.width_hz),
        "q": (own.q, "", own.q),
    }
    found = {}
    for name, value in values.items():
        for what, (there, unit, size) in shown.items():
            here = _in(value.algorithm2, value.unit, unit)
            if abs(here - there) < NEAR * size:
                found[name] = what
    return found


def _in(value: float, unit: str, wanted: str) -> float:
    """A value in hertz, or as the number that it is; NaN where it is neither."""
    if not wanted:
        return value if unit in ("", "1") else math.nan
    try:
        return convert(value, unit, wanted, where="")
    except BadInput:
        return math.nan
