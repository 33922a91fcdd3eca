"""Magnitudes of noisy quadratures: against mpmath, and against what is drawn."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from fitting.signal.roughness import rician


def by_mpmath(a: float) -> float:
    """sqrt(pi/2) L_1/2(-a^2/2), at 30 digits."""
    with mp.workdps(30):
        return float(mp.sqrt(mp.pi / 2) * mp.laguerre(mp.mpf(1) / 2, 0, -(mp.mpf(a) ** 2) / 2))


def test_means_and_slopes_are_those_of_rice() -> None:
    a = np.array([0.0, 1e-3, 0.3, 1.0, 2.017, 7.77, 15.99, 16.0, 16.01, 40.0, 1e4])
    found = rician(2.5 * a, np.full(a.size, 2.5))
    assert found.mean == pytest.approx([2.5 * by_mpmath(x) for x in a], rel=1e-9, abs=2e-9)
    slopes = [float(mp.diff(by_mpmath, x, h=1e-4)) for x in a[1:-1]]
    assert found.slope[1:-1] == pytest.approx(slopes, abs=1e-5)
    assert found.slope[[0, -1]] == pytest.approx([0.0, 1.0], abs=1e-7)


def slope_by_mpmath(a: float) -> float:
    """sqrt(pi/8) a e^-q (I0(q) + I1(q)), q = a^2/4, at 30 digits."""
    with mp.workdps(30):
        q = mp.mpf(a) ** 2 / 4
        both = mp.besseli(0, q) + mp.besseli(1, q)
        return float(mp.sqrt(mp.pi / 8) * mp.mpf(a) * mp.exp(-q) * both)


@pytest.mark.parametrize("a", [0.01, 0.9, 5.3, 15.97, 16.0, 16.4, 19.0, 25.0])
def test_what_noise_adds_is_known_to_a_billionth_and_its_slope_nearly_so(a: float) -> None:
    found = rician(np.array([a, 3.0 * a]), np.array([1.0, 3.0]))
    with mp.workdps(30):
        more = float(mp.sqrt(mp.pi / 2) * mp.laguerre(mp.mpf(1) / 2, 0, -(mp.mpf(a) ** 2) / 2) - a)
    assert found.mean[0] - a == pytest.approx(more, abs=1.2e-9)
    assert found.mean[1] - 3.0 * a == pytest.approx(3.0 * more, abs=3.6e-9)
    assert found.slope == pytest.approx([slope_by_mpmath(a)] * 2, abs=1e-7)


def test_what_has_no_noise_is_left_alone() -> None:
    found = rician(np.array([0.0, 3.0, 3.0]), np.array([0.0, 0.0, 1.0]))
    assert found.mean == pytest.approx([0.0, 3.0, by_mpmath(3.0)])
    assert found.slope[:2] == pytest.approx([1.0, 1.0])


def test_drawn_magnitudes_have_that_mean() -> None:
    rng = np.random.default_rng(4)
    for a in (0.0, 0.7, 3.0):
        drawn = np.abs(a + rng.standard_normal(200_000) + 1j * rng.standard_normal(200_000))
        [mean] = rician(np.array([a]), np.ones(1)).mean
        assert np.mean(drawn) == pytest.approx(mean, abs=4.0 * np.std(drawn) / np.sqrt(drawn.size))
