"""Equal solutions of values that have a prior of their own: found, listed, and verdicts bear them.

A prior wider than what the data leave of a value chooses between two solutions no better than its
own chi square does: while that is below 3.84 both are in a 95 % region.
"""

from __future__ import annotations

import numpy as np
import pytest

from fitting.fit.fit import solve_problem
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Evaluator, Objective, make_objective
from fitting.fit.options import Options, Schedule
from fitting.fit.problem import Problem
from fitting.fit.search import Box, search_box
from fitting.fit.twins import find_twins, twins_but_for_priors
from fitting.inference.infer import infer
from fitting.inference.likelihood.knowledge import Determined
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Verdict
from tests.support.datasets import dataset
from tests.support.rows import RowsResponse
from tests.support.whitened import SIGMA, learnt, parameter, whitened

#: Of the square: its size at the truth, and the error of that size.
TRUE, ERROR = 0.8, 0.05


def square(p: FloatArray) -> FloatArray:
    """Rows of a^2 and r: a and -a are one to them."""
    return np.array([(p[0] ** 2 - TRUE**2) / ERROR, (p[1] - 2.0) / 0.1, 0.3])


A = parameter("a", -3.0, 3.0, start=0.5, prior=1.8)
R = parameter("r", 0.2, 10.0, start=1.0)


def values(determined: Determined, name: str) -> list[float]:
    """Values at the fits that are as good, within 95 %."""
    assert all(other.delta < 3.84 for other in determined.knowledge.equivalents)
    return [other.parameters[name] for other in determined.knowledge.equivalents]


@pytest.mark.parametrize("prior", [0.9, 1.8, 20.0])
def test_the_other_sign_is_listed_however_wide_the_prior_is(prior: float) -> None:
    """(0.5 + 0.8)^2 - (0.5 - 0.8)^2 = 1.6 over the prior variance is what the other costs."""
    own = parameter("a", -3.0, 3.0, start=0.5, prior=prior)
    determined = learnt(whitened(square, own, R))
    assert values(determined, "a") == pytest.approx([-TRUE], abs=0.05)
    [delta, *_] = [other.delta for other in determined.knowledge.equivalents]
    assert delta == pytest.approx(1.6 / prior**2, rel=0.05, abs=0.01)
    assert determined.parameters["a"].status is Verdict.SEVERAL
    assert determined.parameters["r"].status is Verdict.DETERMINED


def test_a_prior_that_excludes_the_other_sign_determines_the_value() -> None:
    own = parameter("a", -3.0, 3.0, start=0.5, prior=0.2)
    determined = learnt(whitened(square, own, R))
    assert values(determined, "a") == []
    assert determined.parameters["a"].status is Verdict.DETERMINED


def test_two_values_exchanged_are_listed_where_one_of_them_has_a_prior() -> None:
    def rows(p: FloatArray) -> FloatArray:
        return np.array([(p[0] + p[1] - 10.0) / 0.2, (p[0] * p[1] - 21.0) / 0.5, 0.3])

    one = parameter("p1", 0.0, 20.0, start=7.5, prior=4.0)
    other = parameter("p2", 0.0, 20.0, start=2.0)
    determined = learnt(whitened(rows, one, other))
    assert values(determined, "p1") == pytest.approx([3.0], abs=0.2)
    assert values(determined, "p2") == pytest.approx([7.0], abs=0.2)


def test_a_second_solution_without_any_symmetry_is_listed() -> None:
    """(a - 0.8)(a - 2.1): no reversal and no exchange leads from one root to the other."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([(p[0] - 0.8) * (p[0] - 2.1) / ERROR, (p[1] - 2.0) / 0.1, 0.3])

    determined = learnt(whitened(rows, A, R))
    [best] = [determined.parameters["a"].likely]
    assert sorted([best, *values(determined, "a")]) == pytest.approx([0.8, 2.1], abs=0.06)


def problem() -> Problem:
    """The square as a problem of three peaks."""
    return Problem((A, R), dataset(np.ones(3), np.full(3, SIGMA), weigh=True))


def test_a_whole_fit_lists_it_too() -> None:
    response = RowsResponse(lambda p: SIGMA * square(p))
    fit = solve_problem(problem(), lambda chosen: response, Options(schedule=Schedule(starts=2)))
    inferred = infer(fit)
    knowledge = inferred.knowledge
    assert knowledge is not None
    [finding] = [f for f in inferred.findings if f.kind == "equivalent_solution"]
    assert (finding.severity, finding.subject) == ("warning", "a")
    assert finding.numbers["a"] == pytest.approx(-knowledge.most_likely["a"], abs=0.06)
    assert finding.numbers["delta_chi2"] < 3.84
    both = [knowledge.most_likely["a"], *(e.parameters["a"] for e in knowledge.equivalents)]
    assert sorted(both) == pytest.approx([-TRUE, TRUE], abs=0.06)


def evaluator_of(objective: Objective) -> LikelihoodEvaluator:
    size = objective.data.sigma.size
    return LikelihoodEvaluator(
        likelihood_of(objective, RowNoise(np.full(size, SIGMA), np.zeros((size, 0))))
    )


def test_a_search_of_the_box_goes_through_both_signs() -> None:
    evaluator = evaluator_of(whitened(square, A, R))
    minima, _ = search_box(evaluator, [np.array([0.3, 1.0])], 1, 10**6)
    at = sorted(0.5 + minimum.x[0] for minimum in minima)  # x is counted from the reference
    assert at == pytest.approx([-TRUE, TRUE], abs=0.06)


def test_what_is_searched_of_a_prior_ends_where_it_excludes() -> None:
    """Three standard deviations, and never beyond the bounds."""
    narrow = parameter("n", -10.0, 10.0, start=2.0, prior=0.5)
    points = np.array(Box((narrow, A)).spread(64, 1)) + np.array([2.0, 0.5])
    assert points.min(axis=0) == pytest.approx([0.5, -3.0], abs=0.2)
    assert points.max(axis=0) == pytest.approx([3.5, 3.0], abs=0.2)


def test_an_offset_of_one_experiment_that_a_prior_holds_stays_where_it_is() -> None:
    """There are as many as experiments: each would double what is searched."""
    offset = parameter(
        "offset", -50.0, 50.0, prior=10.0, experiment="e1", adds_to=("f",), variable="f"
    )
    scale = parameter("scale", -50.0, 50.0, prior=10.0, role="scale")
    assert list(Box((A, offset, scale)).free) == [True, False, False]


def test_symmetries_that_a_prior_breaks_are_none_of_the_fit() -> None:
    """What J is made of they change; where other minima may be they tell all the same."""
    objective = make_objective(RowsResponse(square), (A, R), dataset(np.ones(3), np.full(3, SIGMA)))
    assert find_twins(Evaluator(objective), seed=1) == []
    [twin] = twins_but_for_priors(Evaluator(objective), seed=1)
    assert twin.signs.tolist() == [-1.0, 1.0]
