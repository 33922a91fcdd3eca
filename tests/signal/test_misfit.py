"""The rule for a misfit at its edges, against scipy's chi square."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2

from fitting.signal.misfit import (
    CORRELATED,
    SHARE,
    Correlation,
    Misfit,
    correlated_below,
    correlation,
    far_off,
    misfit_of,
    of_one_size,
)


@pytest.mark.parametrize(
    ("p_value", "share", "found"),
    [
        (2.0 * CORRELATED, 0.5, Misfit.NONE),
        (0.5 * CORRELATED, 0.9 * SHARE, Misfit.CORRELATED),
        (0.5 * CORRELATED, 1.1 * SHARE, Misfit.REFUSED),
    ],
)
def test_correlated_residuals_are_judged_by_their_share(
    p_value: float, share: float, found: Misfit
) -> None:
    assert Correlation(p_value=p_value, share=share).misfit is found


def test_what_the_simulation_may_be_off_by_is_no_fault_of_the_model() -> None:
    assert Correlation(p_value=1e-9, share=0.08, excused=0.1).misfit is Misfit.NONE


@pytest.mark.parametrize("size", [30, 100, 1000])
@pytest.mark.parametrize("factor", [0.5, 3.0, 100.0])
def test_noise_of_any_size_is_of_one_size(size: int, factor: float) -> None:
    draws = factor * np.random.default_rng(size).standard_normal((300, size))
    # once in a thousand by chance
    assert np.mean([of_one_size(draw) for draw in draws]) > 0.98
    draws[:, : min(10, size // 50)] = 1e3  # as many as may be outliers
    assert np.mean([of_one_size(draw) for draw in draws]) > 0.98


def test_a_quarter_that_is_off_makes_a_hundred_residuals_no_noise_of_one_size() -> None:
    """Eight times the size: seen in nearly all draws, though the four largest may be outliers."""
    draws = np.random.default_rng(7).standard_normal((300, 100))
    draws[:, :25] *= 8.0
    assert np.mean([of_one_size(draw) for draw in draws]) < 0.05


@pytest.mark.parametrize(("size", "off"), [(40, 5), (100, 10), (234, 20), (1000, 150)])
def test_a_part_that_is_off_alone_is_no_noise(size: int, off: int) -> None:
    draws = np.random.default_rng(size).standard_normal((300, size))
    draws[:, :off] *= 100.0
    assert np.mean([of_one_size(draw) for draw in draws]) < 0.02


@pytest.mark.parametrize(
    ("freedom", "ratio", "correlated_p", "found"),
    [
        (4, 4.1, 1.0, Misfit.NONE),  # by chance once in 400
        (8, 4.1, 1.0, Misfit.REFUSED),
        (8, 4.1, math.nan, Misfit.REFUSED),
        (12, 3.9, 1.0, Misfit.UNDERESTIMATED),
        (20, 9.0, 0.5, Misfit.UNDERESTIMATED),
        (20, 9.0, 0.01, Misfit.REFUSED),
        (20, 9.0, math.nan, Misfit.REFUSED),
        (100, 100.0, 0.01, Misfit.UNDERESTIMATED),
        (100, 500.0, 0.5, Misfit.UNDERESTIMATED),
        (100, 500.0, 0.01, Misfit.REFUSED),  # so large is hardly noise
        (30, 500.0, 0.5, Misfit.REFUSED),
        (100, 1.9, 0.5, Misfit.NONE),
        (1000, 1.5, 0.5, Misfit.NONE),
    ],
)
def test_uncorrelated_residuals_are_judged_by_chi_square(
    freedom: float, ratio: float, correlated_p: float, found: Misfit
) -> None:
    square = ratio * freedom
    p_value = float(chi2.sf(square, freedom))
    assert misfit_of(square, freedom, p_value, correlated_p) is found


@pytest.mark.parametrize(
    ("freedom", "ratio", "p_value", "found"),
    [
        (100, 1.0, 1e-4, Misfit.NONE),  # noise explains chi square: once in ten thousand
        (100, 9.0, 1e-4, Misfit.REFUSED),
        (100, 9.0, 0.01, Misfit.NONE),
        (30, 9.0, 1e-4, Misfit.NONE),  # of few every structure is refused beside chi square
        (1000, 1.5, 1e-4, Misfit.NONE),
    ],
)
def test_where_something_is_wrong_less_correlation_tells_what(
    freedom: float, ratio: float, p_value: float, found: Misfit
) -> None:
    square = ratio * freedom
    below = correlated_below(square, freedom, float(chi2.sf(square, freedom)))
    assert Correlation(p_value=p_value, share=0.1, below=below).misfit is found


def test_the_structured_part_is_that_without_the_white_noise() -> None:
    """A sine of 10 % beside white noise of 30 %: 0.1/sqrt(2) of the largest amplitude."""
    noise = 0.3 * np.random.default_rng(1).standard_normal(20_000)
    sine = 0.1 * np.sin(np.linspace(0.0, 40.0, noise.size))
    found = correlation(noise + sine, noise + sine)
    assert found.share == pytest.approx(0.1 / math.sqrt(2.0), rel=0.05)
    assert found.misfit is Misfit.REFUSED
    assert correlation(noise, noise).misfit is Misfit.NONE


def test_single_residuals_far_off_are_told_from_larger_noise() -> None:
    """One of 60 that has pulled a constant along, and three times as much noise."""
    white = np.random.default_rng(2).standard_normal(200)
    white[17] = 60.0
    slopes, each = np.ones((200, 1)), 2 * np.arange(200)
    assert far_off(white - 3.0, slopes, each) == (17,)
    assert far_off(3.0 * np.random.default_rng(3).standard_normal(200), slopes, each) == ()


def test_residuals_of_one_reading_count_as_one() -> None:
    """Both peaks of one of 30 experiments, or of two of them."""
    white, experiment = np.random.default_rng(2).standard_normal(60), 2 * (np.arange(60) // 2)
    white[[8, 9]] += [12.0, 11.0]
    slopes = np.ones((60, 1))
    assert sorted(far_off(white, slopes, experiment)) == [8, 9]
    white[20] -= 9.0
    assert far_off(white, slopes, experiment) == ()
