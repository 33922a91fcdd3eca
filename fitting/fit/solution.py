"""The reported end of a fit, and what was evaluated there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from fitting.campaign.parameters import (
    Parameter,
    prior_sigmas,
    search_bounds,
    starts,
    to_search,
)
from fitting.fit.covariance import WhitenedErrors
from fitting.fit.linearisation import Linearisation, linearise
from fitting.fit.noise import RowNoise, fitted_noise
from fitting.fit.objective import Evaluator, Objective, Point, j_reg
from fitting.signal.residual_tests import Structure, residual_structure
from fitting.text.arrays import FloatArray

#: Step off a plane of symmetry, as a share of the box (at most in units of x).
STRIDE = 0.1
#: Mean change of a row over such a step below which a column counts as vanished.
FLAT = 1e-6


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The reported end, and what was evaluated there.

    `initial` is the campaign's start, `final` the solution; `matrix` dr/dx there, `seen` the same
    with secants for variables without a first-order effect (`secants`), which
    `secant_points` tell of; `noise` of the rows, `errors` by it; `structure` that of the sweep's
    residuals, None where the sweep is not fitted; `nu` is the last weight of the Tikhonov term.
    """

    objective: Objective
    nu: float
    initial: Point
    final: Point
    matrix: FloatArray
    seen: FloatArray
    noise: RowNoise
    errors: Linearisation
    structure: Structure | None
    secant_points: Mapping[int, FloatArray]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The fitted parameters."""
        return self.objective.parameters

    @property
    def j_reg(self) -> float:
        """The Tikhonov term at the last nu."""
        return j_reg(self.final.x, self.nu)

    @property
    def predicted_decrease(self) -> float:
        """Decrease of chi square that a linearised step promises, bounds that hold left aside."""
        lower, upper = search_bounds(self.parameters)
        x, rows, matrix = self.final.x, self.errors.rows, self.errors.matrix
        slope = matrix.T @ rows
        held = ((x <= lower) & (slope > 0.0)) | ((x >= upper) & (slope < 0.0))
        free = matrix[:, ~held]
        return float(rows @ free @ np.linalg.lstsq(free, rows, rcond=None)[0])

    def weighed(self, noise: RowNoise) -> Solution:
        """The same end, its errors by another noise of the rows.

        Args:
            noise: of the rows.
        """
        errors = _errors(self.objective, self.final, self.seen, noise, self.structure, self.nu)
        return replace(self, noise=noise, errors=errors)


def solution_of(evaluator: Evaluator, x: FloatArray, nu: float) -> Solution:
    """Evaluate the campaign's start and an end, with Jacobian and covariance at the end.

    Args:
        evaluator: of the objective.
        x: search vector where the fit ended, (n,).
        nu: last weight of the Tikhonov term.

    Raises:
        FmuFailure: the model failed at one of them.
    """
    objective = evaluator.objective
    parameters = objective.parameters
    initial, final = evaluator.points([to_search(parameters, starts(parameters)), x], whole=True)
    matrix = evaluator.jacobian(x)
    seen, secant_points = secants(evaluator, x, matrix)
    noise = fitted_noise(objective, final, seen, prior_sigmas(parameters, nu))
    structure = curve_structure(objective, final, matrix, noise)
    return Solution(
        objective=objective,
        nu=nu,
        initial=initial,
        final=final,
        matrix=matrix,
        seen=seen,
        noise=noise,
        errors=_errors(objective, final, seen, noise, structure, nu),
        structure=structure,
        secant_points=secant_points,
    )


def _errors(
    objective: Objective,
    final: Point,
    seen: FloatArray,
    noise: RowNoise,
    structure: Structure | None,
    nu: float,
) -> Linearisation:
    """The problem linearised at its end; curves count by what their residuals are worth."""
    data = objective.data
    stated = widened = noise
    if structure is not None:
        widened = noise.widened(data.curve_rows, structure.widening)
        stated = noise.widened(data.curve_rows, structure.excess)
    errors = linearise(
        final.residuals,
        seen,
        stated.covariance,
        prior_sigmas(objective.parameters, nu),
        widened.covariance,
        data.solved_inside,
    )
    errors = replace(errors, scatter=widened.scatter, freedom=noise.freedom)
    if not noise.bounded.columns:
        return errors
    counted = widened.covariance.times(errors.inflation)
    return replace(errors, bounded=WhitenedErrors(noise.bounded, counted))


def curve_structure(
    objective: Objective, final: Point, matrix: FloatArray, noise: RowNoise
) -> Structure | None:
    """Structure of the residuals along curves; what they are solved for inside is fitted, too.

    Of the many spectra of a map each has a scale of its own. Where noise is of one size in volts,
    rows of a small spectrum have more, and so has its scale: nobody asks for that error, nor for
    those of gain, offset and start of a trace.

    Rows count as the fit weighs them, by their noise over its root mean square: where that is
    stated, residuals that grow with it are of one size.

    Args:
        objective: response, parameters and data.
        final: where the fit ended.
        matrix: dr/dx there, shape (m, n).
        noise: of all rows, as stated or as they scatter.
    """
    data = objective.data
    mine = data.curve_rows
    rows, columns = final.residuals[mine], matrix[mine]
    if not rows.size:
        return None
    if any(m.rows and m.takes_scale_from_rows for m in data.measurements if m.is_curve):
        columns = np.column_stack([columns, rows + data.measured_rows[mine]])  # d r/d ln chi
    # what the rows are solved for inside takes degrees of freedom, too: columns of one curve, of
    # the spectra of a map, and of stretches of rows that follow each other
    own = maps = np.empty((rows.size, 0))
    stretches = [np.empty((rows.size, 0))]
    curves = [(k, m) for k, m in enumerate(data.measurements) if m.is_curve]
    if any(m.solved_inside for _, m in curves):
        [answer] = objective.response.evaluate_many([final.parameters])
        of_own, of_maps, stretches = [], [], []
        for k, m in curves:
            prediction, nothing = answer.predictions[k], np.empty((m.rows, 0))
            inside = nothing if m.is_trace else m.solved_columns(prediction)
            of_own.append(nothing if m.control_units else inside)
            of_maps.append(inside if m.control_units else nothing)
            stretches += m.solved_blocks(prediction) if m.is_trace else [nothing]
        own, maps = np.asarray(block_diag(*of_own)), np.asarray(block_diag(*of_maps))
    columns = np.column_stack([columns, own])
    sigma = noise.sigma[mine]
    weights = float(np.sqrt(np.mean(sigma**2))) / sigma
    along = weights[:, None]
    parts = np.split(along, np.cumsum([len(block) for block in stretches])[:-1])
    weighted = [block * part for block, part in zip(stretches, parts, strict=True)]
    structure = residual_structure(rows * weights, columns * along, maps * along, weighted)
    taken = columns.shape[1] + maps.shape[1] + sum(block.shape[1] for block in stretches)
    freedom = max(1, rows.size - taken)
    return structure.beyond(float(np.sum((rows / sigma) ** 2)) / freedom)


def secants(
    evaluator: Evaluator, x: FloatArray, matrix: FloatArray
) -> tuple[FloatArray, dict[int, FloatArray]]:
    """dr/dx with finite differences in place of flat columns where these see more, (m, n).

    The second result gives for each such column the point that the difference was taken to.

    Args:
        evaluator: of the objective.
        x: search vector, shape (n,).
        matrix: dr/dx there, shape (m, n).
    """
    strides = STRIDE * np.minimum(evaluator.upper - evaluator.lower, 1.0)
    flat = np.flatnonzero(np.mean(np.abs(matrix), axis=0) * strides <= FLAT)
    changed, points = matrix.copy(), {}
    rows = evaluator.point(x).residuals
    for i in map(int, flat):
        for step in (strides[i], -strides[i]):
            moved = x.copy()
            moved[i] = np.clip(x[i] + step, evaluator.lower[i], evaluator.upper[i])
            if abs(moved[i] - x[i]) <= 0.5 * abs(step):
                continue  # no room on that side
            column = (evaluator.point(moved).residuals - rows) / (moved[i] - x[i])
            if np.linalg.norm(column) > np.linalg.norm(changed[:, i]):
                changed[:, i], points[i] = column, moved
    return changed, points
