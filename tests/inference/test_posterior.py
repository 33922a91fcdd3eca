"""Whether draws are enough, and whether ranks are uniform: against closed forms and arviz."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fitting.posterior.convergence import autocorrelation_time, split_rhat
from fitting.posterior.minima import Image, Target, about, as_likely, images_of, minima_of
from fitting.posterior.mixture import Minimum, Mixture, share_of
from fitting.posterior.periods import (
    in_period,
    interval_in_period,
    period_begins,
    value_in_period,
)
from fitting.text.arrays import FloatArray
from tests.support.closed_posteriors import parameter
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
    found = autocorrelation_time(autoregressive(rho, 4000, 20, seed=1))
    # Sokal: var(tau)/tau^2 = 2 (2 M + 1)/steps, M = 5 tau, 20 walkers; beyond M is exp(-10) of it
    error = math.sqrt(2.0 * (10.0 * tau + 1.0) / (4000 * 20))
    assert found == pytest.approx(tau, rel=4.0 * error)


def test_walkers_that_stay_have_a_correlation_time_as_long_as_the_chain() -> None:
    apart = np.repeat([[0.0, 1.0]], 1000, axis=0)
    apart = apart + 1e-3 * np.random.default_rng(1).standard_normal(apart.shape)
    assert autocorrelation_time(apart) > 400.0
    assert autocorrelation_time(np.ones((100, 4))) == math.inf


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
    roots = [np.diag([30.0, 50.0]), np.array([[20.0, 10.0], [0.0, 40.0]])]
    minima = [
        Minimum(centre=np.array([0.3, 0.4]), root=roots[0], weight=0.0, origin=""),
        Minimum(centre=np.array([0.7, 0.6]), root=roots[1], weight=1.0, origin=""),
    ]
    mixture = Mixture.of(minima)
    assert mixture.weights.sum() == pytest.approx(1.0)
    draws = mixture.draw(40000, np.random.RandomState(1))
    n, nu = 2, 5.0
    constant = (
        math.lgamma(0.5 * (nu + n)) - math.lgamma(0.5 * nu) - 0.5 * n * math.log(nu * math.pi)
    )
    off = (draws - [0.5, 0.5]) / 0.1
    gaussian = -0.5 * np.sum(off**2, axis=1) - math.log(2.0 * math.pi * 0.01)
    ratio = np.exp(gaussian - mixture.log_density(draws) - constant)
    assert np.mean(ratio) == pytest.approx(1.0, abs=4.0 * np.std(ratio) / 200.0)
    assert share_of(mixture, draws, mixture.log_density(draws)) == pytest.approx(1.0)


def test_a_mixture_is_worth_the_share_of_independent_draws_of_its_proposals() -> None:
    """Of a Gaussian, by draws of it and, as importance sampling has it, by proposals."""
    rng, root = np.random.default_rng(1), np.diag([30.0, 50.0])
    minimum = Minimum(centre=np.array([0.5, 0.5]), root=root, weight=0.0, origin="")
    mixture = Mixture.of([minimum])

    def log(table: FloatArray) -> FloatArray:
        return np.asarray(-0.5 * np.sum(((table - 0.52) * [30.0, 80.0]) ** 2, axis=1))

    draws = 0.52 + rng.standard_normal((40000, 2)) / [30.0, 80.0]
    tried = mixture.draw(40000, np.random.RandomState(2))
    weights = np.exp(log(tried) - mixture.log_density(tried))
    share = float(np.sum(weights) ** 2 / (weights.size * np.sum(weights**2)))
    # draws of a Gaussian do not reach the tails of Student's t, which have a tenth of its weight
    assert share_of(mixture, draws, log(draws)) == pytest.approx(share, rel=0.15)


def two_wells() -> Target:
    """-2 ln p = ((q^2 - 1)/0.1)^2: minima at -1 and 1, as one parameter of the box -3 ... 2."""

    def log(p: FloatArray) -> FloatArray:
        found = np.where(
            np.abs(p[:, 0] + 0.5) <= 2.5, -0.5 * ((p[:, 0] ** 2 - 1.0) / 0.1) ** 2, -np.inf
        )
        return np.asarray(found)

    def rows(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (p**2 - 1.0) / 0.1, np.diag(2.0 * p / 0.1)

    return Target(parameters=(parameter("q", -3.0, 2.0, 0.5),), log=log, rows=rows)


def test_minima_that_nobody_knew_are_looked_for_and_each_is_there_once() -> None:
    target = two_wells()
    found = minima_of(target, [("a fit", np.array([0.9])), ("the same", np.array([1.1]))])
    places = sorted(float(target.in_units(m.centre)[0]) for m in found)
    assert places == pytest.approx([-1.0, 1.0], abs=1e-3)  # where ln is known to 0.01
    assert "a fit" in {m.origin for m in found}
    assert len({m.origin for m in found}) == 2  # the other one by a search of the box
    # the width is 0.1/2 in a box of 5; the box's own variance is a part in 3e4 of it
    assert [abs(float(m.root[0, 0])) for m in found] == pytest.approx([100.0, 100.0], rel=1e-3)


def ring() -> Target:
    """-2 ln p = ((x^2 + y^2 - 1)/0.05)^2 in the box -2 ... 2: the angle is uniform."""

    def log(p: FloatArray) -> FloatArray:
        inside = np.all(np.abs(p) <= 2.0, axis=1)
        return np.where(inside, -0.5 * ((np.sum(p**2, axis=1) - 1.0) / 0.05) ** 2, -np.inf)

    def rows(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([(p @ p - 1.0) / 0.05]), 2.0 * p[None] / 0.05

    names = (parameter("x", -2.0, 2.0, 1.0), parameter("y", -2.0, 2.0, 0.0))
    return Target(parameters=names, log=log, rows=rows)


def test_places_of_one_valley_are_one_minimum_and_two_wells_are_two() -> None:
    valley = minima_of(ring(), [("a fit", np.array([1.0, 0.0])), ("a start", np.array([0.0, 1.0]))])
    assert len(valley) > 1
    assert {m.copy_of for m in valley[1:]} == {0}
    assert [m.copy_of for m in minima_of(two_wells(), [("a fit", np.array([0.9]))])] == [-1, -1]


def test_images_exchange_two_values_and_move_a_third_by_half_its_period_and_back() -> None:
    angle = replace(parameter("theta", -1.0, 7.0, 1.0), period=2.0)
    widths = [replace(parameter(n, 1.0, 100.0, 9.0), unit="Hz") for n in ("d1", "d2")]
    names = (*widths, angle)
    target = Target(parameters=names, log=lambda p: np.zeros(len(p)), rows=None)  # type: ignore[arg-type]
    images = images_of(target)
    point = np.array([20.0, 30.0, 2.2])

    def moved(image: Image, p: FloatArray) -> FloatArray:
        return target.in_units(image(target.in_box(p)))

    exchanged = [moved(image, point) for image in images if "exchanged" in image.name]
    angles = [2.2, 3.2, 1.2, 2.8, 3.8, 4.8]  # as it is, half a period off, about 5/2, 3 and 7/2
    assert np.array(exchanged) == pytest.approx(np.array([[30.0, 20.0, a] for a in angles]))
    for image in images:
        back = [moved(other, moved(image, point)) for other in images]
        assert any(p == pytest.approx(point) for p in back)
    assert len(as_likely(target, images, point)) == len(images) == 11


def test_values_a_period_off_are_told_about_the_minimum() -> None:
    angle = replace(parameter("q", 0.0, 1.0, 0.5), period=1.0)
    target = replace(two_wells(), parameters=(angle,))
    here = Minimum(centre=np.array([0.02]), root=np.eye(1), weight=0.0, origin="")
    drawn = about(target, here, np.array([[0.1], [0.9], [0.45], [0.6]]))
    assert drawn[:, 0] == pytest.approx([0.1, -0.1, 0.45, -0.4])
    narrow = replace(target, parameters=(replace(angle, upper=0.95),))
    assert about(narrow, here, np.array([[0.9]]))[0, 0] == 0.9


def turning(lower: float = -2.0, upper: float = 2.0) -> Target:
    """A value with the period 1."""
    angle = replace(parameter("q", lower, upper, 0.5 * (lower + upper)), period=1.0)
    return replace(two_wells(), parameters=(angle,))


@pytest.mark.parametrize(
    ("middle", "reported", "begins"),
    [
        (0.3, 0.3, -0.2),  # 0.3 in the middle: 0 would do, too
        (0.02, 0.02, -0.48),  # a cut at 0 would go through the draws
        (0.02, 0.98, 0.52),  # the fit calls it 0.98: so do draws
        (0.98, 0.98, 0.48),
    ],
)
def test_draws_that_do_not_go_all_round_are_told_in_one_piece(
    middle: float, reported: float, begins: float
) -> None:
    """Even draws in a tenth of the period, two turns off: the gap is cut in its middle."""
    target, off = turning(), np.linspace(-0.05, 0.05, 101)
    draws = (middle - 2.0 + off)[:, None]
    found = period_begins(target, draws, {"q": reported})
    assert found == pytest.approx([begins])
    turned = in_period(target, found, draws)[:, 0]
    assert turned == pytest.approx(begins + 0.5 + off)
    assert np.ptp(turned) == pytest.approx(0.1)
    # a truth a little beyond the draws is told beside them, on whichever side it is
    for beside in (-0.2, 0.2):
        shown = value_in_period(target.parameters[0], float(found[0]), middle + beside + 5.0)
        assert shown == pytest.approx(begins + 0.5 + beside)


def test_draws_that_go_all_round_are_told_in_the_period_of_the_fit() -> None:
    target = turning()
    even = np.random.default_rng(1).uniform(-2.0, 2.0, (4000, 1))
    assert period_begins(target, even, {"q": 0.7})[0] == 0.0
    # three of four draws about a multiple of the period: where they are rarest is half of it off
    most = np.concatenate([even, np.random.default_rng(2).normal(1.0, 0.08, (12000, 1))])
    begin = float(period_begins(target, most, {"q": 0.1})[0])
    assert -0.75 < begin < -0.25
    assert period_begins(target, most, {"q": 0.9}) == pytest.approx([begin + 1.0])  # by the fit
    # a draw in the middle of an eighth without any leaves no gap that were wide enough
    few = even[np.abs(np.mod(even[:, 0], 1.0) - 14 / 32) > 2 / 32]
    middle = np.concatenate([few, most[4000:], [[14 / 32]]])
    assert period_begins(target, middle, {"q": 0.1}) == pytest.approx([14 / 32 - 1.0])
    # the fit's interval of a whole period is the told one, another stays as the fit tells it
    angle = target.parameters[0]
    assert interval_in_period(angle, begin, (0.1, 1.1)) == (begin, begin + 1.0)
    assert interval_in_period(angle, begin, (0.1, 0.4)) == (0.1, 0.4)


def test_a_box_without_a_whole_period_is_told_in_one_piece_where_the_fit_tells_it() -> None:
    target = turning(-0.3, 0.2)
    ends = np.array([[-0.3], [0.2]])
    found = period_begins(target, ends, {"q": 0.98})  # the fit calls -0.02 so
    assert in_period(target, found, ends)[:, 0] == pytest.approx([0.7, 1.2])
    straight = replace(target, parameters=(parameter("q", -2.0, 2.0, 0.0),))
    assert np.isnan(period_begins(straight, ends, {"q": 0.1}))[0]
    assert np.array_equal(in_period(straight, np.array([math.nan]), ends), ends)


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
