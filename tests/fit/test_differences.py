"""Difference quotients: exact where the theory says so, and never outside the box."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.fit.objective import central, forward
from fitting.text.arrays import FloatArray

X = np.array([0.3, -0.7, 2.0])
WIDE = np.full(3, -10.0), np.full(3, 10.0)


def quadratic(x: FloatArray) -> FloatArray:
    """Two rows, with derivatives [2 x0, x2, x1] and [0, 1, -3]."""
    return np.array([x[0] ** 2 + x[1] * x[2], x[1] - 3.0 * x[2]])


def test_central_differences_of_a_quadratic_are_exact() -> None:
    around = central(X, np.array([0.1, 0.2, 0.3]), *WIDE)
    assert len(around.nodes) == 6
    found = around.quotients([quadratic(x) for x in around.nodes])
    assert found == pytest.approx(np.array([[0.6, 2.0, -0.7], [0.0, 1.0, -3.0]]), abs=1e-12)


def test_derivatives_at_a_bound_are_of_second_order_too() -> None:
    """A one-sided quotient of x0^2 would be off by the step, 0.1."""
    lower, upper = np.array([0.3, -10.0, -10.0]), np.array([9.0, -0.7, 2.0])
    around = central(X, 0.1, lower, upper)
    assert len(around.nodes) == 9  # three along each axis
    assert all(np.all((lower <= x) & (x <= upper)) for x in around.nodes)
    found = around.quotients([quadratic(x) for x in around.nodes])
    assert found == pytest.approx(np.array([[0.6, 2.0, -0.7], [0.0, 1.0, -3.0]]), abs=1e-12)


def test_derivatives_next_to_a_bound_are_as_good_as_anywhere() -> None:
    """exp has itself as derivative; a step cut to a tenth would be off by its half, 4.5e-4."""
    for shift in (0.0, 1e-4, 5e-4):
        around = central(np.zeros(1), 1e-3, np.array([-shift]), np.array([1.0]))
        [found] = around.quotients([np.exp(x) for x in around.nodes])
        assert found == pytest.approx(1.0, abs=1e-6)


def test_a_box_that_is_narrower_than_two_steps_is_used_whole() -> None:
    around = central(np.zeros(1), 1.0, np.array([-0.2]), np.array([0.5]))
    assert [float(x[0]) for x in around.nodes] == [0.5, -0.2]


def test_numbers_have_a_gradient() -> None:
    around = central(X, 1e-3, *WIDE)
    found = around.quotients([float(quadratic(x)[0]) for x in around.nodes])
    assert found == pytest.approx(np.array([0.6, 2.0, -0.7]), abs=1e-9)


def test_forward_differences_are_off_by_the_step() -> None:
    """(f(x + h) - f(x))/h = 2 x + h along the first axis."""
    around = forward(X, np.full(3, 0.01), WIDE[1])
    assert len(around.nodes) == 4
    assert around.nodes[0] is X
    found = around.quotients([quadratic(x) for x in around.nodes])
    assert found[0, 0] == pytest.approx(0.6 + 0.01)
    assert found[:, 1:] == pytest.approx(np.array([[2.0, -0.7], [1.0, -3.0]]))


def test_nodes_stay_in_the_box() -> None:
    lower, upper = np.array([0.3, -1.0, 1.0]), np.array([1.0, -0.65, 2.0])
    around = central(X, 0.1, lower, upper)
    assert all(np.all((lower <= x) & (x <= upper)) for x in around.nodes)
    found = around.quotients([quadratic(x) for x in around.nodes])
    assert found[1] == pytest.approx([0.0, 1.0, -3.0])  # a linear row does not mind
    inward = forward(X, 0.1, upper)
    assert inward.nodes[3] == pytest.approx([0.3, -0.7, 1.9])
    assert inward.quotients([quadratic(x) for x in inward.nodes])[1] == pytest.approx([0, 1, -3])


def test_a_quotient_may_be_taken_between_other_points() -> None:
    """Where a first-order step sees nothing: |x0| at its minimum, by a step of finite size."""
    origin = np.zeros(3)
    far = np.array([0.5, 0.0, 0.0])
    around = central(origin, 0.1, *WIDE).between(0, far, origin)
    values = [np.array([abs(x[0]), x[1]]) for x in around.nodes]
    assert around.quotients(values) == pytest.approx(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))


def test_logarithms_may_be_what_differs() -> None:
    around = central(X, 0.1, *WIDE)
    values = [np.exp(np.array([2.0 * x[0], -x[2]])) for x in around.nodes]
    found = around.quotients(values, lambda above, below: np.log(above / below))
    assert found == pytest.approx(np.array([[2.0, 0.0, 0.0], [0.0, 0.0, -1.0]]), abs=1e-12)
    assert math.isfinite(float(found.sum()))


@pytest.mark.filterwarnings("error")
def test_infinite_values_have_no_slope_and_warn_of_nothing() -> None:
    """1/x0 on the way to zero damping: inf - inf."""
    around = central(X, 0.1, *WIDE)
    found = around.quotients([math.inf if abs(x[0] - X[0]) < 0.05 else x[0] for x in around.nodes])
    assert found[0] == pytest.approx(1.0)
    assert np.all(np.isnan(found[1:]))
