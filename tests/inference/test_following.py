"""Draws that follow a surrogate are those of the posterior, however wrong it is: closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from fitting.inference.posterior.chain import Walk
from fitting.inference.posterior.first_walks import about_walk
from fitting.inference.posterior.follow import Follow
from fitting.inference.posterior.learnt import learnt, worth
from fitting.inference.posterior.minima import Target, minima_of
from fitting.inference.posterior.start import Minimum, Mixture
from fitting.inference.posterior.surrogate import Places, Surrogate
from fitting.signal.chi_square import tail
from fitting.text.arrays import FloatArray
from tests.support.closed_posteriors import parameter

NONE = np.array([math.inf, math.inf])


def bent(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A banana: r = ((x - 0.5)/0.1, (y - 0.3 - 4 (x - 0.5)^2)/0.02), and its derivatives."""
    x, y = u[:, 0] - 0.5, u[:, 1] - 0.3
    rows = np.column_stack([x / 0.1, (y - 4.0 * x**2) / 0.02])
    slopes = np.zeros((len(u), 2, 2))
    slopes[:, 0, 0], slopes[:, 1, 0], slopes[:, 1, 1] = 10.0, -400.0 * x, 50.0
    return rows, slopes


def through(u: FloatArray, scale: float = 1.0) -> Surrogate:
    """The surrogate of the banana through places; `scale` of all residuals: a wrong one."""
    rows, slopes = bent(u)
    return Surrogate(
        known=Places(places=u, rows=scale * rows, slopes=scale * slopes),
        periods=NONE,
        length=0.3,
    )


def places() -> FloatArray:
    x = np.linspace(0.2, 0.8, 7)
    return np.column_stack([x, 0.3 + 4.0 * (x - 0.5) ** 2])


def about(centres: FloatArray, width: float) -> Mixture:
    roots = np.repeat(np.eye(2)[None] / width, len(centres), axis=0)
    return Mixture(centres, roots, np.full(len(centres), 1.0 / len(centres)))


def uniform(draws: FloatArray) -> float:
    """P of chi^2 that numbers in (0, 1) are uniform, in ten bins."""
    counts = np.bincount((10.0 * draws).astype(int).clip(0, 9), minlength=10)
    return tail(float(np.sum((counts - draws.size / 10.0) ** 2) / (draws.size / 10.0)), 9)


def test_a_surrogate_has_the_residuals_of_a_bent_valley_and_their_derivatives() -> None:
    made = through(places())
    asked = np.array([[0.33, 0.42], [0.5, 0.31], [0.61, 0.35]])
    rows, slopes = bent(asked)
    assert made.rows(asked) == pytest.approx(rows, abs=0.02)
    assert made.slopes(asked) == pytest.approx(slopes, abs=2.0)
    known = bent(places())
    assert made.rows(places()) == pytest.approx(known[0], abs=1e-4)
    assert made.slopes(places()) == pytest.approx(known[1], abs=1e-2)
    outside = made.log(np.array([[0.5, 0.3], [1.1, 0.3]]))
    assert outside.tolist() == [pytest.approx(0.0, abs=1e-3), -math.inf]


def test_places_that_are_as_good_as_one_make_a_surrogate_of_it() -> None:
    """As walkers leave them whose posterior is a dot in its box: nothing but rounding between."""
    u = 0.5 + 1e-9 * np.random.default_rng(1).standard_normal((300, 2))
    rows, slopes = bent(u)
    made = Surrogate.through(Places(places=u, rows=rows, slopes=slopes), NONE)
    asked = np.array([[0.5, 0.5]])
    assert made.rows(asked) == pytest.approx(bent(asked)[0], abs=1e-3)


def test_a_periodic_value_is_known_a_period_off() -> None:
    """r = sin(2 pi u/0.25) in a box of four periods, known in the first of them."""
    u = np.linspace(0.0, 0.25, 8, endpoint=False)[:, None]
    angle = 2.0 * math.pi / 0.25
    known = Places(places=u, rows=np.sin(angle * u), slopes=angle * np.cos(angle * u)[:, :, None])
    made = Surrogate(known=known, periods=np.array([0.25]), length=0.3)
    asked = np.array([[0.07], [0.31], [0.9]])
    assert made.rows(asked) == pytest.approx(np.sin(angle * asked), abs=1e-3)
    assert made.turns(asked).ravel() == pytest.approx([0.0, 0.25, 0.75])


def drawn(
    follow: Follow, log: Callable[[FloatArray], FloatArray], u: FloatArray, steps: int
) -> FloatArray:
    """Draws by proposals of 20 steps; every fourth counts, as good as independent."""
    rng, found = np.random.RandomState(1), []
    for step in range(steps):
        v, factor = follow.proposed(u, rng, 20)
        taken = np.log(rng.random_sample(len(u))) < log(v) - log(u) + factor
        u = np.where(taken[:, None], v, u)
        if step >= 8 and step % 4 == 3:
            found.append(u)
    return np.concatenate(found)


@pytest.mark.parametrize("scale", [1.0, 0.7])
def test_draws_are_those_of_a_banana_however_wrong_the_surrogate(scale: float) -> None:
    """Both residuals of a banana are normal numbers; one that is too wide changes nothing."""
    follow = Follow(through(places(), scale), about(places(), 0.05))

    def log(u: FloatArray) -> FloatArray:
        inside = np.all((u >= 0.0) & (u <= 1.0), axis=1)
        return np.where(inside, -0.5 * np.sum(bent(u)[0] ** 2, axis=1), -np.inf)

    rows = bent(drawn(follow, log, np.repeat(places()[2:5], 100, axis=0), 40))[0]
    assert uniform(ndtr(rows[:, 0])) > 1e-3
    assert uniform(ndtr(rows[:, 1])) > 1e-3


def test_modes_of_unequal_weight_are_each_drawn_as_often_as_they_are_likely() -> None:
    """A walk on the surrogate alone: r = ((x - 0.25)(x - 0.75), ...)/width, more at one side."""
    u = np.column_stack([np.linspace(0.05, 0.95, 19), np.full(19, 0.5)])

    def residuals(t: FloatArray) -> FloatArray:
        x = t[:, 0]
        return np.column_stack([(x - 0.25) * (x - 0.75) / 0.02, 1.5 * x, (t[:, 1] - 0.5) / 0.1])

    slopes = np.zeros((19, 3, 2))
    slopes[:, 0, 0], slopes[:, 1, 0], slopes[:, 2, 1] = (2.0 * u[:, 0] - 1.0) / 0.02, 1.5, 10.0
    known = Places(places=u, rows=residuals(u), slopes=slopes)
    surrogate = Surrogate(known=known, periods=NONE, length=1.0)
    follow = Follow(surrogate, about(np.array([[0.25, 0.5], [0.75, 0.5]]), 0.06))
    ends, _ = follow.proposed(np.repeat(u[4:6], 1000, axis=0), np.random.RandomState(2), 60)
    x = (np.arange(4000) + 0.5) / 4000.0
    weight = np.exp(-0.5 * (((x - 0.25) * (x - 0.75) / 0.02) ** 2 + (1.5 * x) ** 2))
    share = float(np.sum(weight[x > 0.5]) / np.sum(weight))
    assert 0.2 < share < 0.4
    error = math.sqrt(share * (1.0 - share) / len(ends))
    assert float(np.mean(ends[:, 0] > 0.5)) == pytest.approx(share, abs=4.0 * error)
    whole = np.cumsum(weight) / np.sum(weight)
    assert uniform(np.interp(ends[:, 0], x, whole)) > 1e-3


def test_steps_about_a_place_count_how_wide_they_are_at_either_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A Gaussian of width 0.1 by steps that are five times as wide on one side as on the other."""
    monkeypatch.setattr("fitting.inference.posterior.follow.ANYWHERE", 0.0)
    u, slopes = np.array([[0.5, 0.5], [0.3, 0.6]]), np.repeat(10.0 * np.eye(2)[None], 2, axis=0)
    known = Places(places=u, rows=10.0 * (u - 0.5), slopes=slopes)
    roots = np.array([np.eye(2) / 0.03, np.eye(2) / 0.15])
    mixture = Mixture(np.array([[0.4, 0.5], [0.6, 0.5]]), roots, np.array([0.5, 0.5]))
    follow = Follow(Surrogate(known=known, periods=NONE, length=3.0), mixture)
    ends, _ = follow.proposed(np.full((2000, 2), 0.5), np.random.RandomState(3), 60)
    assert uniform(ndtr((ends[:, 0] - 0.5) / 0.1)) > 1e-3
    assert uniform(ndtr((ends[:, 1] - 0.5) / 0.1)) > 1e-3


def ring() -> Target:
    """-2 ln p = ((x^2 + y^2 - 1)/0.05)^2 in the box -2 ... 2: the angle is uniform."""

    def log(p: FloatArray) -> FloatArray:
        inside = np.all(np.abs(p) <= 2.0, axis=1)
        return np.where(inside, -0.5 * ((np.sum(p**2, axis=1) - 1.0) / 0.05) ** 2, -np.inf)

    def rows(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([(p @ p - 1.0) / 0.05]), 2.0 * p[None] / 0.05

    return Target(
        parameters=(parameter("x", -2.0, 2.0, 1.0), parameter("y", -2.0, 2.0, 0.0)),
        log=log,
        rows=rows,
    )


def test_a_ring_is_learnt_from_one_place_and_drawn_all_around(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The angle is uniform, x^2 + y^2 a normal number, as dx dy = d(x^2 + y^2) d(angle)/2."""
    for name, few in (("ROUNDS", 6), ("WALKS", 48), ("LAST", 1)):
        monkeypatch.setattr(f"fitting.inference.posterior.learnt.{name}", few)
    target = ring()
    minimum: Minimum = minima_of(target, [("a fit", np.array([1.0, 0.0]))])[0]
    mixture, rng = Mixture.of([replace(minimum, weight=0.0)]), np.random.RandomState(1)
    start = mixture.spread(24, rng)
    begin = (start, target.log(target.in_units(start)))
    follow, (u, _) = learnt(target, begin, mixture, rng, lambda words: None)
    assert follow is not None
    found = drawn(follow, lambda t: target.log(target.in_units(t)), np.resize(u, (120, 2)), 40)
    p = target.in_units(found)
    assert uniform(np.arctan2(p[:, 1], p[:, 0]) / (2.0 * math.pi) + 0.5) > 1e-3
    assert uniform(ndtr((np.sum(p**2, axis=1) - 1.0) / 0.05)) > 1e-3


def test_a_mixture_about_places_of_a_walk_hits_a_ring_that_one_about_a_minimum_misses() -> None:
    target = ring()
    minima = Mixture.of(minima_of(target, [("a fit", np.array([1.0, 0.0]))]))
    angle = np.random.default_rng(3).uniform(0.0, 2.0 * math.pi, (96, 24))
    on_it = 0.5 + 0.25 * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    walk = Walk(places=on_it, log=np.zeros((96, 24)), accepted=0.5)

    def log(u: FloatArray) -> FloatArray:
        return target.log(target.in_units(u))

    rng = np.random.RandomState(1)
    found = about_walk(target, walk, minima, log, rng)
    assert worth(minima, log, rng) < 0.1
    assert worth(found, log, rng) > 0.3
