"""Values with the errors of the problem linearised at its solution: no profiles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, search_bounds, to_model
from fitting.fit.differences import central
from fitting.fit.options import ALGORITHM2, LIKELIHOOD
from fitting.fit.outputs import mean
from fitting.fit.solution import Solution
from fitting.inference.likelihood.ranges import output_ranges
from fitting.measurements.dataset import places_of_outputs
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95
from fitting.text.estimate import OffsetEstimate, OutputEstimate, ParameterEstimate, Verdict
from fitting.text.rendering import phrase

#: Step in x for the slopes of derived outputs, at most a quarter of the box.
OUTPUT_STEP = 1e-4
#: Share of the variance that the data answer for from which a linearised error is one of the data.
SEEN = 0.1


@dataclass(frozen=True)
class Estimates:
    """Both estimates of all parameters (n,), each in its unit, and which of them is reported.

    `best` is the most likely point, `paper` the end of Algorithm 2.
    """

    best: FloatArray
    paper: FloatArray
    estimator: str = LIKELIHOOD

    @property
    def reported(self) -> FloatArray:
        """The one that stands as the value."""
        return self.paper if self.estimator == ALGORITHM2 else self.best


def parameter_results(solution: Solution, found: Estimates) -> dict[str, ParameterEstimate]:
    """Value, error and provenance of every parameter of the whole campaign, by name.

    Args:
        solution: end of the fit.
        found: both estimates.
    """
    results = {}
    shown = canonical(solution.parameters, found.best)
    paper = canonical(solution.parameters, found.paper)
    reported = canonical(solution.parameters, found.reported)
    for i, parameter in enumerate(solution.parameters):
        if parameter.experiments:
            continue
        gradient = np.zeros(len(solution.parameters))
        gradient[i] = parameter.scale
        (std, half), shrinkage = _halves(solution, gradient)
        shift = solution.errors.shift(gradient)
        results[parameter.name] = ParameterEstimate(
            name=parameter.name,
            value=float(reported[i]),
            unit=parameter.unit,
            std=std + shift if shrinkage >= SEEN else float("nan"),
            ci95=_interval(parameter, float(found.best[i]), float(shown[i]), half + shift),
            reference=parameter.reference,
            start=parameter.start,
            lower=parameter.lower,
            upper=parameter.upper,
            shrinkage=shrinkage,
            status=Verdict.LINEARISED if shrinkage >= SEEN else Verdict.UNKNOWN,
            algorithm2=float(paper[i]),
            most_likely=float(shown[i]),
            period=parameter.period,
            simulation=shift,
            reason=phrase("status", "no_profile"),
            asked=parameter.moves_model,
        )
    return results


def _interval(parameter: Parameter, raw: float, shown: float, half: float) -> tuple[float, float]:
    """95 % interval within the box, shifted with the value into its canonical period."""
    low = min(max(raw - half, parameter.lower), raw)
    high = max(min(raw + half, parameter.upper), raw)
    if parameter.period is not None and high - low >= parameter.period:
        return 0.0, parameter.period
    return low + (shown - raw), high + (shown - raw)


def derived_results(
    solution: Solution, found: Estimates, units: Mapping[str, str], seed: int
) -> dict[str, OutputEstimate]:
    """Derived outputs as reported, with errors from their gradient and range over the box.

    Args:
        solution: end of the fit, where they are linearised.
        found: both estimates.
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
    reported, likely = response.derived_many([found.reported, found.best])
    read_at = places_of_outputs(solution.objective.data.measurements)
    places = tuple(label for each in read_at.values() for label, _ in each)
    results = {}
    for name, values in reported.items():
        means = np.array([mean(answer[name]) for answer in answers])
        gradient = around.quotients(list(means[2:]))
        box = (ranges[name].low, ranges[name].high)
        (std, half), shrinkage = _halves(solution, gradient)
        best = mean(likely[name])
        if not np.isfinite(best):
            shrinkage = 0.0
        std, half = (std, half) if shrinkage >= SEEN else (float("nan"), float("nan"))
        shift = solution.errors.shift(gradient) if np.isfinite(std) else 0.0
        value = mean(values)
        each = len(places) == values.size > 1
        slopes = around.quotients([answer[name] for answer in answers[2:]]) if each else ()
        errors = [_bounded_errors(solution, slope) for slope in slopes]
        results[name] = OutputEstimate(
            name=name,
            value=value,
            unit=units.get(name, ""),
            values=tuple(map(float, values)),
            spread=float(np.std(values, ddof=1)) if values.size > 1 else 0.0,
            std=std + shift,
            ci95=_within(box, best, half + shift),
            reference=float(means[1]),
            shrinkage=shrinkage,
            status=Verdict.LINEARISED if shrinkage >= SEEN else Verdict.UNKNOWN,
            lower=box[0],
            upper=box[1],
            algorithm2=float(means[0]),
            most_likely=best,
            simulation=shift,
            reason=phrase("status", "no_profile"),
            places=places if each else (),
            stds=tuple(std for std, _ in errors),
            halves95=tuple(half for _, half in errors),
        )
    return results


def _bounded_errors(solution: Solution, gradient: FloatArray) -> tuple[float, float]:
    """Half intervals of one value with what its simulation may be off by; NaN: open."""
    (std, half), shrinkage = _halves(solution, gradient)
    if not shrinkage >= SEEN:
        return float("nan"), float("nan")
    shift = solution.errors.shift(gradient)
    return std + shift, half + shift


def _halves(solution: Solution, gradient: FloatArray) -> tuple[tuple[float, float], float]:
    """Half of the 68 % and 95 % intervals of a value, and its shrinkage; NaN without a slope.

    Student's where the residuals tell the noise.
    """
    if not np.all(np.isfinite(gradient)):
        return (float("nan"), float("nan")), 0.0
    std, shrinkage = solution.errors.of(gradient)
    freedom = solution.errors.freedom_of(gradient)
    return (reach(ROOT_68, freedom) * std, reach(ROOT_95, freedom) * std), shrinkage


def _within(box: tuple[float, float], value: float, half: float) -> tuple[float, float]:
    """95 % interval of a derived value, cut to its range over the box; without data, that range."""
    if np.isnan(value):
        return float("nan"), float("nan")
    if np.isnan(half):
        return box
    low, high = max(value - half, box[0]), min(value + half, box[1])
    return min(low, value), max(high, value)


def offset_results(solution: Solution, found: Estimates) -> dict[str, OffsetEstimate]:
    """One record per parameter of an experiment, by name: what it adds up to there, with its error.

    Steps of a random walk are reported as the offset that they have led to.

    Args:
        solution: end of the fit, where they are linearised.
        found: both estimates.
    """
    parameters = solution.parameters
    own = [p for p in parameters if p.experiments]
    results = {}
    for i, p in enumerate(parameters):
        if p.experiment is None:
            continue
        gradient, adds = np.zeros(len(parameters)), np.zeros(len(parameters))
        for k, q in enumerate(parameters):
            if p.experiment in q.experiments and _goes_to(q) == _goes_to(p):
                gradient[k], adds[k] = q.scale, 1.0
        best = float(adds @ found.best)
        (std, half), shrinkage = _halves(solution, gradient)
        shift = solution.errors.shift(gradient)
        later = [q.experiment for q in own if q is not p and _goes_to(q) == _goes_to(p)]
        results[p.name] = OffsetEstimate(
            name=p.name,
            experiments=tuple(label for label in p.experiments if label not in later),
            variables=_goes_to(p),
            value=float(adds @ found.reported),
            unit=p.unit,
            std=std + shift,
            ci95=(best - half - shift, best + half + shift),
            prior=p.prior_sigma or float("nan"),
            shrinkage=shrinkage,
            status=Verdict.LINEARISED if shrinkage >= SEEN else Verdict.UNKNOWN,
            fitted=float(found.reported[i]),
            most_likely=best,
            simulation=shift,
        )
    return results


def _goes_to(parameter: Parameter) -> tuple[str, ...]:
    return parameter.adds_to or (parameter.target,)
