"""Least squares: what the data do not see stays unknown, however well they are described."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.least_squares import minimise_squares


def test_an_exact_fit_does_not_tell_what_it_does_not_see() -> None:
    """Residuals that vanish, and a coordinate that none of them holds: 0 and infinite variance."""
    fit = minimise_squares(lambda x: np.array([x[0], 2.0 * x[0], 3.0 * x[0]]), np.zeros(2))
    assert fit.covariance[0, 0] == 0.0
    assert fit.covariance[1, 1] == np.inf
    assert fit.covariance[0, 1] == fit.covariance[1, 0] == 0.0
    unmoved = minimise_squares(lambda x: 0.0 * np.array([x[0], x[1], 1.0]), np.ones(2))
    np.testing.assert_array_equal(np.diag(unmoved.covariance), [np.inf, np.inf])


def test_the_covariance_of_a_straight_line() -> None:
    """sigma^2 (J^T J)^-1, by hand: abscissae -1, 0, 1 give 1/3 and 1/2, and nothing beside."""
    t, y = np.array([-1.0, 0.0, 1.0]), np.array([0.0, 3.0, 0.0])
    known = minimise_squares(lambda x: x[0] + x[1] * t - y, np.zeros(2), residual_sigma=0.5)
    np.testing.assert_allclose(known.values, [1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(known.covariance, np.diag([0.25 / 3, 0.25 / 2]), atol=1e-9)
    own = minimise_squares(lambda x: x[0] + x[1] * t - y, np.zeros(2))
    assert own.covariance[0, 0] == pytest.approx(6.0 / 3, rel=1e-9)  # residuals -1, 2, -1
