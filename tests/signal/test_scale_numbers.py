"""Numbers of the scale against numpy's polynomials, scipy's minimisers, and their limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from fitting.signal.scale import (
    LaboratoryMaximum,
    bend_of,
    chi_of_maxima,
    chi_of_sweep,
    chi_robust,
    half_power_width,
    laboratory_maximum,
    nodes_around,
    refine_maximum,
)
from fitting.text.arrays import FloatArray
from fitting.text.errors import NoScale


def lorentzian(f: FloatArray, top: float = 1.0) -> FloatArray:
    return np.asarray(top / np.sqrt(1.0 + f**2))


def lowest(f: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Place and value of the least interpolated y, by numpy's polynomials and scipy's search."""
    p = np.polynomial.Polynomial.fit(f, y, f.size - 1)
    found = minimize_scalar(p, bounds=(f[0], f[-1]), method="bounded", options={"xatol": 1e-12})
    return float(found.x), float(found.fun)


def test_the_maximum_is_that_of_the_interpolated_quartic_of_the_five_nearest_points() -> None:
    """Unequal steps, an asymmetric curve, and more points than are wanted on both sides."""
    f = np.array([-3.0, -1.7, -0.9, -0.35, 0.2, 0.6, 1.4, 2.9])
    a = lorentzian(f - 0.07) * (1.0 + 0.05 * f + 0.02 * f**3)
    k = int(np.argmax(a))
    window = slice(k - 2, k + 3)
    y = a[window] ** -2.0
    at, least = lowest(f[window], y)
    found = refine_maximum(f, 5.0 * a)
    assert found.frequency_hz == pytest.approx(at, abs=1e-6)
    assert found.value == pytest.approx(5.0 * least**-0.5, rel=1e-10)
    coarse = lowest(f[k - 1 : k + 2], a[k - 1 : k + 2] ** -2.0)[1]
    cubics = [lowest(f[w], a[w] ** -2.0)[1] for w in (slice(k - 2, k + 2), slice(k - 1, k + 3))]
    off = [abs((least / other) ** 0.5 - 1.0) for other in (coarse, *cubics)]
    assert found.bias == pytest.approx(max(off[0], 5.0 * off[1], 5.0 * off[2]), rel=1e-6)


@pytest.mark.parametrize("k", [1, 4])
def test_near_an_end_the_five_points_are_those_there_are(k: int) -> None:
    f = np.linspace(-1.5, 1.5, 6)
    a = lorentzian(f - f[k] - 0.1)
    found = refine_maximum(f, a)
    window = slice(0, 5) if k == 1 else slice(1, 6)
    assert found.value == pytest.approx(lowest(f[window], a[window] ** -2.0)[1] ** -0.5, rel=1e-10)
    assert found.frequency_hz == pytest.approx(f[k] + 0.1, abs=1e-6)


def test_of_four_points_the_fall_to_the_lower_neighbour_is_the_least_bias() -> None:
    f = np.array([-1.0, 0.0, 1.0, 2.0])
    a = np.array([0.8, 1.0, 0.9, 0.7])
    assert refine_maximum(f, a).bias == pytest.approx(1.0 / 0.8 - 1.0, rel=1e-12)
    assert refine_maximum(f[:3], a[:3]).bias == pytest.approx(0.25, rel=1e-12)


def test_where_nothing_is_lowest_between_the_points_the_largest_one_stands() -> None:
    """1/A^2 through five points of a curve with two tops bends down at the middle one."""
    f = np.arange(-2.0, 3.0)
    a = np.array([0.99, 0.2, 1.0, 0.2, 0.99])
    found = refine_maximum(f, a)
    assert found.bracketed
    assert found.value == pytest.approx(1.0, rel=1e-9)


def test_three_points_and_a_bend_give_the_remainder_of_their_parabola() -> None:
    """Cauchy: bend y2/6 |(x - x1)(x - x2)(x - x3)| at the vertex, half of it over y."""
    f, a = np.array([9.5, 10.0, 11.5]), np.array([0.8, 1.0, 0.5])
    y = a**-2.0
    curvature, b, c = map(float, np.polyfit(f - 10.0, y, 2))
    at, least = -b / (2 * curvature), c - b * b / (4 * curvature)
    found = refine_maximum(f, a, 0.3)
    assert found.frequency_hz == pytest.approx(10.0 + at, rel=1e-12)
    assert found.value == pytest.approx(least**-0.5, rel=1e-12)
    remainder = 0.3 * 2 * curvature / 6 * abs((at + 0.5) * at * (at - 1.5))
    assert found.bias == pytest.approx(0.5 * remainder / least, rel=1e-9)
    assert found.bracketed
    # without the bend nothing is known of what a parabola leaves but the fall
    assert refine_maximum(f, a).bias == pytest.approx(1.0, rel=1e-9)
    # four points have their own bias
    assert refine_maximum(np.append(f, 13.0), np.append(a, 0.3), 0.3).bias > 0.9


def test_amplitudes_must_have_all_their_digits() -> None:
    f = np.arange(3.0)
    assert refine_maximum(f, 1e-307 * np.array([1.0, 2.0, 1.0])).bracketed
    with pytest.raises(NoScale, match="1e-310 at 0 Hz"):
        refine_maximum(f, np.array([1e-310, 2e-310, 1e-310]))


def test_the_bend_is_the_ratio_of_derivatives_of_the_quartic() -> None:
    f = np.array([97.0, 99.0, 100.0, 100.5, 103.0])
    a = np.array([0.4, 0.8, 0.9, 1.0, 0.3])
    p = np.polynomial.Polynomial.fit(f - 100.0, a**-2.0, 4).convert()
    found, coefficients = bend_of(f, 7.0 * a)
    expected = np.max(np.abs(p.deriv(3)(f - 100.0))) / p.deriv(2)(0.5)
    assert found == pytest.approx(expected, rel=1e-9)
    assert coefficients == pytest.approx(p.coef, rel=1e-7)
    assert bend_of(f, np.array([1.0, 0.5, 0.0, 0.5, 1.0]))[0] == np.inf
    assert bend_of(f, np.array([1.0, 0.5, 0.4, 0.5, 1.0]))[0] < np.inf
    hill = (5.0 - 0.1 * (f - 100.0) ** 2) ** -0.5  # 1/A^2 bends down everywhere
    assert bend_of(f, hill)[0] == np.inf


def test_the_fitted_top_is_that_of_a_weighted_parabola() -> None:
    """Parabola through 1/A^2 of what is above 70 % of the top, weights A^3; errors from n - 3."""
    f = np.arange(-10.0, 11.0)
    a = 3.0 * lorentzian(f / 5.0) + 0.02 * np.random.default_rng(5).standard_normal(f.size)
    k = int(np.argmax(a))
    top = a >= 0.7 * a[k]
    x, relative = f[top] - f[k], a[top] / a[k]
    columns = np.vander(x, 3, increasing=True) * relative[:, None] ** 3
    c = np.linalg.lstsq(columns, relative**-2.0 * relative**3, rcond=None)[0]
    left = relative - (np.vander(x, 3, increasing=True) @ c) ** -0.5
    found = laboratory_maximum(f, a)
    assert (found.value_v, found.frequency_hz, found.on_edge) == (a[k], f[k], False)
    assert found.fitted_v == pytest.approx(a[k] * (c[0] - c[1] ** 2 / (4 * c[2])) ** -0.5, rel=1e-9)
    assert found.scatter == pytest.approx(np.sqrt(left @ left / (left.size - 3)), rel=1e-7)
    assert found.bias == pytest.approx(a[k] / found.fitted_v - 1.0)
    assert found.bias_std == pytest.approx(1.5 * found.noise / left.size**0.5, rel=1e-9)
    assert found.fall == pytest.approx(1.0 - min(a[k - 1], a[k + 1]) / a[k])


def test_few_points_of_a_top_are_filled_up_to_five() -> None:
    f = np.arange(-6.0, 7.0)
    a = lorentzian((f - 0.1) / 0.8) * (1.0 + 0.01 * np.cos(3.0 * f))
    assert np.count_nonzero(a >= 0.7 * np.max(a)) < 5
    relative = a[4:9] / a[6]
    columns = np.vander(f[4:9], 3, increasing=True) * relative[:, None] ** 3
    c = np.linalg.lstsq(columns, relative, rcond=None)[0]
    found = laboratory_maximum(f, a)
    assert found.fitted_v == pytest.approx(a[6] * (c[0] - c[1] ** 2 / (4 * c[2])) ** -0.5, rel=1e-9)


@pytest.mark.parametrize(("first", "edge"), [(0, True), (1, False), (11, False), (12, True)])
def test_a_top_at_the_end_is_told(first: int, edge: bool) -> None:
    f = np.arange(13.0)
    a = lorentzian((f - first) / 2.0)
    found = laboratory_maximum(f, a)
    assert found.on_edge is edge
    assert found.fall == pytest.approx(1.0 - 1.0 / np.sqrt(1.25))


def test_beside_an_end_the_five_points_of_a_top_are_the_last_ones() -> None:
    for f, places in ((np.arange(8.0), slice(3, 8)), (np.arange(8.0)[::-1], slice(0, 5))):
        a = lorentzian((f - 6.2) / 0.7) * (1.0 + 0.01 * np.cos(3.0 * f))
        k = int(np.argmax(a))
        relative = a[places] / a[k]
        x = f[places] - f[k]
        columns = np.vander(x, 3, increasing=True) * relative[:, None] ** 3
        c = np.linalg.lstsq(columns, relative, rcond=None)[0]
        top = a[k] * (c[0] - c[1] ** 2 / (4 * c[2])) ** -0.5
        found = laboratory_maximum(f, a)
        assert found.fitted_v == pytest.approx(top, rel=1e-9)
        assert found.fall == pytest.approx(1.0 - np.min(a[k - 1 : k + 2]) / a[k])


def test_three_points_have_the_top_of_the_parabola_through_them() -> None:
    f, a = np.array([1.0, 2.0, 4.0]), np.array([0.8, 1.0, 0.5])
    at, least = lowest(f, a**-2.0)
    assert 1.0 < at < 4.0
    found = laboratory_maximum(f, a)
    assert found.fitted_v == pytest.approx(least**-0.5, rel=1e-9)
    assert found.fitted_v > 1.0
    assert found.fall == 0.5


@pytest.mark.parametrize("last", [True, False])
def test_the_largest_point_at_either_end_is_not_refined(last: bool) -> None:
    a = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 9.0])
    found = refine_maximum(np.arange(6.0), a if last else a[::-1])
    assert not found.bracketed
    assert (found.value, found.frequency_hz) == (9.0, 5.0 if last else 0.0)


def test_sweeps_without_a_top_have_no_fitted_one() -> None:
    with pytest.raises(ValueError, match="no points"):
        laboratory_maximum(np.zeros(0), np.zeros(0))
    two = laboratory_maximum(np.arange(2.0), np.array([1.0, 0.5]))
    assert np.isnan(two.fitted_v)
    assert two.sigma == two.fall == 0.5
    assert (two.scatter, two.bias_std) == (0.0, 0.0)
    dark = laboratory_maximum(np.arange(9.0), np.zeros(9))
    assert (dark.value_v, dark.fall) == (0.0, 0.0)
    assert np.isnan(dark.bias)
    valley = laboratory_maximum(np.arange(-3.0, 4.0), 1.0 + 0.03 * np.arange(-3.0, 4.0) ** 2)
    assert np.isnan(valley.fitted_v)


def of_bias(bias: float, std: float) -> LaboratoryMaximum:
    return LaboratoryMaximum(
        value_v=1.0,
        frequency_hz=1.0,
        fitted_v=1.0,
        scatter=0.003,
        noise=0.003,
        bias=bias,
        bias_std=std,
        fall=0.2,
    )


@pytest.mark.parametrize(
    ("bias", "std", "biased"),
    [
        (0.0021, 0.001, True),
        (0.0019, 0.001, False),
        (-0.0021, 0.001, True),
        (0.0011, 1e-6, True),
        (0.0009, 1e-6, False),
    ],
)
def test_a_bias_counts_from_two_standard_errors_and_a_thousandth(
    bias: float, std: float, biased: bool
) -> None:
    found = of_bias(bias, std)
    assert found.is_biased is biased
    assert found.sigma == pytest.approx(np.hypot(0.003, bias) if biased else 0.003)


@pytest.mark.parametrize(("freedom", "table"), [(1, 12.706), (2, 4.303), (5, 2.571), (10, 2.228)])
def test_scatter_of_few_points_counts_as_students_t(freedom: int, table: float) -> None:
    """Published two-sided 95 % points of t; a top of n points leaves n - 3."""
    found = replace(of_bias(0.0, 1.0), freedom=freedom)
    assert found.sigma == pytest.approx(0.003 * table / 1.96, rel=3e-4)


@pytest.mark.parametrize(
    ("step", "proportional", "rarest"),
    [(0.36, False, 0.98), (0.36, True, 0.94), (0.1, False, 0.98)],
)
@pytest.mark.parametrize("sweeps", [500, pytest.param(2000, marks=pytest.mark.nightly)])
def test_a_largest_point_is_as_far_from_the_top_as_is_said(
    step: float, proportional: bool, rarest: float, sweeps: int
) -> None:
    """2,000 sweeps of a line, five to twenty points above 70 %, noise of 1 %: 1.96 sigma hold it.

    By their scatter about the top alone, two degrees of freedom, 1 in 100 were 6 sigma away.
    """
    rng = np.random.default_rng(8)
    held, far, told = 0, 0, []
    for _ in range(sweeps):
        f = (np.arange(-14.0, 15.0) + rng.uniform(-0.5, 0.5)) * step
        line = lorentzian(f)
        noise = 0.01 * (line if proportional else 1.0) * rng.standard_normal(f.size)
        found = laboratory_maximum(f, line + noise)
        held += abs(found.value_v - 1.0) < 1.96 * found.sigma
        far += abs(found.value_v - 1.0) > 4.0 * found.sigma
        told.append(found.noise)
    assert held >= sweeps * rarest
    assert far <= sweeps // 250
    assert np.median(told) == pytest.approx(0.01, rel=0.25)


def test_a_scale_is_a_number_with_all_its_digits() -> None:
    assert chi_of_maxima(3.0, 2.0) == 1.5
    assert chi_of_maxima(3e-308, 1.0) == 3e-308
    for laboratory, simulated in ((1e-310, 1.0), (1.0, 0.0), (1e300, 1e-300), (-1.0, 1.0)):
        with pytest.raises(NoScale):
            chi_of_maxima(laboratory, simulated)
    huge, small = 1e200 * np.array([1.0, 2.0, 1.0]), 1e-100 * np.array([2.0, 4.0, 2.0])
    assert chi_of_sweep(np.array([1.0, 2.0]), np.array([0.0, 1.0])) == 2.0
    assert chi_of_sweep(small, huge / 1e50) / 2e-250 == pytest.approx(1.0)
    with pytest.raises(NoScale, match="zero everywhere"):
        chi_of_sweep(small, 1e-310 * np.ones(3))


@pytest.mark.parametrize("seed", [1, 2])
def test_the_robust_scale_solves_hubers_equation(seed: int) -> None:
    """sum psi((L - chi S)/s) S = 0 with psi cut at 1.345 and s = median |L - chi S|/0.6745."""
    generator = np.random.default_rng(seed)
    simulated = generator.uniform(0.2, 1.0, 60)
    measured = 4.0 * simulated + 0.05 * generator.standard_normal(60)
    measured[:6] += 1.0
    chi = chi_robust(measured, 1e-3 * simulated) * 1e-3
    left = measured - chi * simulated
    spread = np.median(np.abs(left)) / 0.6745
    psi = np.clip(left / spread, -1.345, 1.345)
    assert abs(psi @ simulated) < 1e-9 * np.sum(simulated)
    assert abs(chi / 4.0 - 1.0) < 0.03
    assert abs(chi_of_sweep(measured, simulated) / 4.0 - 1.0) > 0.03


def test_the_robust_scale_of_an_exact_half_is_exact() -> None:
    simulated = np.linspace(0.2, 1.0, 41)
    measured = 7.0 * simulated
    measured[::5] += 3.0
    assert chi_robust(measured, simulated) == pytest.approx(7.0, rel=1e-12)


def test_nodes_and_the_rough_width() -> None:
    assert nodes_around(100.0, 2.0).tolist() == [96.0, 98.0, 100.0, 102.0, 104.0]
    assert nodes_around(100.0, 2.0, 4).tolist() == [97.0, 99.0, 101.0, 103.0]
    f = np.array([0.0, 1.0, 2.0, 5.0, 6.0])
    assert half_power_width(f, np.array([0.1, 0.70, 1.0, 0.71, 0.1])) == 3.0
    assert half_power_width(f, np.array([0.1, 0.2, 1.0, 0.2, 0.1])) == 1.0
