"""Sweeps of few points: how often intervals hold the truth, over virtual laboratories from seeds.

The noise is known from the residuals alone. Of n points a line takes three (frequency, width, and a
height that is a parameter, or a scale that is solved for): the errors of its values are those of
ordinary least squares, s^2 = sum r^2/(n - 3), and Student's t says how far intervals go. Where the
noise is stated, they are normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import binom, norm, t

import fitting as ff
from fitting.campaign.parameters import to_search
from fitting.fit.noise import noise_of
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.inference.determine import InferenceOptions, determine
from fitting.measurements.measurement import Evaluation
from fitting.signal.student import ROOT_68, freedom_of_share, normal_square, reach
from fitting.text.arrays import FloatArray
from fitting.text.estimate import ROOT_95, FittedEstimate
from tests.support.datasets import answer, dataset, sweep_measurement
from tests.support.whitened import parameter

ETA_HZ, WIDTH_HZ, TOP, NOISE = 5000.0, 20.0, 2.0, 0.02


def frequencies(points: int) -> FloatArray:
    return ETA_HZ + np.linspace(-2.0 * WIDTH_HZ, 2.0 * WIDTH_HZ, points)


def line(f: FloatArray, eta: float, width: float, top: float = TOP) -> FloatArray:
    """A/|1 + ...| of one damped mode, A at eta."""
    return np.asarray(top * np.abs(width * eta / ((eta - f) * (eta + f) + 1j * f * width)))


@dataclass(frozen=True)
class SweptLine:
    """`Response` of parameters (eta, width): a sweep of unit height."""

    f: FloatArray

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(sweep=line(self.f, p[0], p[1], 1.0), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]


def swept(points: int, seed: int, *, known: bool = False) -> Objective:
    """A sweep whose scale is solved for; its noise is stated, or not."""
    f = frequencies(points)
    noise = NOISE * np.random.default_rng([points, seed]).standard_normal(points)
    data = line(f, ETA_HZ, WIDTH_HZ) + noise
    told = np.full(points, NOISE) if known else None
    sweep = sweep_measurement(data, scale="fit", fitted=True, maximum_v=TOP, sigmas_v=told)
    boxes = (
        parameter("eta", ETA_HZ - 50.0, ETA_HZ + 50.0, start=ETA_HZ + 1.0),
        parameter("width", 2.0, 200.0, start=1.05 * WIDTH_HZ),
    )
    return make_objective(SweptLine(f), boxes, dataset(np.empty(0), sweep=sweep))


def profiled(objective: Objective, name: str) -> FittedEstimate:
    begin = to_search(objective.parameters, np.array([ETA_HZ, WIDTH_HZ]))
    [point] = evaluate_many(objective, [begin])
    options = InferenceOptions(only=(name,), minima=(), twins=(), directions=False)
    return determine(objective, begin, noise_of(objective, point), options).profiled[name]


def held(inside: int, total: int, share: float) -> bool:
    """Whether a count is one that this share gives in all but two of a thousand such tests."""
    low, high = binom.ppf([1e-3, 1.0 - 1e-3], total, share)
    return bool(low <= inside <= high)


def test_profiles_are_student_s_where_the_residuals_tell_the_noise() -> None:
    """The ends are those of scipy's curve_fit: its standard errors times Student's t."""
    for points, known in ((13, False), (13, True), (101, False)):
        objective = swept(points, 1, known=known)
        f = frequencies(points)
        data = objective.data.measured_rows * TOP
        sigma = {"sigma": np.full(points, NOISE), "absolute_sigma": True} if known else {}
        found, covariance = curve_fit(line, f, data, [ETA_HZ, WIDTH_HZ, TOP], **sigma)
        here = profiled(objective, "eta")
        law = norm if known else t(points - 3)
        assert here.likely == pytest.approx(found[0], abs=0.05 * np.sqrt(covariance[0, 0]))
        for (low, high), share in ((here.ci68, 0.6827), (here.ci95, 0.95)):
            half = law.ppf(0.5 + 0.5 * share) * np.sqrt(covariance[0, 0])
            assert 0.5 * (high - low) == pytest.approx(half, rel=0.03), (points, known, share)


@pytest.mark.parametrize(
    ("points", "known"),
    [
        (9, False),
        *(pytest.param(13, known, marks=pytest.mark.nightly) for known in (False, True)),
    ],
)
def test_profiles_hold_the_truth_as_often_as_they_say(points: int, known: bool) -> None:
    """Sixty sweeps: no rarer and no more often than a binomial count of those shares comes."""
    total, inside = 60, {0.6827: 0, 0.95: 0}
    for seed in range(total):
        here = profiled(swept(points, seed, known=known), "width")
        for (low, high), share in ((here.ci68, 0.6827), (here.ci95, 0.95)):
            inside[share] += low <= WIDTH_HZ <= high
    assert all(held(count, total, share) for share, count in inside.items()), inside


def test_a_line_of_few_points_has_errors_of_least_squares_times_student_s_t() -> None:
    for points in (9, 13, 25, 101):
        f = frequencies(points)
        data = line(f, ETA_HZ, WIDTH_HZ)
        data += NOISE * np.random.default_rng([points, 5]).standard_normal(points)
        found, covariance = curve_fit(line, f, data, [ETA_HZ, WIDTH_HZ, TOP], xtol=1e-12)
        here = ff.line(f, data, wiring="transmission")
        law = t(points - 3)
        error = np.sqrt(covariance[0, 0])
        assert here.dof == pytest.approx(points - 3)
        assert here.frequency.std == pytest.approx(law.ppf(norm.cdf(1.0)) * error, rel=1e-3)
        half = law.ppf(0.975) * error
        assert here.frequency.ci95 == pytest.approx((found[0] - half, found[0] + half), rel=1e-8)
        relative = here.width.std / law.ppf(norm.cdf(1.0))
        assert relative == pytest.approx(np.sqrt(covariance[1, 1]), rel=1e-3)


@pytest.mark.parametrize("points", [9, 13, 25, 101])
def test_an_interval_of_least_squares_holds_the_truth_as_often_as_it_says(points: int) -> None:
    """The closed form alone: linearised errors of 400 sweeps, with the same t and counts."""
    f, total, inside = frequencies(points), 400, {0.6827: 0, 0.95: 0}
    steps = np.array([1e-3, 1e-3, 1e-6])
    truth = np.array([ETA_HZ, WIDTH_HZ, TOP])
    slopes = [(line(f, *(truth + s)) - line(f, *(truth - s))) for s in np.diag(steps)]
    matrix = np.stack(slopes, axis=1) / (2.0 * steps)
    noise = NOISE * np.random.default_rng(points).standard_normal((total, points))
    inverse = np.linalg.pinv(matrix)
    for row in noise:
        off = inverse @ row
        left = row - matrix @ off
        error = np.sqrt((inverse @ inverse.T)[1, 1] * (left @ left) / (points - 3))
        for root, share in ((ROOT_68, 0.6827), (ROOT_95, 0.95)):
            inside[share] += abs(off[1]) <= reach(root, points - 3.0) * error
    assert all(held(count, total, share) for share, count in inside.items()), inside


@pytest.mark.parametrize("freedom", [0.5, 1.0, 6.0, 98.0, 1e6])
def test_the_square_of_a_normal_deviate_is_as_improbable_as_that_of_student_s_t(
    freedom: float,
) -> None:
    for square in (1e-6, 0.5, 1.0, 3.84, 40.0, 900.0):
        tail = t.sf(np.sqrt(square), freedom)
        if tail > 1e-200:
            found = normal_square(square, freedom)
            assert norm.sf(np.sqrt(found)) == pytest.approx(tail, rel=1e-6)
    far = [normal_square(10.0**power, freedom) for power in range(2, 12)]
    assert np.all(np.isfinite(far))
    assert np.all(np.diff(far) > 0.0)
    assert normal_square(7.0, np.inf) == 7.0
    assert normal_square(-1.0, freedom) == -1.0
    assert reach(ROOT_95, freedom) == pytest.approx(t.ppf(0.975, freedom), rel=1e-6)


@pytest.mark.parametrize(("freedom", "square"), [(30, 1e22), (100, 1e8), (1000, 5e3), (1e4, 2e3)])
def test_far_tails_are_those_of_mpmath_but_for_wallace_s_error(
    freedom: float, square: float
) -> None:
    """Tails below 1e-300: ln Phi(-z) = ln F_t(-t), the incomplete beta function at 30 digits."""
    with mp.workdps(30):
        n = mp.mpf(freedom)
        tail = mp.betainc(n / 2, mp.mpf(1) / 2, 0, n / (n + square), regularized=True) / 2
        begin = mp.sqrt(-2 * mp.log(tail))
        z = mp.findroot(lambda z: mp.log(mp.erfc(z / mp.sqrt(2)) / 2) - mp.log(tail), begin)
        wanted = float(z**2)
    assert normal_square(square, freedom) == pytest.approx(wanted, rel=0.5 / freedom)


def test_a_variance_of_which_a_part_is_estimated_has_satterthwaite_s_freedom() -> None:
    """Pulls with the variance a + b s^2/sigma^2: as wide as t of the combined freedom says."""
    freedom, share = 8.0, 0.6
    assert freedom_of_share(freedom, 1.0) == freedom
    assert freedom_of_share(freedom, share) == pytest.approx(freedom / 0.36)
    assert freedom_of_share(freedom, 0.0) == np.inf
    generator = np.random.default_rng(3)
    estimated = generator.chisquare(freedom, 40_000) / freedom
    pulls = generator.standard_normal(40_000) / np.sqrt(1.0 - share + share * estimated)
    inside = np.mean(np.abs(pulls) <= reach(ROOT_95, freedom_of_share(freedom, share)))
    assert inside == pytest.approx(0.95, abs=0.005)
