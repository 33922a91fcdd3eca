"""The linearised problem: against numpy, least squares solved many times, and hand calculation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.campaign.parameters import UNIFORM_WIDTH, Parameter, prior_sigmas
from fitting.fit.linearisation import (
    DETERMINED,
    Linearisation,
    information,
    joined,
    linearise,
    row_sigmas,
    whitened,
)
from fitting.text.arrays import FloatArray


def problem(
    matrix: FloatArray, sigma: FloatArray, prior: FloatArray, residuals: FloatArray | None = None
) -> Linearisation:
    rows = np.zeros(sigma.size) if residuals is None else residuals
    return linearise(rows, matrix, np.diag(sigma**2), prior)


def test_noise_twice_as_large_has_twice_the_errors() -> None:
    generator = np.random.default_rng(6)
    matrix, sigma = generator.standard_normal((12, 2)), generator.uniform(0.01, 0.02, 12)
    narrow = problem(matrix, sigma, np.full(2, 1e9), 0.5 * sigma).widened(2.0)
    wide = problem(matrix, 2.0 * sigma, np.full(2, 1e9), 0.5 * sigma)
    assert narrow.covariance == pytest.approx(wide.covariance, rel=1e-9)
    assert narrow.rows == pytest.approx(wide.rows, rel=1e-12)


def test_well_determined_values_have_the_textbook_covariance() -> None:
    generator = np.random.default_rng(5)
    matrix, sigma = generator.standard_normal((40, 3)), generator.uniform(0.01, 0.02, 40)
    found = problem(matrix, sigma, np.full(3, 1e6), 0.5 * sigma)
    expected = np.linalg.inv(matrix.T @ np.diag(sigma**-2) @ matrix)
    assert found.covariance == pytest.approx(expected, rel=1e-6)
    assert found.inflation == 1.0
    for i in range(3):
        std, shrinkage = found.of(np.eye(3)[i])
        assert std == pytest.approx(math.sqrt(expected[i, i]), rel=1e-6)
        assert shrinkage > 0.999999


def test_linear_least_squares_scatter_as_the_covariance_says() -> None:
    generator = np.random.default_rng(6)
    matrix, sigma = generator.standard_normal((12, 2)), np.full(12, 0.03)
    draws = [
        np.linalg.lstsq(matrix, 0.03 * generator.standard_normal(12), rcond=None)[0]
        for _ in range(4000)
    ]
    found = problem(matrix, sigma, np.full(2, 1e3))
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(np.std(draws, axis=0), rel=0.05)


def test_what_the_data_do_not_see_keeps_the_width_of_its_box() -> None:
    matrix = np.column_stack([np.ones(10), np.zeros(10)])
    found = problem(matrix, np.full(10, 0.01), np.array([2.0, 6.0]) / math.sqrt(12.0))
    std, shrinkage = found.of(np.array([0.0, 1.0]))
    assert std == pytest.approx(6.0 / math.sqrt(12.0), rel=1e-6)  # of a uniform distribution
    assert shrinkage == pytest.approx(0.0, abs=1e-12)
    std, shrinkage = found.of(np.array([1.0, 0.0]))
    assert std == pytest.approx(0.01 / math.sqrt(10.0), rel=1e-3)
    assert shrinkage > DETERMINED
    assert np.abs(found.undetermined(1.0)) == pytest.approx(np.array([[0.0, 1.0]]))


@pytest.mark.parametrize(("second", "unseen"), [(1e2, 1), (1e4, 0)])
def test_nothing_is_determined_at_the_rounding_of_the_sharpest(second: float, unseen: int) -> None:
    """Beside one of 1e12 what is below 1e3 may be rounding, though it is more than the prior."""
    found = problem(np.diag([1e12, second]), np.ones(2), np.ones(2))
    assert np.abs(found.undetermined(1.0)) == pytest.approx(np.eye(2)[2 - unseen :])
    assert found.minimum(1.0).rank == 2 - unseen
    alone = problem(np.array([[5.0]]), np.ones(1), np.ones(1))
    assert alone.minimum(1.0).rank == 1


def test_a_known_sum_does_not_make_its_terms_determined() -> None:
    found = problem(np.ones((10, 2)), np.full(10, 1e-6), np.full(2, 2.0 / math.sqrt(12.0)))
    assert found.of(np.array([1.0, 1.0]))[1] > DETERMINED
    assert found.of(np.array([1.0, 0.0]))[1] < 1.0 - DETERMINED


def test_fewer_rows_than_values_leave_the_prior_to_the_rest() -> None:
    """One row sees the first of three: Bayes' (1/s^2 + 1/sigma^2)^-1, and the prior's own 2^2."""
    found = problem(np.array([[1.0, 0.0, 0.0]]), np.array([1.0]), np.full(3, 2.0))
    assert found.covariance == pytest.approx(np.diag([1.0 / (0.25 + 1.0), 4.0, 4.0]))
    assert found.undetermined(1.0).shape == (2, 3)


def test_the_error_of_the_scale_is_common_to_all_rows() -> None:
    noise = np.diag(np.full(10, 0.01) ** 2) + 0.02**2
    found = linearise(np.zeros(10), np.ones((10, 1)), noise, np.array([1e3]))
    assert found.of(np.ones(1))[0] == pytest.approx(math.hypot(0.01 / math.sqrt(10), 0.02))


def test_residuals_above_the_noise_widen_the_errors() -> None:
    residuals = np.array([0.05, -0.05] * 5 + [0.0])
    found = problem(np.ones((11, 1)), np.full(11, 0.01), np.array([1e3]), residuals)
    assert found.inflation == pytest.approx(5.0, rel=1e-6)
    assert found.of(np.ones(1))[0] == pytest.approx(0.05 / math.sqrt(11), rel=1e-6)
    assert found.chi_square == pytest.approx(10.0)  # rows less values, by the definition


def test_rows_of_a_structured_sweep_weigh_as_their_independent_points() -> None:
    """Weighted mean of four rows of sigma 0.01 and nine that are worth one."""
    sigma = np.full(13, 0.01)
    wider = sigma * np.where(np.arange(13) < 4, 1.0, 3.0)
    found = linearise(
        np.zeros(13), np.ones((13, 1)), np.diag(sigma**2), np.array([1e3]), np.diag(wider**2)
    )
    assert found.of(np.ones(1))[0] == pytest.approx(0.01 / math.sqrt(4 + 1))
    assert found.inflation == 1.0


def test_unknown_sigmas_are_the_scatter_of_their_rows() -> None:
    residuals = np.array([0.1, 0.03, -0.04])
    found = row_sigmas(np.array([0.02, 0.0, 0.0]), residuals)
    assert found == pytest.approx([0.02, math.sqrt((0.0009 + 0.0016) / 2), math.sqrt(0.00125)])


def test_degrees_of_freedom_count_what_the_data_hold() -> None:
    """Ten rows; one value held well, one as well as the prior does, one not at all."""
    matrix = np.zeros((10, 3))
    matrix[0, 0], matrix[1, 1] = 1e6, 1.0
    found = problem(matrix, np.ones(10), np.ones(3))
    assert found.degrees_of_freedom == pytest.approx(10.0 - 1.0 - 0.5)


def test_leverage_of_a_straight_line() -> None:
    """1/m + (t - mean)^2/sum (t - mean)^2, the hat matrix of simple regression."""
    t = np.array([0.0, 1.0, 2.0, 5.0])
    found = problem(np.column_stack([np.ones(4), t]), np.full(4, 0.3), np.full(2, 1e6))
    expected = 0.25 + (t - 2.0) ** 2 / 14.0
    assert found.leverage == pytest.approx(expected, rel=1e-9)


def test_the_minimum_of_two_measurements_of_one_number() -> None:
    """2 +- 1 and 5 +- 2 of one number: mean 2.6, chi square 9/5, variance 4/5; the other unseen."""
    one = Linearisation(
        rows=np.array([-2.0]), matrix=np.array([[1.0, 0.0]]), prior=np.array([100.0, 7.0])
    )
    other = Linearisation(rows=np.array([-2.5]), matrix=np.array([[0.5, 0.0]]), prior=one.prior)
    both = joined([one, other]).minimum(3.0)
    assert both.rank == 1
    assert both.step == pytest.approx([2.6, 0.0])
    assert both.chi_square == pytest.approx(9.0 / 5.0)
    assert both.covariance == pytest.approx(np.diag([0.8, 0.0]))
    assert both.unseen == pytest.approx(np.diag([0.0, 49.0]))
    alone = other.widened(2.0).minimum(3.0)
    assert alone.covariance[0, 0] == pytest.approx(16.0)


def test_whitened_rows_have_unit_variance() -> None:
    noise = np.array([[4.0, 1.0], [1.0, 2.0]])
    rows = np.array([1.0, -3.0])
    white = whitened(rows, noise)
    inverse = np.array([[2.0, -1.0], [-1.0, 4.0]]) / 7.0
    assert white @ white == pytest.approx(rows @ inverse @ rows)
    assert information(np.eye(2), noise) == pytest.approx(inverse)
    assert information(np.stack([np.eye(2)] * 3), np.stack([noise] * 3))[2] == pytest.approx(
        inverse
    )


def test_priors_are_boxes_and_gaussians() -> None:
    """(u - l)/sqrt(12) in units of the scale; a Gaussian in place of it; nu adds its precision."""
    box = Parameter(name="a", unit="Hz", lower=0.0, upper=12.0, start=1.0, reference=1.0, scale=2.0)
    gaussian = Parameter(
        name="b",
        unit="Hz",
        lower=0.0,
        upper=12.0,
        start=1.0,
        reference=1.0,
        scale=2.0,
        prior=3.0,
    )
    assert prior_sigmas([box, gaussian]) == pytest.approx([6.0 / math.sqrt(12.0), 1.5])
    expected = 1.0 / math.sqrt(1.0 / 3.0 + 0.1)
    assert prior_sigmas([box], 0.1)[0] == pytest.approx(expected)
    generator = np.random.default_rng(1)
    drawn = float(np.std(generator.uniform(0.0, 1.0, 200_000)))
    assert 1.0 / drawn == pytest.approx(UNIFORM_WIDTH, rel=5e-3)
