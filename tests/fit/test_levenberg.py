"""Searches over chi square against minima in closed form: where they end, and what they report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from fitting.campaign.parameters import to_model, to_search
from fitting.fit.levenberg import (
    ITERATIONS,
    UNCONSTRAINED,
    Constraint,
    Descent,
    Expansion,
    Goal,
    expand,
    minimise,
)
from fitting.fit.likelihood import Exhausted, LikelihoodEvaluator, Request, Sample
from fitting.text.arrays import FloatArray
from tests.support.whitened import evaluator_of, in_box, parameter, whitened

Rows = Callable[[FloatArray], FloatArray]


def begun(evaluator: LikelihoodEvaluator, x: FloatArray) -> Expansion:
    [here] = expand(evaluator, [x])
    return here


def let_down(
    evaluator: LikelihoodEvaluator,
    *x: float,
    constraint: Constraint = UNCONSTRAINED,
    **goal: Any,
) -> Descent:
    """Where a search from x ends."""
    [end] = minimise(evaluator, [begun(evaluator, np.array(x))], [constraint], Goal(**goal))
    return end


def rosenbrock(p: FloatArray) -> FloatArray:
    return np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])


def wider_valley(p: FloatArray) -> FloatArray:
    return np.array([2.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])


def test_a_point_with_its_slopes() -> None:
    """Rows x0^2 and x1, an output 3 x0 x1: all of it by hand."""
    evaluator = in_box(
        lambda p: np.array([p[0] ** 2, p[1]]), 2, product=lambda p: 3.0 * p[0] * p[1]
    )
    here = begun(evaluator, np.array([2.0, -1.0]))
    assert here.chi_square == pytest.approx(17.0)
    assert here.matrix[:2] == pytest.approx(np.array([[4.0, 0.0], [0.0, 1.0]]), abs=1e-2)
    assert here.outward == pytest.approx(np.array([[-3.0, 6.0]]), rel=1e-6)
    assert here.sample.outputs == pytest.approx([-6.0])


@pytest.mark.parametrize(("low", "high"), [(-10.0, 2.0), (2.0, 10.0)])
def test_slopes_are_taken_to_the_side_where_the_model_answers(low: float, high: float) -> None:
    """About x1 = 2 it answers on one side alone."""
    here = begun(in_box(answered(low, high), 2), np.array([0.0, 2.0]))
    slopes = np.array([[10.0, 0.0], [0.0, 5.0]])
    assert here.matrix[:2] == pytest.approx(slopes, rel=1e-6, abs=1e-6)
    assert here.chi_square == pytest.approx(0.0, abs=1e-12)


def test_a_point_about_which_the_model_answers_on_no_side_fits_nothing() -> None:
    assert begun(in_box(answered(2.0, 2.0), 2), np.array([0.0, 2.0])).chi_square == math.inf


def answered(low: float, high: float) -> Rows:
    """Rows 10 x0 and 5 x1 - 10 for x1 about nought and between two values."""

    def rows(p: FloatArray) -> FloatArray:
        is_answered = abs(p[1]) < 0.5 or low <= p[1] <= high
        return np.array([10.0 * p[0], 5.0 * p[1] - 10.0]) if is_answered else np.full(2, np.nan)

    return rows


def test_straight_rows_end_at_the_normal_equations() -> None:
    generator = np.random.default_rng(2)
    matrix, target = generator.standard_normal((6, 3)), generator.standard_normal(6)
    end = let_down(in_box(lambda p: matrix @ p - target, 3), 4.0, -3.0, 2.0)
    wanted, squares = np.linalg.lstsq(matrix, target, rcond=None)[:2]
    assert end.reached
    assert end.end.x == pytest.approx(wanted, abs=0.02)
    assert squares[0] - 1e-6 <= end.chi_square <= squares[0] + 2e-3


def test_searches_side_by_side_end_where_each_of_them_does_alone() -> None:
    """A double well from both sides, and held at two values, in one call; rows of their own."""
    rows = lambda p: np.array([p[0] ** 2 - 4.0, 0.5 * (p[1] - p[0])])  # noqa: E731
    places = [(-3.0, 0.0), (3.0, 1.0), (0.5, 0.5), (1.0, 1.0)]
    held = [UNCONSTRAINED, UNCONSTRAINED, Constraint(target=1.5, index=1), UNCONSTRAINED]
    evaluator = in_box(rows, 2)
    begins = expand(evaluator, [np.array(place) for place in places])
    together = minimise(evaluator, begins, held)
    alone = [let_down(in_box(rows, 2), *p, constraint=c) for p, c in zip(places, held, strict=True)]
    assert [end.end.x.tolist() for end in together] == [end.end.x.tolist() for end in alone]
    assert [end.end.x[0] for end in together[:2]] == pytest.approx([-2.0, 2.0], abs=0.02)


@pytest.mark.parametrize(("gain", "moves"), [(1.9e-3, False), (2.1e-3, True)])
def test_a_step_that_promises_a_five_hundredth_of_chi_square_is_taken(
    gain: float, moves: bool
) -> None:
    """A row 100 (x - 1): a gain is its square."""
    evaluator = in_box(lambda p: np.array([100.0 * (p[0] - 1.0), 5.0]), 1)
    x = 1.0 - gain**0.5 / 100.0
    end = let_down(evaluator, x)
    assert end.reached
    assert bool(end.end.x[0] != x) is moves
    wider = let_down(evaluator, x, promise=1.5 * gain)
    assert wider.reached
    assert wider.end.x[0] == x


def test_what_the_data_do_not_see_stays_where_it_began() -> None:
    end = let_down(in_box(lambda p: np.array([p[0] + p[1] - 4.0, 0.0]), 3), 0.0, 0.0, 7.0)
    assert end.end.x == pytest.approx([2.0, 2.0, 7.0], abs=0.03)


def test_what_the_data_hardly_see_is_not_walked_while_others_take_their_steps() -> None:
    """A row x^2, whose zero is halved by each step, and 1e-3 (z - 9): all of z gains 8e-5.

    A step across the box of 20 costs 0.1 of chi square: z goes 0.4 per cent of its way in each.
    """
    end = let_down(in_box(lambda p: np.array([p[0] ** 2, 1e-3 * (p[1] - 9.0)]), 2), 8.0, 0.0)
    assert end.reached
    assert abs(end.end.x[0]) < 0.4
    assert 0.0 <= end.end.x[1] < 0.5


def test_a_bound_holds_what_the_data_push_against_it() -> None:
    end = let_down(in_box(lambda p: np.array([p[0] - 14.0, p[1] + p[0]]), 2), 0.0, 0.0)
    assert end.reached
    assert end.end.x == pytest.approx([10.0, -10.0], abs=0.03)
    assert end.chi_square == pytest.approx(16.0, abs=2e-3)


class Recorded(LikelihoodEvaluator):
    """Keeps the search vectors that are asked for."""

    def __call__(self, requests: Sequence[Request]) -> list[list[Sample]]:
        self.asked = [*getattr(self, "asked", []), *(x for r in requests for x in r.xs)]
        return super().__call__(requests)


def test_a_quarter_of_a_period_is_the_longest_step() -> None:
    """From -4 to 3 of a row a - 3, by steps of two."""
    turning = parameter("a", 0.0, 8.0, period=8.0)
    plain = evaluator_of(whitened(lambda p: np.array([p[0] - 7.0, 0.0]), turning))
    evaluator = Recorded(plain.likelihood)
    end = let_down(evaluator, -4.0)
    assert end.reached
    assert end.end.x[0] == pytest.approx(3.0, abs=0.05)
    assert np.max(np.abs(np.diff([float(x[0]) for x in evaluator.asked]))) == pytest.approx(
        2.0, abs=1e-4
    )


def test_a_parameter_is_held_at_its_target_while_the_others_follow() -> None:
    """chi^2 = (x + y - 3)^2 + 4 (y - 1)^2: at x = t least for y = 1 + (2 - t)/5."""
    evaluator = in_box(lambda p: np.array([p[0] + p[1] - 3.0, 2.0 * (p[1] - 1.0)]), 2)
    for target in (-4.0, 2.0, 6.5):
        end = let_down(evaluator, 0.0, 0.0, constraint=Constraint(target=target, index=0))
        assert end.reached
        assert end.end.x[0] == pytest.approx(target, abs=1e-12)
        assert end.end.x[1] == pytest.approx(1.0 + (2.0 - target) / 5.0, abs=0.03)
        assert end.chi_square == pytest.approx(0.8 * (target - 2.0) ** 2, abs=2e-3)


def test_a_frozen_axis_stays() -> None:
    evaluator = in_box(lambda p: np.array([p[0] - 3.0, p[1] - 2.0]), 2)
    end = let_down(evaluator, 0.0, 0.5, constraint=Constraint(frozen=(1,)))
    assert end.end.x == pytest.approx([3.0, 0.5], abs=0.05)
    assert end.end.x[1] == 0.5


def test_a_held_parameter_in_a_curved_valley_ends_on_the_profile() -> None:
    """The free step leaves the valley y = x^2 by 9 times 10: it is tried again, held back."""
    constraint = Constraint(target=3.0, index=0)
    end = let_down(in_box(rosenbrock, 2), 0.0, 0.0, constraint=constraint)
    assert end.reached
    assert end.end.x == pytest.approx([3.0, 9.0], abs=0.01)
    assert end.chi_square == pytest.approx(4.0, abs=2e-3)


@pytest.mark.parametrize("weight", [0.3, 2.0])
def test_an_output_is_held_by_its_weight(weight: float) -> None:
    """(x - 2)^2 + w^2 (3 x - 12)^2 is least at x = (2 + 36 w^2)/(1 + 9 w^2)."""
    evaluator = in_box(lambda p: np.array([p[0] - 2.0, 0.0]), 1, triple=lambda p: 3.0 * p[0])
    held = Constraint(target=12.0, output=0, weight=weight)
    end = let_down(evaluator, 0.0, constraint=held)
    x = (2.0 + 36.0 * weight**2) / (1.0 + 9.0 * weight**2)
    assert end.reached
    assert end.end.x == pytest.approx([x], abs=0.05)
    assert held.residual(end.end.sample) == pytest.approx(weight * (3.0 * end.end.x[0] - 12.0))
    assert Constraint(target=12.0, index=0).residual(end.end.sample) == 0.0


def test_a_step_that_gains_next_to_nothing_of_much_that_it_promised_ends_nothing() -> None:
    """A row of slope -1, four times as steep beyond a kink: 0.03 is promised, 0.001 is gained.

    From there the next step, along the steeper slope, leads to zero.
    """
    first, then = 0.03**0.5, 0.029**0.5
    kink = first - then / 3.0

    def row(x: float) -> float:
        return float(first - x - 3.0 * max(0.0, x - kink))

    assert row(first) == pytest.approx(-then)
    end = let_down(in_box(lambda p: np.array([row(float(p[0])), 0.0]), 1), 0.0)
    assert end.reached
    assert end.chi_square < 2e-3


def test_chi_square_that_is_low_enough_ends_a_search() -> None:
    """A row x^2, whose zero is halved by each step, and 16 times lower its square."""
    evaluator = in_box(lambda p: np.array([p[0] ** 2, 0.0]), 1)
    whole = let_down(evaluator, 8.0)
    short = let_down(evaluator, 8.0, enough=4.0)
    assert short.reached
    assert whole.chi_square < 2e-3 < short.chi_square <= 4.0


def test_a_search_that_thirty_steps_do_not_finish_has_not_arrived() -> None:
    """A valley along y = x^3/10, a hundred times as steep as its floor: no parabola follows it."""
    evaluator = in_box(
        lambda p: np.array([100.0 * (p[1] - 0.1 * p[0] ** 3), 1.0 - p[0]]), 2, half=100.0
    )
    start = begun(evaluator, np.array([-6.0, -21.6]))
    end = let_down(evaluator, -6.0, -21.6)
    assert not end.reached
    assert not end.is_cut
    assert 2e-3 < end.chi_square < start.chi_square
    # of a step that is bent: slopes, the straight one, a probe and the bent one
    assert evaluator.evaluations <= 2 * 3 + ITERATIONS * (2 + 3)


def test_a_search_that_will_not_come_to_where_it_is_wanted_is_left() -> None:
    """A long valley, whose floor is a hundred sigma high at its end: no step leads below."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([100.0 * (p[1] - 0.1 * p[0] ** 3), 1.0 - p[0], 100.0])

    whole, left = in_box(rows, 2, half=100.0), in_box(rows, 2, half=100.0)
    let_down(whole, -6.0, -21.6)
    end = let_down(left, -6.0, -21.6, wanted=9.0)
    assert not end.reached
    assert left.evaluations < 0.5 * whole.evaluations


def test_a_search_that_is_wanted_where_it_leads_arrives() -> None:
    evaluator = in_box(lambda p: np.append(wider_valley(p), 100.0), 2)
    end = let_down(evaluator, -3.0, 9.0, wanted=1e4 + 9.0)
    assert end.reached
    assert end.end.x == pytest.approx([1.0, 1.0], abs=0.05)
    assert end.end.chi_square == pytest.approx(1e4, abs=2e-3)


def test_a_search_at_a_pace_that_leads_there_is_not_left() -> None:
    far = let_down(in_box(wider_valley, 2), -3.0, 9.0, wanted=1e-3)
    assert far.reached
    assert far.end.x == pytest.approx([1.0, 1.0], abs=0.05)


def test_a_start_without_an_answer_is_none() -> None:
    evaluator = in_box(lambda p: np.array([p[0], 0.0]), 1)
    here = begun(evaluator, np.ones(1))
    failed = Expansion(here.sample, np.full((2, 1), np.nan), here.outward)
    assert failed.chi_square == np.inf
    [end] = minimise(evaluator, [failed])
    assert not end.reached
    assert end.end is failed


def test_a_search_whose_slopes_are_false_ends_where_it_began() -> None:
    evaluator = in_box(lambda p: np.array([0.3 * (1.0 + p[0]), 0.0]), 1)
    here = begun(evaluator, np.zeros(1))
    false = Expansion(here.sample, -here.matrix, here.outward)
    [end] = minimise(evaluator, [false])
    assert end.end is false
    assert end.reached  # less than one of chi square was promised


def test_rows_less_by_an_offset_are_those_of_other_data() -> None:
    """A straight line through three points: each data set has its own normal equations."""
    matrix = np.stack([np.ones(3), np.array([-1.0, 0.0, 2.0])], axis=1)
    evaluator = in_box(lambda p: matrix @ p, 2)
    here = begun(evaluator, np.zeros(2))
    data = [np.array([1.0, 2.0, 3.0, 0.0, 0.0]), np.array([0.0, -1.0, 4.0, 0.0, 0.0])]
    begins = [
        replace(here, sample=replace(here.sample, rows=here.sample.rows - measured))
        for measured in data
    ]
    ends = minimise(evaluator, begins, offsets=data)
    for end, measured in zip(ends, data, strict=True):
        wanted, [square], *_ = np.linalg.lstsq(matrix, measured[:3])
        assert end.reached
        assert end.end.x == pytest.approx(wanted, abs=0.02)
        assert end.chi_square == pytest.approx(square, abs=2e-3)


def test_a_search_that_the_budget_ends_reports_that() -> None:
    evaluator = in_box(wider_valley, 2)
    here = begun(evaluator, np.array([-3.0, 9.0]))
    evaluator.limit = evaluator.spent + 3
    [end] = minimise(evaluator, [here])
    assert (end.reached, end.is_cut) == (False, True)
    assert end.chi_square <= here.chi_square
    with pytest.raises(Exhausted):
        begun(evaluator, np.zeros(2))


# --- valleys that bend

#: Places from which Rosenbrock's valley is followed to (1, 1), and half widths of its box.
FROM = ((-1.2, 1.0), (-1.9, 1.9), (-3.0, 9.0), (5.0, -5.0), (-9.0, 9.0))
HALF_WIDTHS = (2.0, 10.0, 30.0, 100.0, 1000.0)


@pytest.mark.parametrize("half", HALF_WIDTHS)
@pytest.mark.parametrize("rows", [rosenbrock, wider_valley])
def test_a_curved_valley_is_followed_to_its_end_whatever_the_width_of_the_box(
    rows: Rows, half: float
) -> None:
    """Within 30 evaluations, ten Jacobians: along a tangent each step is a few widths long."""
    for start in (s for s in FROM if max(map(abs, s)) <= half):
        evaluator = in_box(rows, 2, half)
        end = let_down(evaluator, *start)
        assert end.reached, start
        assert end.chi_square < 2e-3, start
        assert end.end.x == pytest.approx([1.0, 1.0], abs=0.1)
        assert evaluator.evaluations <= 3 + 30, start


@pytest.mark.parametrize("half", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("target", [4.0, 9.0])
def test_a_curved_valley_is_followed_while_a_parameter_is_held(target: float, half: float) -> None:
    """100 (y - x^2)^2 + 100 (z - y)^2 + (1 - x)^2 at z = t: y is halfway, 50 (t - x^2)^2 is left.

    Both x = sqrt(t) and its negative are minima; which is the nearer is a matter of the steps.
    """

    def rows(p: FloatArray) -> FloatArray:
        return np.array([10.0 * (p[1] - p[0] ** 2), 10.0 * (p[2] - p[1]), 1.0 - p[0]])

    evaluator = in_box(rows, 3, half)
    end = let_down(evaluator, -1.2, 1.0, 1.0, constraint=Constraint(target=target, index=2))
    assert end.reached
    assert end.end.x[2] == target
    # d/dx of 50 (t - x^2)^2 + (1 - x)^2
    roots = np.roots([200.0, 0.0, 2.0 - 200.0 * target, -2.0])
    x = min(roots.real, key=lambda root: abs(root - end.end.x[0]))
    assert end.end.x[:2] == pytest.approx([x, 0.5 * (target + x**2)], abs=5e-3)
    least = 50.0 * (target - x**2) ** 2 + (1.0 - x) ** 2
    assert end.chi_square == pytest.approx(least, abs=2e-3)
    assert evaluator.evaluations <= 4 + 60


#: Outputs that are held in Rosenbrock's valley.
OUTPUTS: dict[str, Callable[[FloatArray], float]] = {
    "straight": lambda p: float(p[0] + p[1]),
    "curved": lambda p: float(p[0] * np.exp(0.2 * p[1])),
}


@pytest.mark.parametrize("half", [10.0, 30.0, 100.0])
@pytest.mark.parametrize("target", [0.5, 3.0, 12.0])
@pytest.mark.parametrize("name", OUTPUTS)
def test_a_curved_valley_is_followed_while_an_output_is_held(
    name: str, target: float, half: float
) -> None:
    """It is held near its target by a row: a minimum of all rows with that one, by scipy."""
    weight, output = 30.0, OUTPUTS[name]
    evaluator = in_box(rosenbrock, 2, half, held=output)
    held = Constraint(target=target, output=0, weight=weight)
    end = let_down(evaluator, -1.2, 1.0, constraint=held)
    assert end.reached
    fit = least_squares(
        lambda p: np.append(rosenbrock(p), weight * (output(p) - target)),
        end.end.x,
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
    )
    assert end.chi_square + held.residual(end.end.sample) ** 2 == pytest.approx(
        2.0 * fit.cost, abs=2e-3
    )
    assert evaluator.evaluations <= 3 + 45


def test_an_output_far_off_is_brought_near_its_target_in_a_wide_box() -> None:
    """In a box of 2000 a damping of 1e8 still allows for steps across all of the valley."""
    evaluator = in_box(rosenbrock, 2, half=1000.0, total=lambda p: p[0] + p[1])
    held = Constraint(target=12.0, output=0, weight=30.0)
    end = let_down(evaluator, -1.2, 1.0, constraint=held)
    assert end.reached
    assert float(np.sum(end.end.x)) == pytest.approx(12.0, abs=0.05)


@pytest.mark.parametrize("half", [16.0, 100.0])
@pytest.mark.parametrize("start", [(-1.2, 1.0), (-3.0, 9.0), (-8.0, -8.0)])
def test_a_curved_valley_is_followed_to_a_bound(start: tuple[float, float], half: float) -> None:
    """100 (y - x^2)^2 + (6 - x)^2 with y <= 16: least at the bound, with 200 x (x^2 - 16) = 6 - x.

    A straight step from the other side of the valley ends far beyond the bound.
    """
    own = parameter("x", -half, half), parameter("y", -half, 16.0)
    evaluator = evaluator_of(
        whitened(lambda p: np.array([10.0 * (p[1] - p[0] ** 2), 6.0 - p[0]]), *own)
    )
    end = let_down(evaluator, *to_search(own, np.array(start)))
    x = max(np.roots([200.0, 0.0, 1.0 - 3200.0, -6.0]).real)
    assert end.reached
    assert to_model(own, end.end.x) == pytest.approx([x, 16.0], abs=0.01)
    assert end.chi_square == pytest.approx(100.0 * (16.0 - x**2) ** 2 + (6.0 - x) ** 2, abs=2e-3)


@pytest.mark.parametrize("stiff", [3.0, 10.0, 30.0])
@pytest.mark.parametrize("start", [3.5, -1.5, 2.8, 5.0])
def test_a_curved_valley_round_a_period_is_followed(start: float, stiff: float) -> None:
    """b = 3 sin a along the whole turn, and 2 (e^ia - e^i): its only minimum is at a = 1."""

    def rows(p: FloatArray) -> FloatArray:
        turned = 2.0 * (np.exp(1j * p[0]) - np.exp(1j))
        return np.array([stiff * (p[1] - 3.0 * np.sin(p[0])), turned.real, turned.imag])

    own = parameter("a", 0.0, 2.0 * math.pi, period=2.0 * math.pi), parameter("b", -10.0, 10.0)
    evaluator = evaluator_of(whitened(rows, *own))
    end = let_down(evaluator, *to_search(own, np.array([start, 3.0 * math.sin(start)])))
    a, b = to_model(own, end.end.x)
    assert end.reached
    assert end.chi_square < 2e-3
    assert math.remainder(a - 1.0, 2.0 * math.pi) == pytest.approx(0.0, abs=0.03)
    assert b == pytest.approx(3.0 * math.sin(1.0), abs=0.1)


def valley(seed: int) -> tuple[Rows, FloatArray, FloatArray]:
    """Rows of a random curved valley of 2 to 4 parameters, where it ends, and a start far off.

    In turned axes z: K (z_i - f_i(z_0)), i > 0, and z_0 - d: chi square is 0.49 at z_i = f_i(d) and
    has no other minimum.
    """
    generator = np.random.default_rng(seed)
    n = int(generator.integers(2, 5))
    turned = np.linalg.qr(generator.standard_normal((n, n)))[0]
    bend, curl = generator.uniform(-0.4, 0.4, n - 1), generator.uniform(-1.5, 1.5, n - 1)
    stiff = 10.0 ** generator.uniform(0.3, 1.3)
    wanted = float(generator.uniform(-2.0, 2.0))

    def of(z: float) -> FloatArray:
        return np.asarray(bend * z**2 + curl * math.sin(z))

    def rows(x: FloatArray) -> FloatArray:
        z = turned.T @ x
        return np.concatenate([stiff * (z[1:] - of(z[0])), [z[0] - wanted, 0.7]])

    end = turned @ np.append(wanted, of(wanted))
    return rows, end, generator.uniform(-5.0, 5.0, n)


@pytest.mark.parametrize("seed", range(20))
def test_random_valleys_end_where_scipy_does(seed: int) -> None:
    rows, wanted, start = valley(seed)
    evaluator = in_box(rows, start.size, half=20.0)
    end = let_down(evaluator, *start)
    fit = least_squares(rows, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert fit.x == pytest.approx(wanted, abs=1e-6)
    assert end.reached
    assert end.chi_square == pytest.approx(2.0 * fit.cost, abs=2e-3)
    assert end.end.x == pytest.approx(wanted, abs=0.15)
    assert evaluator.evaluations <= ITERATIONS * (start.size + 1)


def test_a_probe_without_an_answer_leaves_the_step_straight() -> None:
    """Beyond x = -1.1 nobody answers until -0.9: a probe a tenth of the way there has no rows."""
    asked: list[FloatArray] = []

    def rows(p: FloatArray) -> FloatArray:
        asked.append(p)
        return np.full(2, np.nan) if -1.1 < p[0] < -0.9 else rosenbrock(p)

    end = let_down(in_box(rows, 2), -1.2, 1.0)
    assert end.reached
    assert end.chi_square < 2e-3
    assert np.all(np.isfinite(asked))


# --- slopes that are carried on


def held_at_three(
    evaluator: LikelihoodEvaluator, count: int, output: bool = False
) -> tuple[Descent, int]:
    """Where a search from zero ends that holds x0 (or the output) at 3, and what it evaluated."""
    begin = begun(evaluator, np.zeros(count))
    before = evaluator.evaluations
    constraint = (
        Constraint(target=3.0, output=0, weight=100.0)
        if output
        else Constraint(target=3.0, index=0)
    )
    [end] = minimise(evaluator, [begin], [constraint])
    return end, evaluator.evaluations - before


def bent(p: FloatArray) -> FloatArray:
    """x0/2, and how far the other five are from x0^2/50."""
    return np.append(0.5 * p[0], p[1:] - 0.02 * p[0] ** 2)


@pytest.mark.parametrize("output", [False, True])
def test_slopes_are_carried_over_good_steps_and_are_those_of_the_end_where_it_ends(
    output: bool,
) -> None:
    """At x0 = 3 the others are 0.18, chi^2 = 1.5^2, and their rows have the slope -0.12 in x0.

    With slopes at each of its points it would take two times seven evaluations.
    """
    evaluator = in_box(bent, 6, itself=lambda p: float(p[0]))
    end, evaluations = held_at_three(evaluator, 6, output)
    assert end.reached
    assert evaluations <= 7 + 3
    assert end.end.x == pytest.approx([3.0, *[0.18] * 5], abs=2e-3)
    assert end.chi_square == pytest.approx(2.25, abs=1e-2 if output else 1e-4)
    slopes = np.eye(6)
    slopes[0, 0], slopes[1:, 0] = 0.5, -0.12
    assert end.end.matrix[:6] == pytest.approx(slopes, abs=2e-3)
    assert end.end.age == 0


def test_without_confirmation_slopes_that_were_carried_there_do() -> None:
    """The same minimum for fewer evaluations, by slopes that are older."""
    evaluator = in_box(bent, 6)
    whole, evaluations = held_at_three(evaluator, 6)
    begin = begun(evaluator, np.zeros(6))
    before = evaluator.evaluations
    [end] = minimise(evaluator, [begin], [Constraint(target=3.0, index=0)], Goal(confirmed=False))
    assert end.reached
    assert end.chi_square == pytest.approx(whole.chi_square, abs=5e-3)
    assert evaluator.evaluations - before < evaluations
    assert end.end.age > 0


def test_slopes_are_carried_where_a_few_values_belong_to_single_experiments() -> None:
    """The same minimum with five values of single experiments, within as many evaluations."""
    own = [parameter(f"x{i}", -10.0, 10.0, experiment=f"pair{i}") for i in range(1, 6)]
    evaluator = evaluator_of(whitened(bent, parameter("x0", -10.0, 10.0), *own))
    end, evaluations = held_at_three(evaluator, 6)
    assert end.reached
    assert evaluations <= 7 + 3
    assert end.end.x == pytest.approx([3.0, *[0.18] * 5], abs=2e-3)
    assert end.end.matrix[1:6, 0] == pytest.approx(np.full(5, -0.12), abs=2e-3)


@pytest.mark.parametrize(("stiff", "bend", "most"), [(2.0, 0.08, 5), (3.0, 0.2, 8)])
def test_carried_slopes_lead_as_near_to_the_minimum_as_new_ones(
    stiff: float, bend: float, most: int
) -> None:
    """s (y + b y^2 - 0.4 x) at x = 3: of the first, carried slopes leave 1.5e-3 of chi square, less
    than what a step is worth, and a step by slopes taken there follows; of the second, slopes that
    are not mended on the way take nine evaluations.
    """
    evaluator = in_box(
        lambda p: np.array([stiff * (p[1] + bend * p[1] ** 2 - 0.4 * p[0]), 0.5 * p[0]]), 2
    )
    end, evaluations = held_at_three(evaluator, 2)
    assert end.reached
    assert evaluations <= most
    assert end.chi_square == pytest.approx(2.25, abs=1e-5)
    y = ((1.0 + 4.8 * bend) ** 0.5 - 1.0) / (2.0 * bend)
    assert end.end.x[1] == pytest.approx(y, abs=1e-3)


def test_nothing_is_reached_where_the_model_has_no_slopes() -> None:
    """Beyond x0 = 2 it answers next to x2 = 0 alone: a step along x2 fails, whichever way."""

    def rows(p: FloatArray) -> FloatArray:
        whole = np.append(bent(p), 0.0)
        return np.full(7, np.nan) if p[0] > 2.0 and abs(p[2]) > 1e-6 else whole

    evaluator = in_box(lambda p: rows(np.array([p[0], p[1], p[2], *[0.02 * p[0] ** 2] * 3])), 3)
    end, _ = held_at_three(evaluator, 3)
    assert not end.reached
