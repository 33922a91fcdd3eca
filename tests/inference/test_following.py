"""A mixture about places of a walk follows a bent posterior: closed forms."""

from __future__ import annotations

import math

import numpy as np

from fitting.posterior.chain import Walk
from fitting.posterior.learning import about_walk
from fitting.posterior.minima import Target, minima_of
from fitting.posterior.mixture import Mixture, worth
from fitting.text.arrays import FloatArray
from tests.support.closed_posteriors import parameter


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
