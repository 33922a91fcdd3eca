"""Profiles and intervals: Cramér and Rao's bound, asymmetry, bounds, periods, outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.optimize import brentq

from fitting.campaign.parameters import Parameter, to_search
from fitting.fit.likelihood.descent import Optimum, expansion_at
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.likelihood.lockstep import run_in_lockstep
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Determined
from fitting.inference.likelihood.profiles import Quantity, trace_branch
from fitting.inference.likelihood.ranges import output_ranges
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from tests.support import closed_form, single_line
from tests.support.datasets import dataset
from tests.support.whitened import SIGMA, Z95, WhitenedResponse, learnt, parameter, whitened


def known(objective: Objective, start: list[float], budget: int = 10**6) -> Determined:
    sigma = objective.data.sigma
    x = to_search(objective.parameters, np.array(start))
    return determine(
        objective, x, RowNoise(sigma, np.zeros((sigma.size, 1))), InferenceOptions(budget=budget)
    )


def half(interval: tuple[float, float]) -> float:
    return 0.5 * (interval[1] - interval[0])


def test_one_line_is_known_as_well_as_cramer_and_rao_allow() -> None:
    """Two per cent, for the linearised error and for both intervals of the profile."""
    sigma, per_width = 0.02, 3
    objective = single_line.line_objective(sigma=sigma, per_width=per_width)
    determined = known(objective, [1000.2, 8.3, 1.9])
    for name, bound in single_line.bounds_of(sigma, per_width).items():
        profile = determined.parameters[name]
        assert determined.scans[name].sigma == pytest.approx(bound, rel=0.02), name
        assert half(profile.ci68) == pytest.approx(bound, rel=0.02), name
        assert half(profile.ci95) == pytest.approx(1.96 * bound, rel=0.02), name
        assert profile.status == "determined"
    # Q = eta/w, and eta is known 250 times as well, relatively
    q = single_line.ETA_HZ / single_line.WIDTH_HZ
    bound = q * single_line.bounds_of(sigma, per_width)["w"] / single_line.WIDTH_HZ
    assert determined.scans["Q"].sigma == pytest.approx(bound, rel=0.02)
    assert half(determined.derived["Q"].ci95) == pytest.approx(1.96 * bound, rel=0.02)


def test_an_output_has_the_interval_of_the_parameter_it_is_made_of() -> None:
    """Q falls as w rises: the ends of its interval are the ratio at the ends of w's."""
    determined = known(single_line.line_objective(sigma=0.3, span=5.0), [1000.2, 8.3, 1.9])
    low, high = determined.parameters["w"].ci95
    best = determined.parameters["eta"].likely
    assert determined.derived["Q"].ci95 == pytest.approx((best / high, best / low), rel=2e-3)
    # not symmetric, and not taken for it
    q = determined.derived["Q"]
    up, down = q.ci95[1] - q.likely, q.likely - q.ci95[0]
    assert up > 1.05 * down


class Exponential(single_line.LineResponse):
    """One parameter k, seen through exp(k) alone: the profile is known in closed form."""

    def peaks(self, p: np.ndarray) -> np.ndarray:
        return np.full(self.tones_hz.size, math.exp(p[0]))

    def derived_many(self, ps: Sequence[np.ndarray]) -> list[dict[str, np.ndarray]]:
        return [{"root": np.sqrt(p - 0.2)} for p in ps]


def test_a_crooked_likelihood_gives_its_own_interval() -> None:
    """z* = 1, relative sigma s: chi^2 = m (exp(k) - 1)^2/s^2, so k = ln(1 + c s/sqrt m)."""
    m, s = 4, 1.0
    response = Exponential(np.zeros(m))
    parameter = Parameter(
        name="k", unit="", lower=-6.0, upper=3.0, start=0.5, reference=0.0, scale=1.0
    )
    measured = dataset(np.ones(m), np.full(m, s))
    objective = make_objective(response, (parameter,), measured)
    with np.errstate(invalid="ignore"):
        profile = known(objective, [0.1]).parameters["k"]

    def root(k: float) -> float:
        return math.sqrt(m) * (math.exp(k) - 1.0) / s

    wanted = [
        brentq(lambda k: root(k) + 1.959964, -6.0, 3.0),
        brentq(lambda k: root(k) - 1.959964, -6.0, 3.0),
    ]
    assert profile.ci95 == pytest.approx(tuple(wanted), abs=0.02)
    assert profile.closed_by == ("data", "data")


def test_an_interval_that_meets_the_bound_says_so() -> None:
    """The same with so much noise that exp(k) = 0 fits: nothing ends the interval below."""
    m, s = 4, 1.2
    response = Exponential(np.zeros(m))
    parameter = Parameter(
        name="k", unit="", lower=-6.0, upper=3.0, start=0.5, reference=0.0, scale=1.0
    )
    measured = dataset(np.ones(m), np.full(m, s))
    with np.errstate(invalid="ignore"):
        determined = known(make_objective(response, (parameter,), measured), [0.1])
    profile = determined.parameters["k"]
    assert profile.ci95[0] == -6.0
    assert profile.ci95[1] == pytest.approx(math.log(1.0 + 1.959964 * s / 2.0), abs=0.01)
    assert profile.closed_by == ("bound", "data")
    assert profile.status is Verdict.ABOVE


@pytest.mark.parametrize("at", [6.0, 0.0], ids=["at its limit", "inside"])
def test_where_the_model_ends_nothing_is_said_of_what_lies_beyond(at: float) -> None:
    """p = 0 +- 4 of a model without values beyond p = 3, wherever q, which does nothing, stands."""

    def rows(x: FloatArray) -> FloatArray:
        return np.full(3, x[0] / (4.0 * math.sqrt(3.0)) if x[0] <= 3.0 else math.nan)

    objective = whitened(rows, parameter("p", -50.0, 50.0), parameter("q", -6.0, 6.0))
    likelihood = likelihood_of(objective, np.full(3, SIGMA), np.zeros((3, 0)))
    evaluator = LikelihoodEvaluator(likelihood)
    [here] = run_in_lockstep([expansion_at(likelihood, np.array([0.0, at]))], evaluator)
    assert here is not None
    optimum = Optimum(
        likelihood=likelihood,
        expansion=here,
        chi_square=0.0,
        degrees_of_freedom=1.0,
        converged=True,
    )
    quantity = Quantity(name="p", index=0, output=-1, best=0.0, sigma=4.0, low=-50.0, high=50.0)
    walks = [trace_branch(optimum, quantity, direction) for direction in (-1.0, 1.0)]
    down, up = run_in_lockstep(walks, evaluator)
    assert down is not None
    assert up is not None
    assert (down.end, up.end) == ("crossed", "lost")
    assert down.at_95 == pytest.approx(-4.0 * Z95, rel=0.02)
    assert 2.0 < up.points[-1].value <= 3.0


def test_an_interval_of_68_per_cent_goes_as_far_as_anything_in_it_fits() -> None:
    """Delta chi^2 = 2.56 sin^2 0.8 p + (p/5)^12 is 2.56 at p = 1.96, and 0.06 at 3.9.

    Where it crosses 1 for the last time is read off a line between points of the walk.
    """

    def chi(p: float) -> float:
        return math.hypot(1.6 * math.sin(0.8 * p), (p / 5.0) ** 6)

    def rows(x: FloatArray) -> FloatArray:
        return np.array([1.6 * math.sin(0.8 * x[0]), (x[0] / 5.0) ** 6, 0.0])

    p = learnt(whitened(rows, parameter("p", -8.0, 8.0, start=0.0))).parameters["p"]
    ends = [brentq(lambda p, root=root: chi(p) - root, 4.0, 8.0) for root in (1.0, Z95)]
    assert p.ci68 == pytest.approx((-ends[0], ends[0]), rel=0.1)
    assert p.ci95 == pytest.approx((-ends[1], ends[1]), rel=0.02)


@pytest.fixture(scope="module")
def string() -> Determined:
    response = closed_form.string_response()
    measured = closed_form.measured_by(response, noise=0.01, seed=4)
    objective = make_objective(response, closed_form.string_parameters(), measured)
    return known(objective, [1.96, 94.0, 94.0])


def test_an_angle_that_nothing_holds_goes_round(string: Determined) -> None:
    theta = string.parameters["theta"]
    assert theta.closed_by == ("periodic", "periodic")
    assert half(theta.ci95) == pytest.approx(np.pi / 2)
    assert theta.status == "unconstrained"
    scan = string.scans["theta"]
    assert max(scan.delta_chi2) < 0.1
    # it closes: both ends are the same system
    ends = [np.array([scan.path[n][k] for n in ("theta", "d1", "d2")]) for k in (0, -1)]
    matrices = [closed_form.damping(a, b, c, reflection=False) for a, b, c in ends]
    assert matrices[0][0, 0] == pytest.approx(matrices[1][0, 0], rel=0.01)


def test_an_output_that_nothing_holds_is_as_wide_as_the_box(string: Determined) -> None:
    """lambda^2 = -1/2 sin 2 theta (eta-^2 - eta+^2): from 0 to its largest value at 3 pi/4."""
    coupling = string.derived["lambda"]
    largest = math.sqrt(0.5 * (7.02760e6**2 - 6.94026e6**2))
    assert coupling.status == "unconstrained"
    assert coupling.ci95[0] < 1.0
    assert coupling.ci95[1] == pytest.approx(largest, rel=1e-6)
    assert coupling.shrinkage < 1e-6
    truth = math.sqrt(-math.sin(2 * 1.9498)) * largest
    assert coupling.ci95[0] < truth < coupling.ci95[1]


def test_what_the_data_hold_is_not_drowned_by_what_they_do_not(string: Determined) -> None:
    truth = 2 * np.pi * closed_form.damping(1.9498, 120.0, 90.0, reflection=False)[0, 0]
    width = string.derived["D11"]
    assert width.status == "determined"
    assert width.ci95[0] < truth < width.ci95[1]
    assert half(width.ci95) < 0.05 * truth
    assert [string.parameters[n].status for n in ("d1", "d2")] == ["unconstrained"] * 2


def test_walks_that_are_cut_claim_nothing() -> None:
    objective = single_line.line_objective(seed=1, span=2.0)
    determined = known(objective, [1000.2, 8.3, 1.9], budget=30)
    for name, profile in determined.profiled.items():
        assert profile.closed_by == ("", "")
        assert determined.scans[name].stopped == ("budget", "budget")
        assert profile.ci95 == profile.bounds
        assert profile.status is Verdict.UNKNOWN
    assert determined.knowledge.effort.evaluations <= 30
    [incomplete] = of_kind(determined.findings, Kind.profiles_incomplete)
    assert incomplete.subject == "budget"


def test_the_range_of_an_output_is_searched_not_sampled() -> None:
    """An output whose top lies between all points of grid and seed."""

    class Humped(closed_form.ClosedFormResponse):
        def _derived(self, p: np.ndarray) -> dict[str, np.ndarray]:
            hump = math.exp(-((p[0] - 0.777) ** 2) / 0.5) * (1.0 - (p[1] / 100.0 - 1.1) ** 2)
            return {"hump": np.array([hump])}

    old = closed_form.string_response()
    response = Humped(old.pairs_hz, old.eta_plus_hz, old.eta_minus_hz, old.sweep_hz)
    found = output_ranges(response, closed_form.string_parameters(), 1, [np.zeros(3)])["hump"]
    assert found.high == pytest.approx(1.0, abs=1e-5)
    assert list(found.depends) == [True, True, False]


@dataclass(frozen=True)
class _Series(WhitenedResponse):
    """A response at 1,000 places, of which one has an output a thousand times that of the others.

    `read` counts readings of a place.
    """

    most: int = 1000
    read: list[int] = field(default_factory=lambda: [0], compare=False)

    def read_at(self, most: int) -> _Series:
        return replace(self, most=most)

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        self.read[0] += self.most * len(ps)
        places = np.ones(1000)
        places[777] = 1000.0
        kept = np.linspace(0, 999, self.most).astype(int)
        return [{"out": p[0] * p[1] * places[kept]} for p in ps]


def test_the_range_of_a_long_series_is_searched_at_some_places_and_told_of_all() -> None:
    """The mean over the places is p0 p1 (999 + 1000)/1000: 2 to 15 of that in the box."""
    series = _Series(rows=lambda p: p)
    box = (parameter("p0", 1.0, 3.0), parameter("p1", 2.0, 5.0))
    own = parameter("offset", -1.0, 1.0, experiment="pair1")
    found = output_ranges(series, (*box, own), 1, [np.zeros(3)])["out"]
    assert (found.low, found.high) == pytest.approx((2.0 * 1.999, 15.0 * 1.999), rel=1e-9)
    assert list(found.depends) == [True, True, False]
    assert series.read[0] < 20_000


def test_outputs_along_a_profile_are_those_of_its_parameters() -> None:
    """Also at the end of a range that was reached with one parameter held there.

    The data know a + b to 0.07 and leave b open: where b is brought to its end, a follows.
    """

    def rows(p: FloatArray) -> FloatArray:
        total = p[0] + p[1]
        return np.array([(total - 1.0) / 0.1, (total - 1.02) / 0.1])

    objective = whitened(
        rows,
        parameter("a", -50.0, 50.0, start=0.5),
        parameter("b", -3.0, 3.0, start=0.5),
        alone=lambda p: float(p[1]),
        total=lambda p: float(p[0] + p[1]),
    )
    determined = learnt(objective)
    found = {**determined.parameters, **determined.derived}
    for scan in determined.scans.values():
        a, b = np.array(scan.path["a"]), np.array(scan.path["b"])
        np.testing.assert_allclose(scan.path["total"], a + b, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(scan.path["alone"], b, rtol=0.0, atol=1e-9)
    assert found["alone"].closed_by == ("bound", "bound")
    half = Z95 * 0.1 / np.sqrt(2.0)
    np.testing.assert_allclose(found["total"].ci95, (1.01 - half, 1.01 + half), rtol=2e-3)
