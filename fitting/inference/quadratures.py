"""What phases gain, and what follows from gains and backgrounds that are solved inside the rows.

With W the whitened derivatives of the rows by the parameters, what is solved inside taken out of
them, the linearised problem has two errors of a value: s of all rows, and s' of amplitudes alone,
which are the changes along the values themselves. Told are the error e that the value is reported
with, of its profile and widened by what its residuals ask for, and e s'/s: amplitudes of the same
residuals.

A quality Q(x, c) of parameters x and coefficients c has the variance g^T C g + s^2, g = dQ/dx with
the best c at every x, C the covariance of x and s its error at fixed x: the errors of x and those
of c about c(x) are independent.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import prior_sigmas, search_bounds, to_model
from fitting.fit.differences import central
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import noise_of
from fitting.fit.outputs import output_means
from fitting.fit.solution import Solution
from fitting.measurements.measurement import Estimated, Prediction
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Estimate, Verdict
from fitting.text.notation import number

#: Step of x for slopes of derived outputs, in units of the search vector.
STEP = 1e-3
#: Standard deviations of a Gaussian between which 95 % lie.
NINETY_FIVE = 1.959964


@dataclass(frozen=True, kw_only=True)
class PhaseGain:
    """Standard deviation of a value, of `amplitudes` alone and with `phases`, in `unit`.

    With phases it is the reported one, of amplitudes alone it is as many times as wide as in the
    linearised problem.
    """

    name: str
    unit: str
    amplitudes: float
    phases: float


@dataclass(frozen=True, kw_only=True)
class Quadratures:
    """Gains in precision by phases, and qualities that follow from what is solved inside.

    Both are empty without any. The interval of a quality is symmetric in its logarithm, that of a
    quality factor in 1/Q, and infinite above where no loss at all would suit the data as well; its
    value is NaN where its loss comes out negative.
    """

    gains: tuple[PhaseGain, ...] = ()
    qualities: tuple[Estimate, ...] = ()

    @property
    def alike(self) -> list[list[PhaseGain]]:
        """The gains, those of one number together: outputs of the FMU that are a parameter.

        Profiles, which are scanned for each, are the same as far as they are printed.
        """
        groups: dict[tuple[str, ...], list[PhaseGain]] = {}
        for gain in self.gains:
            ratio = f"{gain.amplitudes / gain.phases:.6g}"
            key = (gain.unit, number(gain.amplitudes, 2), number(gain.phases, 2), ratio)
            groups.setdefault(key, []).append(gain)
        return list(groups.values())


def quadratures_of(solution: Solution, units: Mapping[str, str]) -> Quadratures:
    """What the phases of complex measurements tell at the end of a fit.

    Args:
        solution: end of the fit.
        units: of the derived outputs, by name.

    Raises:
        FmuFailure: the model failed near the solution.
    """
    objective = solution.objective
    measurements = objective.data.measurements
    phased = any(m.has_phases for m in measurements)
    if not phased and not any(m.solved_inside for m in measurements):
        return Quadratures()
    x = solution.final.x
    around = central(x, objective.steps, *search_bounds(solution.parameters))
    points = [to_model(solution.parameters, each) for each in (x, *around.nodes)]
    answers = [e.predictions for e in objective.response.evaluate_many(points)]
    gains = _gains(solution, answers[0], units) if phased else ()
    tables = [_qualities(solution, answer) for answer in answers]
    found = []
    for name, here in tables[0].items():
        steps = [np.array([t[name].value if name in t else math.nan]) for t in tables[1:]]
        of_parameters = solution.errors.of(around.quotients(steps)[0])[0]
        error = math.hypot(of_parameters, here.sigma)
        made = _of_loss if here.is_loss else _of_value
        found.append(made(name, here.value, error))
    return Quadratures(gains=gains, qualities=tuple(found))


def _of_value(name: str, value: float, std: float) -> Estimate:
    reach = math.exp(min(NINETY_FIVE * std / value, 50.0))
    return Estimate(name=name, value=value, unit="", std=std, ci95=(value / reach, value * reach))


def _of_loss(name: str, loss: float, error: float) -> Estimate:
    """1/loss, with an interval whose ends are those of the loss."""
    most, least = loss + NINETY_FIVE * error, loss - NINETY_FIVE * error
    there = loss > 0.0
    return Estimate(
        name=name,
        value=1.0 / loss if there else math.nan,
        unit="",
        std=error / loss**2 if there else math.nan,
        ci95=(1.0 / most if most > 0.0 else math.nan, 1.0 / least if least > 0.0 else math.inf),
        status=Verdict.LINEARISED if there else Verdict.UNKNOWN,
    )


def as_reported(gains: Sequence[PhaseGain], stds: Mapping[str, float]) -> tuple[PhaseGain, ...]:
    """The gains with the errors that are reported; without values that have none.

    Args:
        gains: of the linearised problem, noise as it is stated or scatters.
        stds: errors that are reported, by name; NaN where there is no value.
    """
    return tuple(
        replace(gain, phases=std, amplitudes=std * gain.amplitudes / gain.phases)
        for gain in gains
        if (std := stds.get(gain.name, math.nan)) > 0.0 and math.isfinite(std) and gain.phases > 0.0
    )


def _qualities(solution: Solution, answer: Sequence[Prediction]) -> dict[str, Estimated]:
    """Values by name with their errors at fixed parameters, as wide as the residuals ask for."""
    noise = noise_of(solution.objective, solution.final)
    if solution.structure is not None:
        noise = noise.widened(solution.objective.data.curve_rows, solution.structure.widening)
    sigma = noise.sigma * solution.errors.inflation
    data = solution.objective.data
    found = {}
    for m, q, rows in zip(data.measurements, answer, data.slices, strict=True):
        tag = f"[{m.series}]" if m.series else ""
        for name, each in m.qualities(q, sigma[rows]).items():
            found[f"{name}{tag}"] = each
    return found


def _gains(
    solution: Solution, answer: Sequence[Prediction], units: Mapping[str, str]
) -> tuple[PhaseGain, ...]:
    with_phases, amplitudes = (_errors(solution, answer, alone) for alone in (False, True))
    found = []
    for name, unit, gradient in _values(solution, units):
        one, two = (errors.of(gradient)[0] for errors in (amplitudes, with_phases))
        found.append(PhaseGain(name=name, unit=unit, amplitudes=one, phases=two))
    return tuple(found)


def _errors(solution: Solution, answer: Sequence[Prediction], alone: bool) -> Linearisation:
    """The problem of all rows, or of amplitudes alone; what is solved inside is taken out."""
    data = solution.objective.data
    noise = noise_of(solution.objective, solution.final)
    slopes = []
    for m, q, rows in zip(data.measurements, answer, data.slices, strict=True):
        white = 1.0 / noise.sigma[rows][:, None]
        pair = [white * solution.matrix[rows], white * m.solved_columns(q)]
        if alone:
            pair = [m.amplitude_rows(q, each) for each in pair]
        slopes.append(_without(*pair))  # what is solved inside is of one measurement's rows alone
    matrix = np.concatenate(slopes)
    return Linearisation(
        rows=np.zeros(matrix.shape[0]),
        matrix=matrix,
        prior=prior_sigmas(solution.parameters, solution.nu),
    )


def _without(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """A matrix without its share along some columns, if there are any."""
    if not columns.shape[1]:
        return matrix
    sizes = np.linalg.norm(columns, axis=0)
    kept = columns[:, sizes > 1e-9 * np.max(sizes, initial=1e-300)]
    left, singular, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    basis = left[:, singular > 1e-9 * np.max(singular, initial=1e-300)]
    return np.asarray(matrix - basis @ (basis.T @ matrix))


def _values(solution: Solution, units: Mapping[str, str]) -> list[tuple[str, str, FloatArray]]:
    """Name, unit and gradient in x of parameters of the model and of derived outputs."""
    parameters, x = solution.parameters, solution.final.x
    found = [
        (p.name, p.unit, p.scale * np.eye(x.size)[i])
        for i, p in enumerate(parameters)
        if p.moves_model and not p.experiments
    ]
    around = central(x, np.full(x.size, STEP), *search_bounds(parameters))
    means = output_means(solution.objective.response, parameters, list(around.nodes))
    for name, values in means.items():
        gradient = around.quotients(list(values))
        if np.all(np.isfinite(gradient)):
            found.append((name, units.get(name, ""), gradient))
    return found
