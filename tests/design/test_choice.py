"""Choosing measurements: exhaustive search, textbook optimal designs, hand computation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.design.weighing import DesignProblem, choose, losses, ordered, target_sigmas
from fitting.text.choices import CRITERIA
from tests.support.exhaustive import exhaustive


def of_rows(
    rows: np.ndarray,
    gradients: np.ndarray,
    prior: float = 1.0,
    costs: np.ndarray | None = None,
    shown: int | None = None,
) -> DesignProblem:
    """One point, one row of unit variance per candidate."""
    n = rows.shape[1]
    gains = np.einsum("ci,cj->cij", rows, rows)[np.newaxis]
    return DesignProblem(
        base=prior * np.eye(n)[np.newaxis],
        gains=gains,
        gradients=gradients[np.newaxis],
        shown=n if shown is None else shown,
        costs=np.ones(len(rows)) if costs is None else costs,
    )


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("seed", range(5))
def test_nine_tenths_of_the_best(criterion: str, seed: int) -> None:
    """Of the best of all choices."""
    rng = np.random.default_rng(seed)
    problem = of_rows(4.0 * rng.standard_normal((12, 3)), rng.standard_normal(3), prior=0.3)

    def value(chosen: list[int]) -> float:
        return float(losses(problem, problem.information(chosen), criterion))

    best = value(exhaustive(problem, 4, criterion))
    assert math.exp(best - value(choose(problem, 4, criterion))) >= 0.97


def test_the_ends_of_a_line() -> None:
    """The D-optimal design of a straight line on [-1, 1] is half at either end (Kiefer)."""
    x = np.linspace(-1.0, 1.0, 11)
    rows = 30.0 * np.column_stack([np.ones_like(x), x])
    problem = of_rows(rows, np.array([0.0, 1.0]), prior=1e-6)
    assert sorted(choose(problem, 6, "D")) == [0, 0, 0, 10, 10, 10]


def test_a_parabola_wants_its_middle_too() -> None:
    """D-optimal for a parabola: a third each at -1, 0, 1."""
    x = np.linspace(-1.0, 1.0, 9)
    rows = 30.0 * np.column_stack([np.ones_like(x), x, x**2])
    problem = of_rows(rows, np.array([0.0, 1.0, 0.0]), prior=1e-6)
    assert sorted(choose(problem, 6, "D")) == [0, 0, 4, 4, 8, 8]


def test_two_that_help_only_together_are_found() -> None:
    """x0 + x1 and x1 say nothing about x0 - each alone - against two decoys that say a little."""
    rows = np.array([[300.0, 300.0], [0.0, 300.0], [0.8, 0.0], [0.8, 0.0]])
    problem = of_rows(rows, np.array([1.0, 0.0]))
    assert sorted(choose(problem, 2, "target")) == [0, 1]
    expected = math.sqrt(np.linalg.inv(np.eye(2) + rows[:2].T @ rows[:2])[0, 0])
    assert target_sigmas(problem, problem.information([0, 1]))[0] == pytest.approx(expected)


def test_the_cheaper_of_two_alike() -> None:
    rows = np.array([[10.0, 0.0], [10.01, 0.0], [0.0, 1.0]])
    problem = of_rows(rows, np.array([1.0, 0.0]), costs=np.array([1.0, 100.0, 1.0]))
    assert choose(problem, 2, "target") == [0, 0]


def test_what_adds_most_comes_first() -> None:
    rows = np.array([[1.0, 0.0], [9.0, 0.0], [3.0, 0.0]])
    problem = of_rows(rows, np.array([1.0, 0.0]))
    assert ordered(problem, [0, 2, 1], "target") == [1, 2, 0]


def test_a_nuisance_is_eliminated_not_counted() -> None:
    """Rows (1, 1) hold x0 only as far as the nuisance x1 is held: by its prior, of variance one."""
    rows = np.array([[1e4, 1e4]])
    problem = of_rows(rows, np.array([1.0, 0.0]), shown=1)
    # x0 has prior 1 and is measured as x0 + x1 = known: variance of x0 is 1/2
    assert losses(problem, problem.information([0]), "D") == pytest.approx(0.5 * math.log(0.5))
    assert losses(problem, problem.information([0]), "A") == pytest.approx(0.5 * math.log(0.5))


def test_points_without_a_gradient_are_left_out() -> None:
    rows = np.array([[3.0, 0.0], [0.0, 3.0]])
    one = of_rows(rows, np.array([1.0, 0.0]))
    both = DesignProblem(
        base=np.repeat(one.base, 2, axis=0),
        gains=np.repeat(one.gains, 2, axis=0),
        gradients=np.array([[1.0, 0.0], [np.nan, np.nan]]),
        shown=2,
        costs=one.costs,
    )
    assert choose(both, 1, "target") == choose(one, 1, "target") == [0]
    assert np.isnan(target_sigmas(both, both.base)[1])
    nowhere = DesignProblem(
        base=one.base, gains=one.gains, gradients=np.full((1, 2), np.nan), shown=2, costs=one.costs
    )
    with pytest.raises(ValueError, match="gradient"):
        choose(nowhere, 1, "target")
