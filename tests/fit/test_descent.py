"""Descents over chi square against minima in closed form: where they end, and what they say."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from fitting.fit.likelihood.descent import (
    Constraint,
    Descent,
    Expansion,
    descend,
    expansion_at,
    freedom_of,
    held_at,
    inflation_of,
    lower,
    most_likely,
)
from fitting.fit.likelihood.likelihood import (
    LikelihoodEvaluator,
    likelihood_of,
    likelihood_with,
)
from fitting.fit.likelihood.lockstep import Exhausted, Request, Task, run_in_lockstep
from fitting.fit.noise import noise_of
from fitting.fit.objective import Objective, evaluate_many
from fitting.text.arrays import FloatArray
from tests.support.whitened import SIGMA, parameter, whitened

Rows = Callable[[FloatArray], FloatArray]


def evaluator_of(objective: Objective) -> LikelihoodEvaluator:
    size = objective.data.sigma.size
    names = tuple(objective.response.derived_many([np.zeros(len(objective.parameters))])[0])
    own = likelihood_of(objective, np.full(size, SIGMA), np.zeros((size, 0)), names)
    return LikelihoodEvaluator(own)


def box(rows: Rows, count: int, half: float = 10.0, **outputs: Any) -> LikelihoodEvaluator:
    """The likelihood of rows over parameters from -half to half, of scale one."""
    names = [parameter(f"x{i}", -half, half) for i in range(count)]
    return evaluator_of(whitened(rows, *names, **outputs))


def begun(evaluator: LikelihoodEvaluator, x: FloatArray) -> Expansion:
    [here] = run_in_lockstep([expansion_at(evaluator.likelihood, x)], evaluator)
    assert here is not None
    return here


def let_down(evaluator: LikelihoodEvaluator, *x: float, **options: Any) -> Descent:
    """Where a descent from x ends."""
    task: Task[Descent] = lower(evaluator.likelihood, begun(evaluator, np.array(x)), **options)
    [end] = run_in_lockstep([task], evaluator)
    assert end is not None
    return end


def rosenbrock(p: FloatArray) -> FloatArray:
    return np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])


def wider_valley(p: FloatArray) -> FloatArray:
    return np.array([2.0 * (p[1] - p[0] ** 2), 1.0 - p[0]])


def test_a_point_with_its_slopes() -> None:
    """Rows x0^2 and x1, an output 3 x0 x1: all of it by hand."""
    evaluator = box(lambda p: np.array([p[0] ** 2, p[1]]), 2, product=lambda p: 3.0 * p[0] * p[1])
    here = begun(evaluator, np.array([2.0, -1.0]))
    assert here.chi_square == pytest.approx(17.0)
    assert here.matrix[:2] == pytest.approx(np.array([[4.0, 0.0], [0.0, 1.0]]), abs=1e-2)
    assert here.outward == pytest.approx(np.array([[-3.0, 6.0]]), rel=1e-6)
    assert here.sample.outputs == pytest.approx([-6.0])


def test_straight_rows_end_at_the_normal_equations() -> None:
    generator = np.random.default_rng(2)
    matrix, target = generator.standard_normal((6, 3)), generator.standard_normal(6)
    end = let_down(box(lambda p: matrix @ p - target, 3), 4.0, -3.0, 2.0)
    wanted, squares = np.linalg.lstsq(matrix, target, rcond=None)[:2]
    assert end.reached
    assert end.end.x == pytest.approx(wanted, abs=0.02)
    assert squares[0] - 1e-6 <= end.chi_square <= squares[0] + 2e-3


def test_a_curved_valley_is_followed_to_its_end() -> None:
    evaluator = box(wider_valley, 2)
    end = let_down(evaluator, -1.2, 1.0)
    assert end.reached
    assert end.chi_square < 2e-3
    assert end.end.x == pytest.approx([1.0, 1.0], abs=0.1)
    assert evaluator.evaluations < 3 * 31


@pytest.mark.parametrize(("gain", "moves"), [(1.9e-3, False), (2.1e-3, True)])
def test_a_step_that_promises_a_five_hundredth_of_chi_square_is_taken(
    gain: float, moves: bool
) -> None:
    """A row 100 (x - 1): a gain is its square."""
    evaluator = box(lambda p: np.array([100.0 * (p[0] - 1.0), 5.0]), 1)
    x = 1.0 - gain**0.5 / 100.0
    end = let_down(evaluator, x)
    assert end.reached
    assert bool(end.end.x[0] != x) is moves
    wider = let_down(evaluator, x, promise=1.5 * gain)
    assert wider.end.x[0] == x
    [found] = run_in_lockstep(
        [descend(evaluator.likelihood, begun(evaluator, np.array([x])), promise=1.5 * gain)],
        evaluator,
    )
    assert found is not None
    assert found.x[0] == x


def test_what_the_data_do_not_see_stays_where_it_began() -> None:
    end = let_down(box(lambda p: np.array([p[0] + p[1] - 4.0, 0.0]), 3), 0.0, 0.0, 7.0)
    assert end.end.x == pytest.approx([2.0, 2.0, 7.0], abs=0.03)


def test_what_the_data_hardly_see_is_not_walked_while_others_take_their_steps() -> None:
    """A row x^2, whose zero is halved by each step, and 1e-3 (z - 9): all of z gains 8e-5.

    A step across the box of 20 costs 0.1 of chi square: z goes 0.4 per cent of its way in each.
    """
    end = let_down(box(lambda p: np.array([p[0] ** 2, 1e-3 * (p[1] - 9.0)]), 2), 8.0, 0.0)
    assert end.reached
    assert abs(end.end.x[0]) < 0.4
    assert 0.0 <= end.end.x[1] < 0.5


def test_a_bound_holds_and_a_quarter_of_a_period_is_the_longest_step() -> None:
    end = let_down(box(lambda p: np.array([p[0] - 14.0, p[1] + p[0]]), 2), 0.0, 0.0)
    assert end.reached
    assert end.end.x == pytest.approx([10.0, -10.0], abs=0.03)
    assert end.chi_square == pytest.approx(16.0, abs=2e-3)
    turning = parameter("angle", 0.0, 8.0, period=8.0)
    evaluator = evaluator_of(whitened(lambda p: np.array([p[0] - 7.0, 0.0]), turning))
    asked: list[float] = []
    task = lower(evaluator.likelihood, begun(evaluator, np.array([-4.0])))
    request = next(task)
    while True:
        asked.append(float(request.xs[0][0]))
        try:
            request = task.send(evaluator([request])[0])
        except StopIteration:
            break
    assert max(np.abs(np.diff([-4.0, *asked]))) == pytest.approx(2.0)


def test_a_parameter_is_held_at_its_target_while_the_others_follow() -> None:
    """chi^2 = (x + y - 3)^2 + 4 (y - 1)^2: at x = t least for y = 1 + (2 - t)/5."""
    evaluator = box(lambda p: np.array([p[0] + p[1] - 3.0, 2.0 * (p[1] - 1.0)]), 2)
    for target in (-4.0, 2.0, 6.5):
        end = let_down(evaluator, 0.0, 0.0, constraint=Constraint(target, index=0))
        assert end.reached
        assert end.end.x[0] == pytest.approx(target, abs=1e-12)
        assert end.end.x[1] == pytest.approx(1.0 + (2.0 - target) / 5.0, abs=0.03)
        assert end.chi_square == pytest.approx(0.8 * (target - 2.0) ** 2, abs=2e-3)


def test_a_frozen_axis_stays() -> None:
    evaluator = box(lambda p: np.array([p[0] - 3.0, p[1] - 2.0]), 2)
    end = let_down(evaluator, 0.0, 0.5, constraint=Constraint(0.0, frozen=(1,)))
    assert end.end.x == pytest.approx([3.0, 0.5], abs=0.05)
    assert end.end.x[1] == 0.5


def test_a_held_parameter_in_a_curved_valley_ends_on_the_profile() -> None:
    """The free step leaves the valley y = x^2 by 9 times 10: it is tried again, held back."""
    end = let_down(box(rosenbrock, 2), 0.0, 0.0, constraint=Constraint(3.0, index=0))
    assert end.reached
    assert end.end.x == pytest.approx([3.0, 9.0], abs=0.01)
    assert end.chi_square == pytest.approx(4.0, abs=2e-3)


@pytest.mark.parametrize("weight", [0.3, 2.0])
def test_an_output_is_held_by_its_weight(weight: float) -> None:
    """(x - 2)^2 + w^2 (3 x - 12)^2 is least at x = (2 + 36 w^2)/(1 + 9 w^2)."""
    evaluator = box(lambda p: np.array([p[0] - 2.0, 0.0]), 1, triple=lambda p: 3.0 * p[0])
    held = Constraint(12.0, output=0, weight=weight)
    end = let_down(evaluator, 0.0, constraint=held)
    x = (2.0 + 36.0 * weight**2) / (1.0 + 9.0 * weight**2)
    assert end.reached
    assert end.end.x == pytest.approx([x], abs=0.05)
    assert held.residual(end.end.sample) == pytest.approx(weight * (3.0 * end.end.x[0] - 12.0))
    assert Constraint(12.0, index=0).residual(end.end.sample) == 0.0


def test_a_step_that_gains_next_to_nothing_of_much_that_it_promised_ends_nothing() -> None:
    """A row of slope -1, four times as steep beyond a kink: 0.03 is promised, 0.001 is gained.

    From there the next step, along the steeper slope, leads to zero.
    """
    first, then = 0.03**0.5, 0.029**0.5
    kink = first - then / 3.0

    def row(x: float) -> float:
        return float(first - x - 3.0 * max(0.0, x - kink))

    assert row(first) == pytest.approx(-then)
    end = let_down(box(lambda p: np.array([row(float(p[0])), 0.0]), 1), 0.0)
    assert end.reached
    assert end.chi_square < 2e-3


def test_chi_square_that_is_low_enough_ends_a_descent() -> None:
    evaluator = box(wider_valley, 2)
    whole = let_down(evaluator, -1.2, 1.0)
    short = let_down(evaluator, -1.2, 1.0, enough=4.0)
    assert short.reached
    assert whole.chi_square < 2e-3 < short.chi_square <= 4.0


def test_a_descent_that_thirty_steps_do_not_finish_has_not_arrived() -> None:
    """Rosenbrock's valley takes more in a box that is a hundred of its widths wide."""
    evaluator = box(rosenbrock, 2)
    start = begun(evaluator, np.array([-1.2, 1.0]))
    end = let_down(evaluator, -1.2, 1.0)
    assert not end.reached
    assert 2e-3 < end.chi_square < start.chi_square
    [none] = run_in_lockstep([descend(evaluator.likelihood, start)], evaluator)
    assert none is None


@pytest.mark.parametrize(("wanted", "arrives"), [(9.0, False), (1e4 + 9.0, True)])
def test_a_descent_that_will_not_come_to_where_it_is_wanted_is_left(
    wanted: float, arrives: bool
) -> None:
    # the valley's floor is a hundred sigma high at (1, 1): no step leads below
    evaluator = box(lambda p: np.append(wider_valley(p), 100.0), 2)
    end = let_down(evaluator, -3.0, 9.0, wanted=wanted)
    assert end.reached is arrives
    if arrives:
        assert end.end.x == pytest.approx([1.0, 1.0], abs=0.05)
        assert end.end.chi_square == pytest.approx(1e4, abs=2e-3)
    else:  # three steps tell the pace: with its slopes a point takes three evaluations
        assert evaluator.evaluations <= 3 * (1 + 4)


def test_a_descent_at_a_pace_that_leads_there_is_not_left() -> None:
    far = let_down(box(wider_valley, 2), -3.0, 9.0, wanted=1e-3)
    assert far.reached
    assert far.end.x == pytest.approx([1.0, 1.0], abs=0.05)


def test_a_start_without_an_answer_is_none() -> None:
    evaluator = box(lambda p: np.array([p[0], 0.0]), 1)
    here = begun(evaluator, np.ones(1))
    failed = Expansion(here.sample, np.full((2, 1), np.nan), here.outward)
    assert failed.chi_square == np.inf
    [end] = run_in_lockstep([lower(evaluator.likelihood, failed)], evaluator)
    assert end is not None
    assert not end.reached
    assert end.end is failed


def test_a_descent_whose_slopes_are_false_ends_where_it_began() -> None:
    evaluator = box(lambda p: np.array([0.3 * (1.0 + p[0]), 0.0]), 1)
    here = begun(evaluator, np.zeros(1))
    false = Expansion(here.sample, -here.matrix, here.outward)
    [end] = run_in_lockstep([lower(evaluator.likelihood, false)], evaluator)
    assert end is not None
    assert end.end is false
    assert end.reached  # less than one of chi square was promised


# --- slopes that are carried on


def held_at_three(
    evaluator: LikelihoodEvaluator, count: int, output: bool = False
) -> tuple[Descent, int]:
    """Where a descent from zero ends that holds x0 (or the output) at 3, and what it evaluated."""
    begin = begun(evaluator, np.zeros(count))
    before = evaluator.evaluations
    constraint = Constraint(3.0, output=0, weight=100.0) if output else Constraint(3.0, index=0)
    [end] = run_in_lockstep([lower(evaluator.likelihood, begin, constraint)], evaluator)
    assert end is not None
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
    evaluator = box(bent, 6, itself=lambda p: float(p[0]))
    end, evaluations = held_at_three(evaluator, 6, output)
    assert end.reached
    assert evaluations <= 7 + 3
    assert end.end.x == pytest.approx([3.0, *[0.18] * 5], abs=2e-3)
    assert end.chi_square == pytest.approx(2.25, abs=1e-2 if output else 1e-4)
    slopes = np.eye(6)
    slopes[0, 0], slopes[1:, 0] = 0.5, -0.12
    assert end.end.matrix[:6] == pytest.approx(slopes, abs=2e-3)
    assert end.end.outward.shape == ((1, 6) if output else (0, 6))


def test_slopes_are_carried_where_a_few_values_belong_to_single_experiments() -> None:
    """The same minimum with five values of single experiments, within as many evaluations."""
    own = [parameter(f"x{i}", -10.0, 10.0, experiment=f"pair{i}") for i in range(1, 6)]
    evaluator = evaluator_of(whitened(bent, parameter("x0", -10.0, 10.0), *own))
    end, evaluations = held_at_three(evaluator, 6)
    assert end.reached
    assert evaluations <= 7 + 3
    assert end.end.x == pytest.approx([3.0, *[0.18] * 5], abs=2e-3)
    assert end.end.matrix[1:6, 0] == pytest.approx(np.full(5, -0.12), abs=2e-3)


@pytest.mark.parametrize(("stiff", "bend", "most"), [(2.0, 0.08, 5), (3.0, 0.2, 7)])
def test_carried_slopes_lead_as_near_to_the_minimum_as_new_ones(
    stiff: float, bend: float, most: int
) -> None:
    """s (y + b y^2 - 0.4 x) at x = 3: of the first, carried slopes leave 1.5e-3 of chi square, less
    than what a step is worth, and a step by slopes taken there follows; of the second, slopes that
    are not mended on the way take nine evaluations.
    """
    evaluator = box(
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

    evaluator = box(lambda p: rows(np.array([p[0], p[1], p[2], *[0.02 * p[0] ** 2] * 3])), 3)
    end, _ = held_at_three(evaluator, 3)
    assert not end.reached
    assert end.end.x == pytest.approx(np.zeros(3))
    assert end.chi_square == 0.0


# --- the most likely point


def test_the_lowest_of_several_starts_is_the_most_likely_point() -> None:
    """Rows of a double well, one side of it deeper."""
    rows = lambda p: np.array([(p[0] ** 2 - 4.0), 0.5 * (p[0] - 2.0)])  # noqa: E731
    evaluator = box(rows, 1)
    optimum = most_likely(evaluator, [np.array([-3.0]), np.array([3.0])])
    assert optimum.expansion.x == pytest.approx([2.0], abs=0.02)
    assert optimum.converged
    assert optimum.least == pytest.approx(0.0, abs=2e-3)
    assert optimum.likelihood.inflation == 1.0


def test_of_starts_that_are_as_good_the_first_wins() -> None:
    rows = lambda p: np.array([p[0] ** 2 - 4.0, 0.01])  # noqa: E731
    for first in (-3.0, 3.0):
        optimum = most_likely(box(rows, 1), [np.array([first]), np.array([-first])])
        assert optimum.expansion.x == pytest.approx([np.sign(first) * 2.0], abs=0.02)


@pytest.mark.parametrize("each", [1.2, 2.0])
def test_residuals_beyond_the_noise_widen_it(each: float) -> None:
    """Ten rows of one size that nothing explains, beside one that fits: chi^2 over 10 of freedom.

    A chi square of 14.4 is usual for ten (p = 0.16), one of 40 is not.
    """
    evaluator = box(lambda p: np.append(np.full(10, each), 100.0 * (p[0] - 1.0)), 1)
    optimum = most_likely(evaluator, [np.zeros(1)])
    assert optimum.chi_square == pytest.approx(10.0 * each**2, abs=2e-3)
    assert optimum.degrees_of_freedom == pytest.approx(10.0, rel=1e-4)
    wide = each if chi2.sf(10.0 * each**2, 10) < 0.05 else 1.0
    assert optimum.likelihood.inflation == pytest.approx(wide, rel=1e-3)
    assert optimum.least == pytest.approx(10.0 * (each / wide) ** 2, rel=1e-3)


@pytest.mark.parametrize("free", [1.0, 3.5, 10.0, 200.0])
def test_noise_is_wider_from_the_five_per_cent_point_of_chi_square_on(free: float) -> None:
    limit = float(chi2.isf(0.05, free))
    assert inflation_of(0.999 * limit, free) == 1.0
    assert inflation_of(1.001 * limit, free) == pytest.approx((1.001 * limit / free) ** 0.5)
    assert inflation_of(limit, 0.0) == 1.0


def test_degrees_of_freedom_are_rows_less_what_the_data_hold() -> None:
    """m - sum s^2/(1 + s^2), s in units of the box as a uniform distribution, width/sqrt(12)."""
    evaluator = box(lambda p: np.array([0.4 * p[0], 30.0 * p[1], 0.0, 0.0]), 2)
    s = np.array([0.4, 30.0]) * 20.0 / 12**0.5
    free = freedom_of(evaluator.likelihood, begun(evaluator, np.zeros(2)))
    assert free == pytest.approx(4.0 - np.sum(s**2 / (1.0 + s**2)), rel=1e-4)


# --- what a limit holds


def held(
    wanted: float, x: tuple[float, float], besides: tuple[int, ...] = (), **told: Any
) -> tuple[int, ...]:
    """Parameters held at x, of rows x + y - wanted and y - 1 over the box from -10 to 10."""
    evaluator = box(
        lambda p: np.array([p[0] + p[1] - wanted, p[1] - 1.0, 0.0]), 2, own=lambda p: p[0]
    )
    here = begun(evaluator, np.array(x))
    return held_at(evaluator.likelihood, here, besides, **told)


@pytest.mark.parametrize(
    ("wanted", "x", "limits"),
    [
        (12.0, (10.0, 1.5), (0,)),  # least for x = 11
        (12.0, (10.0, 2.0), (0,)),  # also where y meets the first row alone
        (12.0, (9.0, 1.5), ()),  # not at the limit
        (10.9, (10.0, 1.0), ()),  # least for x = 9.9: pushed inward
        (11.4, (10.0, 1.2), ()),  # for a gain of 0.4^2/2
        (11.5, (10.0, 1.25), (0,)),  # of 0.5^2/2
        (-10.4, (-10.0, 0.3), (0,)),  # least for x = -11.4
        (-8.5, (-10.0, 1.0), ()),
    ],
)
def test_a_limit_holds_what_would_gain_a_tenth_while_the_others_follow(
    wanted: float, x: tuple[float, float], limits: tuple[int, ...]
) -> None:
    """At x = t the least over y is (wanted - 1 - t)^2/2: all of it would be gained."""
    assert held(wanted, x) == limits
    assert held(wanted, x, besides=(0,)) == ()


@pytest.mark.parametrize("half", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_at_a_limit_is_within_a_millionth_of_the_box_whatever_its_unit(
    half: float, side: float
) -> None:
    """Ten widths of the noise beyond either end of a box from -half to half."""
    evaluator = box(lambda p: np.array([10.0 * (p[0] / half - 2.0 * side), 0.0]), 1, half)
    for share, limits in ((0.5e-6, (0,)), (2e-6, ())):
        here = begun(evaluator, np.array([side * (1.0 - 2.0 * share) * half]))
        assert held_at(evaluator.likelihood, here, ()) == limits


def test_a_held_output_counts_among_the_rows() -> None:
    """x is pulled inward by its output more than the data push it outward, or the other way."""
    assert held(12.0, (10.0, 1.5), constraint=Constraint(0.0, output=0, weight=5.0)) == ()
    assert held(10.9, (10.0, 1.0), constraint=Constraint(30.0, output=0, weight=5.0)) == (0,)


@pytest.mark.parametrize(("target", "limits"), [(10.35, ()), (10.45, (0,)), (9.5, ())])
def test_what_a_held_output_gains_is_in_units_of_the_output(
    target: float, limits: tuple[int, ...]
) -> None:
    """(x - 10)^2/2 + (x - t)^2 falls from (10 - t)^2 by (10 - t)^2/1.5: a tenth for t = 10.387."""
    assert held(11.0, (10.0, 1.0), constraint=Constraint(target, output=0, weight=1.0)) == limits


# --- noise that the residuals tell


def test_without_a_slope_noise_has_the_freedom_of_all_rows() -> None:
    """1, -2, 0, 2, -1 about a straight line: chi square of ten, three degrees of freedom."""
    times, scattered = np.arange(-2.0, 3.0), np.array([1.0, -2.0, 0.0, 2.0, -1.0])
    line = [parameter(name, -10.0, 10.0) for name in ("height", "slope")]
    objective = whitened(lambda p: p[0] + p[1] * times + scattered, *line, known=False)
    [point] = evaluate_many(objective, [np.zeros(2)])
    evaluator = LikelihoodEvaluator(likelihood_with(objective, noise_of(objective, point)))
    optimum = most_likely(evaluator, [np.zeros(2)])
    assert optimum.noise_freedom == pytest.approx(3.0, rel=1e-2)
    assert optimum.chi_square == pytest.approx(3.0, rel=1e-2)
    wide = optimum.likelihood.residuals(np.ones(5))
    assert wide == pytest.approx(np.full(5, SIGMA * (10.0 / 3.0) ** 0.5), rel=1e-2)
    # the scatter is that of five rows of one size, whatever is asked of the two
    seen = np.linalg.inv(np.diag([5.0, 10.0])) * 10.0 / 3.0
    assert optimum.freedom_along(np.array([1.0, 0.0]), seen) == pytest.approx(3.0, rel=1e-2)
    for lost in (np.array([1.0, np.nan]), np.full(2, np.inf)):
        assert optimum.freedom_along(lost, seen) == optimum.noise_freedom


# --- many at a time


def counting(rounds: int) -> Task[int]:
    """As many rounds; how many were answered, negative where there were no more."""
    done = 0
    try:
        for _ in range(rounds):
            yield Request((np.zeros(1),))
            done += 1
    except Exhausted:
        return -done
    return done


def test_tasks_side_by_side_are_asked_in_one_batch_and_told_when_there_is_no_more() -> None:
    def hard() -> Task[int]:
        while True:
            yield Request((np.zeros(1),))

    batches: list[int] = []

    def evaluate(requests: Any) -> Any:
        if len(batches) == 3:
            raise Exhausted
        batches.append(len(requests))
        return [[] for _ in requests]

    found = run_in_lockstep([counting(1), counting(0), counting(9), hard()], evaluate)
    assert found == [1, 0, -3, None]
    assert batches == [3, 2, 2]
