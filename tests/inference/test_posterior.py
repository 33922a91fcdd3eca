"""Whether draws are enough, and whether ranks are uniform: against closed forms and arviz."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fitting.campaign.parameters import Parameter
from fitting.posterior.chain import Mixture, Target, autocorrelation_times
from fitting.posterior.summary import split_rhat
from fitting.text.arrays import FloatArray
from tests.support.closed_posteriors import Formula, parameter, problem
from tests.support.ranks import rank_of, uniformity


def autoregressive(rho: float, steps: int, walkers: int, seed: int) -> FloatArray:
    """x_t = rho x_(t-1) + noise: tau = (1 + rho)/(1 - rho)."""
    noise = np.random.default_rng(seed).standard_normal((steps + 200, walkers))
    found = np.zeros_like(noise)
    for t in range(1, len(noise)):
        found[t] = rho * found[t - 1] + noise[t]
    return found[200:]


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_correlation_time_of_an_autoregression_is_that_of_its_formula(rho: float) -> None:
    tau = (1.0 + rho) / (1.0 - rho)
    [found] = autocorrelation_times(autoregressive(rho, 4000, 20, seed=1)[..., None])
    # Sokal: var(tau)/tau^2 = 2 (2 M + 1)/steps, M = 5 tau, 20 walkers; beyond M is exp(-10) of it
    error = math.sqrt(2.0 * (10.0 * tau + 1.0) / (4000 * 20))
    assert found == pytest.approx(tau, rel=4.0 * error)


def test_walkers_that_stay_have_no_finite_correlation_time() -> None:
    assert autocorrelation_times(np.ones((100, 4, 1))).tolist() == [math.inf]


def waves() -> FloatArray:
    k, j = np.arange(100)[:, None], np.arange(4)[None, :]
    slow = np.sin(0.7 * (k + 1) * (1 + 0.13 * j)) + 0.05 * j
    return np.asarray(slow + np.sin(0.011 * (k + 1) ** 2))


def test_r_is_that_of_arviz() -> None:
    """arviz-stats 0.8.0, array_stats.rhat(method="rank"), of four chains of a hundred values."""
    chains = waves()
    assert split_rhat(chains) == pytest.approx(0.9977634218182786, rel=1e-9)
    assert split_rhat(np.round(chains, 1)) == pytest.approx(0.9977708505170096, rel=1e-9)  # ties
    wide = chains * [1.0, 1.0, 1.0, 3.0]  # the same means: only the distances from the median tell
    assert split_rhat(wide) == pytest.approx(1.1294681590296174, rel=1e-9)
    assert split_rhat(np.repeat([[0.0, 1.0]], 10, axis=0)) == math.inf


def test_a_mixture_has_the_density_of_its_draws() -> None:
    """By importance: the mean of (Gaussian density)/q over draws of q is one."""
    mixture = Mixture(
        np.array([[0.3, 0.4], [0.7, 0.6]]),
        np.array([np.diag([30.0, 50.0]), [[20.0, 10.0], [0.0, 40.0]]]),
        np.array([0.3, 0.7]),
    )
    random = np.random.RandomState(1)
    draws = mixture.draw(random.choice(2, size=40000, p=mixture.weights), random)
    n, nu = 2, 5.0
    constant = (
        math.lgamma(0.5 * (nu + n)) - math.lgamma(0.5 * nu) - 0.5 * n * math.log(nu * math.pi)
    )
    off = (draws - [0.5, 0.5]) / 0.1
    gaussian = -0.5 * np.sum(off**2, axis=1) - math.log(2.0 * math.pi * 0.01)
    ratio = np.exp(gaussian - mixture.log_density(draws) - constant)
    assert np.mean(ratio) == pytest.approx(1.0, abs=4.0 * np.std(ratio) / 200.0)


def target(
    of: Callable[[FloatArray], FloatArray], parameters: list[Parameter], noise: float
) -> Target:
    """Of one value, measured 10 more than 0."""
    formula = Formula(lambda p: 10.0 + of(p)[:, None])
    return Target(problem(formula, parameters, np.array([10.0]), np.array([noise])))


def two_wells() -> Target:
    """z = q^2 - 1 with noise 0.1: minima at -1 and 1, as one parameter of the box -3 ... 2."""
    return target(lambda p: p[:, 0] ** 2 - 1.0, [parameter("q", -3.0, 2.0, 0.5)], 0.1)


def test_minima_that_nobody_knew_are_looked_for_and_each_is_there_once() -> None:
    found = two_wells().minima([("a fit", np.array([0.9])), ("the same", np.array([1.1]))])
    places = sorted(float(m.centre[0]) for m in found)
    assert places == pytest.approx([-1.0, 1.0], abs=1e-3)  # where ln is known to 0.01
    assert [m.valley for m in found] == [0, 1]
    assert "a fit" in {m.origin for m in found}
    assert len({m.origin for m in found}) == 2  # the other one by a search of the box
    # the width is 0.1/2 in a box of 5; the box's own variance is a part in 3e4 of it
    assert [abs(float(m.root[0, 0])) for m in found] == pytest.approx([20.0, 20.0], rel=1e-2)


def test_places_of_one_valley_are_one_minimum() -> None:
    """z = x^2 + y^2 - 1: the angle is uniform."""
    names = [parameter("x", -2.0, 2.0, 1.0), parameter("y", -2.0, 2.0, 0.0)]
    ring = target(lambda p: np.sum(p**2, axis=1) - 1.0, names, 0.05)
    valley = ring.minima([("a fit", np.array([1.0, 0.0])), ("a start", np.array([0.0, 1.0]))])
    assert len(valley) > 1
    assert {m.valley for m in valley} == {0}


def test_images_exchange_two_values_and_move_a_third_by_half_its_period() -> None:
    angle = replace(parameter("theta", -1.0, 7.0, 1.0), period=2.0)
    widths = [replace(parameter(n, 1.0, 100.0, 9.0), unit="Hz") for n in ("d1", "d2")]
    flat = target(lambda p: 0.0 * p[:, 0], [*widths, angle], 1.0)
    images, point = flat.images(), np.array([20.0, 30.0, 0.2])
    exchanged = [image(point) for name, image in images if "exchanged" in name]
    angles = [0.2, -0.8, -0.2, 0.8]  # as it is, half a period off, about 0 and about a quarter
    assert np.array(exchanged) == pytest.approx(np.array([[30.0, 20.0, a] for a in angles]))
    assert len(images) == 7
    for _, image in images:
        assert image(image(point)) == pytest.approx(point)


@pytest.mark.parametrize("reported", [0.98, 0.02, -1.02])
def test_a_value_with_a_period_is_drawn_in_the_one_that_the_fit_reports(reported: float) -> None:
    """About 0.02 and 0.98, a little apart from each other: no cut goes between them."""
    angle = replace(parameter("q", -2.0, 2.0, 0.0), period=1.0)
    circle = target(lambda p: np.cos(2.0 * math.pi * p[:, 0]) - 0.99, [angle], 0.001)
    minima = circle.minima([("the fit", np.array([reported]))])
    assert sorted(m.valley for m in minima) == [0, 1]
    assert abs(float(minima[0].centre[0] - minima[1].centre[0])) < 0.1
    lower, width = float(circle.lower[0]), float(circle.width[0])
    assert lower <= reported % 1.0 < lower + width == lower + 1.0
    # whole periods off is the same, and beyond the period nothing is drawn
    places = circle.lower + np.array([[0.3], [1.3]])
    assert circle.in_period(places)[:, 0] == pytest.approx([places[0, 0]] * 2)
    assert np.isfinite(circle.log(places)).tolist() == [True, False]


def test_ranks_of_truths_that_are_draws_are_uniform_and_others_are_not() -> None:
    """A Gaussian posterior of known width, and one that says half of it."""
    rng = np.random.default_rng(1)
    truths = rng.standard_normal(400)
    draws = rng.standard_normal((400, 99))
    told = uniformity("x", [rank_of(t, d) for t, d in zip(truths, draws, strict=True)], 99, 20)
    assert sum(told.bins) == 400
    assert told.p_value > 1e-3
    assert told.fraction_std == pytest.approx(math.sqrt(1 / 12), abs=4 * 0.0075)
    narrow = uniformity(
        "x", [rank_of(t, 0.5 * d) for t, d in zip(truths, draws, strict=True)], 99, 20
    )
    assert narrow.p_value < 1e-9
    assert narrow.fraction_std > 0.33
    # by hand: 6 and 2 of 8 in two bins: (2^2 + 2^2)/4 = 2, P = erfc(sqrt(2/2)) = 0.1573
    two = uniformity("x", [0, 0, 1, 1, 2, 2, 7, 9], 9, 2)
    assert two.bins == (6, 2)
    assert two.chi_square == pytest.approx(2.0)
    assert two.p_value == pytest.approx(math.erfc(1.0), rel=1e-12)
