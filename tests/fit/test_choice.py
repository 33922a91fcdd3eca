"""Which fit is reported, and what rows and misfit are worth: rules by hand, noise by columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from fitting.fit.alternative import Outcome
from fitting.fit.choice import chosen
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Objective, evaluate_many, tikhonov_rows, weights
from fitting.fit.search.twins import Twin
from fitting.fit.solution import Solution, negligible, solution_of
from fitting.fit.solver.continuation import (
    Chain,
    ContinuationStep,
    Schedule,
    equal_j,
    is_lower,
    met,
)
from fitting.fit.solver.evaluator import Evaluator
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation, Prediction
from fitting.signal.scale import Maximum
from fitting.text.arrays import FloatArray
from tests.support.datasets import answer, dataset, peaks_measurement, sweep_measurement
from tests.support.rows import RowsResponse, rows_evaluator, rows_objective
from tests.support.whitened import SIGMA, parameter, whitened


class ValuedWhereNegative(RowsResponse):
    """Its output is the root of -x."""

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        with np.errstate(invalid="ignore"):
            return [{"root": np.sqrt(np.array([-p[0]])), "own": p[:1]} for p in ps]


def objective_of() -> Objective:
    even = rows_objective(lambda p: np.array([p[0] ** 2 - 4.0, 0.1]), [-5.0], [5.0])
    return replace(even, response=ValuedWhereNegative(lambda p: np.array([p[0] ** 2 - 4.0, 0.1])))


def chain(start: int, x: float, j: float, *, nu: float = 1e-9, joined: int | None = None) -> Chain:
    """One level done, its end at x with that J."""
    step = ContinuationStep(
        alternative=0,
        start=start,
        level=8,
        nu=nu,
        x=(x,),
        parameters=(x,),
        j_fit=j,
        j_reg=0.0,
        change=0.0,
        optimality=0.0,
        status="optimal",
        message="done",
        iterations=3,
        evaluations=4,
        jacobians=5,
        runs=6,
        seconds=7.0,
    )
    return Chain(start, (x,), steps=(step,), joined=joined)


def reported(*outcomes: Outcome) -> tuple[list[float | None], int]:
    """Ends that are reported, and the index of the best."""
    found, best = chosen([objective_of()] * len(outcomes), outcomes)
    return [each.best.steps[-1].x[0] if each.best else None for each in found], best


def test_among_equal_chains_one_with_every_value_is_reported() -> None:
    left, right = chain(1, -2.0, 0.5), chain(0, 2.0, 0.5)
    assert reported(Outcome((right, left))) == ([-2.0], 0)
    assert reported(Outcome((left, right))) == ([-2.0], 0)
    # not one that is higher, that joined another, or that stands at another nu
    assert reported(Outcome((right, chain(1, -2.0, 0.52)))) == ([2.0], 0)
    assert reported(Outcome((right, chain(1, -2.0, 0.5, joined=0)))) == ([2.0], 0)
    assert reported(Outcome((right, chain(1, -2.0, 0.5, nu=1e-3)))) == ([2.0], 0)
    assert reported(Outcome((Chain(0, (1.0,)),))) == ([None], 0)


def test_a_twin_of_the_fit_does_where_its_own_end_has_not_every_value() -> None:
    twin = Twin(np.array([0]), np.array([-1.0]), np.array([0.0]))
    outcome = Outcome((chain(0, 2.0, 0.5),), twins=(twin,))
    [found], _ = chosen([objective_of()], [outcome])
    assert found.best is not None
    step = found.best.steps[-1]
    assert (step.x, step.parameters, step.level, step.j) == ((-2.0,), (-2.0,), 9, 0.5)
    assert step.message.startswith("done; ")
    spent = step.iterations, step.evaluations, step.jacobians, step.runs, step.seconds
    assert spent == (0, 0, 0, 0, 0.0)
    assert len(found.best.steps) == 2
    # it comes before chains that are but as good as equal, and of these the lowest before others
    higher, lower = chain(1, -1.0, 0.5002), chain(2, -1.5, 0.5001)
    assert reported(Outcome((chain(0, 2.0, 0.5), higher, lower), twins=(twin,))) == ([-2.0], 0)
    assert reported(Outcome((chain(0, 2.0, 0.5), higher, lower))) == ([-1.5], 0)
    # an image outside of the box is none
    shifted = Twin(np.array([0]), np.array([-1.0]), np.array([-4.0]))
    assert reported(Outcome((chain(0, 2.0, 0.5),), twins=(shifted,))) == ([2.0], 0)


def test_the_least_j_of_alternatives_counts_then_values_then_their_order() -> None:
    def alternatives(*ends: tuple[float, float]) -> int:
        return reported(*(Outcome((chain(0, x, j),)) for x, j in ends))[1]

    assert alternatives((2.0, 0.5), (2.0, 0.4)) == 1
    assert alternatives((2.0, 0.4), (2.0, 0.5)) == 0
    assert alternatives((2.0, 0.5), (2.0, 0.5)) == 0
    assert alternatives((2.0, 0.5), (-2.0, 0.5001)) == 1  # equal, and its root exists
    assert alternatives((-2.0, 0.5), (2.0, 0.4999)) == 0
    assert alternatives((2.0, 0.5), (-2.0, 0.6)) == 0
    assert alternatives((2.0, 0.5), (2.0, 0.45), (2.0, 0.4)) == 2
    none, far = Outcome((Chain(0, (1.0,)),)), Outcome((chain(0, 2.0, 0.1, nu=1e-3),))
    near = Outcome((chain(0, 2.0, 0.9),))
    assert reported(none, near)[1] == 1
    assert reported(near, none)[1] == 0
    assert reported(far, near)[1] == 1  # it has come further
    assert reported(near, far)[1] == 0


@pytest.mark.parametrize(
    ("one", "other", "equal", "lower"),
    [
        (1.0, 1.0009, True, True),
        (1.0, 1.0011, False, True),
        (0.0, 0.9e-6, True, False),
        (0.0, 1.1e-6, False, True),
        (1.0, 1.0 + 1.9e-6, True, False),
        (1.0, 1.0 + 2.1e-6, True, True),
        (2.0, 1.0, False, False),
    ],
)
def test_when_two_values_of_j_are_one(one: float, other: float, equal: bool, lower: bool) -> None:
    assert equal_j(one, other) is equal
    assert equal_j(other, one) is equal
    assert is_lower(one, other) is lower


@pytest.mark.parametrize(
    ("x", "j", "joined"),
    [
        (1.009, 0.4, 0),  # within a hundredth of a unit of the search vector
        (1.011, 0.4, None),
        (0.991, 0.4, 0),
        (1.0, 0.4003, 0),  # and a thousandth of J
        (1.0, 0.4005, None),
        (1.0 + 2.0 * np.pi, 0.4, 0),  # a turn on
        (1.5, 0.4, 0),  # at its twin
        (-1.005, 0.4, None),
    ],
)
def test_a_start_meets_another_where_it_ends_beside_it_at_the_same_j(
    x: float, j: float, joined: int | None
) -> None:
    turning = parameter("t", -9.0, 9.0, period=2.0 * np.pi)
    found = met([turning], chain(2, x, j), [chain(0, 1.0, 0.4), chain(1, -1.0, 0.4, joined=0)])
    if x == 1.5:
        assert found.joined is None
        images = [np.array([7.0]), np.array([1.0])]
        found = met([turning], chain(2, x, j), [chain(0, 1.0, 0.4)], images)
        assert "start 1" in found.ended
        assert "1.0e-09" in found.ended
    assert found.joined == joined


# --- noise of the rows


def noise(measured: Dataset, rows: Callable[[FloatArray], FloatArray]) -> RowNoise:
    own = parameter("p", -1.0, 1.0)
    objective = Objective(
        response=RowsResponse(rows), parameters=(own,), data=measured, steps=np.full(1, 1e-4)
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    return noise_of(objective, point)


def test_known_noise_is_its_own_and_unknown_noise_the_scatter_of_its_rows() -> None:
    rows = lambda p: np.array([0.3, -0.4, 0.0, 0.1])  # noqa: E731
    known = noise(dataset(np.ones(4), np.array([0.1, 0.2, 0.3, 0.4])), rows)
    assert known.sigma == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert known.common.shape == (4, 0)
    assert known.bounded.columns == 0
    mixed = noise(dataset(np.ones(4), np.array([0.0, 0.0, 0.3, 0.4])), rows)
    assert mixed.sigma == pytest.approx([np.sqrt(0.125), np.sqrt(0.125), 0.3, 0.4])


MAXIMUM = Maximum(value=2.0, frequency_hz=2.0, bias=0.0, bracketed=True)


class Scaled(RowsResponse):
    """Peaks and, before their scale is taken, the maximum of a sweep."""

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(self.rows(p), maximum=MAXIMUM) for p in ps]


def test_the_error_of_a_scale_is_shared_by_all_rows_that_it_scales() -> None:
    """Half as large as measured at the maximum: chi = 2, whose error e moves a row by e (1 + r)."""
    sweep = sweep_measurement(np.array([1.0, 4.0, 1.0]), sigmas_v=np.array([0.5, 0.08, 0.5]))
    objective = Objective(
        response=Scaled(lambda p: np.array([0.5, 0.25, 0.75])),
        parameters=(parameter("p", -1.0, 1.0),),
        data=dataset(np.ones(3), np.full(3, 0.1), sweep),
        steps=np.full(1, 1e-4),
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    assert point.residuals == pytest.approx([0.0, -0.5, 0.5])
    assert noise_of(objective, point).common == pytest.approx(
        0.02 * np.array([[1.0], [0.5], [1.5]])
    )


def test_widened_rows_are_those_that_were_meant() -> None:
    own = RowNoise(np.array([0.1, 0.2, 0.3]), np.zeros((3, 0)))
    assert own.widened(slice(1, 3), 2.0).sigma == pytest.approx([0.1, 0.4, 0.6])
    assert own.sigma == pytest.approx([0.1, 0.2, 0.3])
    assert own.loosest.sigma == pytest.approx(own.sigma)
    assert own.covariance.row_sigma == pytest.approx(own.sigma)


def test_what_is_promised_bounds_every_row_by_its_share() -> None:
    """e (1 + r) for its own row: no scale is simulated, so that no column is shared."""

    class Promising(RowsResponse):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [replace(each, promised=(1e-3,)) for each in super().evaluate_many(ps)]

    rows = np.array([0.25, -0.5, 0.0])
    objective = replace(
        rows_objective(lambda p: rows, [-1.0], [1.0]), response=Promising(lambda p: rows)
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    bounded = noise_of(objective, point).bounded
    assert np.abs(bounded.own) == pytest.approx(1e-3 * (1.0 + rows))
    assert bounded.common.shape == (3, 0)


def test_what_is_promised_of_a_scale_bounds_the_rows_of_its_series_alone() -> None:
    """Two series, each scaled by its own maximum, the one by 2 and the other by 4.

    An error e of a maximum moves a row of its series by e (1 + r), and none of the other.
    """
    names = ("one", "other")
    peaks = [peaks_measurement(np.ones(2), np.full(2, 0.1), series=name) for name in names]
    sweeps = [sweep_measurement(np.array([1.0, 4.0, 1.0]), series=name) for name in names]
    tops = [Maximum(value=v, frequency_hz=2.0, bias=0.0, bracketed=True) for v in (2.0, 1.0)]
    answered = Evaluation(
        (
            Prediction(np.array([0.25, 0.75])),
            Prediction(np.array([0.5, 0.125])),
            *(Prediction(np.empty(0), top) for top in tops),
        ),
        promised=(1e-3,) * 4,
    )

    class Both(RowsResponse):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [answered for _ in ps]

    objective = Objective(
        response=Both(lambda p: np.zeros(4)),
        parameters=(parameter("p", -1.0, 1.0),),
        data=Dataset((*peaks, *sweeps)),
        steps=np.full(1, 1e-4),
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    scaled = np.array([0.5, 1.5, 2.0, 0.5])
    assert point.residuals == pytest.approx(scaled - 1.0)
    wanted = 1e-3 * np.array([[0.5, 0.0], [1.5, 0.0], [0.0, 2.0], [0.0, 0.5]])
    assert np.abs(noise_of(objective, point).bounded.common) == pytest.approx(wanted)


# --- weights, and a misfit that nobody can tell from none


def test_weights_of_priors_are_those_of_the_noise() -> None:
    """2 sigma^2 for squares, sigma^-2 on average; sqrt(2/pi) sigma for absolute values."""
    sigma = np.array([0.1, 0.2])
    own = parameter("a", -1.0, 1.0), parameter("b", -1.0, 1.0, prior=0.5, scale=2.0)
    objective = replace(whitened(lambda p: p[:2], *own), data=dataset(np.ones(2), sigma))
    squares = weights(objective, 0.3, "squares")
    assert squares == pytest.approx([0.3, 16.0 * 2.0 / np.mean(sigma**-2)])
    for misfit in ("slack", "absolute"):
        assert weights(objective, 0.3, misfit) == pytest.approx(
            [0.3, 16.0 * np.sqrt(2.0 / np.pi) * 0.15]
        )
    unknown = replace(objective, data=dataset(np.ones(2)))
    assert weights(unknown, 0.3, "squares")[1] == pytest.approx(16.0 * 2.0 * 0.01**2)
    assert tikhonov_rows(np.array([2.0]), 0.5) == pytest.approx([1.0])


def solution(rows: FloatArray, sigma: float = SIGMA, accuracy: float = 1e-6) -> Solution:
    """Of rows that nothing changes, noise and accuracy as told."""
    objective = rows_objective(lambda p: rows, [-1.0], [1.0])
    one = peaks_measurement(np.ones(rows.size), np.full(rows.size, sigma))
    measured = replace(one, setup=replace(one.setup, accuracy=accuracy))
    objective = replace(objective, data=Dataset((measured,)))
    return solution_of(Evaluator(objective), Chain(0, (0.0,)), Schedule())


@pytest.mark.parametrize("size", [1e-6, 0.02])
def test_what_is_negligible_is_a_thousandth_of_chi_square(size: float) -> None:
    """Of rows of their own size, or of the noise where they fit better."""
    found = solution(np.full(9, size), accuracy=1e-12)
    square = max(size**2, SIGMA**2)
    assert negligible(found, "squares") == pytest.approx(1e-3 * square, rel=1e-6)
    each = max(size, 0.5 * np.sqrt(2.0 / np.pi) * SIGMA)
    for misfit in ("slack", "absolute"):
        assert negligible(found, misfit) == pytest.approx(1e-3 * each, rel=1e-6)


def test_what_is_computed_no_better_is_negligible_up_to_a_hundredth() -> None:
    """Nine rows of 0.02: errors a of amplitudes add up to 3 a, and 2 a |r| of squares."""
    rows = np.full(9, 0.02)
    assert negligible(solution(rows, accuracy=1e-4), "slack") == pytest.approx(3e-4)
    assert negligible(solution(rows, accuracy=1e-2), "slack") == pytest.approx(1e-2 * 0.18)
    wanted = 2.0 * 1e-4 * 0.06
    assert negligible(solution(rows, accuracy=1e-4), "squares") == pytest.approx(wanted, rel=1e-6)
    assert negligible(solution(rows, accuracy=1e-1), "squares") == pytest.approx(1e-2 * 0.0036)


def test_the_end_of_a_chain_is_evaluated_and_linearised() -> None:
    """Rows x - 1 and 2 x at x = 0.5: slopes 1 and 2, prior of the box and Tikhonov's nu."""
    evaluator = rows_evaluator(lambda p: np.array([p[0] - 1.0, 2.0 * p[0]]), [-3.0], [3.0])
    ended = chain(0, 0.5, 1.0, nu=0.2)
    found = solution_of(evaluator, ended, Schedule(), "slack")
    assert found.nu == 0.2
    assert found.initial.x == pytest.approx([0.0])
    assert found.final.residuals == pytest.approx([-0.5, 1.0])
    assert found.matrix == pytest.approx(np.array([[1.0], [2.0]]))
    assert found.structure is None
    assert found.tikhonov_weights == pytest.approx([0.2])
    assert found.last is ended.steps[-1]
    scatter = np.sqrt(1.25 / 1.0)  # of two rows of unknown noise and one parameter
    precision = 5.0 / scatter**2 + 12.0 / 36.0 + 0.2
    assert found.errors.covariance == pytest.approx(np.array([[1.0 / precision]]))
    freedom = 2.0 - 8.0 / (8.0 + 12.0 / 36.0 + 0.2)  # what the parameter leaves of two rows
    assert found.noise.freedom == pytest.approx(freedom)
    assert found.errors.inflation == pytest.approx(np.sqrt(freedom))
    begun = solution_of(evaluator, Chain(0, (0.25,)), Schedule(nu_start=0.7))
    assert begun.last is None
    assert begun.nu == 0.7
    assert begun.final.x == pytest.approx([0.25])


def test_a_sweep_beside_peaks_has_rows_of_its_own() -> None:
    """Curves stand last; their noise is known or not by itself."""
    both = Dataset(
        (
            peaks_measurement(np.ones(2), np.full(2, 0.1)),
            sweep_measurement(np.ones(3), fitted=True, maximum_v=1.0),
        )
    )
    assert both.sigma == pytest.approx([0.1, 0.1, 0.0, 0.0, 0.0])
    assert both.curve_rows == slice(2, None)
