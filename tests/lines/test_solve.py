"""Variable projection against scipy with all unknowns, derivatives against differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares, minimize

from fitting.lines.duffing import CRITICAL, duffing
from fitting.lines.lorentzian import mode_response
from fitting.lines.solve import Columns, fit_densities, fit_model, folded
from fitting.lines.sweep_model import MEAN, POWER, AmplitudeSweep, ComplexSweep, Place, Shapes
from fitting.text.arrays import FloatArray, both_parts

F = np.linspace(4920.0, 5080.0, 161)
ONE = Shapes(frequency_hz=F, starts=[Place(5003.0, 15.0)])
TWO = Shapes(frequency_hz=F, starts=[Place(5003.0, 15.0), Place(5040.0, 15.0)])
BENT = Shapes(frequency_hz=F, starts=[Place(5003.0, 15.0)], bent=True)
MODELS = [
    ComplexSweep(shapes=ONE),
    ComplexSweep(shapes=TWO, background=2, delay_s=1e-3),
    ComplexSweep(shapes=BENT, background=1),
    AmplitudeSweep(shapes=ONE, added=2),
    AmplitudeSweep(shapes=TWO, phased=True, added=1),
    AmplitudeSweep(shapes=ONE, detector=POWER),
    AmplitudeSweep(shapes=ONE, detector=MEAN, added=1),
    AmplitudeSweep(shapes=BENT),
]


@pytest.mark.parametrize("model", MODELS)
def test_slopes_are_those_of_differences(model: ComplexSweep | AmplitudeSweep) -> None:
    x = 0.1 + 0.05 * np.random.default_rng(1).standard_normal(model.count)
    for k, step in enumerate(1e-6 * np.eye(model.count)):
        ends = model.columns(x + step).values - model.columns(x - step).values
        assert model.columns(x).slopes[k] == pytest.approx(ends / 2e-6, abs=1e-6)


@pytest.mark.parametrize("phases", [True, False])
def test_a_fit_is_that_of_all_unknowns_together(phases: bool) -> None:
    rng = np.random.default_rng(2)
    noise = 0.01 * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size))
    seen = 0.8 * mode_response(F, 5000.0, 20.0) + (0.1 if phases else 0.0) + noise

    def residuals(q: FloatArray) -> FloatArray:
        line = mode_response(F, 5000.0 + 20.0 * q[0], 20.0 * math.exp(q[1]))
        if phases:
            return both_parts(complex(*q[2:4]) * line + complex(*q[4:6]) - seen)
        return np.asarray(q[2] * np.abs(line) + q[3] - np.abs(seen))

    whole = least_squares(
        residuals, [0, 0, 1, 0, 0.1, 0] if phases else [0, 0, 1, 0], xtol=1e-14, ftol=1e-14
    )
    shapes = Shapes(frequency_hz=F, starts=[Place(5000.0, 20.0)])
    if phases:
        fit = fit_model(ComplexSweep(shapes=shapes, background=1), seen, [np.zeros(2)])
    else:
        fit = fit_model(AmplitudeSweep(shapes=shapes, added=1), np.abs(seen), [np.zeros(2)])
    assert fit.converged
    assert fit.x == pytest.approx(whole.x[:2], abs=1e-6)
    assert fit.squares == pytest.approx(2.0 * whole.cost, rel=1e-9)
    expected = np.linalg.inv(whole.jac.T @ whole.jac)
    assert np.diag(fit.inverse) == pytest.approx(np.diag(expected), rel=1e-4)


def test_weights_are_those_of_the_rows() -> None:
    rng = np.random.default_rng(3)
    sigma = np.where(F < 5000.0, 0.3, 0.01)
    seen = np.abs(mode_response(F, 5000.0, 20.0)) + sigma * rng.standard_normal(F.size)
    shapes = Shapes(frequency_hz=F, starts=[Place(5000.0, 20.0)])
    fit = fit_model(AmplitudeSweep(shapes=shapes), seen, [np.zeros(2)], weights=1.0 / sigma)
    assert fit.squares == pytest.approx(F.size, abs=5.0 * math.sqrt(2.0 * F.size))
    assert abs(20.0 * fit.x[0]) < 4.0 * 20.0 * math.sqrt(fit.inverse[0, 0]) < 1.0


def test_a_direction_that_no_value_determines_has_no_error() -> None:
    same = Shapes(frequency_hz=F, starts=[Place(5000.0, 20.0), Place(5000.0, 20.0)])
    fit = fit_model(ComplexSweep(shapes=same), mode_response(F, 5000.0, 20.0), [np.zeros(4)])
    assert not np.all(np.isfinite(fit.inverse))


class Square:
    """c below, and c (1 + x^2) in the last points."""

    above = np.repeat([0.0, 1.0], [600, 400])

    def columns(self, x: FloatArray) -> Columns:
        values = (1.0 + x[0] ** 2 * self.above)[:, None]
        return Columns(values, (2.0 * x[0] * self.above)[None, :, None])


def test_a_direction_without_a_slope_has_the_error_of_its_square() -> None:
    """x^2 is the difference of two means, and x at zero has the root of its error."""
    sigma = 0.01
    seen = 1.0 + sigma * np.random.default_rng(3).standard_normal(1000)
    seen[:600] += 1.0 - np.mean(seen[:600])
    seen[600:] += 1.0 - np.mean(seen[600:])
    fit = fit_model(Square(), seen, [np.array([1e-9])])
    spread = folded(Square(), seen, fit).inverse * fit.squares / fit.dof
    assert math.sqrt(spread[0, 0]) == pytest.approx(
        math.sqrt(sigma * math.sqrt(1.0 / 400.0 + 1.0 / 600.0)), rel=0.05
    )
    assert math.sqrt(spread[1, 1]) == pytest.approx(sigma / math.sqrt(600.0), rel=0.05)


class Floor:
    """Height and floor of a density whose shape is known: nothing but linear unknowns."""

    def columns(self, x: FloatArray) -> Columns:
        line = np.abs(mode_response(F, 5000.0, 20.0 * math.exp(x[0]))) ** 2
        step = 1e-6
        up = np.abs(mode_response(F, 5000.0, 20.0 * math.exp(x[0] + step))) ** 2
        values = np.stack([line, np.ones_like(F)], axis=1)
        slopes = np.stack([(up - line) / step, np.zeros_like(F)], axis=1)[None]
        return Columns(values, slopes)


@pytest.mark.parametrize("averages", [1.0, 50.0])
def test_densities_are_fitted_by_their_likelihood(averages: float) -> None:
    rng = np.random.default_rng(4)
    true = 3.0 * np.abs(mode_response(F, 5000.0, 20.0)) ** 2 + 0.5
    seen = true * rng.gamma(averages, 1.0 / averages, F.size)
    start = np.array([0.0, 2.0, 1.0])
    fit = fit_densities(Floor(), seen, start)

    def loss(q: FloatArray) -> float:
        curve = Floor().columns(q[:1]).values @ q[1:]
        return float(np.sum(seen / curve + np.log(curve))) if np.min(curve) > 0.0 else np.inf

    best = minimize(loss, [0.0, 3.0, 0.5], method="Nelder-Mead", options={"xatol": 1e-9})
    assert [*fit.x, *fit.coefficients] == pytest.approx(best.x, abs=2e-4)


@pytest.mark.parametrize("bend", [0.5, -1.2, 4.0, -4.0])
def test_a_duffing_line_is_the_branch_of_its_sweep(bend: float) -> None:
    """Against the roots of its cubic, of a sweep that rises the least one."""
    line = duffing(F, 5000.0, 20.0, bend).values
    for h, x in zip(line, 2.0 * (F - 5000.0) / 20.0, strict=True):
        roots = np.roots([1.0, -x, 1.0, bend - x])
        real = np.sort(roots[np.abs(roots.imag) < 1e-6].real)
        assert h == pytest.approx(-1j / (1.0 + 1j * real[0]), abs=1e-6)
    jumps = np.max(np.abs(np.diff(np.abs(line)))) > 0.2
    assert jumps == (abs(bend) > CRITICAL)
