"""One alternative on double wells: which minima are looked for, and which is reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from fitting.campaign.parameters import to_model
from fitting.fit import alternative
from fitting.fit.alternative import (
    Outcome,
    best_alternative,
    chi_squares,
    search_alternative,
    with_values,
)
from fitting.fit.objective import Objective
from fitting.fit.options import Schedule
from fitting.fit.search import Minimum, SearchResult
from fitting.fit.twins import Twin
from fitting.text.arrays import FloatArray
from tests.support.rows import RowsResponse, rows_objective
from tests.support.whitened import parameter, whitened


def wells(left: float, right: float, start: float) -> Objective:
    """Minima at -2 and 2, where so many sigmas are left in one row; the reference is the start."""

    def rows(p: FloatArray) -> FloatArray:
        # straight between the two heights: the first row holds p at its wells far more sharply
        return np.array([300.0 * (p[0] ** 2 - 4.0), left + (right - left) * (p[0] + 2.0) / 4.0])

    return whitened(rows, parameter("p", -6.0, 6.0, start=start, reference=start))


def searched(objective: Objective, starts: int = 3) -> Outcome:
    return search_alternative(objective, Schedule(starts=starts))


def place(objective: Objective, x: FloatArray) -> float:
    return float(to_model(objective.parameters, x)[0])


def test_a_lower_minimum_elsewhere_is_reported() -> None:
    objective = wells(3.0, 1.0, -3.0)
    outcome = searched(objective)
    assert place(objective, outcome.x) == pytest.approx(2.0, abs=1e-2)
    assert outcome.converged
    assert outcome.search is not None
    assert sorted(round(place(objective, m.x)) for m in outcome.minima) == [-2, 2]
    assert outcome.counts.evaluations > outcome.search.evaluations > 0
    assert not outcome.interrupted


@pytest.mark.parametrize(("left", "searches"), [(1.0, False), (5.0, True)])
def test_one_start_searches_where_noise_does_not_explain_its_end(
    left: float, searches: bool
) -> None:
    """One sigma, and five, are left of two rows; the other well has none."""
    objective = wells(left, 0.0, -3.0)
    outcome = searched(objective, starts=1)
    assert (outcome.search is not None) is searches
    end = 2.0 if searches else -2.0
    assert place(objective, outcome.x) == pytest.approx(end, abs=1e-2)


def test_of_minima_that_are_as_likely_that_from_the_reference_is_reported() -> None:
    rows = lambda p: np.array([300.0 * (p[0] ** 2 - 4.0), 1.0])  # noqa: E731
    for reference in (-2.5, 2.5):
        objective = whitened(rows, parameter("p", -6.0, 6.0, start=-reference, reference=reference))
        end = 2.0 * np.sign(reference)
        assert place(objective, searched(objective).x) == pytest.approx(end, abs=1e-2)


def test_what_mirrors_a_solved_alternative_takes_its_search_over() -> None:
    first = wells(3.0, 1.0, 0.0)
    outcome = searched(first)
    mirrored = search_alternative(wells(1.0, 3.0, 0.0), Schedule(), [outcome])
    assert mirrored.search is not None
    assert outcome.search is not None
    assert (mirrored.search.evaluations, mirrored.search.fmu_runs) == (0, 0)
    assert len(mirrored.minima) == len(outcome.minima)
    assert mirrored.x == pytest.approx(-outcome.x)
    assert mirrored.converged


def test_an_interruption_ends_with_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*given: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(alternative, "search_box", stop)
    objective = wells(3.0, 1.0, -3.0)
    outcome = searched(objective)
    assert outcome.interrupted
    assert place(objective, outcome.x) == pytest.approx(-2.0, abs=1e-2)
    assert outcome.search is None


# --- which of several is reported


class ValuedWhereNegative(RowsResponse):
    """Its output is the root of -x."""

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        with np.errstate(invalid="ignore"):
            return [{"root": np.sqrt(np.array([-p[0]])), "own": p[:1]} for p in ps]


def even() -> Objective:
    rows = lambda p: np.array([p[0] ** 2 - 4.0, 0.1])  # noqa: E731
    return replace(rows_objective(rows, [-5.0], [5.0]), response=ValuedWhereNegative(rows))


def at(x: float, *others: tuple[float, float], twin: Twin | None = None) -> Outcome:
    """An end, other minima with their chi square, and a symmetry."""
    minima = tuple(
        Minimum(x=np.array([y]), start=np.array([y]), chi_square=square) for y, square in others
    )
    search = SearchResult(
        screened=1,
        screens=1,
        descents=1,
        explained=True,
        evaluations=1,
        fmu_runs=1,
    )
    return Outcome(
        objective=even(),
        x=np.array([x]),
        search=search if others else None,
        minima=minima,
        twins=() if twin is None else (twin,),
    )


def test_an_equivalent_end_at_which_every_output_has_a_value_comes_first() -> None:
    def end(outcome: Outcome) -> float:
        return float(with_values(outcome).x[0])

    assert end(at(-2.0, (2.0, 4.0), (-2.0, 4.0))) == -2.0
    assert end(at(2.0, (2.0, 4.0), (-1.9, 4.0))) == -1.9
    assert end(at(2.0, (2.0, 4.0), (-1.9, 4.1))) == 2.0  # less likely
    assert end(at(2.0)) == 2.0
    twin = Twin(np.array([0]), np.array([-1.0]), np.array([0.0]))
    assert end(at(2.0, (2.0, 4.0), (-1.9, 4.0), twin=twin)) == -2.0
    shifted = Twin(np.array([0]), np.array([-1.0]), np.array([-4.0]))
    assert end(at(2.0, twin=shifted)) == 2.0  # its image is outside of the bounds


@pytest.mark.parametrize(
    ("values", "complete", "best"),
    [
        ([5.0, 4.0], [True, False], 1),
        ([4.0, 5.0], [False, True], 0),
        ([4.0, 4.0], [True, True], 0),
        ([4.0, 4.0], [False, True], 1),
        ([4.0, 4.04], [False, True], 1),  # the same but for rounding
        ([4.0, 4.06], [False, True], 0),
        ([6.0, 5.0, 4.0], [True, True, True], 2),
    ],
)
def test_the_least_chi_square_counts_then_values_then_the_order(
    values: list[float], complete: list[bool], best: int
) -> None:
    assert best_alternative(values, complete) == best


def test_alternatives_are_compared_by_the_noise_of_the_first() -> None:
    """Noise that nobody stated is the scatter of two rows: 0.05 each, and twice that."""
    near = rows_objective(lambda p: np.array([0.05, -0.05]), [-1.0], [1.0])
    far = rows_objective(lambda p: np.array([0.1, -0.1]), [-1.0], [1.0])
    values, points = chi_squares([Outcome(objective=o, x=np.zeros(1)) for o in (near, far)])
    assert values[1] == pytest.approx(4.0 * values[0])
    assert points[1].residuals == pytest.approx([0.1, -0.1])
