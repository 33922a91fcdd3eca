"""Results of lines under the names of lmfit, against least squares by scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.optimize import curve_fit

import fitting as ff
from fitting.text.arrays import FloatArray

F = np.linspace(4900.0, 5100.0, 201)
T = np.arange(2000) / 4000.0


def size(f: FloatArray, eta: float, width: float, amplitude: float) -> FloatArray:
    return np.asarray(amplitude * eta * width / np.hypot(eta**2 - f**2, f * width))


def fall(t: FloatArray, f: float, width: float, a: float, b: float, c: float) -> FloatArray:
    turn = 2.0 * np.pi * f * t
    return np.asarray(np.exp(-np.pi * width * t) * (a * np.cos(turn) - b * np.sin(turn)) + c)


def noise(count: int, sigma: float) -> FloatArray:
    return np.random.default_rng(2).normal(0.0, sigma, count)


def check(found: ff.Line | ff.Ringdown, data: FloatArray, best: FloatArray, unknowns: int) -> None:
    n = data.size
    np.testing.assert_allclose(found.best_fit, best, atol=1e-5)
    np.testing.assert_allclose(found.residual, data - found.best_fit, atol=1e-12)
    squares = float(np.sum((data - best) ** 2))
    assert found.chisqr == pytest.approx(squares, rel=1e-6)
    assert found.redchi == pytest.approx(squares / (n - unknowns), rel=1e-6)
    assert found.aic == pytest.approx(n * math.log(squares / n) + 2.0 * unknowns, rel=1e-6)
    np.testing.assert_allclose(
        np.sqrt(np.diag(found.covar)), [each.std for each in found.params.values()]
    )
    assert found.plot(ax=Figure().subplots()).lines
    assert repr(found) in found.fit_report()


def test_a_sweep_has_the_covariance_of_least_squares() -> None:
    data = size(F, 5000.0, 20.0, 2.0) + noise(F.size, 0.01)
    best, covar = curve_fit(size, F, data, [5000.0, 20.0, 2.0])
    found = ff.line(F, data, wiring="transmission")
    assert list(found.params) == ["frequency", "width", "amplitude"]
    check(found, data, size(F, *best), 3)
    np.testing.assert_allclose([each.value for each in found.params.values()], best, rtol=1e-6)
    np.testing.assert_allclose(
        found.covar / np.sqrt(np.outer(*[np.diag(covar)] * 2)),
        covar / np.sqrt(np.outer(*[np.diag(covar)] * 2)),
        atol=0.02,
    )


def test_a_ringdown_has_the_covariance_of_least_squares() -> None:
    data = fall(T, 812.0, 5.0, 0.8, 0.3, 0.2) + noise(T.size, 0.02)
    best, covar = curve_fit(fall, T, data, [812.0, 5.0, 0.8, 0.3, 0.2])
    found = ff.ringdown(T, data)
    assert list(found.params) == ["frequency", "width", "amplitude"]
    check(found, data, fall(T, *best), 5)
    along = np.array(
        [[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, *best[2:4] / math.hypot(*best[2:4]), 0]]
    )
    expected = along @ covar @ along.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found.covar / scale, expected / scale, atol=0.03)


def test_phasors_amplitudes_and_laws_have_their_own_numbers() -> None:
    z = np.exp((-12.0 + 30j) * T) + noise(T.size, 0.01) + 1j * noise(T.size, 0.01)[::-1]
    assert list(ff.ringdown(T, z).params) == ["offset", "width", "amplitude"]
    assert list(ff.ringdown(T, np.abs(z)).params) == ["width", "amplitude"]
    law = np.exp(-12.0 * T) / np.sqrt(1.0 + 3.0 * (1.0 - np.exp(-24.0 * T)))
    found = ff.ringdown(T, law * np.cos(5000.0 * T) + noise(T.size, 1e-3))
    assert list(found.params) == ["frequency", "width", "amplitude", "extra"]
    assert found.covar.shape == (4, 4)


def test_a_noise_spectrum_has_a_deviance_of_one_for_each_degree_of_freedom() -> None:
    """Of gamma deviates of shape M the deviance times M is about n; its likelihood is Whittle's."""
    density = size(F, 5000.0, 20.0, 1.0) ** 2 + 0.01
    data = density * np.random.default_rng(4).gamma(50.0, 1.0 / 50.0, F.size)
    found = ff.noise_line(F, data)
    assert list(found.params) == ["frequency", "width", "power"]
    assert found.redchi == pytest.approx(1.0, abs=0.05)
    assert found.aic == pytest.approx(found.chisqr + 8.0)
    power = found.power.value / (0.5 * math.pi * 20.0)
    assert power == pytest.approx(1.0, abs=4.0 * found.power.std / (0.5 * math.pi * 20.0))
    np.testing.assert_allclose(found.residual, data - found.best_fit)
    assert found.plot(ax=Figure().subplots()).lines
