"""The likelihood and its most likely point: against scipy, closed forms and a linear problem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from fitting.campaign.parameters import to_model, to_search
from fitting.fit.levenberg import Constraint, Goal, expand, minimise
from fitting.fit.likelihood import (
    MOST_FAILURES,
    Exhausted,
    LikelihoodEvaluator,
    Request,
    likelihood_of,
)
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.fit.optimum import inflation_of, most_likely
from fitting.measurements.measurement import Evaluation
from fitting.text.errors import FmuFailure
from tests.support import closed_form, single_line


def string_objective(seed: int = 3) -> Objective:
    response = closed_form.string_response()
    measured = closed_form.measured_by(response, noise=0.01, seed=seed)
    return make_objective(response, closed_form.string_parameters(), measured)


def evaluator_of(
    objective: Objective, common: float = 0.0, limit: int = 10**6
) -> LikelihoodEvaluator:
    sigma = objective.data.sigma
    return LikelihoodEvaluator(
        likelihood_of(objective, RowNoise(sigma, np.full((sigma.size, 1), common))), limit
    )


def test_chi_square_is_that_of_the_full_covariance() -> None:
    """r^T V^-1 r with V written out, chi's error common to all rows."""
    objective = string_objective()
    x = np.array([0.3, 0.2, -0.1])
    evaluator = evaluator_of(objective, common=0.03)
    rows = evaluator.one(x).rows
    [point] = evaluate_many(objective, [x])
    sigma = objective.data.sigma
    v = np.diag(sigma**2) + 0.03**2
    wanted = point.residuals @ np.linalg.solve(v, point.residuals)
    assert rows @ rows == pytest.approx(wanted, rel=1e-9)
    assert evaluator.likelihood.noise.row_sigma == pytest.approx(
        np.sqrt(sigma**2 + 0.03**2), rel=1e-9
    )


def test_the_most_likely_point_is_that_of_scipy() -> None:
    objective = single_line.line_objective(seed=5, span=2.0)
    evaluator = evaluator_of(objective)
    start = to_search(objective.parameters, np.array([1002.0, 12.0, 1.0]))
    optimum = most_likely(evaluator, [start])
    sigma = objective.data.sigma
    fit = least_squares(
        lambda x: evaluate_many(objective, [x])[0].residuals / sigma, start, xtol=1e-12
    )
    assert optimum.converged
    bound = single_line.bounds_of(0.02, 3)
    scales = np.array([p.scale for p in objective.parameters])
    # far below what the noise leaves open
    off = (
        np.abs(optimum.expansion.x - fit.x)
        * scales
        / np.array([bound[k] for k in ("eta", "w", "A")])
    )
    assert np.max(off) < 0.02
    assert optimum.chi_square == pytest.approx(2.0 * fit.cost, abs=1e-3)


def test_a_gaussian_prior_pulls_as_bayes_says() -> None:
    """A prior as sharp as the data, one sigma off: the answer lies half way; both are Gaussian."""
    bound = single_line.bounds_of(0.02, 3)["eta"]
    objective = single_line.line_objective(prior_hz=bound)
    optimum = most_likely(evaluator_of(objective), [np.zeros(3)])
    place = to_model(objective.parameters, optimum.expansion.x)[0] - single_line.ETA_HZ
    assert place == pytest.approx(0.5 * bound, rel=0.02)
    assert optimum.least == pytest.approx(0.5, rel=0.02)  # a quarter from the data, one from it


def test_residuals_beyond_the_noise_widen_and_noise_does_not() -> None:
    assert inflation_of(40.0, 10.0) == pytest.approx(2.0)
    assert inflation_of(float(chi2.ppf(0.94, 10)), 10.0) == 1.0
    assert inflation_of(float(chi2.ppf(0.96, 10)), 10.0) > 1.0
    assert inflation_of(3.0, 10.0) == 1.0


def test_a_valley_is_left_where_it_was_entered() -> None:
    """Directions that the data do not see are walked along no further than the others ask for."""
    objective = string_objective()
    start = to_search(objective.parameters, np.array([1.7, 100.0, 94.0]))
    optimum = most_likely(evaluator_of(objective), [start])
    assert optimum.expansion.x[0] == pytest.approx(start[0], abs=0.3)
    fitted = to_model(objective.parameters, optimum.expansion.x)
    theta, d1, d2 = map(float, fitted)
    width = closed_form.damping(theta, d1, d2, reflection=False)[0, 0]
    assert width == pytest.approx(94.1, abs=2.0)


def test_a_pinned_search_is_the_minimum_over_the_rest() -> None:
    """On a linear-Gaussian problem the rest follows along the regression line."""
    objective = single_line.line_objective()
    evaluator = evaluator_of(objective)
    optimum = most_likely(evaluator, [np.zeros(3)])
    [here] = expand(evaluator, [optimum.expansion.x])
    bound = single_line.bounds_of(0.02, 3)
    w = objective.parameters[1]
    target = (single_line.WIDTH_HZ + 0.1 * bound["w"] - w.reference) / w.scale
    held = [Constraint(target=target, index=1)]
    [found] = minimise(evaluator, [here], held, Goal(promise=1e-10))
    assert found.reached
    # cov(A, w)/var(w) = -sigma^2.../...: with var w and I_Aw = A/(w) (pi/2), I_AA = pi
    slope = -0.5 * single_line.TOP / single_line.WIDTH_HZ
    moved = to_model(objective.parameters, found.end.x)[2] - single_line.TOP
    assert moved == pytest.approx(slope * 0.1 * bound["w"], rel=0.03)
    assert found.chi_square - optimum.least == pytest.approx(0.01, rel=0.03)


def test_angles_that_differ_by_a_period_are_one_system() -> None:
    likelihood = evaluator_of(string_objective()).likelihood
    lower, upper = -2 * np.pi - closed_form.THETA_REFERENCE, 2 * np.pi - closed_form.THETA_REFERENCE
    for theta in (lower - 0.4, upper + 5.0, 0.3):
        x = likelihood.folded(np.array([theta, 0.0, 0.0]))
        assert lower <= x[0] <= upper
        assert math.isclose(math.cos(2 * (x[0] - theta)), 1.0, abs_tol=1e-9)


def test_what_asks_for_too_much_is_told_and_ends() -> None:
    objective = string_objective()
    evaluator = evaluator_of(objective, limit=20)
    with pytest.raises(Exhausted):
        evaluator([Request(tuple(np.zeros(3) for _ in range(21)))])
    with pytest.raises(Exhausted):
        expand(evaluator, [np.zeros(3)] * 6)
    assert evaluator.cuts == 2


class Failing(closed_form.ClosedFormResponse):
    """Fails where d1 is large, as an FMU may at a corner of the box."""

    def evaluate_many(self, ps: Sequence[np.ndarray], *, whole: bool = False) -> list[Evaluation]:
        if any(p[1] > 150.0 for p in ps):
            raise FmuFailure("overdamped", {}, Path("test.fmu"))
        return super().evaluate_many(ps, whole=whole)


def test_points_at_which_the_model_fails_are_left_out() -> None:
    whole = string_objective()
    old = closed_form.string_response()
    bad = Failing(old.pairs_hz, old.eta_plus_hz, old.eta_minus_hz, old.sweep_hz)
    objective = Objective(
        response=bad, parameters=whole.parameters, data=whole.data, steps=whole.steps
    )
    evaluator = evaluator_of(objective)
    good, failed = np.zeros(3), np.array([0.0, 1.3, 0.0])
    answers = evaluator([Request((good, failed, good))])[0]
    assert [bool(np.all(np.isfinite(a.rows))) for a in answers] == [True, False, True]
    with pytest.raises(FmuFailure, match="overdamped"):
        evaluator_of(objective)([Request((failed,) * (MOST_FAILURES + 1))])
