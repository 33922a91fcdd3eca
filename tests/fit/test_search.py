"""The search of the box against other optimisers and against symmetries known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import differential_evolution

import fitting as ff
from fitting.campaign.parameters import Parameter, bounds, to_model, to_search
from fitting.fit.alternative import Outcome, search_alternative, with_values
from fitting.fit.objective import Evaluator, Objective, make_objective
from fitting.fit.options import Options, Schedule
from fitting.fit.path import follow_path, own_start
from fitting.fit.search import Box, search_box
from fitting.fit.twins import Twin, find_twins
from fitting.text.arrays import FloatArray
from tests.support import closed_form
from tests.support.crossing import Laboratory, laboratory
from tests.support.curve_fits import U, fitted_line, line, sweep
from tests.support.datasets import answer, dataset
from tests.support.virtual.answers import ModesResponse
from tests.support.virtual.judge import Likelihood
from tests.support.virtual.kinds import KINDS
from tests.support.whitened import SIGMA, parameter, whitened

pytestmark = pytest.mark.usefixtures("swift_models")


def test_points_fill_the_box_by_decades_and_go_on_where_they_ended() -> None:
    box = Box(laboratory(0).parameters)
    points = [to_model(box.parameters, x) for x in box.spread(64, seed=3)]
    decades = np.bincount([int(np.log10(p[1])) for p in points], minlength=3)
    assert decades == pytest.approx([64 / 3] * 3, abs=2.0)  # 1 to 1000 Hz
    quarters = np.bincount([int(4 * np.mod(p[0], np.pi) / np.pi) for p in points], minlength=4)
    assert quarters == pytest.approx([16] * 4, abs=1)
    longer = box.spread(128, seed=3)
    assert np.array_equal(longer[:64], box.spread(64, seed=3))
    assert np.array_equal(longer[64:], box.spread(64, seed=3, skip=64))


def test_distances_in_the_box_take_periods_off() -> None:
    lab = laboratory(0)
    box, p = Box(lab.parameters), lab.truth
    turned = p + np.array([np.pi, 0.0, 0.0, 0.0, 0.0])
    doubled = p * np.array([1.0, 10.0, 1.0, 1.0, 1.0])
    x, y, z = (to_search(lab.parameters, each) for each in (p, turned, doubled))
    assert box.apart(x, y) == pytest.approx(0.0, abs=1e-12)
    assert box.apart(x, z) == pytest.approx(1.0 / 3.0)  # a decade of three


def least_by_evolution(lab: Laboratory) -> float:
    """Chi square of scipy's differential evolution over the whole box, polished."""
    low, high = bounds(lab.parameters)
    low, high = low.copy(), high.copy()
    low[0], high[0] = 0.0, np.pi
    found = differential_evolution(
        lab.chi_square, list(zip(low, high, strict=True)), rng=1, popsize=12, maxiter=120, tol=1e-6
    )
    return float(found.fun)


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.nightly) for k in (0, 2))])
def test_the_search_finds_what_differential_evolution_finds(seed: int) -> None:
    lab = laboratory(seed)
    minima, search = search_box(lab.evaluator(), [own_start(lab.parameters)], 1, 1000)
    least = minima[0]
    # a minimum is known to what a descent leaves
    assert least.chi_square <= min(least_by_evolution(lab), lab.chi_square(lab.truth)) + 0.01
    assert lab.chi_square(to_model(lab.parameters, least.x)) == pytest.approx(least.chi_square)
    assert search.explained
    heights = [minimum.chi_square for minimum in minima]
    assert heights == sorted(heights)
    assert sum(minimum.descents for minimum in minima) == search.descents


def objective_of(lab: Laboratory, *, reflection: bool = False) -> Objective:
    response = replace(lab.response, reflection=reflection)
    return replace(lab, response=response).objective()


@pytest.fixture(scope="module")
def one_side() -> tuple[Laboratory, Outcome]:
    """A laboratory started with both lines on one side."""
    lab = laboratory(1, starts=(5.0, 5.0))
    return lab, search_alternative(objective_of(lab), Schedule())


def test_a_lower_minimum_than_that_of_algorithm_2_is_reported(
    one_side: tuple[Laboratory, Outcome],
) -> None:
    """Algorithm 2 ends thousands of chi square too high, as published."""
    lab, outcome = one_side
    *_, last = follow_path(objective_of(lab), Options())
    assert lab.chi_square(np.array(last.parameters)) > 1000.0
    end = to_model(lab.parameters, outcome.x)
    assert lab.chi_square(end) < lab.chi_square(lab.truth) + 5.0


# --- symmetries -----------------------------------------------------------------------------------


def test_the_quarter_turn_with_dampings_exchanged_is_found_and_nothing_else() -> None:
    """T(theta + pi/2) diag(d2, d1) T^T is T(theta) diag(d1, d2) T^T, by matrices alone."""
    lab = laboratory(3)
    [twin] = find_twins(Evaluator(lab.objective()), seed=1)
    image = twin.of(lab.parameters, to_search(lab.parameters, lab.truth))
    assert image is not None
    p = to_model(lab.parameters, image)
    assert p[1:] == pytest.approx(lab.truth[[2, 1, 3, 4]], rel=1e-12)
    assert np.mod(p[0] - lab.truth[0], np.pi) == pytest.approx(np.pi / 2)
    one, other = (closed_form.damping(q[0], q[1], q[2], reflection=False) for q in (p, lab.truth))
    assert one == pytest.approx(other, rel=1e-12)


def test_an_exchange_is_found_though_the_model_is_inexact_at_one_place() -> None:
    """Rows a + b and a b, a little off where a is large, as a mode is that is damped to nothing.

    At more places than a few it is another model.
    """

    def laboratory_off(is_off: Callable[[FloatArray], bool]) -> list[Twin]:
        def rows(p: FloatArray) -> FloatArray:
            off = 1e-7 / SIGMA if is_off(p) else 0.0
            return np.array([p[0] + p[1] + off, p[0] * p[1] / 1e4])

        pair = (parameter("a", 1.0, 100.0), parameter("b", 1.0, 100.0))
        return find_twins(Evaluator(whitened(rows, *pair)), seed=1)

    [twin] = laboratory_off(lambda p: p[0] > 70.0)
    assert twin.order.tolist() == [1, 0]
    assert laboratory_off(lambda p: p[0] > p[1]) == []


def test_an_exchange_needs_boxes_that_overlap_and_an_image_inside() -> None:
    lab = laboratory(3)
    theta, d1, d2, *rest = lab.parameters
    apart = (theta, replace(d1, upper=100.0), replace(d2, lower=100.5, start=200.0), *rest)
    assert find_twins(Evaluator(replace(lab, parameters=apart).objective()), seed=1) == []
    narrow = (theta, d1, replace(d2, upper=600.0), *rest)
    [twin] = find_twins(Evaluator(replace(lab, parameters=narrow).objective()), seed=1)
    wide = np.array([1.0, 800.0, 50.0, *lab.truth[3:]])
    assert twin.of(narrow, to_search(narrow, wide)) is None


def test_a_reversed_sign_is_found_in_a_box_about_zero() -> None:
    class Even:
        def evaluate_many(self, ps, *, whole=False):  # type: ignore[no-untyped-def]
            return [answer(np.array([p[0] ** 2, np.cosh(p[0]) + p[1]])) for p in ps]

        def derived_many(self, ps):  # type: ignore[no-untyped-def]
            return [{} for _ in ps]

    def parameter(name: str, lower: float) -> Parameter:
        return Parameter(
            name=name, unit="1", lower=lower, upper=5.0, start=1.0, reference=0.0, scale=1.0
        )

    box = (parameter("a", -5.0), parameter("b", -4.0))
    data = dataset(np.array([4.0, 5.0]), np.ones(2))
    [twin] = find_twins(Evaluator(make_objective(Even(), box, data)), seed=1)
    assert twin.of(box, np.array([2.0, 3.0])) == pytest.approx([-2.0, 3.0])


def test_an_alternative_that_mirrors_another_is_not_searched_again(
    one_side: tuple[Laboratory, Outcome],
) -> None:
    """The reflection at -theta has the matrices of the rotation at theta."""
    lab, outcome = one_side
    second = objective_of(lab, reflection=True)
    mirrored = search_alternative(second, Schedule(), [outcome])
    assert outcome.search is not None
    assert mirrored.search is not None
    assert mirrored.search.evaluations == 0
    there = Laboratory(replace(lab.response, reflection=True), lab.parameters, lab.data, lab.truth)
    for minimum in mirrored.minima:
        p = to_model(lab.parameters, minimum.x)
        assert there.chi_square(p) == pytest.approx(minimum.chi_square, rel=1e-6)
    end = to_model(lab.parameters, mirrored.x)
    here = lab.chi_square(to_model(lab.parameters, outcome.x))
    assert there.chi_square(end) == pytest.approx(here, rel=1e-6)


def test_of_a_fit_and_its_twin_the_one_with_every_value_is_reported() -> None:
    """lambda^2 = -sin(2 theta) (eta_-^2 - eta_+^2)/2 changes its sign with a quarter turn."""
    lab = laboratory(0)
    turned = lab.truth[[0, 2, 1, 3, 4]] - np.array([np.pi / 2, 0.0, 0.0, 0.0, 0.0])
    pairs = zip(lab.parameters, turned, strict=True)
    moved = tuple(replace(p, start=float(v), reference=float(v)) for p, v in pairs)
    there = replace(lab, parameters=moved)
    outcome = search_alternative(there.objective(), Schedule(starts=1))
    begun = to_model(moved, outcome.x)
    assert np.mod(begun[0], np.pi) < np.pi / 2  # where lambda is none
    end = to_model(moved, with_values(outcome).x)
    same = end[:3] - np.array([np.pi * np.round((end[0] - lab.truth[0]) / np.pi), 0.0, 0.0])
    assert same == pytest.approx(lab.truth[:3], rel=0.05)  # theta and theta + pi are one system
    assert np.isfinite(lab.response.derived_many([end])[0]["lambda"][0])
    assert lab.chi_square(end) == pytest.approx(lab.chi_square(begun), rel=1e-6)


def test_an_angle_reversed_about_the_middle_of_its_box_is_a_twin_too() -> None:
    class Even:
        """Rows that are even about a = 2."""

        def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Any]:
            return [
                answer(np.array([5.0 + (p[0] - 2.0) ** 2, 7.0 - np.cos(p[0] - 2.0)])) for p in ps
            ]

        def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
            return [{} for _ in ps]

    def box(upper: float) -> tuple[Parameter, ...]:
        told: dict[str, Any] = {"unit": "rad", "start": 1.5, "reference": 0.0, "scale": 1.0}
        return (Parameter(name="a", lower=1.0, upper=upper, **told),)

    def twins(upper: float) -> list[Twin]:
        objective = make_objective(Even(), box(upper), dataset(np.ones(2), np.ones(2)))
        return find_twins(Evaluator(objective), seed=1)

    [twin] = twins(3.0)
    assert twin.of(box(3.0), np.array([1.5])) == pytest.approx([2.5])
    assert twins(3.2) == []


def test_two_lines_in_a_box_of_a_hundred_widths_are_found(tmp_path: Path) -> None:
    """No screen of the box leads to them: five unknowns, a valley of a millionth of the box."""
    virtual = KINDS["crossing"](1030).widened(10.0)
    record = ff.Problem.of(virtual.write(tmp_path), ff.Fmu("CoupledOscillator", workers=1)).record
    found = ff.fit(ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record))
    least = Likelihood(virtual)
    end = least.vector(dict(zip(found.problem.names, found.x, strict=True)), reflection=False)
    # near the truth, in its valley: others end above 70,000
    assert least.chi_square(end) < least.chi_square(least.true) + 20.0


@pytest.mark.parametrize(("bump", "rounds"), [(0.0, 1), (0.02, 2)])
def test_noise_of_any_size_ends_a_search_and_a_pattern_does_not(bump: float, rounds: int) -> None:
    """White residuals three times as large as stated are noise; with a second line they are not."""
    noise = 3e-3 * np.random.default_rng(5).standard_normal(U.size)
    measured = sweep(line(U) + bump * line(U, 1010.0, 4.0) + noise, 1e-3)
    outcome = fitted_line(measured).outcome
    assert outcome.search is not None
    assert min(outcome.search.screens, 2) == rounds
    assert outcome.search.explained is (rounds == 1)


@pytest.mark.nightly
def test_rough_ground_is_searched_though_noise_explains_what_was_found(tmp_path: Path) -> None:
    """Every descent ends elsewhere, one 20 above the truth: noise leaves that one time in five."""
    virtual = KINDS["crossing"](70005)
    record = ff.Problem.of(virtual.write(tmp_path), ff.Fmu("CoupledOscillator", workers=1)).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    found = ff.profile(ff.fit(problem), ["width_plus"])
    least = Likelihood(virtual)
    knowledge = found.inferred.knowledge
    assert knowledge is not None
    assert knowledge.chi_square < least.chi_square(least.true)
    low, high = found.values["width_plus"].interval(0.95)
    assert low < virtual.truth()["width_plus"] < high
    assert not [said for said in found.warnings if "next to" in said]
