"""Minima that are no corners: Rosenbrock's valley on a curved kink, minima known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.interior_point import Solve, SolveSettings, along_the_valley
from fitting.fit.solver.narrow_valley import along_floor, finish_squares_in_valley, follow_valley
from fitting.text.arrays import FloatArray
from tests.support.rows import rows_evaluator


def banana(p: FloatArray) -> FloatArray:
    """|z - x y| has a kink along a curved surface; beside it a row that is 1 where it is least."""
    x, y, z = p
    return np.array([10.0 * (z - x * y), 1.0 + 1e-3 * ((1.0 - x) ** 2 + 100.0 * (y - x**2) ** 2)])


def rough(x: list[float]) -> Solve:
    return Solve(x=np.array(x), optimality=1.0, status="optimal", message="", iterations=0, steps=0)


def j(evaluator: Evaluator, x: FloatArray) -> float:
    return total(evaluator.point(x), 0.0, "slack")


def test_a_narrow_valley_on_a_kink_is_gone_along_to_its_end() -> None:
    """J = 1 at (1, 1, 1), begun beyond the bend."""
    evaluator = rows_evaluator(banana, [-3.0] * 3, [3.0] * 3)
    found = along_the_valley(evaluator, rough([-0.5, 0.4, -0.15]), 0.0, SolveSettings())
    assert j(evaluator, found.x) == pytest.approx(1.0, abs=1e-8)
    assert found.x == pytest.approx([1.0, 1.0, 1.0], abs=5e-3)


def test_the_valley_may_end_at_a_bound() -> None:
    """With x <= 0.5 the least is (1 - 0.5)^2 on y = 0.25, z = 0.125."""
    evaluator = rows_evaluator(banana, [-3.0] * 3, [0.5, 3.0, 3.0])
    found = along_the_valley(evaluator, rough([-0.5, 0.4, -0.15]), 0.0, SolveSettings())
    assert j(evaluator, found.x) == pytest.approx(1.00025, abs=1e-8)
    assert found.x == pytest.approx([0.5, 0.25, 0.125], abs=5e-3)


def test_where_nothing_vanishes_all_variables_are_free() -> None:
    evaluator = rows_evaluator(
        lambda p: banana(np.array([*p, p[0] * p[1] + 1.0])), [-3.0] * 2, [3.0] * 2
    )
    x, _ = along_floor(evaluator, np.array([-1.2, 1.4]), 0.0, 100)
    assert j(evaluator, x) == pytest.approx(11.0, abs=1e-8)


def test_a_corner_stays_where_it_is() -> None:
    """Two rows vanish, and one of them twice, with two variables."""
    evaluator = rows_evaluator(
        lambda p: np.array([p[0] - 1.0, p[1] - p[0] ** 2, 2.0 * (p[0] - 1.0), 1.0 + 0.1 * p[1]]),
        [-3.0] * 2,
        [3.0] * 2,
    )
    x = np.ones(2)
    assert along_floor(evaluator, x, 0.0, 60) == (x, 0)


def test_a_row_that_vanishes_twice_is_one_kink() -> None:
    evaluator = rows_evaluator(
        lambda p: np.array([*banana(p), 3.0 * (p[2] - p[0] * p[1])]), [-3.0] * 3, [3.0] * 3
    )
    x, _ = along_floor(evaluator, np.array([0.5, 0.2, 0.1]), 0.0, 100)
    assert j(evaluator, x) == pytest.approx(1.0, abs=1e-8)


def test_the_tikhonov_term_counts() -> None:
    """Against a grid of x and y, z = x y being on the kink."""
    nu = 2e-3
    evaluator = rows_evaluator(banana, [-3.0] * 3, [3.0] * 3)
    x, _ = along_floor(evaluator, np.array([0.5, 0.2, 0.1]), nu, 100)
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 1001), np.linspace(0.0, 1.0, 1001))
    on = 1.0 + 1e-3 * ((1.0 - a) ** 2 + 100.0 * (b - a**2) ** 2)
    least = np.min(on + 0.5 * nu * (a**2 + b**2 + (a * b) ** 2))
    assert total(evaluator.point(x), nu, "slack") == pytest.approx(least, abs=1e-6)
    assert total(evaluator.point(x), nu, "slack") <= least


def rosenbrock(p: FloatArray) -> FloatArray:
    """Squares whose valley is y = x^2 and almost level along it; zero at (1, 1)."""
    return np.array([100.0 * (p[1] - p[0] ** 2), 1e-3 * (1.0 - p[0])])


def test_squares_are_lowest_at_the_end_of_a_bent_valley() -> None:
    """From beyond the fold at x = 0, at which y turns."""
    evaluator = rows_evaluator(rosenbrock, [-3.0] * 2, [3.0] * 2)
    found = follow_valley(evaluator, np.array([-1.2, 1.44]), 0.0, 1e-18, "squares")
    assert found.x == pytest.approx([1.0, 1.0], abs=1e-5)


def test_squares_may_end_at_a_bound() -> None:
    evaluator = rows_evaluator(rosenbrock, [-3.0] * 2, [0.5, 3.0])
    found = finish_squares_in_valley(evaluator, np.array([-1.2, 1.44]), 0.0, 1e-14)
    assert found.x == pytest.approx([0.5, 0.25], abs=1e-6)
    assert found.optimality <= 1e-14


def test_linearised_steps_that_creep_are_followed_by_curved_ones() -> None:
    """Two levels of damping, one of which the rows hardly see, as next to an uncoupled mode.

    The rows vanish where a = 1/b and b = 0.02, and nowhere else.
    """
    evaluator = rows_evaluator(
        lambda p: np.array([10.0 * (p[0] * p[1] - 1.0), 1e-4 * np.log(p[1] / 0.02)]),
        [0.5, 0.01],
        [100.0, 2.0],
    )
    found = finish_squares_in_valley(evaluator, np.array([1.0, 1.0]), 0.0, 1e-18)
    assert found.x == pytest.approx([50.0, 0.02], rel=1e-3)
    assert total(evaluator.point(found.x), 0.0, "squares") < 1e-14


def test_what_is_taken_on_is_never_higher() -> None:
    """From thirty points of the box, in a dozen steps."""
    evaluator = rows_evaluator(banana, [-3.0] * 3, [3.0] * 3)
    for start in np.random.default_rng(4).uniform(-3.0, 3.0, (30, 3)):
        x, _ = along_floor(evaluator, start, 0.0, 12)
        assert j(evaluator, x) <= j(evaluator, start)
        y, _ = along_floor(evaluator, start, 0.0, 12, "squares")
        squares = [total(evaluator.point(z), 0.0, "squares") for z in (y, start)]
        assert squares[0] <= squares[1]
