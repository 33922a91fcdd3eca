"""Chi square against scipy's normal distributions, what goes round, and the evaluator's counts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from fitting.fit.covariance import BoundedErrors
from fitting.fit.likelihood import (
    MOST_FAILURES,
    Exhausted,
    Likelihood,
    LikelihoodEvaluator,
    Request,
    likelihood_of,
)
from fitting.fit.linearisation import SMALLEST_SIGMA
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from tests.support.rows import rows_objective
from tests.support.whitened import WhitenedResponse, parameter, whitened

GENERATOR = np.random.default_rng(6)
MATRIX = GENERATOR.standard_normal((5, 2))


def straight() -> Objective:
    """Rows 0.01 M x over a box from -10 to 10."""
    return whitened(lambda p: MATRIX @ p, parameter("a", -10.0, 10.0), parameter("b", -10.0, 10.0))


def free(objective: Objective, size: int) -> Likelihood:
    return likelihood_of(objective, RowNoise(np.full(size, 0.01), np.zeros((size, 0))))


@pytest.mark.parametrize("inflation", [1.0, 1.7])
def test_chi_square_is_minus_twice_the_logarithm_of_the_density(inflation: float) -> None:
    """Differences of it, data with errors of their own and shared ones, and a Gaussian prior."""
    sigma = np.array([0.01, 0.02, 0.01, 0.03, 0.015])
    common = 0.02 * GENERATOR.standard_normal((5, 2))
    own = parameter("a", -10.0, 10.0, prior=0.4, scale=2.0), parameter("b", -10.0, 10.0)
    objective = whitened(lambda p: MATRIX @ p, *own)
    likelihood = replace(likelihood_of(objective, RowNoise(sigma, common)), inflation=inflation)
    evaluator = LikelihoodEvaluator(likelihood)
    covariance = inflation**2 * (np.diag(sigma**2) + common @ common.T)
    chi, minus_twice = [], []
    for x in (np.array([0.1, -0.4]), np.array([-0.3, 0.2]), np.zeros(2)):
        p = x * np.array([2.0, 1.0])
        chi.append(float(np.sum(evaluator.one(x).rows ** 2)))
        density = multivariate_normal(np.zeros(5), covariance).logpdf(0.01 * MATRIX @ p)
        minus_twice.append(-2.0 * (density + norm(0.0, 0.4).logpdf(p[0])))
    assert np.diff(chi) == pytest.approx(np.diff(minus_twice), rel=1e-9)
    assert likelihood.data_rows == 5
    back = likelihood.residuals(evaluator.one(np.array([0.1, -0.4])).rows[:5])
    assert back == pytest.approx(0.01 * MATRIX @ np.array([0.2, -0.4]), rel=1e-9)
    assert likelihood.stated.inflation == 1.0


def test_a_shift_is_taken_off_and_rows_are_known_no_better_than_differences() -> None:
    objective = rows_objective(lambda p: np.array([p[0], 2.0 * p[0]]), [-1.0], [1.0])
    own = likelihood_of(objective, RowNoise(np.array([0.1, 0.0]), np.zeros((2, 0))))
    shifted = replace(own, shift=np.array([0.05, 0.0]))
    rows = LikelihoodEvaluator(shifted).one(np.array([0.2])).rows
    assert rows == pytest.approx([1.5, 0.4 / SMALLEST_SIGMA, 0.0], rel=1e-9)
    assert own.bounded.columns == 0
    told = BoundedErrors(np.ones(2), np.zeros((2, 0)))
    kept = likelihood_of(objective, RowNoise(np.ones(2), np.zeros((2, 0)), bounded=told))
    assert kept.bounded is told


def test_what_goes_round_comes_back_and_the_rest_is_cut() -> None:
    turning = parameter("a", 1.0, 5.0, period=2.0, scale=0.5)
    plain = parameter("b", -1.0, 2.0)
    narrow = parameter("c", 0.0, 1.5, period=2.0)
    likelihood = likelihood_of(
        whitened(lambda p: np.zeros(4), turning, plain, narrow),
        RowNoise(np.ones(4), np.zeros((4, 0))),
    )
    # a box of a whole period has no limits, one of less has
    assert likelihood.periods.tolist() == [4.0, math.inf, math.inf]
    assert likelihood.lower.tolist() == [-math.inf, -1.5, -0.75]
    assert likelihood.upper.tolist() == [math.inf, 1.5, 0.75]
    assert likelihood.widths == pytest.approx([4.0, 3.0, 1.5])  # a turn, and two boxes
    # in x, zero at the middle of each box: a from -4 to 4
    for x, wanted in ((3.9, 3.9), (4.1, -3.9), (9.0, -3.0), (-4.5, -0.5), (-8.5, -0.5)):
        assert likelihood.folded(np.array([x, 9.0, -9.0])) == pytest.approx([wanted, 1.5, -0.75])


def test_what_a_model_declares_in_units_of_the_search() -> None:
    own = parameter("a", 1.0, 5.0, least=0.0, most=9.0, scale=0.5)
    likelihood = likelihood_of(
        whitened(lambda p: np.zeros(4), own), RowNoise(np.ones(4), np.zeros((4, 0)))
    )
    least, most = likelihood.declared
    assert (least.tolist(), most.tolist()) == ([-6.0], [12.0])


# --- the evaluator


def requests(count: int, *, rows: bool = True, outputs: bool = False) -> list[Request]:
    return [Request(tuple(np.full(2, 0.1 * k) for k in range(count)), rows=rows, outputs=outputs)]


def test_evaluations_are_counted_and_end_at_the_limit() -> None:
    """Eight are allowed: three, five, and no more; outputs alone cost none."""
    evaluator = LikelihoodEvaluator(free(straight(), 5), limit=8)
    evaluator(requests(3))
    assert evaluator.evaluations == evaluator.spent == 3
    with pytest.raises(Exhausted):
        evaluator(requests(6))
    evaluator(requests(5))
    with pytest.raises(Exhausted):
        evaluator(requests(1))
    evaluator(requests(4, rows=False, outputs=True))
    assert (evaluator.evaluations, evaluator.derived) == (8, 0)  # no output is looked at


def test_runs_count_where_there_are_any() -> None:
    """One run an evaluation is what this response says."""
    objective = rows_objective(lambda p: MATRIX @ p, [-1.0] * 2, [1.0] * 2)
    evaluator = LikelihoodEvaluator(free(objective, 5), limit=4)
    evaluator(requests(3))
    assert evaluator.runs == evaluator.spent == 3
    with pytest.raises(Exhausted):
        evaluator(requests(2))


def test_each_request_is_answered_with_what_it_asks_for() -> None:
    objective = whitened(
        lambda p: MATRIX @ p,
        parameter("a", -10.0, 10.0),
        parameter("b", -10.0, 10.0),
        sum=lambda p: p[0] + p[1],
        product=lambda p: p[0] * p[1],
    )
    likelihood = likelihood_of(
        objective, RowNoise(np.full(5, 0.01), np.zeros((5, 0))), ["product", "sum"]
    )
    evaluator = LikelihoodEvaluator(likelihood)
    x = np.array([2.0, 3.0])
    both, rows, outputs = evaluator(
        [Request((x,)), Request((x, -x), outputs=False), Request((x,), rows=False)]
    )
    assert both[0].outputs == pytest.approx([6.0, 5.0])
    assert both[0].rows[:5] == pytest.approx(MATRIX @ x, rel=1e-9)
    assert [sample.rows.size for sample in rows] == [7, 7]
    assert rows[1].rows[:5] == pytest.approx(-MATRIX @ x, rel=1e-9)
    assert rows[0].outputs.size == 0
    assert outputs[0].rows.size == 0
    assert outputs[0].outputs == pytest.approx([6.0, 5.0])
    assert (evaluator.evaluations, evaluator.derived) == (3, 2)


def refusing_beyond_half() -> LikelihoodEvaluator:
    """A model that fails where its first parameter is above 0.5; the box goes on to 10."""

    def rows(p: FloatArray) -> FloatArray:
        if p[0] > 0.5:
            raise FmuFailure("not positive definite", {}, Path("test.fmu"))
        return MATRIX @ p

    objective = replace(straight(), response=WhitenedResponse(rows))
    return LikelihoodEvaluator(replace(free(objective, 5), upper=np.full(2, 99.0)))


def test_a_model_that_has_answered_nowhere_may_fail_a_dozen_times_in_its_box() -> None:
    evaluator = refusing_beyond_half()
    for _ in range(2 * MOST_FAILURES):  # beyond the box any time
        assert np.all(np.isnan(evaluator.one(np.array([11.0, 0.0])).rows))
    assert evaluator.failures == 0
    for _ in range(MOST_FAILURES):
        assert evaluator.one(np.array([1.0, 0.0])).rows.shape == (7,)
    with pytest.raises(FmuFailure):
        evaluator.one(np.array([1.0, 0.0]))
    assert np.all(np.isfinite(evaluator.one(np.zeros(2)).rows))


def test_a_model_that_answers_somewhere_may_refuse_most_of_its_box() -> None:
    """Coupled modes refuse a coupling beyond their frequencies, however far a box goes."""
    evaluator = refusing_beyond_half()
    points = tuple(np.array([float(k % 16 != 0), 0.0]) for k in range(16 * MOST_FAILURES))
    [answers] = evaluator([Request(points, outputs=False)])
    answered = [bool(np.all(np.isfinite(a.rows))) for a in answers]
    assert answered == [k % 16 == 0 for k in range(16 * MOST_FAILURES)]
    assert evaluator.failures == 15 * MOST_FAILURES
