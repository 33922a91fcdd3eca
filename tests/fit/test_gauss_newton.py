"""The finish of sums of squares against normal equations, bounded least squares and hand counts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from fitting.fit.solver.evaluator import Evaluator
from fitting.fit.solver.gauss_newton import finish_squares, newton_decrement, squares_model
from fitting.text.arrays import FloatArray
from tests.support.rows import bent_at, rows_evaluator

GENERATOR = np.random.default_rng(4)
MATRIX, TARGET = GENERATOR.standard_normal((8, 3)), 0.1 * GENERATOR.standard_normal(8)
NU = np.array([0.0, 0.3, 2.0])


def straight(lower: float = -9.0, upper: float = 9.0) -> Evaluator:
    return rows_evaluator(lambda p: MATRIX @ p - TARGET, [lower] * 3, [upper] * 3)


def bounded_minimum(lower: float, upper: float) -> FloatArray:
    """Of |M x - t|^2 + sum nu/2 x^2 in a box, by scipy."""
    stacked = np.concatenate([MATRIX, np.diag(np.sqrt(0.5 * NU))])
    wanted = np.concatenate([TARGET, np.zeros(3)])
    return np.asarray(lsq_linear(stacked, wanted, (lower, upper), method="bvls", tol=1e-14).x)


def value(x: FloatArray) -> float:
    return float(np.sum((MATRIX @ x - TARGET) ** 2) + 0.5 * np.sum(NU * x**2))


def test_slope_and_curvature_are_those_of_the_sum() -> None:
    x = np.array([0.1, -0.2, 0.05])
    model = squares_model(straight(), x, NU)
    assert model.slope == pytest.approx(2.0 * MATRIX.T @ (MATRIX @ x - TARGET) + NU * x, rel=1e-9)
    assert model.curvature == pytest.approx(2.0 * MATRIX.T @ MATRIX + np.diag(NU), rel=1e-9)
    assert model.free.tolist() == [True] * 3


def test_the_decrement_is_what_is_left_to_gain() -> None:
    x, least = np.array([0.3, -0.4, 0.2]), bounded_minimum(-9.0, 9.0)
    promise = newton_decrement(straight(), x, NU)
    assert promise == pytest.approx(value(x) - value(least), rel=1e-8)


@pytest.mark.parametrize(("x", "free"), [(1.0, False), (0.5, True), (-1.0, True)])
def test_a_variable_that_pushes_against_its_bound_is_held(x: float, free: bool) -> None:
    """(x - 3)^2 in -1 <= x <= 1, and its mirror image."""
    for sign in (1.0, -1.0):
        evaluator = rows_evaluator(lambda p, s=sign: p - 3.0 * s, [-1.0], [1.0])  # type: ignore[misc]
        model = squares_model(evaluator, np.array([sign * x]), 0.0)
        assert model.free.tolist() == [free]
        promise = newton_decrement(evaluator, np.array([sign * x]), 0.0)
        assert promise == pytest.approx((3.0 - x) ** 2 if free else 0.0)


@pytest.mark.parametrize("half", [9.0, 0.02, 0.005])
def test_the_end_is_that_of_bounded_least_squares(half: float) -> None:
    end = finish_squares(straight(-half, half), np.zeros(3), NU, 1e-14)
    assert end.x == pytest.approx(bounded_minimum(-half, half), abs=1e-7)
    assert end.optimality <= 1e-14
    assert "promises" in end.message


def test_straight_rows_take_one_step() -> None:
    end = finish_squares(straight(), np.zeros(3), NU, 1e-12)
    assert end.steps == 1
    again = finish_squares(straight(), end.x, NU, 1e-12)
    assert again.steps == 0
    assert np.array_equal(again.x, end.x)


def test_variables_of_any_size_are_damped_alike() -> None:
    scale = np.array([1e-6, 1.0, 1e6])
    evaluator = rows_evaluator(
        lambda p: (MATRIX * scale) @ p - 1e-7 * TARGET, [-9.0] * 3, [9.0] * 3
    )
    end = finish_squares(evaluator, np.zeros(3), 0.0, 1e-26)
    wanted = np.linalg.lstsq(MATRIX * scale, 1e-7 * TARGET, rcond=None)[0]
    assert end.x == pytest.approx(wanted, rel=1e-3)
    assert end.steps <= 3


def test_no_step_is_longer_than_half_a_unit() -> None:
    """(x - 3)^2 from zero: six steps at least, and not many more."""
    evaluator = rows_evaluator(lambda p: p - 3.0, [-9.0], [9.0])
    end = finish_squares(evaluator, np.zeros(1), 0.0, 1e-12)
    assert end.x == pytest.approx([3.0], abs=1e-6)
    assert 6 <= end.steps <= 16
    one = finish_squares(evaluator, np.zeros(1), 0.0, 1e-12, steps=1)
    assert 0.0 < one.x[0] <= 0.5
    assert "enough" in one.message
    assert one.optimality == pytest.approx((3.0 - one.x[0]) ** 2)
    near = finish_squares(evaluator, np.array([2.52]), 0.0, 1e-12)
    assert near.steps == 1


def test_steps_that_never_pay_are_told() -> None:
    evaluator = rows_evaluator(lambda p: np.array([bent_at(p[0])]), [-9.0], [9.0])
    end = finish_squares(evaluator, np.zeros(1), 0.0, 1e-12)
    assert "short" in end.message
    assert (end.x[0], end.steps) == (0.0, 0)


def test_a_curved_valley_is_followed_to_its_end() -> None:
    """Rosenbrock's function from its usual start, minimum at (1, 1)."""
    evaluator = rows_evaluator(
        lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]]), [-3.0, -3.0], [3.0, 3.0]
    )
    end = finish_squares(evaluator, np.array([-1.2, 1.0]), 0.0, 1e-16, steps=100)
    assert end.x == pytest.approx([1.0, 1.0], abs=1e-6)
    assert "promises" in end.message
