"""Values and errors of the problem linearised at its solution: before any profile is walked."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, search_bounds, to_model
from fitting.fit.differences import central
from fitting.fit.linearisation import IDENTIFIABLE, in_words
from fitting.fit.outputs import mean
from fitting.fit.solution import Solution
from fitting.inference.likelihood.ranges import output_ranges
from fitting.inference.values import DerivedResult, OffsetResult, ParameterResult
from fitting.text.arrays import FloatArray

#: Step in x for the slopes of derived outputs, at most a quarter of the box.
OUTPUT_STEP = 1e-4


def parameter_results(solution: Solution) -> dict[str, ParameterResult]:
    """Value, error and provenance of every parameter of the whole campaign, by name.

    Args:
        solution: end of the fit.
    """
    results = {}
    shown = canonical(solution.parameters, solution.final.parameters)
    for i, parameter in enumerate(solution.parameters):
        if parameter.experiments:
            continue
        gradient = np.zeros(len(solution.parameters))
        gradient[i] = parameter.scale
        std, shrinkage = solution.errors.of(gradient)
        raw = float(solution.final.parameters[i])
        results[parameter.name] = ParameterResult(
            value=float(shown[i]),
            unit=parameter.unit,
            std=std if _is_determined(shrinkage) else float("nan"),
            ci95=_interval(parameter, raw, float(shown[i]), std),
            reference=parameter.reference,
            start=parameter.start,
            lower=parameter.lower,
            upper=parameter.upper,
            shrinkage=shrinkage,
            identifiable=in_words(shrinkage),
        )
    return results


def _is_determined(shrinkage: float) -> bool:
    """Whether the data say anything: else a linearised error would be one of the box's width."""
    return in_words(shrinkage) != IDENTIFIABLE[2]


def _interval(parameter: Parameter, raw: float, shown: float, std: float) -> tuple[float, float]:
    """95 % interval within the box, shifted with the value into its canonical period."""
    low = max(raw - 1.96 * std, parameter.lower)
    high = min(raw + 1.96 * std, parameter.upper)
    if parameter.period is not None and high - low >= parameter.period:
        return 0.0, parameter.period
    return low + (shown - raw), high + (shown - raw)


def derived_results(
    solution: Solution, units: Mapping[str, str], seed: int
) -> dict[str, DerivedResult]:
    """Derived outputs at the solution, with errors from their gradient and range over the box.

    Args:
        solution: end of the fit.
        units: of the outputs, by name.
        seed: of the random numbers.
    """
    parameters, response = solution.parameters, solution.objective.response
    x = solution.final.x
    lower, upper = search_bounds(parameters)
    around = central(x, np.minimum(OUTPUT_STEP, 0.25 * (upper - lower)), lower, upper)
    for i, moved in solution.secant_points.items():  # as the covariance saw it
        around = around.between(i, moved, x)
    everything = [x, np.clip(np.zeros(x.size), lower, upper), *around.nodes]
    answers = response.derived_many([to_model(parameters, y) for y in everything])
    ranges = output_ranges(response, parameters, seed, everything)
    results = {}
    for name, values in answers[0].items():
        means = np.array([mean(answer[name]) for answer in answers])
        gradient = around.quotients(list(means[2:]))
        box = (ranges[name].low, ranges[name].high)
        results[name] = _derived(solution, values, gradient, means, units.get(name, ""), box)
    return results


def _derived(
    solution: Solution,
    values: FloatArray,
    gradient: FloatArray,
    means: FloatArray,
    unit: str,
    box: tuple[float, float],
) -> DerivedResult:
    known = bool(np.all(np.isfinite(gradient)) and np.isfinite(means[0]))
    std, shrinkage = solution.errors.of(gradient) if known else (float("nan"), 0.0)
    std = std if _is_determined(shrinkage) else float("nan")
    value = float(means[0])
    return DerivedResult(
        value=value,
        unit=unit,
        values=tuple(map(float, values)),
        mean=value,
        spread=float(np.std(values, ddof=1)) if values.size > 1 else 0.0,
        std=std,
        ci95=_within(box, value, std),
        reference=float(means[1]),
        shrinkage=shrinkage,
        identifiable=in_words(shrinkage) if known else IDENTIFIABLE[2],
        box=box,
    )


def _within(box: tuple[float, float], value: float, std: float) -> tuple[float, float]:
    """95 % interval of a derived value, cut to its range over the box; without data, that range."""
    if np.isnan(value):
        return float("nan"), float("nan")
    if np.isnan(std):
        return box
    return max(value - 1.96 * std, box[0]), min(value + 1.96 * std, box[1])


def offset_results(solution: Solution) -> tuple[OffsetResult, ...]:
    """One record per parameter of an experiment: what it adds up to there, with its error.

    Steps of a random walk are reported as the offset that they have led to.

    Args:
        solution: end of the fit.
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


def _goes_to(parameter: Parameter) -> tuple[str, ...]:
    return parameter.adds_to or (parameter.target,)
