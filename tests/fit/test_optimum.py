"""The most likely point against closed forms: which minimum it is, wider noise, active bounds."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from fitting.campaign.parameters import to_model
from fitting.fit.levenberg import Constraint, expand
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import noise_of
from fitting.fit.objective import evaluate_many
from fitting.fit.optimum import (
    Optimum,
    active_bounds_at,
    confirmed,
    freedom_of,
    inflation_of,
    most_likely,
    with_central_slopes,
)
from fitting.text.arrays import FloatArray
from fitting.text.errors import OutOfBudget
from tests.support.whitened import SIGMA, evaluator_of, in_box, parameter, whitened


def test_the_lowest_of_several_starts_is_the_most_likely_point() -> None:
    """Rows of a double well, one side of it deeper."""
    rows = lambda p: np.array([(p[0] ** 2 - 4.0), 0.5 * (p[0] - 2.0)])  # noqa: E731
    evaluator = in_box(rows, 1)
    optimum = most_likely(evaluator, [np.array([-3.0]), np.array([3.0])])
    assert optimum.expansion.x == pytest.approx([2.0], abs=0.02)
    assert optimum.converged
    assert optimum.least == pytest.approx(0.0, abs=2e-3)
    assert optimum.likelihood.inflation == 1.0


def test_of_starts_that_are_as_good_the_first_wins() -> None:
    rows = lambda p: np.array([p[0] ** 2 - 4.0, 0.01])  # noqa: E731
    for first in (-3.0, 3.0):
        optimum = most_likely(in_box(rows, 1), [np.array([first]), np.array([-first])])
        assert optimum.expansion.x == pytest.approx([np.sign(first) * 2.0], abs=0.02)


@pytest.mark.parametrize("each", [1.2, 2.0])
def test_residuals_beyond_the_noise_widen_it(each: float) -> None:
    """Ten rows of one size that nothing explains, beside one that fits: chi^2 over 10 of freedom.

    A chi square of 14.4 is usual for ten (p = 0.16), one of 40 is not.
    """
    evaluator = in_box(lambda p: np.append(np.full(10, each), 100.0 * (p[0] - 1.0)), 1)
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
    evaluator = in_box(lambda p: np.array([0.4 * p[0], 30.0 * p[1], 0.0, 0.0]), 2)
    s = np.array([0.4, 30.0]) * 20.0 / 12**0.5
    free = freedom_of(evaluator.likelihood, expand(evaluator, [np.zeros(2)])[0])
    assert free == pytest.approx(4.0 - np.sum(s**2 / (1.0 + s**2)), rel=1e-4)


# --- what a limit holds


def held(
    wanted: float, x: tuple[float, float], besides: tuple[int, ...] = (), **told: Any
) -> tuple[int, ...]:
    """Parameters held at x, of rows x + y - wanted and y - 1 over the box from -10 to 10."""
    evaluator = in_box(
        lambda p: np.array([p[0] + p[1] - wanted, p[1] - 1.0, 0.0]), 2, own=lambda p: p[0]
    )
    [here] = expand(evaluator, [np.array(x)])
    return active_bounds_at(evaluator.likelihood, here, besides, **told)


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
    evaluator = in_box(lambda p: np.array([10.0 * (p[0] / half - 2.0 * side), 0.0]), 1, half)
    for share, limits in ((0.5e-6, (0,)), (2e-6, ())):
        [here] = expand(evaluator, [np.array([side * (1.0 - 2.0 * share) * half])])
        assert active_bounds_at(evaluator.likelihood, here, ()) == limits


def test_a_held_output_counts_among_the_rows() -> None:
    """x is pulled inward by its output more than the data push it outward, or the other way."""
    assert held(12.0, (10.0, 1.5), constraint=Constraint(target=0.0, output=0, weight=5.0)) == ()
    assert held(10.9, (10.0, 1.0), constraint=Constraint(target=30.0, output=0, weight=5.0)) == (0,)


@pytest.mark.parametrize(("target", "limits"), [(10.35, ()), (10.45, (0,)), (9.5, ())])
def test_what_a_held_output_gains_is_in_units_of_the_output(
    target: float, limits: tuple[int, ...]
) -> None:
    """(x - 10)^2/2 + (x - t)^2 falls from (10 - t)^2 by (10 - t)^2/1.5: a tenth for t = 10.387."""
    assert (
        held(11.0, (10.0, 1.0), constraint=Constraint(target=target, output=0, weight=1.0))
        == limits
    )


# --- bounds of the campaign, and of the model


def found_at(wanted: float, **limits: float) -> Optimum:
    """p is measured with unit noise as `wanted`; its box goes from 1 to 10 Hz."""
    own = parameter("p", 1.0, 10.0, unit="Hz", scale=2.0, **limits)
    rows = whitened(lambda p: np.full(3, (p[0] - wanted) / math.sqrt(3.0)), own)
    return most_likely(evaluator_of(rows), [np.zeros(1)])


@pytest.mark.parametrize(("wanted", "end"), [(14.0, 10.0), (-3.0, 1.0), (7.0, 7.0)])
def test_the_most_likely_point_stays_within_the_bounds(wanted: float, end: float) -> None:
    """Chi square there is (14 - 10)^2 or (1 + 3)^2: nothing is looked for beyond."""
    optimum = found_at(wanted)
    assert optimum.converged
    [value] = to_model(optimum.likelihood.parameters, optimum.expansion.x)
    assert value == pytest.approx(end, abs=0.01)
    assert optimum.chi_square == pytest.approx((wanted - end) ** 2, abs=2e-3)


def held_beside(wanted: float, at: float, **limits: float) -> tuple[int, ...]:
    """Parameters held at (at, 0) where p is measured as `wanted`, its box from -10 to 10."""
    p = parameter("p", -10.0, 10.0, **limits)
    q = parameter("q", -10.0, 10.0)
    rows = whitened(lambda x: np.array([x[0] - wanted, x[1], 0.0]), p, q)
    evaluator = evaluator_of(rows)
    [here] = expand(evaluator, [np.array([at, 0.0])])
    return active_bounds_at(evaluator.likelihood, here, ())


def test_a_limit_holds_what_the_data_push_beyond_it() -> None:
    assert held_beside(12.0, 10.0) == (0,)
    assert held_beside(-12.0, -10.0) == (0,)
    assert held_beside(5.0, 10.0) == held_beside(5.0, -10.0) == ()  # pushed inward
    assert held_beside(12.0, 9.0) == ()  # not there
    assert held_beside(10.3, 10.0) == ()  # for a gain of 0.09
    assert held_beside(10.33, 10.0) == (0,)


def test_a_limit_of_the_model_itself_holds_nothing() -> None:
    assert held_beside(12.0, 10.0, most=10.0) == ()
    assert held_beside(-12.0, -10.0, least=-10.0) == ()
    assert held_beside(12.0, 10.0, most=11.0) == (0,)


# --- what it rests on


def test_outputs_and_their_slopes_are_those_of_the_most_likely_point() -> None:
    """x y and x/y at (3, 2): gradients (2, 3) and (1/2, -3/4)."""
    evaluator = in_box(
        lambda p: np.array([100.0 * (p[0] - 3.0), 100.0 * (p[1] - 2.0), 0.0]),
        2,
        product=lambda p: p[0] * p[1],
        ratio=lambda p: p[0] / p[1] if p[1] else math.nan,
    )
    optimum = most_likely(evaluator, [np.array([2.0, 1.0])])
    here = with_central_slopes(evaluator, optimum).expansion
    assert here.sample.outputs == pytest.approx([6.0, 1.5], rel=2e-3)
    a, b = here.x
    # differences have the error of the step squared, whatever slopes the search had at its end
    slopes = np.array([[b, a], [1.0 / b, -a / b**2]])
    assert here.outward == pytest.approx(slopes, rel=1e-5)
    old = replace(optimum, expansion=replace(here, matrix=2.0 * here.matrix, age=3))
    again = with_central_slopes(evaluator, old).expansion
    assert again.matrix == pytest.approx(here.matrix)
    assert again.age == 0


def test_of_a_valley_the_most_likely_point_is_that_of_scipy() -> None:
    """b (1 - exp(-a t)) with scattered data, from far off."""
    t = np.linspace(0.2, 4.0, 12)
    data = 7.0 * (1.0 - np.exp(-0.6 * t)) + 0.05 * np.random.default_rng(1).standard_normal(12)

    def rows(p: FloatArray) -> FloatArray:
        return np.asarray((p[1] * (1.0 - np.exp(-p[0] * t)) - data) / 0.05)

    own = parameter("a", 0.01, 5.0), parameter("b", 0.1, 50.0)
    optimum = most_likely(evaluator_of(whitened(rows, *own)), [np.array([2.0, 20.0])])
    fit = least_squares(rows, [0.5, 6.0], xtol=1e-14, ftol=1e-14, gtol=1e-14)
    errors = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    assert optimum.converged
    assert optimum.chi_square == pytest.approx(2.0 * fit.cost, abs=2e-3)
    assert to_model(own, optimum.expansion.x) == pytest.approx(fit.x, abs=0.02 * min(errors))


def test_a_budget_that_does_not_allow_the_first_slopes_is_refused() -> None:
    evaluator = in_box(lambda p: p - 1.0, 2)
    evaluator.limit = 2
    with pytest.raises(OutOfBudget, match=r"budget: found 2, wanted more: .* 3 evaluations"):
        most_likely(evaluator, [np.zeros(2)])


# --- noise that the residuals tell


def test_without_a_slope_noise_has_the_freedom_of_all_rows() -> None:
    """1, -2, 0, 2, -1 about a straight line: chi square of ten, three degrees of freedom."""
    times, scattered = np.arange(-2.0, 3.0), np.array([1.0, -2.0, 0.0, 2.0, -1.0])
    line = [parameter(name, -10.0, 10.0) for name in ("height", "slope")]
    objective = whitened(lambda p: p[0] + p[1] * times + scattered, *line, known=False)
    [point] = evaluate_many(objective, [np.zeros(2)])
    evaluator = LikelihoodEvaluator(likelihood_of(objective, noise_of(objective, point)))
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


def test_a_staircase_is_descended_by_steps_of_the_noise() -> None:
    """Between its steps it falls where it rises as a whole, as an FMU with events may.

    Its level is 8 k/20 at x = k/20, and 24 was measured five times: x = 3 to a step.
    """

    def rows(p: FloatArray) -> FloatArray:
        k = math.floor(20.0 * p[0])
        return np.full(5, 8.0 * (k / 20.0 - 0.3 * (p[0] - k / 20.0)) - 24.0)

    evaluator = in_box(rows, 1)
    stuck = most_likely(evaluator, [np.array([0.02])])
    assert stuck.expansion.x[0] < 1.0
    assert confirmed(evaluator, stuck).expansion.x[0] == pytest.approx(3.0, abs=0.1)


def test_a_minimum_is_confirmed_by_two_evaluations_for_each_parameter() -> None:
    """Rows that are straight: it is the same one."""
    evaluator = in_box(lambda p: np.array([p[0] - 1.0, 2.0 * p[1] + p[0], p[1]]), 2)
    found = most_likely(evaluator, [np.zeros(2)])
    before = evaluator.evaluations
    assert confirmed(evaluator, found) is found
    assert evaluator.evaluations == before + 4
