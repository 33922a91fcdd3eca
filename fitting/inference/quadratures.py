"""What phases gain, and what follows from gains and backgrounds that are solved inside the rows.

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

import numpy as np

from fitting.campaign.parameters import prior_sigmas, search_bounds, to_model
from fitting.fit.differences import central
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import noise_of
from fitting.fit.solution import Solution
from fitting.inference.estimates import Outputs
from fitting.inference.likelihood.knowledge import PhaseGain, Quadratures
from fitting.measurements.measurement import Estimated, Prediction
from fitting.text.estimate import Estimate, Verdict

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
        both, amplitudes = (_errors(solution, answers[0], alone) for alone in (False, True))
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


def _errors(solution: Solution, answer: Sequence[Prediction], alone: bool) -> Linearisation:
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
