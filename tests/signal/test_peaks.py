"""Reading laboratory traces: floor statistics, unbiased peaks, resonance against known answers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm, t

from fitting.campaign.instruments import read_trace
from fitting.lines.form import fit_resonance
from fitting.signal.peaks import noise_floor, read_peaks
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

AFM = Path(__file__).parents[2] / "data" / "afm_sensor" / "afm_sensor_sweep.dat"
GRID = 6.94e6 + np.arange(-250.0, 251.0)
TONES = (6.94e6 - 10.0, 6.94e6 + 10.0)


def spectrum(lines: tuple[float, ...], sigma: float, seed: int) -> FloatArray:
    """Magnitudes: two lines on their points plus complex Gaussian noise, sigma per quadrature."""
    rng = np.random.default_rng(seed)
    wave = sigma * (rng.standard_normal(GRID.size) + 1j * rng.standard_normal(GRID.size))
    for tone, line in zip(TONES, lines, strict=True):
        wave[tone == GRID] += line
    return np.abs(wave)


@pytest.mark.parametrize("kind", ["mean", "robust"])
def test_floor_of_rayleigh_noise(kind: str) -> None:
    floor = noise_floor(GRID, spectrum((30.0, 20.0), 0.2, 1), TONES, kind)
    # mean of |n| is sigma sqrt(pi/2); 475 points leave 2.4 % (mean) and 3.3 % (median) scatter
    assert floor.level_v == pytest.approx(0.2 * math.sqrt(math.pi / 2), rel=0.08)
    assert floor.sigma_v == pytest.approx(0.2, rel=0.08)


def test_robust_floor_ignores_spurious_lines_that_spoil_the_mean() -> None:
    trace = spectrum((30.0, 20.0), 0.2, 2)
    clean = noise_floor(GRID, trace, TONES, "robust").level_v
    trace[20:60] = 50.0
    assert noise_floor(GRID, trace, TONES, "robust").level_v == pytest.approx(clean, rel=0.15)
    assert noise_floor(GRID, trace, TONES, "mean").level_v > 10 * clean


def test_robust_peaks_are_unbiased_and_the_mean_difference_is_low_by_the_floor() -> None:
    sigma, truth, draws = 0.5, np.array([5.0, 8.0]), 4000
    part = slice(215, 286)
    traces = [spectrum((5.0, 8.0), sigma, 100 + k)[part] for k in range(draws)]
    error = 2.5 * sigma / math.sqrt(draws)  # 0.020; one order down is sigma^2 / 2a = 0.025
    robust = np.mean([read_peaks(GRID[part], t, TONES).peaks_v for t in traces], axis=0)
    np.testing.assert_allclose(robust, truth, atol=error)
    mean = np.mean([read_peaks(GRID[part], t, TONES, "mean").peaks_v for t in traces], axis=0)
    level = sigma * math.sqrt(math.pi / 2)
    expected = truth + sigma**2 / (2 * truth) - level
    np.testing.assert_allclose(mean, expected, atol=error)


def test_stated_sigma_is_the_scatter_of_the_peaks() -> None:
    readings = [read_peaks(GRID, spectrum((30.0, 20.0), 0.25, k), TONES) for k in range(400)]
    scatter = np.std([r.peaks_v for r in readings], axis=0)
    np.testing.assert_allclose(scatter, 0.25, rtol=0.15)
    np.testing.assert_allclose(np.mean([r.sigmas_v for r in readings], axis=0), 0.25, rtol=0.03)


def test_without_noise_a_tone_on_its_point_is_returned_exactly() -> None:
    for kind in ("robust", "mean", "none"):
        reading = read_peaks(GRID, spectrum((30.0, 20.0), 0.0, 1), TONES, kind)
        np.testing.assert_array_equal(reading.peaks_v, [30.0, 20.0])


@given(offset=st.floats(-0.5, 0.5), bandwidth=st.floats(1.0, 4.0), height=st.floats(1e-6, 1e3))
def test_crest_between_points_is_exact_for_a_gaussian_filter(
    offset: float, bandwidth: float, height: float
) -> None:
    tone = 6.94e6 + offset
    trace = height * np.exp(-0.5 * math.log(2) * (2 * (GRID - tone) / bandwidth) ** 2)
    found = read_peaks(GRID, trace, (tone,), "none").peaks_v[0]
    assert found == pytest.approx(height, rel=1e-7)
    if 0.01 < abs(offset) < 0.3:  # the crest, even where the stated tone is a little beside it
        found = read_peaks(GRID, trace, (6.94e6 + 1.3 * offset,), "none").peaks_v[0]
        assert found == pytest.approx(height, rel=1e-7)


@pytest.mark.parametrize("end", [slice(0, 3), slice(-3, None)])
def test_a_crest_between_the_last_points_is_that_of_their_filter(end: slice) -> None:
    """Three points of a Gaussian line are enough, at either end of a trace as well."""
    middle = float(GRID[end][1])
    trace = 5.0 * np.exp(-0.3 * (GRID - (middle + 0.3)) ** 2)
    found = read_peaks(GRID, trace, (middle + 0.2,), "none")
    assert found.peaks_v[0] == pytest.approx(5.0, rel=1e-7)


def test_a_crest_more_than_a_point_away_is_another_line() -> None:
    """What the tone has there is no more than the largest of its three points."""
    step = float(GRID[1] - GRID[0])
    tone = float(GRID[250]) - 0.3 * step
    trace = np.exp(-0.1 * ((GRID - tone) / step - 1.5) ** 2)
    found = read_peaks(GRID, trace, (tone,), "none").peaks_v[0]
    assert found == pytest.approx(trace[251], rel=1e-12)


def test_a_point_stands_for_half_a_spacing_around_it() -> None:
    """Of two lines in a bare list, too: what is further from both is not in the list."""
    f, a = np.array([10.0, 12.0]), np.array([3.0, 5.0])
    assert read_peaks(f, a, (9.1, 12.9), "none").peaks_v.tolist() == [3.0, 5.0]
    for tone in (8.9, 13.1):
        with pytest.raises(BadInput, match=f"tone {tone:g} Hz.* 10 to 12 Hz"):
            read_peaks(f, a, (tone,), "none")


def test_a_line_beside_points_of_zero_is_at_least_its_largest_point() -> None:
    """What an instrument cut off has no logarithm, and no crest between the points is known."""
    trace = np.zeros(GRID.size)
    trace[250:252] = 3.0, 2.0
    assert read_peaks(GRID, trace, (float(GRID[250]) + 0.2,), "none").peaks_v[0] == 3.0


@pytest.mark.parametrize(
    ("scale", "outside", "silent"),
    [
        (1.0, "60 Hz.* 30 to 50 Hz", "45 Hz"),
        (1e3, "60 kHz.* 30 to 50 kHz", "45 kHz"),
        (1e9, "60 GHz.* 30 to 50 GHz", "45 GHz"),
    ],
)
def test_frequencies_are_told_in_the_unit_that_suits_them(
    scale: float, outside: str, silent: str
) -> None:
    grid = scale * np.linspace(30.0, 50.0, 201)
    flat = np.ones(201)
    with pytest.raises(BadInput, match=outside):
        read_peaks(grid, flat, (60.0 * scale,))
    with pytest.raises(BadInput, match=silent):
        read_peaks(grid, flat, (45.0 * scale,))


@pytest.mark.parametrize(
    ("tones", "size", "words"),
    [
        ((6.95e6,), 501, r"6\.95 MHz.* 6\.93975"),
        ((6.94e6 + 60,), 501, r"6\.94006 MHz"),
        (TONES, 258, r"\d points .* 6 points"),
    ],
)
def test_a_spectrum_that_cannot_hold_the_tone_is_refused(
    tones: tuple[float, ...], size: int, words: str
) -> None:
    trace = spectrum((30.0, 20.0), 0.2, 3)
    part = slice(0, 501) if size == 501 else slice(238, 263)
    with pytest.raises(BadInput, match=words) as caught:
        read_peaks(GRID[part], trace[part], tones, source="spectra/pair1.csv")
    assert str(caught.value).startswith("spectra/")
    assert "\n" not in str(caught.value)


def lorentz(f: FloatArray, eta: float, width: float, height: float) -> FloatArray:
    """Steady amplitude of x'' + 2 pi w x' + (2 pi eta)^2 x = cos 2 pi f t, height at eta."""
    a = (2 * np.pi) ** 2 * ((eta**2 - f**2) + 1j * f * width)
    peak = 1.0 / ((2 * np.pi) ** 2 * eta * width)
    return np.asarray(height * np.abs(1.0 / a) / peak)


@settings(max_examples=40, deadline=None)
@given(
    eta=st.floats(-0.6, 0.6),
    log_q=st.floats(1.5, 5.0),
    height=st.floats(-9, 3),
    points=st.integers(25, 300),
)
def test_resonance_without_noise_comes_back(
    eta: float, log_q: float, height: float, points: int
) -> None:
    width = 1e6 / 10**log_q
    f = 1e6 + 3 * width * np.linspace(-1, 1, points)
    fit = fit_resonance(f, lorentz(f, 1e6 + eta * width, width, 10**height))
    # eta^2 - f^2 of the data above cancels at high Q: that is the data's rounding, not the fit's
    rounding = 1e-15 * 10**log_q
    assert fit.frequency.value == pytest.approx(
        1e6 + eta * width, abs=(1e-9 + 30 * rounding) * width
    )
    assert fit.width.value == pytest.approx(width, rel=1e-8 + 30 * rounding)
    assert fit.amplitude.value == pytest.approx(10**height, rel=1e-8 + 30 * rounding)
    assert fit.q.value == pytest.approx((1e6 + eta * width) / width, rel=1e-8 + 30 * rounding)


@pytest.mark.parametrize(
    ("at", "inside"), [(0.5, True), (-0.5, False), (39.5, True), (40.5, False)]
)
def test_a_line_is_found_up_to_the_ends_of_its_sweep(at: float, inside: bool) -> None:
    """Forty gaps of half a width; the line lies so many gaps from the first point."""
    f: FloatArray = np.asarray(1e6 + 5.0 * np.arange(41), dtype=np.float64)
    trace = lorentz(f, 1e6 + 5.0 * at, 10.0, 1.0)
    if inside:
        assert fit_resonance(f, trace).frequency.value == pytest.approx(1e6 + 5.0 * at, abs=1e-6)
    else:
        with pytest.raises(BadInput, match="no resonance"):
            fit_resonance(f, trace)


@pytest.mark.parametrize("draws", [100, pytest.param(300, marks=pytest.mark.nightly)])
def test_stated_uncertainties_are_the_scatter(draws: int) -> None:
    f = 6.94e6 + np.arange(-300.0, 301.0, 5.0)
    clean, rng, pulls = lorentz(f, 6.94001e6, 94.0, 40.0), np.random.default_rng(5), []
    for _ in range(draws):
        noise = 0.2 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        fit = fit_resonance(f, np.abs(clean + noise))
        q = 6.94001e6 / 94.0
        pulls.append(
            [
                (fit.frequency.value - 6.94001e6) / fit.frequency.std,
                (fit.width.value - 94.0) / fit.width.std,
                (fit.amplitude.value - 40.0) / fit.amplitude.std,
                (fit.q.value - q) / fit.q.std,
            ]
        )
    np.testing.assert_allclose(np.std(pulls, axis=0), 1.0, atol=0.15)
    np.testing.assert_allclose(np.mean(pulls, axis=0), 0.0, atol=0.25)


@pytest.mark.parametrize("q", [0.8, 2.0, 30.0])
def test_the_error_of_q_is_that_of_a_fit_of_q(q: float) -> None:
    """With eta and Q for unknowns Q has a variance of its own, whatever eta and width are."""
    f = np.linspace(300.0, 1900.0, 161)

    def curve(x: FloatArray) -> FloatArray:
        return lorentz(f, x[0], x[0] / x[1], x[2])

    x = np.array([1000.0, q, 5.0])
    steps = 1e-5 * np.diag(x)
    slopes = [(curve(x + h) - curve(x - h)) / (2.0 * np.sum(h)) for h in steps]
    a = curve(x) + 1e-3 * np.random.default_rng(3).standard_normal(f.size)
    fit = fit_resonance(f, a)
    # by the residuals, scaled by their correlation; ± holds 68 %, Student's
    variance = float(np.sum((fit.curve - a) ** 2)) / (f.size - 3)
    covariance = variance * np.linalg.inv(np.inner(slopes, slopes))
    widening = fit.structure.widening
    scale = widening * t.ppf(norm.cdf(1.0), (f.size - 3) / widening**2)
    assert fit.q.value == pytest.approx(q, rel=1e-2)
    assert fit.q.std == pytest.approx(scale * covariance[1, 1] ** 0.5, rel=1e-2)
    assert fit.frequency.std == pytest.approx(scale * covariance[0, 0] ** 0.5, rel=1e-2)


def test_complex_background_is_separated() -> None:
    f = 3e4 + np.linspace(-40, 40, 200)
    a = (3e4 + 1.5 - f) * (3e4 + 1.5 + f) + 1j * f * 25.0
    trace = np.abs(2.0 * 25.0 * (3e4 + 1.5) / a + (0.1 - 0.05j))
    plain = fit_resonance(f, trace)
    assert abs(plain.frequency.value - 30001.5) > 0.1
    full = fit_resonance(f, trace, background="complex")
    assert full.frequency.value == pytest.approx(30001.5, abs=1e-6)
    assert full.width.value == pytest.approx(25.0, rel=1e-7)
    # magnitudes know the background up to a mirror image, which has the same size
    assert abs(full.background) == pytest.approx(abs(0.1 - 0.05j), rel=1e-5)


@pytest.mark.parametrize("depth", [0.05, 0.5, 1.0, 1.6])
@pytest.mark.parametrize("widths", [1.5, 20.0])
def test_a_line_that_takes_away_from_a_background_comes_back(depth: float, widths: float) -> None:
    """Almost opposite to the background at its top; beyond a depth of 1 it is the larger one."""
    f = 3e4 + 25.0 * np.linspace(-widths, widths, 121)
    eta = 3e4 + 5.0
    line = depth * 25.0 * eta / ((eta - f) * (eta + f) + 1j * f * 25.0)
    fit = fit_resonance(f, 7.0 * np.abs(line + np.exp(1.67j)), background="complex")
    assert fit.frequency.value == pytest.approx(eta, abs=1e-5)
    assert fit.width.value == pytest.approx(25.0, rel=1e-6)


def test_measured_cantilever_gives_what_another_program_found() -> None:
    raw = read_trace(AFM, "afm")
    fit = fit_resonance(raw.frequency, raw.amplitude)
    assert fit.frequency.value == pytest.approx(30280.96, abs=0.05)
    assert fit.width.value == pytest.approx(24.90, abs=0.05)
    assert fit.q.value == pytest.approx(1216, abs=3)
    assert fit.rms_residual == pytest.approx(0.0043, abs=0.00005)
    full = fit_resonance(raw.frequency, raw.amplitude, background="complex")
    assert full.frequency.value == pytest.approx(30281.26, abs=0.02)
    assert full.width.value == pytest.approx(24.84, abs=0.02)
    assert full.q.value == pytest.approx(1219, abs=1)


@pytest.mark.parametrize(
    ("trace", "words"),
    [
        (np.ones(5), "5 points"),
        (np.ones(40), r"999980\.5 and 1000019\.5 Hz"),
    ],
)
def test_sweep_without_a_resonance_is_refused(trace: FloatArray, words: str) -> None:
    f = np.linspace(-0.5, 0.5, trace.size) * (trace.size - 1.0) + 1e6
    with pytest.raises(BadInput, match=words):
        fit_resonance(f, trace, source="sweep.csv")
