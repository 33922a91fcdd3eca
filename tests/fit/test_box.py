"""The box as a cube, its minima and its twins: maps by hand, wells and symmetries known exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fitting.campaign.parameters import Parameter, to_model, to_search
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Evaluator, make_objective
from fitting.fit.search import Box, Minimum, along_edges, lowest, screened, search_box, worth
from fitting.fit.twins import find_twins
from fitting.text.arrays import FloatArray
from tests.support.datasets import dataset
from tests.support.rows import RowsResponse
from tests.support.whitened import SIGMA, parameter, whitened

PLAIN = parameter("plain", -2.0, 6.0, scale=2.0)
DECADES = parameter("decades", 1.0, 1000.0, scale=50.0)
NARROW = parameter("narrow", 1.0, 9.9)
TURNING = parameter("turning", 1.0, 8.0, period=3.0)
PRIOR = parameter("prior", 0.0, 1.0, prior=0.1, start=0.3, experiment="e1")
ALL = (PLAIN, DECADES, NARROW, TURNING, PRIOR)


def test_a_point_of_the_cube_by_hand() -> None:
    box = Box(ALL)
    p = np.array([4.0, 10.0, 9.9 - 0.25 * 8.9, 2.5, 0.7])
    x = to_search(ALL, p)
    cube = box.to_cube(x)
    assert cube == pytest.approx([0.75, 1.0 / 3.0, 0.75, 0.5, 0.7])
    back = to_model(ALL, box.from_cube(cube[:4]))
    assert back == pytest.approx([4.0, 10.0, 9.9 - 0.25 * 8.9, 2.5, 0.3])  # a prior: at its start
    assert to_model(ALL, box.from_cube(np.ones(4))) == pytest.approx([6.0, 1000.0, 9.9, 4.0, 0.3])
    ten = Box((parameter("ten", 1.0, 10.0),))  # a decade is spread in its logarithm
    assert to_model(ten.parameters, ten.from_cube(np.array([0.5])))[0] == pytest.approx(10**0.5)


def test_distances_go_the_short_way_round_and_leave_priors_out() -> None:
    box = Box(ALL)
    p = np.array([4.0, 10.0, 5.0, 1.2, 0.1])
    x = to_search(ALL, p)

    def apart(**moved: float) -> float:
        names = [each.name for each in ALL]
        q = p.copy()
        for name, value in moved.items():
            q[names.index(name)] = value
        return box.apart(x, to_search(ALL, q))

    assert apart() == 0.0
    assert apart(prior=0.9) == 0.0
    assert apart(turning=3.9) == pytest.approx(0.1)  # 2.7 of 3 forward is 0.3 back
    assert apart(turning=7.2) == pytest.approx(0.0, abs=1e-12)
    assert apart(turning=2.2, plain=5.0) == pytest.approx(1.0 / 3.0)
    assert apart(decades=100.0) == pytest.approx(1.0 / 3.0)
    narrow = Box((parameter("part", 0.0, 2.0, period=3.0),))  # less than a turn has two ends
    assert narrow.apart(np.array([-0.9]), np.array([0.9])) == pytest.approx(0.9)


@pytest.mark.parametrize("lower", [0.0, -0.1, -7.3, 1e3])
def test_a_box_of_one_turn_has_no_ends(lower: float) -> None:
    """Whatever rounding leaves of the turn between its bounds."""
    own = (parameter("turn", lower, lower + np.pi, period=np.pi),)
    first, last = (to_search(own, np.array([lower + share * np.pi])) for share in (0.05, 0.95))
    assert Box(own).apart(first, last) == pytest.approx(0.1)


def test_a_box_without_unknowns_has_no_points() -> None:
    assert Box((PRIOR,)).spread(4, 1) == []


# --- minima


def evaluator_of(
    rows: Callable[[FloatArray], FloatArray], *parameters: Parameter
) -> LikelihoodEvaluator:
    objective = whitened(rows, *parameters)
    size = objective.data.sigma.size
    return LikelihoodEvaluator(
        likelihood_of(objective, RowNoise(np.full(size, SIGMA), np.zeros((size, 0))))
    )


def wells(p: FloatArray) -> FloatArray:
    """Minima at x = -2 and 2 of chi^2 36 and 0, both at y = 1."""
    return np.array([4.0 * (p[0] ** 2 - 4.0), 1.5 * (p[0] - 2.0), 3.0 * (p[1] - 1.0), 0.0, 0.0])


TWO = (parameter("x", -6.0, 6.0), parameter("y", -6.0, 6.0))


def test_all_wells_are_found_the_lowest_first() -> None:
    evaluator = evaluator_of(wells, *TWO)
    (low, high), search = search_box(evaluator, [np.array([-3.0, 0.0])], 1, 10**6)
    assert low.x == pytest.approx([2.0, 1.0], abs=0.02)
    assert low.chi_square == pytest.approx(0.0, abs=2e-3)
    # beside the other the second row tilts the well: 16 (x^2 - 4) 2 x + 2.25 (x - 2) = 0 near -2
    assert high.x == pytest.approx([-1.965, 1.0], abs=0.02)
    assert high.chi_square == pytest.approx(wells(np.array([-1.965, 1.0])) @ wells(high.x), abs=0.3)
    assert search.explained
    assert (search.screened, search.screens) == (64, 1)  # noise explains it at once
    assert search.descents == low.descents + high.descents == 9
    assert search.evaluations == evaluator.evaluations
    assert lowest([low, high]) == [low]


def test_what_noise_does_not_explain_is_screened_on_to_the_budget() -> None:
    """A row of ten that nothing lowers. Each screen is as many points as there were before."""
    offset = lambda p: np.append(wells(p), 10.0)  # noqa: E731
    for budget, most in ((1, 1), (500, 4)):
        minima, search = search_box(evaluator_of(offset, *TWO), [], 1, budget)
        assert not search.explained
        assert min(budget, 2) <= search.screens <= most
        assert search.evaluations >= budget
        assert search.screened == 64 * 2 ** (search.screens - 1)
        assert search.descents == 8 * search.screens
        assert minima[0].chi_square == pytest.approx(100.0, abs=2e-3)


def test_boxes_of_more_parameters_are_screened_by_more_points() -> None:
    for count, points in ((3, 64), (4, 128)):
        own = [parameter(f"x{i}", -6.0, 6.0) for i in range(count)]
        evaluator = evaluator_of(lambda p: np.append(3.0 * (p - 1.0), np.zeros(2)), *own)
        minima, search = search_box(evaluator, [], 1, 10**6)
        assert search.explained
        assert search.screened == points
        assert len(minima) == 1


def test_a_line_finds_the_other_well_along_an_edge() -> None:
    """Through the well at (2, 1): along x the one near -2, the other edge has none."""
    evaluator = evaluator_of(wells, *TWO)
    [x], number = along_edges(evaluator, [np.array([2.0, 1.0])], 0.5)
    assert x == pytest.approx([-1.965, 1.0], abs=0.5 * 12.0 / 64.0)
    assert number == 2 * (64 + 1)
    points, number = along_edges(evaluator, [np.array([2.0, 1.0]), np.array([-1.965, 1.0])], 0.5)
    assert [p[0] > 0.0 for p in points] == [True, False]  # the better one first
    assert number == 2 * 2 * (64 + 1)


@pytest.mark.parametrize("centre", [-3.0, 0.55, 3.5])
def test_a_narrow_valley_below_what_noise_barely_explains_is_found(centre: float) -> None:
    """Chi square 18.5 on 12 degrees of freedom nearly everywhere (P = 0.10), 4 in a valley.

    It is there only where the other parameters are near their values, so that no points that fill
    the box meet it.
    """

    def rows(p: FloatArray) -> FloatArray:
        others = p[1:] - 1.0
        valley = np.exp(-0.5 * (((p[0] - centre) / 0.05) ** 2 + (others @ others) / 0.3**2))
        free = [np.sqrt(14.5) * (1.0 - valley)]
        return np.concatenate([free, 30.0 * others, np.ones(4), np.zeros(8)])

    own = [parameter(f"x{i}", -6.0, 6.0) for i in range(5)]
    minima, _ = search_box(evaluator_of(rows, *own), [np.array([5.0] + 4 * [1.0])], 1, 3300)
    assert minima[0].x == pytest.approx([centre] + 4 * [1.0], abs=0.1)
    assert minima[0].chi_square == pytest.approx(4.0, abs=0.1)


def test_without_unknowns_only_the_starts_are_let_down() -> None:
    evaluator = evaluator_of(lambda p: np.array([p[0] - 0.4, 0.0]), PRIOR)
    _, search = search_box(evaluator, [np.zeros(1)], 1, 10**6)
    assert (search.screened, search.screens, search.descents) == (0, 0, 1)


def test_the_points_to_descend_from_are_the_best_that_are_alone() -> None:
    """Ranked by sum ln(1 + row^2); of neighbours within half a spacing the better one."""
    evaluator = evaluator_of(wells, *TWO)
    box = Box(TWO)
    points = box.spread(64, 5)
    merits = [float(np.sum(np.log1p(wells(x) ** 2))) for x in points]
    order = sorted(range(64), key=lambda k: merits[k])
    near = 0.5 * 64**-0.5
    alone = [
        k
        for i, k in enumerate(order)
        if all(np.max(np.abs(points[k] - points[j])) / 12.0 > near for j in order[:i])
    ]
    found = screened(evaluator, 5)
    assert len(found) == 8
    wanted = [*alone, *(k for k in order if k not in alone)][:8]
    assert [f.tolist() for f in found] == [points[k].tolist() for k in wanted]
    assert alone[:8] != order[:8]  # it does matter
    further = screened(evaluator, 5, 64, skip=64)
    assert all(any(np.array_equal(f, x) for x in box.spread(128, 5)[64:]) for f in further)


@pytest.mark.parametrize(("chi_square", "counts"), [(0.0, 1.0), (99.0, 1.0), (250.0, 2.5)])
def test_a_difference_of_one_counts_or_of_a_hundredth(chi_square: float, counts: float) -> None:
    assert worth(chi_square) == counts

    def minimum(height: float) -> Minimum:
        return Minimum(x=np.zeros(1), start=np.zeros(1), chi_square=height)

    minima = [minimum(chi_square + step * counts) for step in (0.0, 0.99, 1.01)]
    assert lowest(minima) == minima[:2]
    assert lowest([]) == []


# --- twins


def twins_of(
    rows: Callable[[FloatArray], FloatArray], *parameters: Parameter
) -> list[tuple[list[int], list[float], list[float]]]:
    """Order, signs and shifts of every symmetry that is found."""
    size = rows(np.array([p.start for p in parameters])).size
    objective = make_objective(
        RowsResponse(rows), parameters, dataset(np.ones(size), np.full(size, SIGMA))
    )
    found = find_twins(Evaluator(objective), seed=1)
    return [(t.order.tolist(), t.signs.tolist(), t.shifts.tolist()) for t in found]


def test_exchanges_are_found_among_boxes_that_share_a_tenth() -> None:
    def rows(p: FloatArray) -> FloatArray:
        return np.array([p[0] + p[1], p[0] * p[1]])

    def box(lower: float, **told: Any) -> Parameter:
        return parameter("b", lower, lower + 10.0, **told)

    a = parameter("a", 0.0, 10.0)
    assert twins_of(rows, a, box(0.0)) == [([1, 0], [1.0, 1.0], [0.0, 0.0])]
    assert len(twins_of(rows, a, box(7.0))) == 1
    assert twins_of(rows, a, box(9.1)) == []
    assert twins_of(rows, a, box(0.0, unit="Hz")) == []
    assert twins_of(rows, a, box(0.0, prior=1.0)) == []


def test_all_orders_of_three_alike_are_found() -> None:
    own = [parameter(name, 0.0, 10.0) for name in "abc"]
    rows = lambda p: np.array([np.sum(p), np.sum(p**2), np.prod(p)])  # noqa: E731
    assert len(twins_of(rows, *own)) == 5
    two = lambda p: np.array([p[0] + p[2], p[0] * p[2], p[1]])  # noqa: E731
    assert twins_of(two, *own) == [([2, 1, 0], [1.0] * 3, [0.0] * 3)]


@pytest.mark.parametrize("harmonic", [1, 2, 4])
def test_fractions_of_a_turn_and_its_reversal(harmonic: int) -> None:
    """cos(k t) of a period of 8 is the same a k-th of it on, and reversed."""
    own = parameter("t", -4.0, 4.0, period=8.0)
    rows = lambda p: np.array([np.cos(2.0 * np.pi * harmonic * p[0] / 8.0), 1.0])  # noqa: E731
    found = {(s[0], t[0] % 8.0) for _, s, t in twins_of(rows, own)}
    turns = {8.0 * k / harmonic for k in range(harmonic)}
    assert found == {(s, t) for s in (1.0, -1.0) for t in turns} - {(1.0, 0.0)}


def test_a_sign_is_reversed_about_zero_and_an_angle_about_its_middle() -> None:
    even = lambda p: np.array([p[0] ** 2, 1.0])  # noqa: E731
    assert twins_of(even, parameter("a", -3.0, 3.0)) == [([0], [-1.0], [0.0])]
    assert twins_of(even, parameter("a", -3.0, 4.0)) == []
    about_two = lambda p: np.array([(p[0] - 2.0) ** 2, 1.0])  # noqa: E731
    assert twins_of(about_two, parameter("a", 1.0, 3.0, unit="rad")) == [([0], [-1.0], [4.0])]
    assert twins_of(about_two, parameter("a", 1.0, 3.0)) == []


def test_an_angle_without_a_period_is_turned_by_quarters() -> None:
    """cos^2 and sin^2 are exchanged a quarter turn on; its period of a half turn leads beyond."""
    angle = parameter("a", 0.2, 3.0, unit="rad")
    own = [parameter(name, 1.0, 10.0) for name in "bc"]

    def rows(p: FloatArray) -> FloatArray:
        c, s = np.cos(p[0]), np.sin(p[0])
        return np.array([c * c * p[1] + s * s * p[2], s * c * (p[1] - p[2]), p[1] + p[2]])

    half = 0.5 * np.pi
    found = twins_of(rows, angle, *own)
    assert [(order, signs) for order, signs, _ in found] == [([0, 2, 1], [1.0] * 3)] * 2
    assert sorted(shifts[0] for _, _, shifts in found) == pytest.approx([-half, half])
    wide = twins_of(rows, parameter("a", -4.0, 4.0, unit="rad"), *own)
    turns = {round(shifts[0] / half) for order, _, shifts in wide if order == [0, 1, 2]}
    assert turns == {-4, -2, 2, 4}


def test_rows_that_differ_by_more_than_rounding_are_no_twin() -> None:
    own = parameter("a", -3.0, 3.0)
    for off, found in ((1e-11, 1), (1e-7, 0)):
        rows = lambda p, e=off: np.array([p[0] ** 2 + e * p[0], 1.0])  # noqa: E731
        assert len(twins_of(rows, own)) == found
    # at one place of the box only: a bump that most points do not see is no symmetry either
    bump = lambda p: np.array([p[0] ** 2 + max(0.0, p[0] - 1.0), 1.0])  # noqa: E731
    assert twins_of(bump, own) == []


def test_of_more_orders_than_are_tried_exchanges_in_pairs_come_first() -> None:
    """Five alike have 120 orders, six have 720, of which 75 exchange one, two or three pairs."""
    rows = lambda p: np.array([np.sum(p), np.sum(p**2)])  # noqa: E731
    five = [parameter(f"x{i}", 1.0, 10.0) for i in range(5)]
    six = [*five, parameter("x5", 1.0, 10.0)]
    assert len(twins_of(rows, *five)) == 119
    found = [tuple(order) for order, _, _ in twins_of(rows, *six)]
    pairs = {order for order in found if all(order[order[i]] == i for i in range(6))}
    assert (len(found), len(set(found)), len(pairs)) == (127, 127, 75)


def test_modes_relabelled_are_found_where_every_box_overlaps_every_other() -> None:
    """An angle's eight turns with 24 orders of four values of one unit are more than are tried."""
    own = [parameter(name, 1.0, 10.0) for name in ("d1", "d2", "f1", "f2")]
    angle = parameter("theta", 0.0, np.pi, period=np.pi)

    def rows(p: FloatArray) -> FloatArray:
        c, s = np.cos(p[4]) ** 2, np.sin(p[4]) ** 2
        lines = np.array([p[2] - 1j * (c * p[0] + s * p[1]), p[3] - 1j * (s * p[0] + c * p[1])])
        poles = [np.sum(1.0 / (lines - u)) for u in (2.0, 3.0, 5.0, 8.0)]
        return np.concatenate([np.real(poles), np.imag(poles)])

    found = [order for order, _, _ in twins_of(rows, *own, angle)]
    assert {tuple(order[:4]) for order in found} == {
        (0, 1, 2, 3),  # the angle reversed
        (1, 0, 2, 3),  # a quarter of a turn on, the damped ones exchanged
        (0, 1, 3, 2),  # the lines exchanged
        (1, 0, 3, 2),
    }


def test_turns_are_tried_up_to_a_hundred_and_twenty_eight_and_not_some_of_more() -> None:
    """Eight of each parameter that goes round, two of one about zero: 8 x 8 x 2, then 8^3."""
    angles = [parameter(name, -4.0, 4.0, period=8.0) for name in "stu"]
    rows = lambda p: np.append(np.cos(np.pi * p), 1.0)  # noqa: E731
    about_zero = parameter("a", -3.0, 3.0)
    even = lambda p: np.append(np.cos(np.pi * p[:2]), p[2] ** 2)  # noqa: E731
    assert len(twins_of(even, *angles[:2], about_zero)) == 127
    assert twins_of(rows, *angles) == []
