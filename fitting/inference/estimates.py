"""Values with the errors of the problem linearised at its solution: no profiles.

With W the whitened derivatives of the rows by the parameters, what is solved inside projected out,
the linearised problem has two errors of a value: s of all rows, and s' of amplitudes alone, which
are the changes along the values themselves. Reported are the error e of the value, of its profile
and as wide as its residuals require, and e s'/s: amplitudes of the same residuals.

A quality Q(x, c) of parameters x and coefficients c has the variance g^T C g + s^2, g = dQ/dx with
the best c at every x, C the covariance of x and s its error at fixed x: the errors of x and those
of c about c(x) are independent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from fitting.campaign.parameters import canonical, prior_sigmas, search_bounds, to_model
from fitting.fit.fit import Solution
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import noise_of
from fitting.fit.objective import Stencil, central
from fitting.fit.outputs import mean
from fitting.inference.likelihood.knowledge import PhaseGain, Quadratures
from fitting.inference.likelihood.profile import output_ranges
from fitting.measurements.dataset import places_of_outputs
from fitting.measurements.measurement import Estimated, Prediction
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import FloatArray
from fitting.text.estimate import (
    ROOT_95,
    Estimate,
    FittedEstimate,
    OffsetEstimate,
    OutputEstimate,
    ParameterEstimate,
    Verdict,
)
from fitting.text.rendering import phrase

#: What a profile gives an estimate.
BY_PROFILE = (
    *("std", "ci68", "ci95", "shrinkage", "status", "simulation", "reason", "method"),
    *("closed_by", "active_bounds"),
)

Fitted = TypeVar("Fitted", bound=FittedEstimate)

#: Step in x for the slopes of derived outputs, at most a quarter of the bounds' distance.
OUTPUT_STEP = 1e-4
#: Share of the variance that the data answer for from which a linearised error is one of the data.
DETERMINED = 0.1


class Estimates(NamedTuple):
    """Estimates of all parameters (n,), each in its unit.

    `best` is the most likely point, `paper` the end of Algorithm 2, NaN where it was not asked for;
    `reported` is the one of them that is the value.
    """

    best: FloatArray
    paper: FloatArray
    reported: FloatArray


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


def _errors(solution: Solution, gradient: FloatArray) -> tuple[dict[str, Any], float, float]:
    """Fields of an estimate by its slope, and half of its 68 % and 95 % intervals, NaN without one.

    Student's where the residuals estimate the noise. The fields have no error where the data do not
    determine the value.
    """
    std = half = math.nan
    shift = shrinkage = 0.0
    if np.all(np.isfinite(gradient)):
        errors = solution.errors
        sigma, shrinkage = errors.of(gradient)
        freedom, shift = errors.freedom_of(gradient), errors.shift(gradient)
        std, half = reach(ROOT_68, freedom) * sigma + shift, reach(ROOT_95, freedom) * sigma + shift
    is_determined = shrinkage >= DETERMINED
    fields = {
        "std": std if is_determined else math.nan,
        "shrinkage": shrinkage,
        "status": Verdict.LINEARISED if is_determined else Verdict.UNKNOWN,
        "simulation": shift,
    }
    return fields, std, half


def parameter_results(solution: Solution, estimates: Estimates) -> dict[str, ParameterEstimate]:
    """Value, error and provenance of every parameter of the whole campaign, by name.

    Args:
        solution: end of the fit.
        estimates: both estimates.
    """
    parameters, results = solution.parameters, {}
    shown, paper, reported = (canonical(parameters, p) for p in estimates)
    for i, p in enumerate(parameters):
        if p.experiments:
            continue
        error, _, half = _errors(solution, p.scale * np.eye(len(parameters))[i])
        # within the bounds, moved with the value into its canonical period
        raw, turn = float(estimates.best[i]), float(shown[i] - estimates.best[i])
        low, high = min(max(raw - half, p.lower), raw), max(min(raw + half, p.upper), raw)
        ci95 = (low + turn, high + turn)
        if p.period is not None and high - low >= p.period:
            ci95 = (0.0, float(p.period))
        results[p.name] = ParameterEstimate(
            name=p.name,
            value=float(reported[i]),
            unit=p.unit,
            ci95=ci95,
            reference=p.reference,
            start=p.start,
            lower=p.lower,
            upper=p.upper,
            algorithm2=float(paper[i]),
            most_likely=float(shown[i]),
            period=p.period,
            reason=phrase("status", "no_profile"),
            asked=p.moves_model,
            **error,
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
    response, results = solution.objective.response, {}
    ranges = output_ranges(response, solution.parameters, seed, outputs.points)
    papers = [estimates.paper] if np.all(np.isfinite(estimates.paper)) else []
    points = [estimates.reported, estimates.best, *papers]
    reported, likely, *of_paper = response.derived_many(points)
    read_at = places_of_outputs(solution.objective.data.measurements)
    places = tuple(label for each in read_at.values() for label, _ in each)
    for name, values in reported.items():
        means = outputs.means(name)
        best, low, high = mean(likely[name]), ranges[name].low, ranges[name].high
        gradient = outputs.gradient(name, secants=True)
        slope = gradient if math.isfinite(best) else gradient * math.nan
        error, _, half = _errors(solution, slope)
        # within what the model allows; without data all of it
        ci95 = (low, high) if math.isfinite(best) else (math.nan, math.nan)
        if error["status"] is Verdict.LINEARISED:
            ci95 = min(max(best - half, low), best), max(min(best + half, high), best)
        else:
            error["simulation"] = 0.0
        # of a value of its own at each place
        each = len(places) == values.size > 1
        stds, halves = list[float](), list[float]()
        if each:
            around = [answer[name] for answer in outputs.values[2:]]
            for slope in outputs.secants.quotients(around):
                own, _, end = _errors(solution, slope)
                stds.append(own["std"])
                halves.append(end if own["status"] is Verdict.LINEARISED else math.nan)
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
            stds=tuple(stds),
            halves95=tuple(halves),
            **error,
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
    scales = np.array([p.scale for p in parameters])
    for i, p in enumerate(parameters):
        if p.experiment is None:
            continue
        adds, later = np.zeros(len(parameters)), set[str | None]()
        for k, other in enumerate(parameters):
            if targets[k] == targets[i]:
                adds[k] = float(p.experiment in other.experiments)
                if k != i and other.experiments:
                    later.add(other.experiment)
        error, std, half = _errors(solution, adds * scales)
        best = float(adds @ estimates.best)
        # its prior gives it an error where the data do not
        results[p.name] = OffsetEstimate(
            name=p.name,
            experiments=tuple(label for label in p.experiments if label not in later),
            variables=targets[i],
            value=float(adds @ estimates.reported),
            unit=p.unit,
            ci95=(best - half, best + half),
            prior=p.prior_sigma or math.nan,
            fitted=float(estimates.reported[i]),
            most_likely=best,
            **error | {"std": std},
        )
    return results


def with_profiles(
    values: Mapping[str, Fitted],
    profiled: Mapping[str, FittedEstimate],
    apart: Mapping[str, str],
    why_not: str,
    at_bounds: tuple[str, ...],
) -> dict[str, Fitted]:
    """Values with status, error and intervals of their profiles, where these were scanned.

    Args:
        values: with the errors of the linearised problem, by name.
        profiled: with those of their profiles.
        apart: why single values have none, by name.
        why_not: why none has any; empty: the fit converged and the model describes the data.
        at_bounds: parameters that the data would move beyond their bounds: how far other values go
            along is not known without scans, and linearised ones have no errors.
    """
    made = {}
    for name, value in values.items():
        why = apart.get(name, why_not)
        if name in profiled:
            known = {each: getattr(profiled[name], each) for each in BY_PROFILE}
            value = replace(value, **known)
        if why:
            value = value.withdrawn(why)
        elif at_bounds and value.status is Verdict.LINEARISED:
            reason, status = phrase("status", "on_bound", at_bounds), Verdict.UNKNOWN
            value = replace(
                value, status=status, std=math.nan, reason=reason, active_bounds=at_bounds
            )
        made[name] = value
    return made


# --- what phases gain, and qualities behind a wiring ----------------------------------------------

#: Standard deviations of a Gaussian between which 95 % lie.
NINETY_FIVE = 1.959964
#: Share of the largest size or singular value below which a column is none.
NOTHING = 1e-9


def quadratures_of(
    solution: Solution, outputs: Outputs, units: Mapping[str, str], stds: Mapping[str, float]
) -> Quadratures:
    """What the phases of complex measurements determine at the end of a fit.

    Args:
        solution: end of the fit.
        outputs: derived outputs there and around.
        units: of them, by name.
        stds: errors that are reported, by name; NaN where there is no value.

    Raises:
        FmuFailure: the model failed near the solution.
    """
    objective, parameters, x = solution.objective, solution.parameters, solution.final.x
    measurements = objective.data.measurements
    phased = any(m.has_phases for m in measurements)
    if not phased and not any(m.solved_inside for m in measurements):
        return Quadratures()
    around = central(x, objective.steps, *search_bounds(parameters))
    points = [to_model(parameters, each) for each in (x, *around.nodes)]
    answers = [e.predictions for e in objective.response.evaluate_many(points)]
    gains: list[PhaseGain] = []
    if phased:
        both, amplitudes = (_by_rows(solution, answers[0], alone) for alone in (False, True))
        # parameters of the model and derived outputs, by their gradients in x
        values = [
            (p.name, p.unit, p.scale * np.eye(x.size)[i])
            for i, p in enumerate(parameters)
            if p.moves_model and not p.experiments
        ]
        values += [
            (name, units.get(name, ""), outputs.gradient(name)) for name in outputs.values[0]
        ]
        for name, unit, gradient in values:
            std = stds.get(name, 0.0)
            if np.all(np.isfinite(gradient)) and 0.0 < std < math.inf:
                one, two = amplitudes.of(gradient)[0], both.of(gradient)[0]
                if two > 0.0:
                    size = std * one / two
                    gains.append(PhaseGain(name=name, unit=unit, amplitudes=size, phases=std))

    # qualities by name at every point, with their errors at fixed parameters, as wide as the
    # residuals require
    noise, data = noise_of(objective, solution.final), objective.data
    if solution.structure is not None:
        noise = noise.widened(data.curve_rows, solution.structure.widening)
    sigma = noise.sigma * solution.errors.inflation
    tables: list[dict[str, Estimated]] = []
    for answer in answers:
        tables.append({})
        for m, q, rows in zip(measurements, answer, data.slices, strict=True):
            for name, each in m.qualities(q, sigma[rows]).items():
                tables[-1][f"{name}[{m.series}]" if m.series else name] = each
    qualities = []
    for name, here in tables[0].items():
        steps = [np.array([t[name].value if name in t else math.nan]) for t in tables[1:]]
        of_parameters = solution.errors.of(around.quotients(steps)[0])[0]
        qualities.append(_quality(name, here, math.hypot(of_parameters, here.sigma)))
    return Quadratures(gains=tuple(gains), qualities=tuple(qualities))


def _quality(name: str, here: Estimated, error: float) -> Estimate:
    """A value, or one over a loss with an interval whose ends are those of the loss."""
    value = here.value
    if not here.is_loss:
        reach = math.exp(min(NINETY_FIVE * error / value, 50.0))
        ci95 = (value / reach, value * reach)
        return Estimate(name=name, value=value, unit="", std=error, ci95=ci95)
    most, least = value + NINETY_FIVE * error, value - NINETY_FIVE * error
    there = value > 0.0
    return Estimate(
        name=name,
        value=1.0 / value if there else math.nan,
        unit="",
        std=error / value**2 if there else math.nan,
        ci95=(1.0 / most if most > 0.0 else math.nan, 1.0 / least if least > 0.0 else math.inf),
        status=Verdict.LINEARISED if there else Verdict.UNKNOWN,
    )


def _by_rows(solution: Solution, answer: Sequence[Prediction], alone: bool) -> Linearisation:
    """The problem of all rows, or of amplitudes alone; what is solved inside is projected out."""
    data, slopes = solution.objective.data, []
    sigma = noise_of(solution.objective, solution.final).sigma[:, None]
    for m, q, rows in zip(data.measurements, answer, data.slices, strict=True):
        matrix, columns = solution.matrix[rows] / sigma[rows], m.solved_columns(q) / sigma[rows]
        if alone:
            matrix, columns = m.amplitude_rows(q, matrix), m.amplitude_rows(q, columns)
        sizes = np.linalg.norm(columns, axis=0)
        columns = columns[:, sizes > NOTHING * np.max(sizes, initial=1e-300)]
        if columns.shape[1]:  # of one measurement's rows alone
            scaled = columns / np.linalg.norm(columns, axis=0)
            left, singular, _ = np.linalg.svd(scaled, full_matrices=False)
            basis = left[:, singular > NOTHING * np.max(singular, initial=1e-300)]
            matrix = matrix - basis @ (basis.T @ matrix)
        slopes.append(matrix)
    matrix = np.concatenate(slopes)
    prior = prior_sigmas(solution.parameters, solution.nu)
    return Linearisation(rows=np.zeros(matrix.shape[0]), matrix=matrix, prior=prior)
