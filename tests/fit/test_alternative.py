"""One alternative on double wells: which minima of the box are lowered, and which is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.fit.alternative import Outcome, Solved, run_alternative, with_starts
from fitting.fit.objective import Objective, evaluate_many
from fitting.fit.solver.continuation import Course, Journal, Schedule
from fitting.fit.solver.interior_point import SolveSettings
from fitting.text.arrays import FloatArray
from tests.support.whitened import SIGMA, parameter, whitened

SETTINGS = SolveSettings()


def wells(left: float, right: float, start: float) -> Objective:
    """Minima at -2 and 2, where so many sigmas are left in one row."""

    def rows(p: FloatArray) -> FloatArray:
        # straight between the two heights: the first row holds p at its wells far more sharply
        return np.array([300.0 * (p[0] ** 2 - 4.0), left + (right - left) * (p[0] + 2.0) / 4.0])

    return whitened(rows, parameter("p", -6.0, 6.0, start=start, reference=0.0))


def course(left: float, right: float, start: float, **told: int) -> Course:
    schedule = Schedule(nu_start=1e-8, levels=1, **{"starts": 3, **told})
    return Course(objective=wells(left, right, start), schedule=schedule, settings=SETTINGS)


def ends(outcome: Outcome) -> list[float]:
    return [round(chain.steps[-1].x[0], 2) for chain in outcome.chains]


def test_a_lower_minimum_elsewhere_is_lowered_and_reported() -> None:
    outcome = run_alternative(course(9.0, 5.0, -3.0))
    assert ends(outcome) == [-2.0, 2.0]
    assert outcome.best is outcome.chains[1]
    assert outcome.best.steps[-1].j == pytest.approx(5.0 * SIGMA, rel=1e-3)
    assert outcome.search is not None
    assert outcome.further.evaluations >= outcome.search.evaluations
    assert not outcome.interrupted


def test_one_start_is_no_search() -> None:
    outcome = run_alternative(course(9.0, 5.0, -3.0, starts=1))
    assert ends(outcome) == [-2.0]
    assert outcome.search is None


def test_what_noise_does_not_explain_is_searched_for_twelve_times_what_algorithm_2_took() -> None:
    """Both wells are left with sigmas that nothing lowers."""
    outcome = run_alternative(course(9.0, 5.0, -3.0))
    assert outcome.search is not None
    assert not outcome.search.explained
    own = sum(step.evaluations for step in outcome.chains[0].steps)
    assert outcome.search.evaluations >= 12 * own


@pytest.mark.parametrize(("right", "lowered"), [(9.0, True), (12.0, False)])
def test_a_minimum_of_twice_the_least_is_not_lowered(right: float, lowered: bool) -> None:
    """Twice 5 and a tenth of the noise of two rows: 10.2 sigmas."""
    outcome = run_alternative(course(5.0, right, -3.0))
    assert ends(outcome) == [-2.0, *([2.0] if lowered else [])]
    assert outcome.best is outcome.chains[0]


def test_two_starts_are_the_campaigns_own_and_one_more() -> None:
    """Four wells at -3, -1, 1, 3: of three others two are lowered with three starts."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([30.0 * (p[0] ** 2 - 1.0) * (p[0] ** 2 - 9.0), 5.0 + 0.1 * p[0]])

    objective = whitened(rows, parameter("p", -6.0, 6.0, start=1.2, reference=0.0))
    for starts, count in ((2, 2), (3, 3)):
        outcome = run_alternative(
            Course(
                objective=objective,
                schedule=Schedule(nu_start=1e-8, levels=1, starts=starts),
                settings=SETTINGS,
            )
        )
        assert len(outcome.chains) == count
        assert outcome.chains[0].steps[-1].x[0] == pytest.approx(1.0, abs=1e-2)
        # the lowest of all: chi^2 of 4.7^2 at -3
        assert outcome.chains[1].steps[-1].x[0] == pytest.approx(-3.0, abs=1e-2)


def test_minima_as_likely_as_the_lowest_are_lowered_whatever_their_misfit() -> None:
    """Chi square of 8 in all three: one row of 2.8 sigmas at -2, 8 rows of one each at 2 and 5.

    2.8 times the misfit of the campaign's own, as an error that all peaks share makes it.
    """

    def rows(p: FloatArray) -> FloatArray:
        along = (p[0] + 2.0) * (p[0] - 9.0) / -28.0  # 0 at -2; 1 at 2 and 5
        well = 300.0 * (p[0] + 2.0) * (p[0] - 2.0) * (p[0] - 5.0)
        return np.array([well, 8.0**0.5 * (1.0 - along), *([along] * 8)])

    objective = whitened(rows, parameter("p", -4.0, 7.0, start=-2.4, reference=0.0))
    schedule = Schedule(nu_start=1e-8, levels=1, starts=3)
    outcome = run_alternative(Course(objective=objective, schedule=schedule, settings=SETTINGS))
    assert sorted(round(end) for end in ends(outcome)) == [-2, 2, 5]
    assert outcome.best is outcome.chains[0]


def test_further_starts_join_what_is_known_or_are_chains_of_their_own() -> None:
    own = course(9.0, 5.0, -3.0, starts=1)
    outcome = run_alternative(own)
    more = with_starts(own, outcome, [np.array([-2.1]), np.array([1.9])])
    assert ends(more) == [-2.0, -2.0, 2.0]
    assert [chain.joined for chain in more.chains] == [None, 0, None]
    assert more.best is more.chains[2]


def flat(depth: float) -> Objective:
    """Two rows whose sum is the same all along q = 1 to 10^4; a third has a dip at q = 10^3.2.

    Chi square is least at the start, 10^0.8, and rises to nearly twice that: a search of the box
    finds nothing else. J there is 2.1 sigmas, in the dip 2.1 - 0.1 depth but for the
    bowl that holds the start; without a dip there is none.
    """

    def rows(p: FloatArray) -> FloatArray:
        u = np.log10(p[0]) / 4.0
        bowl = 1.0 + 0.1 * (u - 0.2) ** 2 if depth else 1.0
        return np.array(
            [1.2 + u, 0.8 - u, 0.1 * (bowl - depth * np.exp(-0.5 * ((u - 0.8) / 0.05) ** 2))]
        )

    start = 10.0**0.8
    return whitened(rows, parameter("q", 1.0, 1e4, start=start, reference=start, scale=1e3))


@pytest.mark.parametrize(("depth", "found"), [(0.9, 10.0**3.2), (0.0, 10.0**0.8)])
def test_a_dip_far_along_what_leaves_j_flat_is_looked_for(depth: float, found: float) -> None:
    schedule = Schedule(nu_start=1e-12, levels=1)
    outcome = run_alternative(Course(objective=flat(depth), schedule=schedule, settings=SETTINGS))
    assert outcome.best is not None
    assert outcome.best.steps[-1].parameters[0] == pytest.approx(found, rel=0.02)
    # the others came to nothing lower, and are not told as minima of their own
    alone = [chain for chain in outcome.chains if chain.joined is None]
    assert len(alone) == (2 if depth > 0.0 else 1)


def test_an_interruption_ends_with_what_is_done() -> None:
    def entering(*key: int) -> None:
        if key[1] == 1:
            raise KeyboardInterrupt

    whole = course(9.0, 5.0, -3.0)
    outcome = run_alternative(
        Course(
            objective=whole.objective,
            schedule=whole.schedule,
            settings=SETTINGS,
            journal=Journal(entering=entering),
        )
    )
    assert outcome.interrupted
    assert ends(outcome) == [-2.0]
    assert outcome.search is not None


def test_what_mirrors_a_solved_alternative_takes_its_minima_over() -> None:
    first = course(9.0, 5.0, -3.0)
    outcome = run_alternative(first)
    again = run_alternative(first, [Solved(first.objective, outcome)])
    assert again.search is not None
    assert outcome.search is not None
    assert again.search.mirrored
    assert (again.search.evaluations, again.search.runs) == (0, 0)
    assert len(again.search.minima) == len(outcome.search.minima)
    assert ends(again) == ends(outcome)


@pytest.mark.parametrize(("start", "image"), [(3.0, True), (2.5, False)])
def test_algorithm_2_of_a_mirror_image_is_taken_over_where_it_begins_there(
    start: float, image: bool
) -> None:
    """Rows at -p: what the first ended in, from -3, is seen in the second from 3 without a run."""
    first = course(9.0, 5.0, -3.0)
    outcome = run_alternative(first)
    second = replace(course(5.0, 9.0, start), alternative=1)
    mirrored = run_alternative(second, [Solved(first.objective, outcome)])
    own, theirs = mirrored.chains[0].steps[-1], outcome.chains[0].steps[-1]
    assert own.x == pytest.approx([2.0], abs=1e-3)
    assert (own.evaluations == 0) == image
    assert ("alternative 1" in own.message) == image
    assert own.j == pytest.approx(theirs.j, rel=1e-4)
    [there] = evaluate_many(second.objective, [np.array(own.x)])
    assert own.j_fit == pytest.approx(there.j_fit, rel=1e-9)
    assert mirrored.best is not None
    assert mirrored.best.steps[-1].x == pytest.approx([-2.0], abs=1e-3)


def test_the_course_is_told_with_its_places_counted_from_one(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The third alternative: its own start, the search of the box, and one start more."""
    own = replace(course(9.0, 5.0, -3.0), alternative=2)
    with caplog.at_level("INFO", logger="fitting.fit"):
        outcome = run_alternative(own)
    first, searched, second = (record.getMessage() for record in caplog.records)
    assert first.startswith("alternative 3, start 1, ν = 1.0e-08: J = 0.09, ")
    assert searched.startswith("alternative 3: ")
    assert ", 2 minima, " in searched
    assert second.startswith("alternative 3, start 2, ν = 1.0e-08: J = 0.05, ")
    assert len(outcome.chains) == 2
