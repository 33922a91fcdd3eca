"""Steps off planes of symmetry by hand: where rows are even, finite steps see what is there."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.fit.fit import secants
from fitting.fit.objective import Evaluator
from fitting.text.arrays import FloatArray
from tests.support.rows import rows_evaluator


def even_about(place: float, lower: float, upper: float) -> Evaluator:
    """Rows (x - place)^2 and y."""
    return rows_evaluator(
        lambda p: np.array([(p[0] - place) ** 2, p[1]]), [lower, -9.0], [upper, 9.0]
    )


def at(evaluator: Evaluator, x: float) -> tuple[list[int], FloatArray, FloatArray]:
    """Columns with a secant at (x, 1), the secant along x and where it was taken to."""
    place = np.array([x, 1.0])
    matrix = evaluator.jacobian(place)
    changed, points = secants(evaluator, place, matrix)
    assert changed[:, 1] == pytest.approx([0.0, 1.0])
    return list(points), changed[:, 0], points.get(0, place)


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
@pytest.mark.parametrize("room", [0.02, 0.08])
def test_the_longer_step_counts_where_a_side_has_little_room(side: float, room: float) -> None:
    """Symmetric about 3 or -3, where the box ends soon."""
    place = 3.0 * side
    lower, upper = sorted((place + room * side, -9.0 * side))
    evaluator = even_about(place, lower, upper)
    flat, column, end = at(evaluator, place)
    assert flat == [0]
    assert column == pytest.approx([-0.1 * side, 0.0])
    assert end == pytest.approx([place - 0.1 * side, 1.0])
