"""Steps off planes of symmetry by hand: where rows are even, finite steps see what is there."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.fit.solver.evaluator import Evaluator
from fitting.fit.solver.symmetry import flat_columns, off_symmetry, secants
from fitting.text.arrays import FloatArray
from tests.support.rows import rows_evaluator


def even_about(place: float, lower: float, upper: float) -> Evaluator:
    """Rows (x - place)^2 and y."""
    return rows_evaluator(
        lambda p: np.array([(p[0] - place) ** 2, p[1]]), [lower, -9.0], [upper, 9.0]
    )


def at(evaluator: Evaluator, x: float) -> tuple[list[int], FloatArray, FloatArray]:
    """Flat columns at (x, 1), the secant along x and where it was taken to."""
    place = np.array([x, 1.0])
    matrix = evaluator.jacobian(place)
    changed, points = secants(evaluator, place, matrix)
    assert changed[:, 1] == pytest.approx([0.0, 1.0])
    return flat_columns(evaluator, place), changed[:, 0], points.get(0, place)


@pytest.mark.parametrize("place", [0.0, 2.5, -0.05, -4.0])
@pytest.mark.parametrize(
    ("width", "stride"),
    [(18.0, 0.1), (1.5, 0.1), (0.4, 0.04)],  # a tenth of the box, at most of one unit
)
def test_a_step_off_a_plane_is_a_tenth_of_the_box_or_of_a_unit(
    place: float, width: float, stride: float
) -> None:
    """h^2/h = h to either side."""
    evaluator = even_about(place, place - 0.5 * width, place + 0.5 * width)
    flat, column, end = at(evaluator, place)
    assert flat == [0]
    assert np.abs(column) == pytest.approx([stride, 0.0])
    assert abs(end[0] - place) == pytest.approx(stride)
    assert end[1] == 1.0
    assert at(evaluator, place + 0.2 * width)[0] == []  # no plane of symmetry


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("room", "goes"), [(0.02, False), (0.08, True)])
def test_a_side_with_little_room_is_left_out(side: float, room: float, goes: bool) -> None:
    """Symmetric about 3 or -3, where the box ends soon: of a step of 0.1 half has to fit."""
    place = 3.0 * side
    lower, upper = sorted((place + room * side, -9.0 * side))
    evaluator = even_about(place, lower, upper)
    flat, column, end = at(evaluator, place)
    assert flat == [0]
    assert column == pytest.approx([-0.1 * side, 0.0])
    assert end == pytest.approx([place - 0.1 * side, 1.0])
    found = off_symmetry(evaluator, np.array([place, 1.0]), lambda x: -side * x[0], -3.0)
    assert (found is not None) is goes
    if found is not None:
        assert found == pytest.approx([place + room * side, 1.0])


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("place", [0.0, -0.05, 0.05])
def test_of_both_sides_the_lower_one_counts_if_it_is_low_enough(side: float, place: float) -> None:
    evaluator = even_about(place, -9.0, 9.0)
    x = np.array([place, 1.0])

    def value(point: FloatArray) -> float:
        """Falls to one side and half as far to the other."""
        off = side * (point[0] - place)
        return float(-off if off > 0.0 else 0.5 * off)

    found = off_symmetry(evaluator, x, value, 0.0)
    assert found is not None
    assert found == pytest.approx([place + 0.1 * side, 1.0])
    assert off_symmetry(evaluator, x, value, -0.11) is None
    assert off_symmetry(evaluator, np.array([place + 1.0, 1.0]), value, 9.0) is None
