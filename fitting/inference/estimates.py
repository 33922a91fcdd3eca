"""Values with the errors of the problem linearised at its solution: no profiles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitting.campaign.parameters import canonical, search_bounds, to_model
from fitting.fit.differences import Stencil, central
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

#: Step in x for the slopes of derived outputs, at most a quarter of the bounds' distance.
OUTPUT_STEP = 1e-4
#: Share of the variance that the data answer for from which a linearised error is one of the data.
DETERMINED = 0.1


@dataclass(frozen=True)
class Estimates:
    """Both estimates of all parameters (n,), each in its unit, and which of them is reported.

    `best` is the most likely point, `paper` the end of Algorithm 2, NaN where it was not asked for.
    """

    best: FloatArray
    paper: FloatArray
    estimator: str = LIKELIHOOD

    @property
    def reported(self) -> FloatArray:
        """The one that is the value."""
        return self.paper if self.estimator == ALGORITHM2 else self.best


@dataclass(frozen=True)
class Outputs:
    """Derived outputs at the end of a fit, at the references, and around: evaluated once.

    `points` are search vectors (n,), the end and the references first; `values` of every output at
    each, by name, shape (experiments,). Of `secants` a variable without a first-order effect has
    the slope of its secant, as the covariance has it.
    """

    points: tuple[FloatArray, ...]
    values: tuple[Mapping[str, FloatArray], ...]
    stencil: Stencil
    secants: Stencil

    def means(self, name: str) -> FloatArray:
        """Means over the experiments at all points, shape (points,)."""
        return np.array([mean(answer[name]) for answer in self.values])

    def gradient(self, name: str, *, secants: bool = False) -> FloatArray:
        """Slopes of the mean in x at the end, shape (n,)."""
        around = self.secants if secants else self.stencil
        return around.quotients(list(self.means(name)[2:]))


def outputs_of(solution: Solution) -> Outputs:
    """The derived outputs at the end of a fit and around, in one batch.

    Args:
        solution: end of the fit.

    Raises:
        FmuFailure: the model failed there.
    """
    parameters, x = solution.parameters, solution.final.x
    lower, upper = search_bounds(parameters)
    stencil = central(x, np.minimum(OUTPUT_STEP, 0.25 * (upper - lower)), lower, upper)
    secants = stencil
    for i, moved in solution.secant_points.items():
        secants = secants.between(i, moved, x)
    points = (x, np.clip(np.zeros(x.size), lower, upper), *secants.nodes)
    values = solution.objective.response.derived_many([to_model(parameters, y) for y in points])
    return Outputs(points, tuple(values), stencil, secants)


@dataclass(frozen=True)
class _Error:
    """Half of the 68 % and 95 % intervals of a value, with its simulation's error, and shrinkage.

    Student's where the residuals estimate the noise; NaN without a slope.
    """

    std: float
    half: float
    shift: float
    shrinkage: float

    @property
    def is_determined(self) -> bool:
        return self.shrinkage >= DETERMINED

    @property
    def about(self) -> dict[str, Any]:
        """Fields of an estimate; no error where the data do not determine the value."""
        return {
            "std": self.std if self.is_determined else math.nan,
            "shrinkage": self.shrinkage,
            "status": Verdict.LINEARISED if self.is_determined else Verdict.UNKNOWN,
            "simulation": self.shift,
        }


def _error(solution: Solution, gradient: FloatArray) -> _Error:
    if not np.all(np.isfinite(gradient)):
        return _Error(math.nan, math.nan, 0.0, 0.0)
    std, shrinkage = solution.errors.of(gradient)
    freedom, shift = solution.errors.freedom_of(gradient), solution.errors.shift(gradient)
    half68, half95 = (reach(root, freedom) * std + shift for root in (ROOT_68, ROOT_95))
    return _Error(half68, half95, shift, shrinkage)


def parameter_results(solution: Solution, estimates: Estimates) -> dict[str, ParameterEstimate]:
    """Value, error and provenance of every parameter of the whole campaign, by name.

    Args:
        solution: end of the fit.
        estimates: both estimates.
    """
    parameters, results = solution.parameters, {}
    shown, paper, reported = (
        canonical(parameters, p) for p in (estimates.best, estimates.paper, estimates.reported)
    )
    for i, p in enumerate(parameters):
        if p.experiments:
            continue
        error = _error(solution, p.scale * np.eye(len(parameters))[i])
        # within the bounds, moved with the value into its canonical period
        raw, turn = float(estimates.best[i]), float(shown[i] - estimates.best[i])
        low = min(max(raw - error.half, p.lower), raw)
        high = max(min(raw + error.half, p.upper), raw)
        whole = p.period is not None and high - low >= p.period
        results[p.name] = ParameterEstimate(
            name=p.name,
            value=float(reported[i]),
            unit=p.unit,
            ci95=(0.0, float(p.period or 0.0)) if whole else (low + turn, high + turn),
            reference=p.reference,
            start=p.start,
            lower=p.lower,
            upper=p.upper,
            algorithm2=float(paper[i]),
            most_likely=float(shown[i]),
            period=p.period,
            reason=phrase("status", "no_profile"),
            asked=p.moves_model,
            **error.about,
        )
    return results


def derived_results(
    solution: Solution, outputs: Outputs, estimates: Estimates, units: Mapping[str, str], seed: int
) -> dict[str, OutputEstimate]:
    """Derived outputs as reported, with errors from their gradient and range within the bounds.

    Args:
        solution: end of the fit, where they are linearised.
        outputs: there and around.
        estimates: both estimates.
        units: of the outputs, by name.
        seed: of the random numbers.
    """
    parameters, response = solution.parameters, solution.objective.response
    ranges = output_ranges(response, parameters, seed, outputs.points)
    papers = [estimates.paper] if np.all(np.isfinite(estimates.paper)) else []
    asked = [estimates.reported, estimates.best, *papers]
    reported, likely, *of_paper = response.derived_many(asked)
    read_at = places_of_outputs(solution.objective.data.measurements)
    places = tuple(label for each in read_at.values() for label, _ in each)
    results = {}
    for name, values in reported.items():
        means = outputs.means(name)
        best, low, high = mean(likely[name]), ranges[name].low, ranges[name].high
        error = _error(solution, outputs.gradient(name, secants=True))
        if not np.isfinite(best):
            error = _Error(math.nan, math.nan, 0.0, 0.0)
        elif not error.is_determined:
            error = _Error(math.nan, math.nan, 0.0, error.shrinkage)
        # within what the model allows; without data all of it
        ci95 = low, high
        if np.isnan(best):
            ci95 = math.nan, math.nan
        elif not np.isnan(error.half):
            ci95 = (
                min(max(best - error.half, low), best),
                max(min(best + error.half, high), best),
            )
        # of a value of its own at each place
        each = len(places) == values.size > 1
        around = [answer[name] for answer in outputs.values[2:]]
        slopes = outputs.secants.quotients(around) if each else ()
        errors = [_error(solution, slope) for slope in slopes]
        results[name] = OutputEstimate(
            name=name,
            value=mean(values),
            unit=units.get(name, ""),
            values=tuple(map(float, values)),
            spread=float(np.std(values, ddof=1)) if values.size > 1 else 0.0,
            ci95=ci95,
            reference=float(means[1]),
            lower=low,
            upper=high,
            algorithm2=mean(of_paper[0][name]) if of_paper else math.nan,
            most_likely=best,
            reason=phrase("status", "no_profile"),
            places=places if each else (),
            stds=tuple(e.std if e.is_determined else math.nan for e in errors),
            halves95=tuple(e.half if e.is_determined else math.nan for e in errors),
            **error.about,
        )
    return results


def offset_results(solution: Solution, estimates: Estimates) -> dict[str, OffsetEstimate]:
    """One record per parameter of an experiment, by name: what it adds up to there, with its error.

    Steps of a random walk are reported as the offset that they have led to.

    Args:
        solution: end of the fit, where they are linearised.
        estimates: both estimates.
    """
    parameters, results = solution.parameters, {}
    targets = [p.adds_to or (p.target,) for p in parameters]
    for i, p in enumerate(parameters):
        if p.experiment is None:
            continue
        alike = [k for k in range(len(parameters)) if targets[k] == targets[i]]
        adds = np.zeros(len(parameters))
        adds[[k for k in alike if p.experiment in parameters[k].experiments]] = 1.0
        error = _error(solution, adds * [q.scale for q in parameters])
        best = float(adds @ estimates.best)
        others = [parameters[k] for k in alike if k != i and parameters[k].experiments]
        later = [q.experiment for q in others]
        results[p.name] = OffsetEstimate(
            name=p.name,
            experiments=tuple(label for label in p.experiments if label not in later),
            variables=targets[i],
            value=float(adds @ estimates.reported),
            unit=p.unit,
            ci95=(best - error.half, best + error.half),
            prior=p.prior_sigma or math.nan,
            fitted=float(estimates.reported[i]),
            most_likely=best,
            **error.about | {"std": error.std},
        )
    return results
