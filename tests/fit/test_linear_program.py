"""Linearised steps of sum |r| against vertices counted out, medians, and steps known by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from fitting.fit.solver.linear_program import (
    Pace,
    follow,
    linear_step,
    promised_decrease,
    with_slacks,
)
from fitting.text.arrays import FloatArray
from tests.support.rows import bent_at, rows_evaluator

WIDE = (np.full(2, -9.0), np.full(2, 9.0))


def merit(rows: FloatArray, matrix: FloatArray, slope: FloatArray, d: FloatArray) -> float:
    return float(np.sum(np.abs(rows + matrix @ d)) + slope @ d)


def least_of_vertices(
    rows: FloatArray, matrix: FloatArray, slope: FloatArray, low: FloatArray, high: FloatArray
) -> float:
    """A convex function of straight pieces is least where two of its edges or bounds meet."""
    lines = [(a, -r) for a, r in zip(matrix, rows, strict=True)]
    lines += [(np.eye(2)[i], bound[i]) for i in range(2) for bound in (low, high)]
    least = np.inf
    for (a, p), (b, q) in itertools.combinations(lines, 2):
        both = np.array([a, b])
        if abs(np.linalg.det(both)) > 1e-12:
            d = np.linalg.solve(both, np.array([p, q]))
            if np.all(d >= low - 1e-9) and np.all(d <= high + 1e-9):
                least = min(least, merit(rows, matrix, slope, d))
    return least


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("size", [1e-7, 1.0, 1e7])
def test_the_step_is_the_best_vertex(seed: int, size: float) -> None:
    generator = np.random.default_rng(seed)
    rows, matrix = generator.standard_normal(7), generator.standard_normal((7, 2))
    slope, radius = 0.5 * generator.standard_normal(2), 0.6
    room = (np.array([-0.2, -9.0]), np.array([9.0, 0.3]))
    step = linear_step(size * rows, size * matrix, size * slope, room, radius)
    low, high = np.maximum(room[0], -radius), np.minimum(room[1], radius)
    assert np.all(step >= low - 1e-12)
    assert np.all(step <= high + 1e-12)
    least = least_of_vertices(rows, matrix, slope, low, high)
    assert merit(rows, matrix, slope, step) == pytest.approx(least, rel=1e-9)


@pytest.mark.parametrize("count", [501, 30_001])
def test_the_step_of_a_long_series_is_a_weighted_median(count: int) -> None:
    """Sum |r_i + j_i d| is least at the median of -r_i/j_i, each weighing |j_i|."""
    generator = np.random.default_rng(7)
    slopes, centres = generator.uniform(-2.0, 2.0, count), generator.normal(0.1, 0.3, count)
    order = np.argsort(centres)
    weight = np.cumsum(np.abs(slopes[order]))
    median = centres[order][np.searchsorted(weight, 0.5 * weight[-1])]
    room = (np.array([-5.0]), np.array([5.0]))
    step = linear_step(-slopes * centres, slopes[:, np.newaxis], np.zeros(1), room, 1.0)
    assert step[0] == pytest.approx(median, abs=1e-9)


@pytest.mark.parametrize("rows", [3, 99, 100, 101])
def test_the_bands_of_the_slacks(rows: int) -> None:
    """-s <= J x <= s in whichever form; sparse from a hundred rows on."""
    matrix = np.random.default_rng(1).standard_normal((rows, 2))
    bands = with_slacks(matrix)
    assert isinstance(bands, np.ndarray) is (rows < 100)
    dense = bands if rows < 100 else bands.toarray()
    one = np.eye(rows)
    np.testing.assert_array_equal(dense, np.block([[matrix, -one], [-matrix, -one]]))


@pytest.mark.parametrize(
    ("x", "upper", "promise"),
    [
        (0.4, 9.0, 0.6 + 0.6),  # both rows fall to the row of the other, as far as x = 1
        (0.4, 0.7, 0.3 + 0.3),
        (1.5, 9.0, 0.0),  # between the two: one falls as the other rises
        (-0.5, 9.0, 1.0 + 1.0),  # no further than one unit
        (-3.0, 9.0, 1.0 + 1.0),
    ],
)
def test_the_promise_is_what_one_unit_of_the_search_vector_gains(
    x: float, upper: float, promise: float
) -> None:
    """Sum |x - 1| + |x - 2|."""
    evaluator = rows_evaluator(lambda p: np.array([p[0] - 1.0, p[0] - 2.0]), [-9.0], [upper])
    found = promised_decrease(evaluator, np.array([x]), 0.0, "slack")
    assert found == pytest.approx(promise, abs=1e-9)


def test_the_promise_takes_the_tikhonov_term_along_its_slope() -> None:
    """|x - 2| + 0.4/2 x^2 at x = 1: a unit gains 1 - 0.4; at x = 3 a unit back 1 + 0.4 * 3."""
    evaluator = rows_evaluator(lambda p: p - 2.0, [-9.0], [9.0])
    for x, promise in ((1.0, 0.6), (3.0, 2.2)):
        found = promised_decrease(evaluator, np.array([x]), 0.4, "slack")
        assert found == pytest.approx(promise, abs=1e-9)


def test_the_minimum_is_the_median() -> None:
    b = np.array([0.3, -1.2, 2.5, 0.9, 7.0])
    end = follow(rows_evaluator(lambda p: p[0] - b, [-9.0], [9.0]), np.array([-4.0]), 0.0, 1e-12)
    assert end.x == pytest.approx([0.9], abs=1e-12)
    assert end.optimality <= 1e-12
    assert "promises" in end.message


@pytest.mark.parametrize(("nu", "x"), [(0.5, 2.0), (0.8, 1.25), (4.0, 0.75)])
def test_the_minimum_with_a_tikhonov_term(nu: float, x: float) -> None:
    """|x - 1| + |x - 2| + |x - 10| + nu/2 x^2: flat where nu x is the number of rows above less
    those below (3 below 1, 1 below 2), else at a kink.
    """
    b = np.array([1.0, 2.0, 10.0])
    end = follow(rows_evaluator(lambda p: p[0] - b, [-9.0], [9.0]), np.array([-0.5]), nu, 1e-9)
    assert end.x == pytest.approx([x], abs=1e-4)


@pytest.mark.parametrize(
    ("far", "steps"),
    [(0.1, 1), (0.35, 2), (1.25, 3), (1.35, 4), (2.25, 4), (2.35, 5)],
)
def test_the_radius_is_a_tenth_at_first_and_threefold_after_each_good_step_up_to_one(
    far: float, steps: int
) -> None:
    """A straight row far away: steps of 0.1, 0.3, 0.9, 1, 1."""
    end = follow(rows_evaluator(lambda p: p - far, [-9.0], [9.0]), np.zeros(1), 0.0, 1e-9)
    assert end.x == pytest.approx([far])
    assert end.steps == steps


def test_steps_that_are_too_few_are_told() -> None:
    evaluator = rows_evaluator(lambda p: p - 3.3, [-9.0], [9.0])
    end = follow(evaluator, np.zeros(1), 0.0, 1e-9, Pace(steps=2))
    assert end.steps == 2
    assert end.x == pytest.approx([0.4])
    assert "enough" in end.message
    assert end.optimality == pytest.approx(1.0)
    there = follow(evaluator, np.array([3.3]), 0.0, 1e-9, Pace(steps=0))
    assert "promises" in there.message
    assert follow(evaluator, np.zeros(1), 0.0, 1e-9, Pace(steps=0)).steps == 0


def test_steps_that_never_pay_are_told() -> None:
    evaluator = rows_evaluator(lambda p: np.array([bent_at(p[0])]), [-9.0], [9.0])
    end = follow(evaluator, np.zeros(1), 0.0, 1e-9)
    assert "short" in end.message
    assert (end.x[0], end.steps) == (0.0, 0)


def test_a_curved_valley_is_followed_in_long_steps() -> None:
    """10 |y - x^2| + |1 - x| from (-1, 1): corrections take back what the curvature costs.

    The valley is 4.6 units of y and x long; without corrections steps along it are of the order of
    the square root of what they gain, and hundreds of them would be taken.
    """
    evaluator = rows_evaluator(
        lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]]), [-3.0, -3.0], [3.0, 3.0]
    )
    end = follow(evaluator, np.array([-1.0, 1.0]), 0.0, 1e-9)
    assert end.x == pytest.approx([1.0, 1.0], abs=1e-6)
    assert end.steps <= 12


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_step_knows_the_bounds_and_does_not_run_into_them(side: float) -> None:
    """10 |x - y| + |x - 3| along x = y, x <= 1: steps of 0.1, 0.3 and the 0.6 that are left."""
    low, high = sorted((-5.0 * side, side))

    def rows(p: FloatArray) -> FloatArray:
        return np.array([10.0 * (p[0] - p[1]), p[0] - 3.0 * side])

    end = follow(rows_evaluator(rows, [low, -5.0], [high, 5.0]), np.zeros(2), 0.0, 1e-9)
    assert end.x == pytest.approx([side, side])
    assert end.steps == 3


def test_a_bound_that_is_met_holds() -> None:
    """|x + y - 4| + |x - y| with x <= 1: least at 2 on 1 <= y <= 3, x = 1."""
    evaluator = rows_evaluator(
        lambda p: np.array([p[0] + p[1] - 4.0, p[0] - p[1]]), [-5.0, -5.0], [1.0, 5.0]
    )
    end = follow(evaluator, np.zeros(2), 0.0, 1e-9)
    assert end.x[0] == 1.0
    assert np.abs(end.x[0] + end.x[1] - 4.0) + abs(end.x[0] - end.x[1]) == pytest.approx(2.0)
