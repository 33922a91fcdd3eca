"""Levels whose minima are known by hand, and other solvers as referees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares, linprog

from fitting.campaign.parameters import search_bounds
from fitting.fit.interior_point import inside, second_value, solve
from fitting.fit.objective import Evaluator, Objective, make_objective, total
from fitting.fit.path import own_start
from fitting.text.errors import FmuFailure
from tests.support import closed_form
from tests.support.rows import rows_evaluator

B = np.array([1.0, 2.0, 10.0])


def three(lower: float = -9.0, upper: float = 9.0) -> Evaluator:
    """Rows x - 1, x - 2, x - 10."""
    return rows_evaluator(lambda p: p[0] - B, [lower], [upper])


def exact(misfit: str, nu: float) -> float:
    """The minimum in closed form."""
    if misfit == "squares":  # 2 sum (x - b) + nu x = 0
        return 2.0 * float(np.sum(B)) / (6.0 + nu)
    # between kinks nu x is the number of rows above less those below
    return {0.0: 2.0, 0.5: 2.0, 0.8: 1.25, 4.0: 0.75}[nu]


@pytest.mark.parametrize("misfit", ["slack", "absolute", "squares"])
@pytest.mark.parametrize("nu", [0.0, 0.5, 0.8, 4.0])
def test_the_minimum_is_that_of_the_closed_form(misfit: str, nu: float) -> None:
    evaluator = three()
    end = solve(evaluator, np.array([-2.0]), nu, misfit)
    x = exact(misfit, nu)
    least = total(evaluator.point(np.array([x])), nu, misfit)
    assert end.converged
    assert 0 < end.iterations <= 40
    assert end.value == total(evaluator.point(end.x), nu, misfit)
    assert least - 1e-12 <= end.value <= least * (1.0 + 1e-5) + 1e-9
    assert end.x == pytest.approx([x], abs=1e-2)


@pytest.mark.parametrize("misfit", ["slack", "squares"])
@pytest.mark.parametrize("upper", [0.9, 1.5])
def test_a_bound_that_is_met_holds(misfit: str, upper: float) -> None:
    end = solve(three(upper=upper), np.array([-1.0]), 0.0, misfit)
    assert end.x[0] <= upper
    assert end.x == pytest.approx([upper], abs=2e-3)


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
    moved = inside(np.zeros(2), np.array(lower), np.array(upper))
    assert moved == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize("misfit", ["slack", "squares"])
def test_one_iterate_is_never_worse_than_the_start(misfit: str) -> None:
    """From the minimum itself, which the barrier drives the first iterates away from."""
    evaluator, x = three(), np.array([exact(misfit, 0.8)])
    end = solve(evaluator, x, 0.8, misfit, iterations=1)
    assert not end.converged
    assert end.value <= total(evaluator.point(x), 0.8, misfit)


@pytest.mark.parametrize("misfit", ["slack", "squares"])
def test_solvers_turn_away_from_where_the_model_fails(misfit: str) -> None:
    """Steps along arctan overshoot its zero at -1, and the model ends half a unit beyond."""

    def rows(p: np.ndarray) -> np.ndarray:
        if p[0] < -1.5:
            raise FmuFailure("no motion", {"a": float(p[0])}, Path("test.fmu"))
        return np.repeat(np.arctan(p[0] + 1.0), 3)

    evaluator, start = rows_evaluator(rows, [-99.0], [99.0]), np.array([2.0])
    end = solve(evaluator, start, 0.0, misfit)
    assert end.x == pytest.approx([-1.0], abs=0.02)
    begun = total(evaluator.point(start), 0.0, misfit)
    assert second_value(evaluator, start, 0.0, misfit) < 0.5 * begun
    here, away = evaluator.trials([start, np.array([-2.0])])
    assert total(here, 0.0, misfit) == begun
    assert total(away, 0.0, misfit) > 1e140
    with pytest.raises(FmuFailure, match="no motion"):
        solve(evaluator, np.array([-2.0]), 0.0, misfit)


def test_there_is_one_jacobian_for_each_iterate() -> None:
    evaluator = three()
    end = solve(evaluator, np.array([-2.0]), 0.5, "slack")
    assert evaluator.counts.jacobians <= end.iterations + 1


def string(noise: float = 0.01) -> Objective:
    measured = closed_form.measured_by(closed_form.string_response(), noise=noise)
    response = closed_form.string_response()
    return make_objective(response, closed_form.string_parameters(), measured)


def by_linear_programs(evaluator: Evaluator, x: np.ndarray, nu: float) -> float:
    """Least sum of absolute values by sequential linear programs in a trust region."""
    radius, value = 0.3, total(evaluator.point(x), nu, "slack")
    m = evaluator.point(x).residuals.size
    for _ in range(400):
        r, matrix = evaluator.point(x).residuals, evaluator.jacobian(x)
        cost = np.concatenate([nu * x, np.ones(m)])
        a = np.block([[matrix, -np.eye(m)], [-matrix, -np.eye(m)]])
        box = [
            (max(-radius, lo - xi), min(radius, hi - xi))
            for lo, hi, xi in zip(evaluator.lower, evaluator.upper, x, strict=True)
        ]
        answer = linprog(cost, a, np.concatenate([-r, r]), bounds=[*box, *[(0, None)] * m])
        trial = np.clip(x + answer.x[: x.size], evaluator.lower, evaluator.upper)
        reached = total(evaluator.point(trial), nu, "slack")
        if reached < value:
            x, value, radius = trial, reached, min(1.0, 2.0 * radius)
        else:
            radius *= 0.5
        if radius < 1e-8:
            break
    return value


@pytest.mark.parametrize("nu", [0.1, 1e-3])
def test_two_other_solvers_come_by_nothing_lower(nu: float) -> None:
    objective = string()
    evaluator = Evaluator(objective)
    end = solve(evaluator, own_start(objective.parameters), nu, "slack", iterations=100)
    programs = min(by_linear_programs(evaluator, x, nu) for x in (end.x, np.zeros(3)))
    assert end.value <= programs * (1.0 + 1e-4)
    assert end.value <= second_value(evaluator, end.x, nu, "slack") * (1.0 + 1e-4)


def test_squares_agree_with_least_squares() -> None:
    objective = string()
    evaluator, nu = Evaluator(objective), 0.1
    end = solve(evaluator, np.array([-0.5, 0.3, 0.3]), nu, "squares")

    def rows(x: np.ndarray) -> np.ndarray:
        return np.concatenate([evaluator.point(x.copy()).residuals, np.sqrt(nu / 2) * x])

    bounds = search_bounds(objective.parameters)
    truth = least_squares(rows, np.zeros(3), bounds=bounds, xtol=1e-14, ftol=1e-15, gtol=1e-14)
    assert end.value == pytest.approx(2 * truth.cost, rel=1e-5, abs=1e-10)


@pytest.mark.parametrize("misfit", ["slack", "squares"])
def test_the_second_solver_sees_what_is_not_minimised(misfit: str) -> None:
    evaluator, x = three(), np.array([6.0])
    here = total(evaluator.point(x), 0.5, misfit)
    least = total(evaluator.point(np.array([exact(misfit, 0.5)])), 0.5, misfit)
    second = second_value(evaluator, x, 0.5, misfit)
    assert least - 1e-12 <= second <= least + 0.01 * (here - least)
    at_least = np.array([exact(misfit, 0.5)])
    assert second_value(evaluator, at_least, 0.5, misfit) == pytest.approx(least, rel=1e-9)


def test_curvature_finds_the_last_digits_of_a_smooth_minimum() -> None:
    """Rows (x - 1)^2 + 1 and y - 2 beside the term of nu: no corner holds x."""
    evaluator = rows_evaluator(
        lambda p: np.array([(p[0] - 1.0) ** 2 + 1.0, p[1] - 2.0]), [-9.0, -9.0], [9.0, 9.0]
    )
    start = np.array([-3.0, 0.0])
    end = solve(evaluator, start, 0.1, "slack", iterations=100, curved=True)
    assert end.x == pytest.approx([2.0 / 2.1, 2.0], abs=1e-3)  # 2 (x - 1) + 0.1 x = 0
    straight = solve(evaluator, start, 0.1, "slack", iterations=100)
    assert end.value <= straight.value + 1e-9


def test_a_bent_row_does_not_hold_the_iterates() -> None:
    """Along y = x^2 the first row vanishes; J falls along the valley to x = 3 alone."""
    rows = lambda p: np.array([20.0 * (p[1] - p[0] ** 2), 0.1 * (p[0] - 3.0)])  # noqa: E731
    evaluator = rows_evaluator(rows, [-5.0, -20.0], [5.0, 20.0])
    end = solve(evaluator, np.array([0.0, 0.0]), 1e-9, "slack", iterations=100)
    assert end.value < 0.5 * total(evaluator.point(np.array([0.0, 0.0])), 1e-9, "slack")


def test_parameters_beyond_no_bound_are_asked_for() -> None:
    objective = string()
    lower, upper = search_bounds(objective.parameters)
    asked: list[np.ndarray] = []

    class Watching(closed_form.ClosedFormResponse):
        def evaluate_many(self, ps, *, whole=False):  # type: ignore[no-untyped-def]
            asked.extend(ps)
            return super().evaluate_many(ps, whole=whole)

    watched = replace(objective, response=Watching(**vars(objective.response)))
    evaluator = Evaluator(watched)
    solve(evaluator, own_start(objective.parameters), 1e-3, "slack")
    scale = np.array([p.scale for p in objective.parameters])
    reference = np.array([p.reference for p in objective.parameters])
    places = (np.array(asked) - reference) / scale
    assert np.all(places >= lower - 1e-9)
    assert np.all(places <= upper + 1e-9)
