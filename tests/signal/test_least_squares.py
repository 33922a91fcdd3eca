"""The damped step: what the data do not determine stays unmoved."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.least_squares import damped_step


def test_the_step_solves_the_damped_normal_equations() -> None:
    generator = np.random.default_rng(3)
    matrix, rows = generator.standard_normal((9, 4)), generator.standard_normal(9)
    for damping in (0.0, 0.3, 40.0):
        normal = matrix.T @ matrix + damping * np.eye(4)
        expected = -np.linalg.solve(normal, matrix.T @ rows)
        assert damped_step(matrix, rows, damping) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("unit", [1e-25, 1e25])
def test_the_step_does_not_depend_on_the_unit_of_the_rows(unit: float) -> None:
    matrix, rows = np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([-4.0, 0.0])
    assert damped_step(unit * matrix, unit * rows, 0.0) == pytest.approx([2.0, 2.0])


def test_nothing_moves_along_what_the_rows_do_not_see() -> None:
    matrix = np.array([[1.0, 1.0], [1.0, 1.0]])
    step = damped_step(matrix, np.array([-2.0, -2.0]), 0.0)
    assert step == pytest.approx([1.0, 1.0])  # the shortest of all that solve x + y = 2


def test_directions_below_the_least_are_left_out() -> None:
    matrix, rows = np.diag([3.0, 0.5]), np.array([-3.0, -1.0])
    assert damped_step(matrix, rows, 0.0) == pytest.approx([1.0, 2.0])
    wide = np.full(2, -9.0), np.full(2, 9.0)
    for room in (None, wide):  # bounds that are not met change nothing
        assert damped_step(matrix, rows, 0.0, room, least=1.0) == pytest.approx([1.0, 0.0])


def test_a_bound_that_is_met_moves_the_rest() -> None:
    """Min (x + y - 4)^2 + (x - y)^2: at x = 1 that is (y - 3)^2 + (1 - y)^2, least at y = 2."""
    matrix, rows = np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([-4.0, 0.0])
    wide = np.full(2, -9.0), np.full(2, 9.0)
    assert damped_step(matrix, rows, 0.0, wide) == pytest.approx([2.0, 2.0])
    found = damped_step(matrix, rows, 0.0, (wide[0], np.array([1.0, 9.0])))
    assert found == pytest.approx([1.0, 2.0])


def test_a_variable_without_room_stays() -> None:
    matrix, rows = np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([-4.0, 0.0])
    room = np.array([0.0, -9.0]), np.array([0.0, 9.0])
    assert damped_step(matrix, rows, 0.0, room) == pytest.approx([0.0, 2.0])
    damped = damped_step(matrix, rows, 2.0, room)
    assert damped == pytest.approx([0.0, 1.0])  # 2 y + 2 y = 4


@pytest.mark.parametrize("steepest", [1.0, 1e7])
@pytest.mark.parametrize("half", [np.inf, 0.5, 0.02])
def test_a_step_of_many_unknowns_is_least_in_its_box(half: float, steepest: float) -> None:
    """Karush, Kuhn and Tucker: no slope along what is free, and none inward at an end."""
    generator = np.random.default_rng(7)
    matrix, rows = generator.standard_normal((260, 130)), 3.0 * generator.standard_normal(260)
    matrix[:, 0] *= steepest
    room = (np.full(130, -half), half * generator.uniform(0.5, 1.0, 130))
    step = damped_step(matrix, rows, 0.1, None if np.isinf(half) else room)
    assert np.all((step >= room[0]) & (step <= room[1]))
    low, high = step <= room[0] + 1e-12, step >= room[1] - 1e-12
    assert np.any(low | high) == np.isfinite(half)
    slope = matrix.T @ (rows + matrix @ step) + 0.1 * step
    slope /= np.linalg.norm(matrix, axis=0) * np.linalg.norm(rows)
    assert np.max(np.abs(slope[~(low | high)]), initial=0.0) < 1e-9
    assert np.all(slope[low] > -1e-9)
    assert np.all(slope[high] < 1e-9)
