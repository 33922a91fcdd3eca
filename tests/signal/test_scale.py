"""Algorithm 1: maxima between grid points, the bias bound, the laboratory's maximum, chi."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.signal.scale import (
    bend_of,
    chi_of_maxima,
    chi_of_sweep,
    half_power_width,
    laboratory_maximum,
    nodes_around,
    refine_maximum,
)
from tests.support import closed_form

ETA, ETA_OTHER = 6.94026e6, 7.02760e6


def single_mode(f: np.ndarray, eta: float, width: float) -> np.ndarray:
    """|1/((2 pi)^2 (eta^2 - f^2) + i (2 pi)^2 f w)|, one damped mode."""
    return np.asarray(1.0 / np.abs((2 * np.pi) ** 2 * ((eta - f) * (eta + f) + 1j * f * width)))


def exact_top(eta: float, width: float) -> float:
    """Maximum of one damped mode at 40 digits: 1/A = (2 pi)^2 w sqrt(eta^2 - w^2/4)."""
    with mp.workdps(40):
        bottom = (
            (2 * mp.pi) ** 2 * mp.mpf(width) * mp.sqrt(mp.mpf(eta) ** 2 - mp.mpf(width) ** 2 / 4)
        )
        return float(1 / bottom)


@given(
    offset=st.floats(-0.49, 0.49),
    log_q=st.floats(1.0, 6.0),
    spacing=st.floats(0.02, 1.5),
)
@settings(max_examples=200, deadline=None)
def test_a_single_mode_is_found_exactly_whatever_the_grid(
    offset: float, log_q: float, spacing: float
) -> None:
    width = ETA / 10**log_q
    top = float(np.sqrt(ETA**2 - width**2 / 2))
    f = nodes_around(top + offset * spacing * width, spacing * width)
    found = refine_maximum(f, single_mode(f, ETA, width))
    assert found.bracketed
    assert found.value == pytest.approx(exact_top(ETA, width), rel=1e-9)
    assert found.frequency_hz == pytest.approx(top, abs=1e-4 * width)


@pytest.mark.parametrize("spacing_hz", [5.0, 20.0, 45.0, 80.0])
def test_the_bias_bound_holds_for_two_coupled_modes(spacing_hz: float) -> None:
    d = closed_form.damping(1.9498, 120.0, 90.0, reflection=False)
    fine = ETA + np.linspace(-2.0, 2.0, 40001)
    truth = float(np.max(closed_form.amplitude(fine, (ETA, ETA_OTHER), d, 0)))
    for shift in (-0.4, -0.1, 0.0, 0.3):
        f = nodes_around(ETA + shift * spacing_hz, spacing_hz, 7)
        a = closed_form.amplitude(f, (ETA, ETA_OTHER), d, 0)
        found = refine_maximum(f, a)
        assert abs(found.value / truth - 1.0) <= max(found.bias, 1e-12)
        assert found.bias < 1e-5
        # the largest point itself would not have done
        if abs(shift) * spacing_hz > 1.0:
            assert truth / float(np.max(a)) - 1.0 > 1e-5


@given(
    offset=st.floats(-0.45, 0.45),
    spacing=st.floats(0.1, 0.5),
    background=st.floats(0.0, 0.3),
    angle=st.floats(0.0, 6.3),
    points=st.sampled_from([3, 4, 5, 9]),
)
@settings(max_examples=200, deadline=None)
def test_the_bias_bound_holds_where_the_curve_is_no_lorentzian(
    offset: float, spacing: float, background: float, angle: float, points: int
) -> None:
    """One mode with crosstalk, |1/(1 + 2 i t) + b e^(i a)|: 1/A^2 is no polynomial any more."""

    def curve(t: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(1.0 / (1.0 + 2j * t) + background * np.exp(1j * angle)))

    fine = np.linspace(-1.5, 1.5, 3001)
    fine = fine[np.argmax(curve(fine))] + np.linspace(-1e-3, 1e-3, 1001)
    top = float(fine[np.argmax(curve(fine))])
    t = nodes_around(top + offset * spacing, spacing, points)
    found = refine_maximum(t, curve(t))
    if found.bracketed:
        assert abs(found.value / np.max(curve(fine)) - 1.0) <= found.bias + 1e-9


def test_a_maximum_at_the_end_is_not_taken_for_one() -> None:
    f = nodes_around(ETA + 500.0, 50.0)
    found = refine_maximum(f, single_mode(f, ETA, 94.0))
    assert not found.bracketed
    assert found.bias == float("inf")


@pytest.mark.parametrize(
    ("amplitude", "words"),
    [
        (np.array([1.0, 2.0]), "3 points"),
        (np.array([1.0, np.nan, 1.0]), "positive and finite"),
        (np.array([1.0, -2.0, 1.0]), "positive and finite"),
    ],
)
def test_nonsense_is_refused(amplitude: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        refine_maximum(np.arange(amplitude.size, dtype=float), amplitude)


def test_the_laboratory_maximum_is_the_largest_point_and_its_bias_is_told() -> None:
    f = ETA + np.arange(-300.0, 301.0, 5.0)
    clean = single_mode(f, ETA, 94.0) / exact_top(ETA, 94.0)
    biases = []
    for seed in range(200):
        noisy = clean * (1.0 + 0.02 * np.random.default_rng(seed).standard_normal(f.size))
        found = laboratory_maximum(f, noisy)
        assert found.value_v == np.max(noisy)
        assert found.fitted_v == pytest.approx(1.0, abs=0.03)
        biases.append((found.bias, np.max(noisy) - 1.0))
    told, happened = np.mean(biases, axis=0)
    # the largest of the noisy points near the top is high by about a sigma, and that is told ...
    assert happened > 0.01
    assert told == pytest.approx(happened, abs=0.002)
    # ... and without noise it is right, or low by what the grid misses
    assert abs(laboratory_maximum(f, clean).bias) < 1e-6
    coarse = f[::4] + 10.0
    missed = float(np.max(single_mode(coarse, ETA, 94.0))) / exact_top(ETA, 94.0) - 1.0
    coarse_bias = laboratory_maximum(coarse, single_mode(coarse, ETA, 94.0)).bias
    assert coarse_bias == pytest.approx(missed, rel=1e-3)
    assert missed < -0.01


@pytest.mark.parametrize("spacing_hz", [16.0, 24.0, 28.0, 60.0])
def test_the_error_of_a_maximum_covers_its_noise_on_coarse_grids(spacing_hz: float) -> None:
    """Two to six points of a top: the stated error covers the noise of the largest one."""
    rng = np.random.default_rng(round(spacing_hz))
    covered = []
    for _ in range(400):
        places = np.arange(-10.0, 11.0) + rng.uniform(-0.5, 0.5)
        f = np.asarray(ETA + spacing_hz * places, dtype=float)
        clean = single_mode(f, ETA, 94.0)
        noisy = clean + 0.004 * clean.max() * rng.standard_normal(f.size)
        k = int(np.argmax(noisy))
        found = laboratory_maximum(f, noisy)
        covered.append(abs(found.value_v / clean[k] - 1.0) <= 1.96 * found.sigma)
    assert np.mean(covered) > 0.92


def test_the_maximum_of_a_flat_sweep_is_its_level() -> None:
    """On some processors the fitted curve is then exactly flat, and numpy trims its zeros."""
    for n in range(3, 60):
        found = laboratory_maximum(np.arange(float(n)), np.full(n, 3.0))
        assert found.value_v == 3.0
        assert found.fall == 0.0
        assert np.isnan(found.fitted_v) or found.fitted_v == pytest.approx(3.0, rel=1e-12)


def test_the_maximum_of_an_exactly_flat_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    flat = np.polynomial.Polynomial([1.0, 0.0, 0.0])
    monkeypatch.setattr(np.polynomial.Polynomial, "fit", lambda *_, **__: flat)
    assert laboratory_maximum(np.arange(9.0), np.full(9, 3.0)).value_v == 3.0


def test_the_scale_of_a_whole_sweep_is_the_least_squares_one() -> None:
    generator = np.random.default_rng(3)
    simulated = generator.uniform(0.1, 1.0, 50)
    measured = 7.0 * simulated + 0.01 * generator.standard_normal(50)
    expected = np.linalg.lstsq(simulated[:, np.newaxis], measured, rcond=None)[0][0]
    assert chi_of_sweep(measured, simulated) == pytest.approx(expected, rel=1e-12)
    with pytest.raises(ValueError, match="zero everywhere"):
        chi_of_sweep(measured, np.zeros(50))
    with pytest.raises(ValueError, match="50 and 49 points"):
        chi_of_sweep(measured, simulated[1:])


def test_the_ratio_of_maxima() -> None:
    assert chi_of_maxima(3e-5, 6e-11) == 5e5
    with pytest.raises(ValueError, match="no scale"):
        chi_of_maxima(3e-5, float("nan"))


def test_half_power_width_of_a_lorentzian() -> None:
    f = ETA + np.arange(-400.0, 400.0, 1.0)
    assert half_power_width(f, single_mode(f, ETA, 94.0)) == pytest.approx(94.0, abs=2.0)


@pytest.mark.parametrize("q", [20.0, 1e3, 7e4])
@pytest.mark.parametrize("offset", [-0.2, 0.05, 0.15])
@pytest.mark.parametrize("part", [0.05, 0.1, 0.25])
def test_three_points_are_off_by_no_more_than_their_bound(
    q: float, offset: float, part: float
) -> None:
    """A = 1/sqrt((1 - u^2)^2 + (u/Q)^2): the maximum is Q/sqrt(1 - 1/(4 Q^2)), in closed form."""

    def amplitude(u: np.ndarray) -> np.ndarray:
        return np.asarray(1.0 / np.sqrt(((1.0 - u) * (1.0 + u)) ** 2 + (u / q) ** 2))

    width = 1.0 / q
    centre = np.sqrt(1.0 - 0.5 / q**2) + offset * part * width
    five = centre + 0.5 * width * np.arange(-2.0, 3.0)
    bend, _ = bend_of(five, amplitude(five))
    assert bend == pytest.approx(3.0, rel=20.0 / q)  # 24 u / (12 u^2 - 4 + 2/Q^2) at u = 1
    three = centre + part * width * np.array([-1.0, 0.0, 1.0])
    found = refine_maximum(three, amplitude(three), 2.0 * bend)
    truth = q / np.sqrt(1.0 - 0.25 / q**2)
    assert found.bracketed
    assert abs(found.value / truth - 1.0) <= found.bias + 1e-11
    assert found.bias < 10.0 * part**3 / q


def test_a_grid_of_the_same_bias_needs_more_than_five_times_the_runs() -> None:
    """Over two widths about the maximum, the largest point of a grid of n is off by up to that."""
    q, width = 1e3, 1e-3

    def amplitude(u: np.ndarray) -> np.ndarray:
        return np.asarray(1.0 / np.sqrt(((1.0 - u) * (1.0 + u)) ** 2 + (u / q) ** 2))

    top, truth = np.sqrt(1.0 - 0.5 / q**2), q / np.sqrt(1.0 - 0.25 / q**2)
    three = top + 0.05 * width + 0.25 * width * np.array([-1.0, 0.0, 1.0])
    bias = abs(refine_maximum(three, amplitude(three), 6.0).value / truth - 1.0)

    def grid_bias(n: int) -> float:
        step = 2.0 * width / (n - 1)
        shifts = np.linspace(-0.5, 0.5, 21) * step
        grids = [top + shift + step * (np.arange(n) - n // 2) for shift in shifts]
        return max(float(1.0 - np.max(amplitude(u)) / truth) for u in grids)

    assert bias < 1e-4
    assert grid_bias(16) > bias


def test_points_that_are_one_but_for_rounding_tell_nothing_of_what_is_between() -> None:
    """No polynomial goes through them: the largest point stands, and its bias is not known."""
    f = np.array([99.0, 100.0, 100.0, 101.0, 102.0])
    found = refine_maximum(f, np.array([1.0, 2.0, 2.0, 1.5, 1.0]))
    assert (found.value, found.frequency_hz) == (2.0, 100.0)
    assert found.bias == float("inf")
