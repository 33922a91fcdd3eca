"""Which values of a fit are those of the line that its sweep shows by itself."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping

import numpy as np

from fitting.campaign.parameters import to_search
from fitting.fit.objective import evaluate_many
from fitting.fit.outputs import output_means
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.measurements.measurement import Values
from fitting.measurements.sweep import Sweep
from fitting.signal.peaks import fit_resonance
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure, NoScale
from fitting.text.estimate import FittedEstimate
from fitting.text.units import convert

#: A value is the line's where both agree to this share: of the width, or of the quality.
NEAR = 1e-3
#: Where else both have to agree: positive parameters times these factors, by turns of the first and
#: of one over it, and others by such a part of their scale on.
ELSEWHERE = ((1.1, 0.3), (1.0 / 1.3, -0.5), (1.2, 1.0))


def values_of_line(
    problem: Problem, solution: Solution, values: Mapping[str, FittedEstimate]
) -> dict[str, str]:
    """Names of values that are the line's "frequency", "width" or "q".

    The line is fitted to the sweep *as simulated*, at the end of Algorithm 2 and at some places
    elsewhere: a value that is what that line shows at all of them is this line's, whatever its
    name. At one place alone it might be another's by chance, as the dampings of two modes are that
    were not told apart. Empty where the sweep is fitted with the rest (its information is in the
    values), or where there is none, or no line in it.

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
    here = {name: value.algorithm2 for name, value in values.items()}
    units = {name: value.unit for name, value in values.items()}
    found = _same(here, units, _shown(sweep.frequency_hz, solution.final.scaled[k]))
    if not found:
        return {}
    swept = float(np.min(sweep.frequency_hz)), float(np.max(sweep.frequency_hz))
    kept = {n for n, value in here.items() if swept[0] <= _in(value, units[n], "Hz") <= swept[1]}
    try:
        places = _moved(solution, k, kept)
    except (FmuFailure, NoScale):
        return {}
    for there, simulated in places:
        same = _same({n: there[n] for n in found}, units, _shown(sweep.frequency_hz, simulated))
        found = {name: what for name, what in found.items() if same.get(name) == what}
    return found


def _moved(
    solution: Solution, k: int, kept: Container[str]
) -> list[tuple[dict[str, float], Values]]:
    """Values by name, and the k-th measurement as simulated, at the places elsewhere."""
    parameters = solution.parameters
    xs = [_elsewhere(solution, kept, factor, turn) for factor, turn in ELSEWHERE]
    points = evaluate_many(solution.objective, xs, whole=True)
    means = output_means(solution.objective.response, parameters, xs)
    moved = []
    for i, point in enumerate(points):
        there = {p.name: float(v) for p, v in zip(parameters, point.parameters, strict=True)}
        there |= {name: float(row[i]) for name, row in means.items()}
        moved.append((there, point.scaled[k]))
    return moved


def _elsewhere(solution: Solution, kept: Container[str], factor: float, turn: float) -> FloatArray:
    """The end of Algorithm 2 moved in its box, (n,): all but what is known, and some that are kept.

    Those are in the swept range: it would not show its line any more.
    """
    parameters = solution.parameters
    p = solution.final.parameters.copy()
    for i, parameter in enumerate(parameters):
        if parameter.prior_sigma is not None or parameter.experiments or parameter.name in kept:
            continue
        here, low, high = float(p[i]), parameter.lower, parameter.upper
        positive = low >= 0.0 and parameter.period is None and not parameter.is_angle
        ways = (here + turn * parameter.scale, here - turn * parameter.scale)
        if positive:
            ways = (here * factor, here / factor)
        inside = [way for way in ways if low <= way <= high]
        p[i] = inside[0] if inside else min(max(ways[0], low), high)
        if positive:  # the next one goes the other way
            factor = here / float(p[i]) if p[i] != here else 1.0 / factor
    return to_search(parameters, p)


def _shown(frequency_hz: FloatArray, simulated: Values) -> dict[str, tuple[float, str, float]]:
    """What the line of a simulated sweep shows: value, unit and size; empty without a line."""
    try:
        own = fit_resonance(frequency_hz, np.abs(simulated))
    except BadInput:
        return {}
    return {
        "frequency": (own.frequency.value, "Hz", own.width.value),
        "width": (own.width.value, "Hz", own.width.value),
        "q": (own.q.value, "", own.q.value),
    }


def _same(
    values: Mapping[str, float],
    units: Mapping[str, str],
    shown: Mapping[str, tuple[float, str, float]],
) -> dict[str, str]:
    """Which values are something that a line shows, and what."""
    return {
        name: what
        for name, value in values.items()
        for what, (there, unit, size) in shown.items()
        if abs(_in(value, units[name], unit) - there) < NEAR * size
    }


def _in(value: float, unit: str, wanted: str) -> float:
    """A value in hertz, or as the number that it is; NaN where it is neither."""
    if not wanted:
        return value if unit in ("", "1") else math.nan
    try:
        return convert(value, unit, wanted, where="")
    except BadInput:
        return math.nan
