"""Chi square of noise that was estimated: tables, and spectra that tell their noise themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.signal.roughness import roughness, roughness_freedom
from fitting.signal.student import largest, tail


@pytest.mark.parametrize(
    ("freedom", "noise_freedom", "square"),
    [(10, math.inf, 18.307), (10, 20, 10 * 2.348), (4, 10, 4 * 3.478), (1, 120, 3.920)],
)
def test_tables_of_five_per_cent(freedom: float, noise_freedom: float, square: float) -> None:
    """Of chi square and F: Abramowitz and Stegun, tables 26.8 and 26.9."""
    assert tail(square, freedom, noise_freedom) == pytest.approx(0.05, rel=1e-3)
    assert largest(0.95, freedom, noise_freedom) == pytest.approx(square, rel=1e-3)


@pytest.mark.parametrize("points", [61, 201])
def test_freedom_of_a_roughness_is_that_of_its_scatter(points: int) -> None:
    draws = np.random.default_rng(7).normal(size=(3000, points))
    found = np.array([roughness(values) for values in draws])
    relative = float(np.var(found) / np.mean(found) ** 2)
    assert 0.5 / relative == pytest.approx(roughness_freedom(points), rel=0.1)


def test_noise_that_spectra_tell_of_themselves_explains_them_as_often_as_is_said() -> None:
    """Seven spectra, 61 points each, of noise alone: chi square by their own roughness.

    Against noise that is known one in five would be too large by the 5 % of chi square.
    """
    rng, size, count = np.random.default_rng(11), 61, 7
    told = count * roughness_freedom(size)
    squares = []
    for _ in range(1500):
        spectra = rng.normal(size=(count, size))
        squares.append(sum(float(s @ s) / roughness(s) ** 2 for s in spectra))
    by_estimate = np.mean([tail(square, count * size, told) < 0.05 for square in squares])
    as_known = np.mean([tail(square, count * size) < 0.05 for square in squares])
    assert 0.02 < by_estimate < 0.08
    assert as_known > 0.15
