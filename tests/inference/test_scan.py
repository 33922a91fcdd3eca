"""Intervals against Cramér and Rao's bound, closed forms and profiles that scipy traces densely."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares
from scipy.stats import t as student

from fitting.campaign.parameters import Parameter, to_search
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.likelihood.knowledge import Determined
from fitting.inference.likelihood.profile import output_ranges
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoScale
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from tests.support import closed_form, single_line
from tests.support.datasets import dataset
from tests.support.whitened import Z95, WhitenedResponse, learnt, parameter, whitened

Rows = Callable[[FloatArray], FloatArray]


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


def test_where_the_model_ends_nothing_is_known_of_what_lies_beyond() -> None:
    """p = 0 +- 4 of a model without values beyond p = 3, wherever q, which does nothing, is."""

    def rows(x: FloatArray) -> FloatArray:
        return np.full(3, x[0] / (4.0 * math.sqrt(3.0)) if x[0] <= 3.0 else math.nan)

    objective = whitened(rows, parameter("p", -50.0, 50.0, start=0.1), parameter("q", -6.0, 6.0))
    found = learnt(objective, minima=())
    p, scan = found.parameters["p"], found.scans["p"]
    assert p.closed_by == ("data", "")
    assert scan.stopped == ("", "search")
    assert p.ci95[0] == pytest.approx(-4.0 * Z95, rel=0.02)
    assert p.ci95[1] == 50.0
    assert 2.0 < max(scan.values) <= 3.0
    assert p.status is Verdict.UNKNOWN


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


def test_scans_that_are_cut_claim_nothing() -> None:
    objective = single_line.line_objective(seed=1, span=2.0)
    determined = known(objective, [1000.2, 8.3, 1.9], budget=20)
    for name, profile in determined.profiled.items():
        assert profile.closed_by == ("", "")
        assert determined.scans[name].stopped == ("budget", "budget")
        assert profile.ci95 == profile.bounds
        assert math.isnan(profile.std)
        assert profile.status is Verdict.UNKNOWN
    assert determined.knowledge.effort.evaluations <= 20
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


# --- where the covariance is the interval


def straight(rows: int = 20, count: int = 3) -> tuple[FloatArray, FloatArray, Objective]:
    """Rows M p - y in sigma with random M, and two outputs that are linear in p."""
    generator = np.random.default_rng(8)
    matrix = generator.standard_normal((rows, count))
    measured = matrix @ np.arange(1.0, count + 1.0) + generator.standard_normal(rows)
    own = (parameter(f"p{k}", -40.0, 40.0, start=1.0) for k in range(count))
    objective = whitened(
        lambda p: matrix @ p - measured,
        *own,
        sum=lambda p: float(np.sum(p)),
        gap=lambda p: float(3.0 * p[0] - p[1]),
    )
    return matrix, measured, objective


def test_a_straight_problem_has_the_intervals_of_its_normal_equations_for_four_runs_each() -> None:
    """Errors by (M^T M)^-1, of the outputs along their gradients; each verified at its ends."""
    matrix, measured, objective = straight()
    covariance = np.linalg.inv(matrix.T @ matrix)
    best = covariance @ matrix.T @ measured
    gradients = {"sum": np.ones(3), "gap": np.array([3.0, -1.0, 0.0])}
    gradients |= {f"p{k}": row for k, row in enumerate(np.eye(3))}
    found = learnt(objective, minima=(), twins=(), directions=False)
    assert found.knowledge.inflation == 1.0
    for name, value in found.profiled.items():
        gradient = gradients[name]
        error = math.sqrt(gradient @ covariance @ gradient)
        middle = float(gradient @ best)
        assert value.likely == pytest.approx(middle, abs=0.05 * error)
        for root, ends in ((1.0, value.ci68), (Z95, value.ci95)):
            assert half(ends) == pytest.approx(root * error, rel=2e-3), name
            assert sum(ends) / 2.0 == pytest.approx(middle, abs=0.05 * error), name
        assert value.method == "linearised, verified"
        assert value.closed_by == ("data", "data")
        assert len(found.scans[name].values) == 5
    # the search for the optimum, its slopes, and four runs for each of five values
    assert found.knowledge.effort.evaluations <= 20 + 4 * 5 + 5


def test_an_interval_that_is_only_nearly_straight_is_scanned() -> None:
    """p + p^2/4 = 0 +- 0.4: chi square at the foreseen ends is off by a third, and by two."""

    def rows(x: FloatArray) -> FloatArray:
        return np.full(3, (x[0] + 0.25 * x[0] ** 2) / 0.4 / math.sqrt(3.0))

    p = learnt(whitened(rows, parameter("p", -1.9, 8.0, start=0.3))).parameters["p"]
    ends = [2.0 * (math.sqrt(1.0 + side * 0.4 * Z95) - 1.0) for side in (-1.0, 1.0)]
    assert p.method == "profile"
    assert p.ci95 == pytest.approx(tuple(ends), rel=0.01)


# --- a crooked likelihood, traced by scipy

TIMES = np.array([0.3, 0.8, 1.5, 2.5, 4.0, 6.0])
#: Of A exp(-k t) + c: a decay that six points hardly show.
DECAY, NOISE = np.array([5.0, 0.5, 1.0]), 0.25


def decay(p: FloatArray) -> FloatArray:
    """Rows, in sigma, of data with a fixed scatter."""
    scatter = np.array([0.6, -1.0, 0.4, 0.8, -0.5, 0.2])
    ideal = DECAY[0] * np.exp(-DECAY[1] * TIMES) + DECAY[2]
    return np.asarray((p[0] * np.exp(-p[1] * TIMES) + p[2] - ideal) / NOISE - scatter)


LOWER, UPPER = np.array([0.1, 0.01, -10.0]), np.array([60.0, 8.0, 10.0])


def least(of: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray) -> float:
    """The least chi square over what is free, from many places."""
    starts = [low + share * (high - low) for share in (0.02, 0.1, 0.3, 0.6, 0.9)]
    fits = (least_squares(of, start, bounds=(low, high), xtol=1e-10) for start in starts)
    return min(2.0 * float(fit.cost) for fit in fits)


def dense_ends(
    at: Callable[[float], float], minimum: float, low: float, best: float, high: float
) -> tuple[float, float]:
    """The outermost crossings of a profile that is evaluated densely, or the ends of its range."""
    ends = []
    for limit in (low, high):
        spaced = np.geomspace if best * limit > 0.0 else np.linspace
        places = spaced(best, limit, 12)
        above = [at(float(place)) - minimum > Z95**2 for place in places]
        if not above[-1]:
            ends.append(limit)
            continue
        last = max(k for k, each in enumerate(above) if not each)
        inside, outside = float(places[last]), float(places[last + 1])
        ends.append(brentq(lambda c: at(c) - minimum - Z95**2, inside, outside, rtol=1e-4))
    return ends[0], ends[1]


@pytest.fixture(scope="module")
def decayed() -> Determined:
    own = (
        parameter(name, low, high, start=start)
        for name, low, high, start in zip("Akc", LOWER, UPPER, (4.0, 0.7, 0.5), strict=True)
    )
    objective = whitened(
        decay,
        *own,
        tau=lambda p: 1.0 / float(p[1]),
        area=lambda p: float(p[0] / p[1]),
        total=lambda p: float(p[0] + p[2]),
    )
    return learnt(objective)


@pytest.fixture(scope="module")
def lowest() -> float:
    return least(decay, LOWER, UPPER)


@pytest.mark.parametrize("name", ["A", "k", "c"])
def test_intervals_of_crooked_parameters_are_those_of_their_dense_profiles(
    name: str, decayed: Determined, lowest: float
) -> None:
    i = "Akc".index(name)
    free = np.arange(3) != i

    def at(c: float) -> float:
        def rows(q: FloatArray) -> FloatArray:
            return decay(np.insert(q, i, c))

        return least(rows, LOWER[free], UPPER[free])

    found = decayed.parameters[name]
    wanted = dense_ends(at, lowest, LOWER[i], found.likely, UPPER[i])
    assert decayed.knowledge.inflation == 1.0
    for end, true in zip(found.ci95, wanted, strict=True):
        assert end == pytest.approx(true, abs=0.03 * abs(true - found.likely))


#: A and c of outputs that are held at a value, by k and what is free besides.
HELD_OUTPUTS: dict[str, tuple[Callable[[float, FloatArray], FloatArray], list[int], float, float]]
HELD_OUTPUTS = {
    "tau": (lambda v, q: np.array([q[0], 1.0 / v, q[1]]), [0, 2], 1.0 / 8.0, 100.0),
    "area": (lambda v, q: np.array([v * q[0], q[0], q[1]]), [1, 2], 0.0125, 6000.0),
    "total": (lambda v, q: np.array([q[0], q[1], v - q[0]]), [0, 1], -9.9, 70.0),
}


@pytest.mark.parametrize("name", HELD_OUTPUTS)
def test_intervals_of_crooked_outputs_are_those_of_their_dense_profiles(
    name: str, decayed: Determined, lowest: float
) -> None:
    place, free, low, high = HELD_OUTPUTS[name]

    def at(v: float) -> float:
        def rows(q: FloatArray) -> FloatArray:
            p = place(v, q)
            out = np.maximum(LOWER - p, 0.0) + np.maximum(p - UPPER, 0.0)
            return np.append(decay(np.clip(p, LOWER, UPPER)), 1e4 * out)

        return least(rows, LOWER[free], UPPER[free])

    found = decayed.derived[name]
    assert found.bounds == pytest.approx((low, high), rel=1e-3)
    wanted = dense_ends(at, lowest, low, found.likely, high)
    low95, high95 = found.ci95
    if low > 0.0:  # over decades, as a width and its inverse
        assert math.log(low95 / wanted[0]) == pytest.approx(0.0, abs=0.02)
        assert math.log(high95 / wanted[1]) == pytest.approx(0.0, abs=0.02)
    else:
        for end, true in zip(found.ci95, wanted, strict=True):
            assert end == pytest.approx(true, abs=0.03 * abs(true - found.likely))


# --- bounds


def test_a_bound_that_fits_is_tried_before_anything_is_scanned() -> None:
    """p and q of which only the sum is measured: four sides are open after a few runs each."""

    def rows(x: FloatArray) -> FloatArray:
        return np.array([(x[0] + x[1] - 10.0) / 0.1, 0.5, -0.5])

    own = (parameter(name, 1.0, 9.0, start=start) for name, start in (("p", 4.5), ("q", 5.0)))
    found = learnt(whitened(rows, *own), minima=(), twins=(), directions=False)
    for value in found.parameters.values():
        assert value.closed_by == ("bound", "bound")
        assert value.ci95 == (1.0, 9.0)
        assert value.status is Verdict.UNCONSTRAINED
    assert found.knowledge.effort.evaluations <= 60


def leaning(upper: float) -> Determined:
    """a + d is 5 +- 0.1 and a is 4 +- 0.6, d at most `upper`; d may not be below 0.1."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([(p[0] + p[1] - 5.0) / 0.1, (p[0] - 4.0) / 0.6, 0.0, 0.0])

    a, d = parameter("a", 0.5, 50.0, start=4.0), parameter("d", 0.1, upper, start=0.5)
    return learnt(whitened(rows, a, d))


def test_an_interval_along_which_a_bound_is_active_names_it() -> None:
    """Below, d ends at 1.5: chi^2 = ((a - 3.5)/0.1)^2 + ((a - 4)/0.6)^2 is 3.84 at a = 3.33.

    Above, at d = 0.1, it is ((a - 4.9)/0.1)^2 + ((a - 4)/0.6)^2.
    """

    def end(d: float, side: float) -> float:
        # the root of a quadratic: A a^2 - 2 B a + C = 3.84
        one, two = 1.0 / 0.01, 1.0 / 0.36
        b = one * (5.0 - d) + two * 4.0
        c = one * (5.0 - d) ** 2 + two * 16.0 - Z95**2
        return (b + side * math.sqrt(b * b - (one + two) * c)) / (one + two)

    found = leaning(1.5)
    a = found.parameters["a"]
    assert a.ci95 == pytest.approx((end(1.5, -1.0), end(0.1, 1.0)), abs=0.01)
    assert a.active_bounds == ("d",)
    assert found.scans["a"].held == ("d",)
    assert a.condition  # what is printed beside "determined"
    [at_bound] = of_kind(found.findings, Kind.interval_at_bound)
    assert at_bound.names["held"] == ("d",)
    assert "a" in at_bound.names["values"]


def test_an_interval_within_all_bounds_names_none() -> None:
    found = leaning(6.0)
    assert found.parameters["a"].active_bounds == ("d",)  # above a = 4.9 d still ends at 0.1
    rows = lambda p: np.array([(p[0] + p[1] - 5.0) / 0.1, (p[0] - 4.0) / 0.2, 0.0])  # noqa: E731
    own = parameter("a", 0.5, 50.0, start=4.0), parameter("d", 0.1, 6.0, start=0.5)
    free = learnt(whitened(rows, *own))
    error = 1.0 / math.sqrt(1.0 / 0.2**2)
    assert free.parameters["a"].ci95 == pytest.approx((4.0 - Z95 * error, 4.0 + Z95 * error), 1e-3)
    assert free.parameters["a"].active_bounds == ()
    assert not of_kind(free.findings, Kind.interval_at_bound)


def test_a_little_of_a_mode_damped_without_end_is_much_to_a_width() -> None:
    """A line at 20 whose mode hangs a little in another one, and the width a + d sin^2 theta.

    Of that other mode's damping d the line shows nothing to speak of; sin^2 theta is known to 1e-5
    at theta = 0, where no slope leads away. At d = 1e5, its bound, the width may be 20 + sqrt(0.1^2
    + (1e-5 d)^2) 1.96; downward the line alone counts.
    """
    seen, turn, most = 0.1, 1e-5, 1e5

    def rows(p: FloatArray) -> FloatArray:
        turned = math.sin(p[0]) ** 2
        return np.array([(p[2] + 10.0 * turned - 20.0) / seen, turned / turn, 0.0, 0.0])

    width = learnt(
        whitened(
            rows,
            parameter("theta", 0.0, math.pi, period=math.pi, start=1e-3),
            parameter("d", 1.0, most, start=300.0),
            parameter("a", 1.0, 1e3, start=20.0),
            width=lambda p: float(p[2] + p[1] * math.sin(p[0]) ** 2),
        )
    ).derived["width"]
    assert width.ci95[0] == pytest.approx(20.0 - Z95 * seen, rel=1e-3)
    assert width.ci95[1] == pytest.approx(20.0 + Z95 * math.hypot(seen, turn * most), rel=2e-3)
    assert width.closed_by == ("data", "data")
    assert width.active_bounds == ("d",)


def test_a_product_that_the_data_determine_is_not_scanned() -> None:
    """Along a b = 6 nothing but the bounds holds a and b: g = a b is known by its covariance."""

    def rows(p: FloatArray) -> FloatArray:
        return np.array([(p[0] * p[1] - 6.0) / 0.01, 0.0, 0.0])

    own = parameter("a", 1e-2, 1e3, start=2.0), parameter("b", 1e-2, 1e3, start=3.1)
    found = learnt(whitened(rows, *own, g=lambda p: float(p[0] * p[1]))).derived["g"]
    assert found.method == "linearised, verified"
    assert found.ci95 == pytest.approx((6.0 - 0.01 * Z95, 6.0 + 0.01 * Z95), rel=1e-6)


# --- points that scans share


def test_a_scan_goes_on_from_a_point_that_another_one_came_by() -> None:
    """Along p = q^3 - 3 q with q = 0 +- 1.1: from p = 0 the scan of p leads to the turn at q = -1.

    There p = 2; q goes on to 2.156 at the other side, where p is 3.55. Dense over q.
    """
    s = 0.05

    def rows(x: FloatArray) -> FloatArray:
        p, q = x
        return np.array([(p - q**3 + 3.0 * q) / s, q / 1.1, 0.0])

    own = parameter("p", -30.0, 30.0, start=0.1), parameter("q", -5.0, 5.0, start=0.05)
    found = learnt(whitened(rows, *own), minima=(), twins=()).parameters
    q = np.linspace(-1.1 * Z95, 1.1 * Z95, 100_001)
    farthest = float(np.max(q**3 - 3.0 * q + s * np.sqrt(Z95**2 - np.minimum(q / 1.1, Z95) ** 2)))
    assert farthest > 3.5
    assert found["q"].ci95 == pytest.approx((-1.1 * Z95, 1.1 * Z95), rel=0.01)
    assert found["p"].ci95 == pytest.approx((-farthest, farthest), rel=0.02)
    assert found["p"].closed_by == ("data", "data")


@pytest.mark.parametrize("height", [0.0, 1.0, 2.5])
def test_an_interval_holds_another_minimum_that_fits(height: float) -> None:
    """Valleys at k = 1 and 5, by a wall of 30 sigma, the farther one `height` of chi^2 higher.

    Each is (k - k_0)/s with s = 1/30: the far end is where chi^2 has 3.84 - height left.
    """

    def rows(p: FloatArray) -> FloatArray:
        k = float(p[0])
        near, far = 30.0 * (k - 1.0), math.hypot(30.0 * (k - 5.0), math.sqrt(height))
        return np.array([near if abs(near) < far else far, 0.0, 0.0])

    found = learnt(whitened(rows, parameter("k", 0.1, 12.0, start=1.2)), minima=[np.array([3.8])])
    k = found.parameters["k"]
    assert k.likely == pytest.approx(1.0, abs=1e-3)
    ends = 1.0 - Z95 / 30.0, 5.0 + math.sqrt(Z95**2 - height) / 30.0
    assert k.ci95 == pytest.approx(ends, abs=2e-3)
    assert k.status is Verdict.SEVERAL
    [other] = found.knowledge.equivalents
    assert other.parameters["k"] == pytest.approx(5.0, abs=0.02)
    assert other.delta == pytest.approx(height, abs=5e-3)


def test_a_better_minimum_is_gone_to_and_the_first_one_named() -> None:
    """Chi^2 is 2 in the valley at k = 1, where the search began, and none at 5."""

    def rows(p: FloatArray) -> FloatArray:
        k = float(p[0])
        near, far = math.hypot(30.0 * (k - 1.0), math.sqrt(2.0)), 30.0 * (k - 5.0)
        return np.array([near if near < abs(far) else far, *np.zeros(4)])

    found = learnt(whitened(rows, parameter("k", 0.1, 12.0, start=1.2)), minima=[np.array([3.8])])
    k = found.parameters["k"]
    assert k.likely == pytest.approx(5.0, abs=1e-3)
    ends = 1.0 - math.sqrt(Z95**2 - 2.0) / 30.0, 5.0 + Z95 / 30.0
    assert k.ci95 == pytest.approx(ends, abs=2e-3)
    [other] = found.knowledge.equivalents
    assert other.parameters["k"] == pytest.approx(1.0, abs=0.02)


# --- noise that the residuals give


def test_intervals_are_student_s_where_the_residuals_give_the_noise() -> None:
    """1, -2, 0, 2, -1 about a straight line: three degrees of freedom, s^2 = 10/3."""
    times, scattered = np.arange(-2.0, 3.0), np.array([1.0, -2.0, 0.0, 2.0, -1.0])
    own = [parameter(name, -200.0, 200.0, start=1.0) for name in ("height", "slope")]
    objective = whitened(lambda p: p[0] + p[1] * times + scattered, *own, known=False)
    [point] = evaluate_many(objective, [np.zeros(2)])
    found = determine(objective, np.zeros(2), noise_of(objective, point)).parameters
    for name, square in (("height", 5.0), ("slope", 10.0)):
        assert found[name].method == "linearised, verified"
        error = math.sqrt(10.0 / 3.0 / square)
        for share, ends in ((0.6827, found[name].ci68), (0.95, found[name].ci95)):
            wide = float(student.ppf(0.5 + 0.5 * share, 3)) * error
            assert ends == pytest.approx((-wide, wide), rel=0.02, abs=0.02 * wide), name


# --- effort


def test_whatever_the_budget_no_interval_leaves_the_truth_out(decayed: Determined) -> None:
    """Ends that are called closed are those of an unlimited budget; others are at the bounds."""
    own = [
        parameter(name, low, high, start=start)
        for name, low, high, start in zip("Akc", LOWER, UPPER, (4.0, 0.7, 0.5), strict=True)
    ]
    for budget in (40, 80, 120, 160, 240, 320, 480, 960):
        found = learnt(whitened(decay, *own), budget=budget)
        assert found.knowledge.effort.evaluations <= budget
        for name, value in found.parameters.items():
            whole = decayed.parameters[name]
            wide = whole.ci95[1] - whole.ci95[0]
            sides = zip(value.closed_by, value.ci95, whole.ci95, value.bounds, strict=True)
            for closed, end, wanted, bound in sides:
                if closed == "data":
                    assert end == pytest.approx(wanted, abs=0.02 * wide), (budget, name)
                else:
                    assert end == bound, (budget, name)
            if "" in value.closed_by:
                assert value.status is Verdict.UNKNOWN
                assert "budget" in found.scans[name].stopped


# --- a model that has no answer beyond its bounds


def failing(error: Callable[[], Exception], s: float) -> Rows:
    """p = 8 with noise s, and no answer outside its bounds."""

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
def test_a_model_is_not_asked_beyond_its_bounds(error: Callable[[], Exception]) -> None:
    """Of noise 0.2 the data close both sides, of noise 3 the lower one: up to 10 all fits."""
    own = parameter("p", 1.0, 10.0)
    found = learnt(whitened(failing(error, 0.2), own), (8.1,)).parameters["p"]
    assert found.status is Verdict.DETERMINED
    assert found.ci95 == pytest.approx((8.0 - 0.2 * Z95, 8.0 + 0.2 * Z95), rel=1e-3)
    wide = learnt(whitened(failing(error, 3.0), own), (8.1,)).parameters["p"]
    assert wide.closed_by == ("data", "bound")
    assert wide.status is Verdict.BELOW
    assert wide.ci95 == pytest.approx((8.0 - 3.0 * Z95, 10.0), rel=1e-3)


class Undefined(WhitenedResponse):
    """Whose outputs cannot be read outside the bounds, as of an FMU that does not initialise."""

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        if any(not 1.0 <= p[0] <= 10.0 for p in ps):
            raise FmuFailure("no root of a negative number", {}, Path("test.fmu"))
        return super().derived_many(ps)


def test_an_output_that_cannot_be_read_beyond_the_bounds_costs_no_interval() -> None:
    """p = 8 -+ 0.39, and its square likewise."""
    rows = failing(lambda: AssertionError("never asked"), 0.2)
    inside = whitened(lambda p: rows(np.clip(p, 1.0, 10.0)), parameter("p", 1.0, 10.0))
    response = Undefined(lambda p: rows(np.clip(p, 1.0, 10.0)), {"square": lambda p: p[0] ** 2})
    found = learnt(replace(inside, response=response), (8.1,))
    assert {p.status for p in found.profiled.values()} == {Verdict.DETERMINED}
    ends = np.array([8.0 - 0.2 * Z95, 8.0 + 0.2 * Z95])
    assert found.parameters["p"].ci95 == pytest.approx(tuple(ends), rel=1e-3)
    # verified ends are straight to a twentieth of chi square
    half_width = 0.5 * float(np.diff(ends**2)[0])
    assert found.derived["square"].ci95 == pytest.approx(tuple(ends**2), abs=0.03 * half_width)
