"""Values of one experiment alone, as drift offsets are: their results, and when drift is large."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.campaign.parameters import Parameter, prior_widths
from fitting.fit.assembly import Solution
from fitting.fit.noise import noise_of, outlier_sentences, prior_precision
from fitting.fit.problem import Problem
from fitting.fit.result import OffsetResult
from fitting.inference.uncertainty import in_words
from fitting.text.errors import BadInput
from fitting.text.notation import hertz
from fitting.text.units import convert


def offset_results(solution: Solution) -> tuple[OffsetResult, ...]:
    """One record per parameter of an experiment: what it adds up to there, with its error.

    Steps of a random walk are reported as the offset that they have led to.
    """
    parameters = solution.parameters
    values = solution.final.parameters
    own = [p for p in parameters if p.experiments]
    found = []
    for i, p in enumerate(parameters):
        if p.experiment is None:
            continue
        gradient = np.zeros(len(parameters))
        value = 0.0
        for k, q in enumerate(parameters):
            if p.experiment in q.experiments and _goes_to(q) == _goes_to(p):
                gradient[k] = q.scale
                value += float(values[k])
        std, shrinkage = solution.errors.of(gradient)
        later = [q.experiment for q in own if q is not p and _goes_to(q) == _goes_to(p)]
        found.append(
            OffsetResult(
                parameter=p.name,
                experiments=tuple(label for label in p.experiments if label not in later),
                variables=_goes_to(p),
                value=value,
                unit=p.unit,
                std=std,
                ci95=(value - 1.96 * std, value + 1.96 * std),
                prior=p.prior_sigma or float("nan"),
                shrinkage=shrinkage,
                identifiable=in_words(shrinkage),
                fitted=float(values[i]),
            )
        )
    return tuple(found)


def outlier_warnings(problem: Problem, solution: Solution) -> list[str]:
    """Peaks that the fit misses by much more than their noise, by name."""
    point = solution.final
    sigma = noise_of(solution.objective, point).sigma
    precision = prior_precision(prior_widths(solution.parameters), solution.nu)
    return outlier_sentences(problem, point.residuals, sigma, solution.matrix, precision)


def _goes_to(parameter: Parameter) -> tuple[str, ...]:
    return parameter.adds_to or (parameter.target,)


def drift_warnings(
    bound: BoundCampaign, offsets: Sequence[OffsetResult], width_hz: float
) -> list[str]:
    """Where the drift over the series, or an offset from it, exceeds the line width (Hz)."""
    if not width_hz > 0.0:
        return []
    said = []
    moved = {
        name: abs(after - before) * _in_hertz(bound.drift.units.get(name, "Hz"))
        for name, (before, after) in bound.drift.ends.items()
    }
    wide = {name: hz for name, hz in moved.items() if hz > width_hz}
    if wide:
        said.append(
            f"{_listed(wide)} over the series, more than the line width of "
            f"{hertz(width_hz, digits=4)}: a small departure from the drift that is assumed moves "
            "the peaks much."
            + ("" if offsets else ' [drift] model = "offsets" or "walk" estimates it.')
        )
    far = {
        f"{o.experiments[0]} ({', '.join(o.variables)})": abs(o.value) * _in_hertz(o.unit)
        for o in offsets
        if o.prior == o.prior and abs(o.value) * _in_hertz(o.unit) > width_hz
    }
    if far:
        said.append(
            "Offsets from the interpolated drift beyond the line width of "
            f"{hertz(width_hz, digits=4)}: "
            + ", ".join(f"{name} {hertz(hz, digits=4)}" for name, hz in far.items())
            + "."
        )
    return said


def _listed(moved: Mapping[str, float]) -> str:
    return " and ".join(f"{name} drifts by {hertz(hz, digits=4)}" for name, hz in moved.items())


def _in_hertz(unit: str) -> float:
    """Hertz per unit, zero where it is no frequency."""
    try:
        return convert(1.0, unit, "Hz", where="")
    except BadInput:
        return 0.0
