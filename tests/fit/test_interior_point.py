"""Regularised problems whose minima are known by hand: what is found, and what is said of it."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fitting.fit.objective import j_reg
from fitting.fit.solver.evaluator import Evaluator, total
from fitting.fit.solver.interior_point import (
    Solve,
    SolveSettings,
    along_the_valley,
    crept,
    finish,
    inside,
    quick_settings,
    solve,
    to_the_last_digits,
)
from fitting.text.arrays import FloatArray
from fitting.text.choices import MISFITS
from tests.support.rows import bent_at, rows_evaluator

B = np.array([1.0, 2.0, 10.0])


def three(lower: float = -9.0, upper: float = 9.0) -> Evaluator:
    """Rows x - 1, x - 2, x - 10."""
    return rows_evaluator(lambda p: p[0] - B, [lower], [upper])


def solved(evaluator: Evaluator, start: float, nu: float, settings: SolveSettings) -> Solve:
    return solve(evaluator, np.array([start]), nu, settings, np.random.default_rng(1))


def exact(misfit: str, nu: float) -> float:
    """The minimum in closed form."""
    if misfit == "squares":  # 2 sum (x - b) + nu x = 0
        return 2.0 * float(np.sum(B)) / (6.0 + nu)
    # between kinks nu x is the number of rows above less those below
    return {0.0: 2.0, 0.5: 2.0, 0.8: 1.25, 4.0: 0.75}[nu]


@pytest.mark.parametrize("misfit", MISFITS)
@pytest.mark.parametrize("nu", [0.0, 0.5, 0.8, 4.0])
def test_the_minimum_is_that_of_the_closed_form(misfit: str, nu: float) -> None:
    evaluator = three()
    settings = SolveSettings(misfit=misfit, absolute=1e-6, relative=0.0, iterations=100, restarts=2)
    found = solved(evaluator, -5.0, nu, settings)
    x = np.array([exact(misfit, nu)])
    least = total(evaluator.point(x), nu, misfit)
    reached = total(evaluator.point(found.x), nu, misfit)
    assert reached <= least + (1e-6 if misfit != "absolute" else 1e-2)
    assert reached >= least - 1e-12
    assert 0 < found.iterations <= 300
    if misfit != "absolute":
        assert found.status == "optimal"
        assert found.optimality <= 1e-6
        assert found.x == pytest.approx(x, abs=1e-2)


@pytest.mark.parametrize("misfit", MISFITS)
@pytest.mark.parametrize(("upper", "x"), [(0.9, 0.9), (1.5, 1.5)])
def test_a_bound_that_is_met_holds(misfit: str, upper: float, x: float) -> None:
    found = solved(three(upper=upper), -1.0, 0.0, SolveSettings(misfit=misfit, iterations=100))
    assert found.x[0] <= upper
    assert found.x == pytest.approx([x], abs=2e-3)


@pytest.mark.parametrize(
    ("lower", "upper", "wanted"),
    [
        ((0.0, 0.0), (4.0, 0.1), (1e-3, 1e-4)),  # a thousandth of the box, at most of a unit
        ((-9.0, -9.0), (-1.0, -5.0), (-1.001, -5.001)),
        ((-9.0, -9.0), (9.0, 9.0), (0.0, 0.0)),
    ],
)
def test_a_start_on_a_bound_is_moved_inside(
    lower: tuple[float, ...], upper: tuple[float, ...], wanted: tuple[float, ...]
) -> None:
    found = inside(np.zeros(2), np.array(lower), np.array(upper))
    assert found == pytest.approx(wanted, rel=1e-12)


def one_row_and_a_constant(constant: float) -> Callable[[FloatArray], FloatArray]:
    return lambda p: np.array([p[0] - 1.0, constant])


@pytest.mark.parametrize(
    ("settings", "least"),
    [
        (SolveSettings(absolute=0.3, relative=0.0), 0.3),
        # 1 - x <= 0.1 + 0.1 (1 - x + 2)
        (SolveSettings(absolute=0.1, relative=0.1), 1.0 / 3.0),
        # (1 - x)^2 <= 0.1^2 + 0.1 ((1 - x)^2 + 4): squares have another dimension
        (SolveSettings(misfit="squares", absolute=0.1, relative=1.0), (0.41 / 0.9) ** 0.5),
        (SolveSettings(misfit="squares", absolute=0.2, relative=0.0), 0.2),
    ],
)
def test_a_start_that_promises_less_than_the_tolerance_is_optimal(
    settings: SolveSettings, least: float
) -> None:
    """Rows x - 1 and 2: what is left to gain is 1 - x, or its square."""
    evaluator = rows_evaluator(one_row_and_a_constant(2.0), [-9.0], [9.0])
    near = solved(evaluator, 1.0 - 0.99 * least, 0.0, settings)
    assert (near.status, near.iterations, near.steps) == ("optimal", 0, 0)
    assert near.x[0] == 1.0 - 0.99 * least
    square = 2 if settings.misfit == "squares" else 1
    assert near.optimality == pytest.approx((0.99 * least) ** square, rel=1e-6)
    far = solved(evaluator, 1.0 - 1.01 * least, 0.0, settings)
    assert far.iterations > 0


def test_a_maximum_by_symmetry_is_no_start_that_is_optimal() -> None:
    """cos x + 2 is even: its slope at zero promises nothing, a step to the side does."""
    evaluator = rows_evaluator(lambda p: np.array([2.0 + np.cos(p[0])]), [-3.5], [3.5])
    found = solved(evaluator, 0.0, 0.0, SolveSettings())
    assert abs(found.x[0]) == pytest.approx(np.pi, abs=0.05)
    assert found.status == "optimal"


def test_iterations_are_at_most_as_many_as_wanted() -> None:
    """A run and its one restart."""
    settings = SolveSettings(misfit="absolute", absolute=0.0, relative=0.0, iterations=3)
    found = solved(three(), -5.0, 0.5, replace(settings, restarts=0))
    assert found.iterations == 3
    assert found.status == "stalled"
    assert found.message.startswith("interior point: ")
    begun = total(three().point(np.array([-5.0])), 0.5, "absolute")
    assert total(three().point(found.x), 0.5, "absolute") < begun


def test_further_tries_never_make_it_worse_and_are_the_same_for_one_seed() -> None:
    settings = SolveSettings(misfit="absolute", absolute=0.0, relative=0.0, iterations=4)
    values = []
    for restarts in range(4):
        ends = [solved(three(), -5.0, 0.5, replace(settings, restarts=restarts)) for _ in range(2)]
        assert np.array_equal(ends[0].x, ends[1].x)
        values.append(total(three().point(ends[0].x), 0.5, "absolute"))
    assert values == sorted(values, reverse=True)
    assert values[3] < values[0]


def test_a_solve_that_lowers_nothing_ends_at_its_start() -> None:
    """A row whose slope is false at its kink promises a decrease that nobody gets."""
    evaluator = rows_evaluator(lambda p: np.array([bent_at(p[0])]), [-9.0], [9.0])
    for misfit in ("slack", "squares"):
        settings = SolveSettings(misfit=misfit, absolute=1e-9, relative=0.0, restarts=0)
        found = solved(evaluator, 0.0, 0.0, settings)
        assert found.status == "stalled"
        assert found.x[0] == 0.0
        assert "interior point" in found.message
        assert found.optimality > 0.1


@pytest.mark.parametrize(("half", "size"), [(9.0, 1.0), (0.05, 0.1)])
def test_a_further_try_begins_beside_the_end_of_the_first(half: float, size: float) -> None:
    """Within some fiftieths of the box, or of a unit: it is another try of the same minimum."""
    asked: list[list[float]] = []

    def rows(p: FloatArray) -> FloatArray:
        asked[-1].append(float(p[0]))
        return np.asarray(p[0] / half - B)

    settings = SolveSettings(misfit="absolute", absolute=0.0, relative=0.0, iterations=3)
    ends = []
    for restarts in (0, 1):
        asked.append([])
        evaluator = rows_evaluator(rows, [-half], [half], step=1e-4 * size)
        ends.append(solved(evaluator, -0.5 * half, 0.5, replace(settings, restarts=restarts)))
    first, both = asked
    assert both[: len(first)] == first
    assert 0.0 < abs(both[len(first)] - ends[0].x[0]) < 5.0 * 0.02 * size


@pytest.mark.parametrize("misfit", ["slack", "squares"])
def test_a_finish_near_the_minimum_takes_linearised_steps_only(misfit: str) -> None:
    evaluator = three()
    settings = SolveSettings(misfit=misfit, absolute=1e-8, relative=0.0)
    x = exact(misfit, 0.5)
    end = finish(evaluator, np.array([x - 0.05]), 0.5, settings, np.random.default_rng(1))
    assert end.status == "optimal"
    assert end.iterations == 0
    assert end.steps >= 1
    assert end.message.startswith(f"{end.steps} ")
    assert "promises" in end.message
    assert end.x == pytest.approx([x], abs=1e-3)
    assert end.optimality <= 1e-8


def test_a_finish_that_steps_cannot_do_is_solved() -> None:
    evaluator = three()
    absolute = SolveSettings(misfit="absolute", absolute=1e-3, relative=0.0)
    generator = np.random.default_rng(1)
    assert finish(evaluator, np.array([1.0]), 0.5, absolute, generator).iterations > 0
    # a valley that forty steps do not follow to its end
    bent = rows_evaluator(lambda p: np.array([bent_at(p[0])]), [-9.0], [9.0])
    slack = SolveSettings(absolute=1e-9, relative=0.0, restarts=0)
    assert finish(bent, np.zeros(1), 0.0, slack, generator).iterations > 0


@pytest.mark.parametrize("misfit", ["slack", "squares"])
def test_the_last_digits_are_those_of_a_hundred_millionth(misfit: str) -> None:
    evaluator, x = three(), exact(misfit, 0.8)
    settings = SolveSettings(misfit=misfit)
    rough = Solve(
        x=np.array([x - 0.01]),
        optimality=1.0,
        status="stalled",
        message="rough",
        iterations=7,
        steps=2,
    )
    found = to_the_last_digits(evaluator, rough, 0.8, settings)
    if misfit == "slack":  # between two corners, where linearised steps creep
        assert crept(found.optimality, total(evaluator.point(found.x), 0.8, misfit), misfit)
        found = along_the_valley(evaluator, found, 0.8, settings)
    least = total(evaluator.point(np.array([x])), 0.8, misfit)
    assert total(evaluator.point(found.x), 0.8, misfit) <= least * (1.0 + 1e-8)
    assert found.optimality <= 1e-8 * total(evaluator.point(rough.x), 0.8, misfit)
    assert (found.status, found.iterations) == ("optimal", 7)
    assert found.steps > 2
    said = found.message.split("; ")
    assert said[0] == "rough"
    assert "last digits" in said[1]
    assert ["valley" in words for words in said[2:]] == [True] * (misfit == "slack")
    assert not crept(found.optimality, least, misfit)
    again = to_the_last_digits(evaluator, found, 0.8, settings)
    assert again is found
    other = replace(settings, misfit="absolute")
    assert to_the_last_digits(evaluator, rough, 0.8, other) is rough


def test_the_last_digits_go_along_a_valley_as_far_as_it_goes() -> None:
    """900 units of y, along which J falls by a hundredth: steps of 0.1 times 3, 9, ... 3^8.

    Steps of at most a unit, which a solve before the last takes, would be more than 900.
    """
    evaluator = rows_evaluator(
        lambda p: np.array([p[0] - 1e-3 * p[1], 1e-5 * (p[1] - 900.0), 1.0]),
        [-9.0, -2000.0],
        [9.0, 2000.0],
    )
    rough = Solve(
        x=np.zeros(2), optimality=1.0, status="optimal", message="", iterations=0, steps=0
    )
    found = to_the_last_digits(evaluator, rough, 0.0, SolveSettings())
    assert found.x == pytest.approx([0.9, 900.0])
    assert found.steps == 9


@pytest.mark.parametrize(("lower_by", "goes_on"), [(2.9e-3, True), (3.1e-3, False)])
def test_last_digits_are_left_where_three_units_of_their_promise_lie_above_what_is_known(
    lower_by: float, goes_on: bool
) -> None:
    """J falls by 1e-3 a unit of y; the end that is known is lower by nearly or over three."""
    evaluator = rows_evaluator(lambda p: np.array([1e-3 * (p[0] - 50.0), 1.0]), [-90.0], [90.0])
    rough = Solve(
        x=np.zeros(1), optimality=1e-3, status="optimal", message="", iterations=0, steps=0
    )
    j = total(evaluator.point(rough.x), 0.0, "slack")
    counted = evaluator.counts.evaluations
    found = to_the_last_digits(evaluator, rough, 0.0, SolveSettings(), j - lower_by)
    assert (found is not rough) == goes_on
    assert (evaluator.counts.evaluations > counted) == goes_on


def test_last_digits_that_are_not_reached_leave_the_status() -> None:
    """A row 60,000 units away: sixty steps come to 984, the sum of nine, and 51 times 1000."""
    evaluator = rows_evaluator(lambda p: p - 6e4, [-9e4], [9e4])
    rough = Solve(
        x=np.zeros(1), optimality=1.0, status="stalled", message="rough", iterations=0, steps=0
    )
    found = to_the_last_digits(evaluator, rough, 0.0, SolveSettings())
    assert found.status == "stalled"
    assert found.steps == 60
    assert found.message.startswith("rough; 60 ")
    assert "enough" in found.message
    assert found.x == pytest.approx([51984.1])
    assert found.optimality == pytest.approx(1.0)


def test_a_quick_solve_is_looser_in_everything() -> None:
    own, quick = SolveSettings(misfit="squares"), quick_settings(SolveSettings(misfit="squares"))
    assert quick.misfit == own.misfit
    assert quick.absolute > own.absolute
    assert quick.relative > own.relative
    assert quick.iterations < own.iterations
    assert quick.restarts < own.restarts


def test_the_tikhonov_term_is_half_its_weights() -> None:
    x = np.array([1.0, -2.0])
    assert j_reg(x, 0.5) == 1.25
    assert j_reg(x, np.array([1.0, 3.0])) == 6.5
    evaluator = rows_evaluator(lambda p: p - np.array([2.0, 2.0]), [-9.0] * 2, [9.0] * 2)
    point = evaluator.point(x)
    assert total(point, 0.5, "slack") == total(point, 0.5, "absolute") == 5.0 + 1.25
    assert total(point, 0.5, "squares") == 17.0 + 1.25


def test_points_are_remembered_and_counted() -> None:
    """A point and a Jacobian cost once; the ninth point pushes out the first."""
    evaluator = three()
    xs = [np.array([0.1 * k]) for k in range(9)]
    for _ in range(2):
        for x in xs[:8]:
            evaluator.point(x)
    assert evaluator.counts.evaluations == evaluator.counts.runs == 8
    evaluator.point(xs[8])
    evaluator.point(xs[1])
    assert evaluator.counts.evaluations == 9
    evaluator.point(xs[0])
    assert evaluator.counts.evaluations == 10
    for _ in range(2):
        assert evaluator.jacobian(xs[3]) == pytest.approx(np.ones((3, 1)), rel=1e-9)
    assert (evaluator.counts.evaluations, evaluator.counts.jacobians) == (12, 1)
    evaluator.points(xs[:4])
    assert evaluator.counts.evaluations == 16
    evaluator.whole([xs[2]])
    evaluator.point(xs[2])
    assert evaluator.counts.evaluations == 17


def test_thousands_of_rows_are_lowered_without_a_matrix_of_all_pairs() -> None:
    """The sum of |x - b| is least at the median; a slack for each, squared, would be 72 MB."""
    b = np.random.default_rng(3).normal(4.0, 1.0, 3001)
    evaluator = rows_evaluator(lambda p: p[0] - b, [-9.0], [9.0])
    settings = SolveSettings(absolute=1e-6, relative=0.0)
    tracemalloc.start()
    try:
        found = solved(evaluator, 0.0, 0.0, settings)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert found.status == "optimal"
    assert found.x[0] == pytest.approx(float(np.median(b)), abs=1e-6)
    assert most < 20e6
