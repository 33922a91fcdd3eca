"""Value, error and interval are of one estimator: least squares of the whitened rows.

On a linear problem that estimator has a closed form, numpy.linalg.lstsq; data with outliers are
those where another estimator, the least sum of |r| of Algorithm 2, lies elsewhere.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.stats import chi2, norm, t

from fitting.fit.fit import solve_problem, with_path
from fitting.fit.options import ALGORITHM2, LIKELIHOOD, Options, Schedule
from fitting.fit.problem import Problem
from fitting.inference.infer import Inference, infer
from fitting.report.screen import phrase
from fitting.report.table import table as table_of
from fitting.report.table import text_lines
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from tests.support.whitened import Z95, learnt, parameter, whitened

ROWS = 15


def straight(seed: int, outlier: float) -> tuple[FloatArray, FloatArray]:
    """Rows A p - y of a line through noise of one sigma, one of them `outlier` sigma off."""
    generator = np.random.default_rng(seed)
    matrix = np.stack([np.ones(ROWS), np.linspace(-1.0, 1.0, ROWS)], axis=1)
    matrix *= generator.uniform(2.0, 8.0, size=(1, 2))
    measured = matrix @ generator.uniform(8.0, 12.0, 2) + generator.standard_normal(ROWS)
    measured[generator.integers(ROWS)] += outlier * generator.choice([-1.0, 1.0])
    return np.asarray(matrix), np.asarray(measured)


def widened(chi_square: float) -> float:
    """The factor of the Particle Data Group, only where noise would exceed it one time in 20."""
    freedom = ROWS - 2
    return math.sqrt(chi_square / freedom) if chi2.sf(chi_square, freedom) < 0.05 else 1.0


def reaches(chi_square: float) -> tuple[float, float]:
    """Half of 68 % and 95 % intervals in errors: Student's where the residuals made them wider."""
    law = t(ROWS - 2) if widened(chi_square) > 1.0 else norm
    return float(law.ppf(norm.cdf(1.0))), float(law.ppf(0.975))


def seeds(sample: int, most: int) -> list[Any]:
    """Some, and the others for the night."""
    others = range(sample, most)
    return [*range(sample), *(pytest.param(k, marks=pytest.mark.nightly) for k in others)]


@pytest.mark.parametrize("outlier", [0.0, 3.0, 5.0])
@pytest.mark.parametrize("seed", seeds(2, 6))
def test_value_error_and_interval_are_those_of_least_squares(seed: int, outlier: float) -> None:
    matrix, measured = straight(seed, outlier)
    solution, [chi_square], *_ = np.linalg.lstsq(matrix, measured)
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))) * widened(float(chi_square))
    objective = whitened(
        lambda x: matrix @ x - measured,
        parameter("p", 1.0, 40.0, start=9.0),
        parameter("q", 1.0, 40.0, start=9.0),
    )
    found = learnt(objective)
    assert found.knowledge.chi_square == pytest.approx(float(chi_square), rel=1e-3, abs=2e-3)
    for value, error, profile in zip(solution, errors, found.parameters.values(), strict=True):
        assert profile.likely == pytest.approx(value, abs=0.05 * error)
        assert found.scans[profile.name].sigma == pytest.approx(error, rel=0.01)
        assert profile.ci95[0] < profile.likely < profile.ci95[1]
        at_68, at_95 = (reach * error for reach in reaches(float(chi_square)))
        assert profile.ci95 == pytest.approx((value - at_95, value + at_95), abs=0.06 * error)
        assert profile.ci68 == pytest.approx((value - at_68, value + at_68), abs=0.05 * error)


def with_outlier(
    seed: int, estimator: str = LIKELIHOOD
) -> tuple[FloatArray, FloatArray, Inference]:
    matrix, measured = straight(seed, 5.0)
    objective = whitened(
        lambda x: matrix @ x - measured,
        parameter("p", 1.0, 40.0, start=9.0),
        parameter("q", 1.0, 40.0, start=9.0),
    )
    problem = Problem(objective.parameters, objective.data)
    schedule = Schedule(starts=1, nu_start=1e-6, beta=0.1, iterations=3)
    options = Options(schedule=schedule, estimator=estimator, path=True)
    fit = with_path(solve_problem(problem, lambda _: objective.response, options))
    return matrix, measured, infer(fit)


def least_absolute(matrix: FloatArray, measured: FloatArray) -> Any:
    """min sum |A p - y|, a linear program."""
    eye = np.eye(ROWS)
    return linprog(
        np.concatenate([np.zeros(2), np.ones(ROWS)]),
        A_ub=np.block([[matrix, -eye], [-matrix, -eye]]),
        b_ub=np.concatenate([measured, -measured]),
        bounds=[(None, None)] * 2 + [(0.0, None)] * ROWS,
    )


@pytest.mark.parametrize("seed", seeds(1, 4))
def test_the_estimate_of_algorithm_2_stands_beside_and_not_in_the_interval(seed: int) -> None:
    """min sum |A p - y| is a linear program; the value that is reported is not its solution."""
    matrix, measured, found = with_outlier(seed)
    solution, [chi_square], *_ = np.linalg.lstsq(matrix, measured)
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))) * widened(float(chi_square))
    least = least_absolute(matrix, measured)
    for k, result in enumerate(found.parameters.values()):
        assert result.status is Verdict.DETERMINED
        assert result.value == pytest.approx(solution[k], abs=0.05 * errors[k])
        assert result.std == pytest.approx(errors[k] * reaches(float(chi_square))[0], rel=0.03)
        assert result.ci95[0] < result.value < result.ci95[1]
    papers = np.array([result.algorithm2 for result in found.parameters.values()])
    reached = float(np.sum(np.abs(matrix @ papers - measured)))
    assert reached == pytest.approx(least.fun, rel=1e-4)
    # these data tell the two estimators apart
    assert float(np.sum(np.abs(matrix @ solution - measured))) > 1.01 * reached
    assert found.knowledge is not None
    for name, profile in found.parameters.items():
        low, high = profile.ci68
        assert found.parameters[name].std == pytest.approx(0.5 * (high - low))


@pytest.mark.parametrize("seed", seeds(2, 6))
def test_algorithm_2_is_reported_where_asked_for_and_errors_stay_those_of_least_squares(
    seed: int,
) -> None:
    matrix, measured, found = with_outlier(seed, ALGORITHM2)
    solution, [chi_square], *_ = np.linalg.lstsq(matrix, measured)
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix))) * widened(float(chi_square))
    values = np.array([result.value for result in found.parameters.values()])
    least = least_absolute(matrix, measured).fun
    assert float(np.sum(np.abs(matrix @ values - measured))) == pytest.approx(least, rel=1e-4)
    assert len(of_kind(found.findings, Kind.estimator)) == 1
    beyond = {each.subject for each in of_kind(found.findings, Kind.outside_interval)}
    for k, (name, result) in enumerate(found.parameters.items()):
        assert result.value == result.algorithm2
        assert result.most_likely == pytest.approx(solution[k], abs=0.05 * errors[k])
        assert result.std == pytest.approx(errors[k] * reaches(float(chi_square))[0], rel=0.03)
        half = errors[k] * reaches(float(chi_square))[1]
        low, high = solution[k] - half, solution[k] + half
        assert result.ci95 == pytest.approx((low, high), abs=0.06 * errors[k])
        outside = not low < result.value < high
        assert (name in beyond) == outside
        words = phrase("values", "reported", result)
        assert "by Algorithm 2" in words
        assert "most likely" in words
        assert result.is_outside == outside
        assert ("outside" in words) == outside
    for ends in (False, True):
        table = table_of("intervals", result=found, ends=ends)
        lines = " ".join(text_lines(table))
        assert "most likely" in lines
        numbers = np.array([float(n) for n in re.findall(r"(?<!\S)\d+\.?\d*(?!\S)", lines)])
        for result in found.parameters.values():  # rounded as their error
            assert np.min(np.abs(numbers - result.value)) <= 0.05 * result.std
            assert np.min(np.abs(numbers - result.most_likely)) <= 0.05 * result.std


def test_a_value_of_algorithm_2_beyond_the_interval_is_said_to_be_there() -> None:
    """Three rows of thirteen stand 2.9 sigma off: the mean is moved by them, the median is not."""
    y = np.array([10.0] * 10 + [12.9] * 3)
    objective = whitened(lambda x: x[0] - y, parameter("p", 1.0, 40.0, start=9.0))
    problem = Problem(objective.parameters, objective.data)
    options = Options(
        schedule=Schedule(starts=1, nu_start=1e-6, iterations=2), estimator=ALGORITHM2
    )
    found = infer(with_path(solve_problem(problem, lambda _: objective.response, options)))
    mean, error = float(np.mean(y)), y.size**-0.5
    assert mean - Z95 * error > np.median(y)
    result = found.parameters["p"]
    assert result.value == pytest.approx(np.median(y), abs=1e-3)
    assert result.most_likely == pytest.approx(mean, abs=0.01)
    assert result.std == pytest.approx(error, rel=0.03)
    assert result.is_outside
    [beyond] = of_kind(found.findings, Kind.outside_interval)
    assert beyond.subject == "p"
    assert (beyond.numbers["low"], beyond.numbers["high"]) == result.ci95
    lines = " ".join(text_lines(table_of("intervals", result=found)))
    assert "outside" in lines
