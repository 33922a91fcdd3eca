"""How far out of the box of a campaign the likelihood is looked at, and what is said of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign.parameters import Parameter, outside_box, to_model, to_search
from fitting.fit.likelihood.descent import (
    Expansion,
    Optimum,
    expansion_at,
    held_at,
    let_out,
    most_likely,
)
from fitting.fit.likelihood.likelihood import Likelihood, LikelihoodEvaluator, likelihood_of
from fitting.fit.likelihood.lockstep import run_in_lockstep
from fitting.fit.objective import Objective
from fitting.inference.likelihood.outside import widened
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.estimate import Verdict
from tests.support.whitened import SIGMA, Z95, WhitenedResponse, learnt, parameter, whitened

#: What a descent leaves undone, in standard deviations of a value.
SMALL = 0.01


def evaluator_of(objective: Objective) -> LikelihoodEvaluator:
    size = objective.data.sigma.size
    return LikelihoodEvaluator(likelihood_of(objective, np.full(size, SIGMA), np.zeros((size, 0))))


def room(own: Parameter, at: float, error: float = 0.1) -> tuple[float, float]:
    """The room of one parameter about a value with an error, in its unit."""
    likelihood = evaluator_of(whitened(lambda p: np.zeros(3), own)).likelihood
    x, errors = (at - own.reference) / own.scale, error / own.scale
    out = likelihood.let_out(np.array([x]), np.array([errors]))
    [low], [high] = (to_model((own,), x) for x in (out.lower, out.upper))
    return float(low), float(high)


@pytest.mark.parametrize(
    ("box", "at", "wanted"),
    [
        # positive, but an angle: a factor of ten would go round five times
        ((1.6, 3.1), 2.0, (2.0 - 0.5 * math.pi, 2.0 + 0.5 * math.pi)),
        ((-1.0, 0.5), 0.0, (-0.5 * math.pi, 0.5 * math.pi)),
        ((-3.0, 3.0), 1.0, (-3.0, 3.0)),
    ],
)
def test_an_angle_without_a_period_goes_a_quarter_turn_each_way_and_through_its_box(
    box: tuple[float, float], at: float, wanted: tuple[float, float]
) -> None:
    angle = parameter("angle", *box, unit="rad")
    assert room(angle, at) == pytest.approx(wanted)
    [wide] = widened([angle])
    middle, half = 0.5 * (box[0] + box[1]), max(0.5 * math.pi, 0.5 * (box[1] - box[0]))
    assert (wide.lower, wide.upper) == pytest.approx((middle - half, middle + half))
    assert not parameter("angle", 0.01, 3.0, unit="rad").spans_decades


@pytest.mark.parametrize(
    ("box", "wanted"),
    [
        ((1.0, 8.0), (0.4, 40.0)),
        ((0.0, 5.0), (0.0, 40.0)),
        ((0.5, 90.0), (0.4, 90.0)),
        ((1e-3, 1e4), (1e-3, 1e4)),
    ],
)
def test_a_positive_value_goes_by_a_factor_of_ten_each_way_and_through_its_box(
    box: tuple[float, float], wanted: tuple[float, float]
) -> None:
    own = parameter("p", *box, start=3.0, scale=0.2)
    assert room(own, 4.0) == pytest.approx(wanted)


def test_a_positive_value_that_zero_fits_goes_by_ten_of_its_errors() -> None:
    """Its own size says nothing: it may be any, and the data end it at about two errors."""
    assert room(parameter("p", 0.005, 2.0), 0.01, 0.5) == pytest.approx((0.001, 5.0))
    assert room(parameter("p", 0.0, 2.0), 0.0, 0.5) == pytest.approx((0.0, 5.0))


def test_another_value_goes_by_three_widths_of_its_box() -> None:
    assert room(parameter("p", -1.0, 3.0, scale=0.2), 0.5) == pytest.approx((-11.5, 12.5))


@pytest.mark.parametrize("lower", [-50.0, 0.0])
def test_a_value_with_a_prior_goes_by_ten_of_its_sigmas(lower: float) -> None:
    own = parameter("p", lower, 50.0, start=20.0, prior=0.3, scale=0.2)
    assert room(own, 20.5) == pytest.approx((17.0, 23.0))


def test_nothing_goes_beyond_what_the_model_declares() -> None:
    positive = parameter("p", 1.0, 8.0, least=0.5, most=12.0)
    assert room(positive, 4.0) == pytest.approx((0.5, 12.0))
    assert room(parameter("p", -1.0, 3.0, least=-2.0, most=4.0), 0.5) == pytest.approx((-2.0, 4.0))
    prior = parameter("p", 0.0, 50.0, start=20.0, prior=0.3, least=19.0, most=21.0)
    assert room(prior, 20.0) == pytest.approx((19.0, 21.0))


def test_a_value_that_goes_round_has_no_limits() -> None:
    low, high = room(parameter("p", 0.0, 1.0, period=math.pi), 0.5)
    assert (low, high) == (-math.inf, math.inf)


# --- beyond the room


def farther(own: Parameter, times: float) -> tuple[float, float]:
    """Limits of a parameter that may go so many times as far as its box, in its unit."""
    others = parameter("before", -1.0, 3.0), parameter("after", 1.0, 8.0)
    both = others[0], own, others[1]
    inside = evaluator_of(whitened(lambda p: np.zeros(3), *both)).likelihood
    out = inside.farther([1], times)
    for now, then in ((out.lower, inside.lower), (out.upper, inside.upper)):
        assert now[[0, 2]].tolist() == then[[0, 2]].tolist()  # those are not meant
    low, high = (float(to_model(both, x)[1]) for x in (out.lower, out.upper))
    return low, high


@pytest.mark.parametrize("times", [2.0, 64.0])
def test_a_positive_value_goes_farther_by_a_factor_each_way(times: float) -> None:
    assert farther(parameter("p", 1.0, 8.0, scale=0.2), times) == pytest.approx(
        (1.0 / times, 8.0 * times)
    )
    from_zero = parameter("p", 0.0, 0.5, scale=0.2)
    assert farther(from_zero, times) == pytest.approx((0.0, 0.5 * times))


@pytest.mark.parametrize("times", [2.0, 64.0])
def test_another_value_goes_farther_by_widths_of_its_room_each_way(times: float) -> None:
    """One width more each way for twice, 63 for 64 times."""
    own = parameter("p", -1.0, 3.0, scale=0.2)
    assert farther(own, times) == pytest.approx((3.0 - 4.0 * times, 4.0 * times - 1.0))


def test_nothing_goes_farther_than_the_model_declares() -> None:
    for told, wanted in (
        ({"least": 0.5, "most": 12.0}, (0.5, 12.0)),
        ({"least": 0.5}, (0.5, 32.0)),
        ({"most": 12.0}, (0.25, 12.0)),
    ):
        own = parameter("p", 1.0, 8.0, scale=0.2, **told)
        assert farther(own, 4.0) == pytest.approx(wanted)
    for told, wanted in (
        ({"least": -2.0, "most": 4.0}, (-2.0, 4.0)),
        ({"least": -2.0}, (-2.0, 15.0)),
        ({"most": 4.0}, (-13.0, 4.0)),
    ):
        own = parameter("p", -1.0, 3.0, **told)
        assert farther(own, 4.0) == pytest.approx(wanted)


def test_values_go_farther_each_in_its_own_way() -> None:
    own = parameter("p", 1.0, 8.0, scale=0.2), parameter("q", -1.0, 3.0)
    inside = evaluator_of(whitened(lambda p: np.zeros(3), *own)).likelihood
    out = inside.farther([1, 0], 4.0)
    assert to_model(own, out.lower) == pytest.approx([0.25, -13.0])
    assert to_model(own, out.upper) == pytest.approx([32.0, 15.0])


# --- the most likely point


def found_at(wanted: float, **limits: float) -> Optimum:
    """p is measured with unit noise as `wanted`; its box goes from 1 to 10 Hz."""
    own = parameter("p", 1.0, 10.0, unit="Hz", scale=2.0, **limits)
    rows = whitened(lambda p: np.full(3, (p[0] - wanted) / math.sqrt(3.0)), own)
    evaluator = evaluator_of(rows)
    return let_out(evaluator, most_likely(evaluator, [np.zeros(1)]))


def leaves_its_bounds(optimum: Optimum) -> bool:
    return bool(outside_box(optimum.likelihood.parameters, optimum.expansion.x))


def value_of(optimum: Optimum) -> float:
    return float(to_model(optimum.likelihood.parameters, optimum.expansion.x)[0])


@pytest.mark.parametrize("wanted", [11.5, 0.4])
def test_the_most_likely_point_leaves_the_box_where_the_data_want_it(wanted: float) -> None:
    optimum = found_at(wanted)
    assert value_of(optimum) == pytest.approx(wanted, abs=SMALL)
    assert optimum.least == pytest.approx(0.0, abs=SMALL**2)
    assert optimum.chi_square == pytest.approx(0.0, abs=SMALL**2)
    assert leaves_its_bounds(optimum)


@pytest.mark.parametrize(("beyond", "leaves"), [(0.3, False), (0.33, True)])
def test_the_box_is_left_for_a_tenth_of_chi_square(beyond: float, leaves: bool) -> None:
    """A gain of 0.09 does not, one of 0.109 does; the limit is 10."""
    optimum = found_at(10.0 + beyond)
    assert value_of(optimum) == pytest.approx(10.0 + beyond * leaves, abs=SMALL)
    assert leaves_its_bounds(optimum) is leaves


def test_the_most_likely_point_goes_no_further_than_the_model_declares() -> None:
    optimum = found_at(12.0, most=11.0)
    assert value_of(optimum) == pytest.approx(11.0)
    assert optimum.least == pytest.approx(1.0, rel=1e-4)
    at_box = found_at(12.0, most=10.0)
    assert value_of(at_box) == pytest.approx(10.0)
    assert not leaves_its_bounds(at_box)


# --- what a limit holds


def held(wanted: float, at: float, **limits: float) -> tuple[int, ...]:
    """Parameters held at (at, 0) where p is measured as `wanted`, its box from -10 to 10."""
    p = parameter("p", -10.0, 10.0, **limits)
    q = parameter("q", -10.0, 10.0)
    rows = whitened(lambda x: np.array([x[0] - wanted, x[1], 0.0]), p, q)
    likelihood: Likelihood = evaluator_of(rows).likelihood
    x = np.array([at, 0.0])
    [here] = run_in_lockstep([expansion_at(likelihood, x)], evaluator_of(rows))
    assert here is not None
    return held_at(likelihood, here, ())


def test_a_limit_holds_what_the_data_push_beyond_it() -> None:
    assert held(12.0, 10.0) == (0,)
    assert held(-12.0, -10.0) == (0,)
    assert held(5.0, 10.0) == held(5.0, -10.0) == ()  # pushed inward
    assert held(12.0, 9.0) == ()  # not there
    assert held(10.3, 10.0) == ()  # for a gain of 0.09
    assert held(10.33, 10.0) == (0,)


def test_a_limit_of_the_model_itself_holds_nothing() -> None:
    assert held(12.0, 10.0, most=10.0) == ()
    assert held(-12.0, -10.0, least=-10.0) == ()
    assert held(12.0, 10.0, most=11.0) == (0,)


# --- a model that has no answer out there


def failing(error: Callable[[], Exception], s: float) -> Callable[[FloatArray], FloatArray]:
    """p = 8 with noise s, and no answer outside its box."""

    def rows(p: FloatArray) -> FloatArray:
        if p[0] > 10.0 or p[0] < 1.0:
            raise error()
        return np.full(3, (p[0] - 8.0) / (math.sqrt(3.0) * s))

    return rows


ERRORS = pytest.mark.parametrize(
    "error",
    [
        lambda: NoScale("the simulated sweep has an amplitude of 0"),
        lambda: FmuFailure("overdamped", {}, Path("test.fmu")),
    ],
    ids=["no scale", "failure"],
)


@ERRORS
def test_a_model_without_an_answer_beyond_its_box_costs_nothing_that_the_data_end(
    error: Callable[[], Exception],
) -> None:
    found = learnt(whitened(failing(error, 0.2), parameter("p", 1.0, 10.0)), (8.1,)).parameters["p"]
    assert found.status is Verdict.DETERMINED
    assert found.ci95 == pytest.approx((8.0 - 0.2 * Z95, 8.0 + 0.2 * Z95), rel=1e-3)


@ERRORS
def test_nothing_is_said_of_where_a_model_has_no_answer(error: Callable[[], Exception]) -> None:
    """Noise of 3 ends p below at 2.1 and above only where nobody answers."""
    found = learnt(whitened(failing(error, 3.0), parameter("p", 1.0, 10.0)), (8.1,)).parameters["p"]
    assert found.closed_by == ("data", "")
    assert found.status is Verdict.UNKNOWN
    assert found.ci95[0] < found.ci68[0] < found.ci68[1] <= found.ci95[1]
    assert found.ci95 == pytest.approx((8.0 - 3.0 * Z95, 10.0), rel=1e-3)


def test_an_end_at_which_the_model_fails_is_lost_for_other_values_free_too() -> None:
    """As above, q beside it: the search for p at its end begins where nobody answers."""
    rows = failing(lambda: NoScale("the simulated sweep has an amplitude of 0"), 3.0)
    objective = whitened(
        lambda x: np.append(rows(x), [(x[1] - 5.0) / 0.1, 0.0]),
        parameter("p", 1.0, 10.0),
        parameter("q", 1.0, 10.0),
    )
    found = learnt(objective, (8.1, 5.1)).parameters
    assert found["p"].closed_by == ("data", "")
    assert found["q"].status is Verdict.DETERMINED
    assert found["q"].ci95 == pytest.approx((5.0 - 0.1 * Z95, 5.0 + 0.1 * Z95), rel=1e-3)


def slopes_at_ten(reaches: tuple[float, float]) -> Expansion:
    """The expansion at p = 5, q = 10 in the room of profiles; q is answered in `reaches` alone."""

    def rows(x: FloatArray) -> FloatArray:
        if not reaches[0] <= x[1] <= reaches[1]:
            raise FmuFailure("overdamped", {}, Path("test.fmu"))
        return np.array([(x[0] - 5.0) / 0.1, (x[1] - 10.0) / 0.2, 0.0])

    own = parameter("p", 1.0, 10.0), parameter("q", 1.0, 10.0)
    whole = whitened(lambda x: np.zeros(3), *own)
    evaluator = evaluator_of(replace(whole, response=WhitenedResponse(rows)))
    x = to_search(own, np.array([5.0, 10.0]))
    evaluator.likelihood = evaluator.likelihood.let_out(x, np.ones(2))
    [here] = run_in_lockstep([expansion_at(evaluator.likelihood, x)], evaluator)
    assert here is not None
    return here


def test_slopes_are_taken_where_the_model_answers() -> None:
    """Downward where it ends at q = 10; where it answers on neither side it has failed."""
    slopes = np.array([[10.0, 0.0], [0.0, 5.0], [0.0, 0.0]])
    assert slopes_at_ten((1.0, 10.0)).matrix[:3] == pytest.approx(slopes, rel=1e-6, abs=1e-6)
    assert slopes_at_ten((1.0, 10.0)).chi_square == pytest.approx(0.0, abs=1e-12)
    assert slopes_at_ten((10.0, 10.0)).chi_square == math.inf


class Undefined(WhitenedResponse):
    """Whose outputs cannot be read outside the box, as of an FMU that does not initialise there."""

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        if any(not 1.0 <= p[0] <= 10.0 for p in ps):
            raise FmuFailure("no root of a negative number", {}, Path("test.fmu"))
        return super().derived_many(ps)


def test_an_output_that_cannot_be_read_beyond_the_box_costs_no_profile() -> None:
    """p = 8 -+ 0.39, and its square likewise."""
    rows = failing(lambda: AssertionError("never asked"), 0.2)
    inside = whitened(lambda p: rows(np.clip(p, 1.0, 10.0)), parameter("p", 1.0, 10.0))
    response = Undefined(lambda p: rows(np.clip(p, 1.0, 10.0)), {"square": lambda p: p[0] ** 2})
    found = learnt(replace(inside, response=response), (8.1,))
    assert {p.status for p in found.profiled.values()} == {Verdict.DETERMINED}
    ends = np.array([8.0 - 0.2 * Z95, 8.0 + 0.2 * Z95])
    assert found.parameters["p"].ci95 == pytest.approx(tuple(ends), rel=1e-3)
    assert found.derived["square"].ci95 == pytest.approx(tuple(ends**2), rel=2e-3)
