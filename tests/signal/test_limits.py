"""Where lines and combinations are refused and where not: limits by hand, from both sides."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.stats import norm, t

from fitting.lines.form import fit_resonance
from fitting.lines.lorentzian import mode_response
from fitting.signal.combinations import (
    combination_name,
    lines_to_read,
    mixed_hz,
    mixed_lines,
    parse_combination,
)
from fitting.signal.peaks import (
    noise_floor,
    read_peaks,
    unknown_line,
)
from fitting.signal.tones import (
    ToneFit,
    common_period,
    cycle_fraction,
    fit_tones,
    tones_in_words,
    unit_hint,
)
from fitting.signal.window import Window, folded, kept_apart, whole_steps
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

# --- combinations


@pytest.mark.parametrize(("tones", "order"), [(1, 3), (2, 1), (2, 5), (3, 2), (3, 4)])
def test_mixed_lines_are_all_there_are(tones: int, order: int) -> None:
    """Counted out: every combination up to the order, and of k and -k one."""
    wanted = {
        k
        for k in itertools.product(range(-order - 1, order + 2), repeat=tones)
        if 1 <= sum(map(abs, k)) <= order
    }
    found = mixed_lines(tones, order)
    assert len(found) == len(set(found)) == len(wanted) / 2
    assert {*found, *(tuple(-x for x in k) for k in found)} == wanted
    assert all(next(x for x in k if x) > 0 for k in found)


def test_their_frequencies_are_positive_different_and_no_tone_of_order_one() -> None:
    tones = (100.1, 100.3)
    wanted = set()
    for k in itertools.product(range(-4, 5), repeat=2):
        f = abs(k[0] * Fraction("100.1") + k[1] * Fraction("100.3"))
        if 2 <= sum(map(abs, k)) <= 4 and f:
            wanted.add(float(f))
    assert mixed_hz(tones, 4) == tuple(sorted(wanted))
    assert mixed_hz(tones, 1) == ()
    assert mixed_hz((50.0,), 3) == (100.0, 150.0)


def test_so_many_lines_are_kept_apart_and_no_more() -> None:
    """(2 n + 1)^2 of a million at most: 999^2 = 998,001."""
    tones = ("u1", "u2")
    assert lines_to_read(["u1"], 499, tones, "here")[1] == 499
    with pytest.raises(BadInput, match="order = 500 with 2"):
        lines_to_read(["u1"], 500, tones, "here")
    assert lines_to_read(["u1", "3*u1"], 3, tones, "here")[1] == 3
    with pytest.raises(BadInput, match=r"order 3.* order = 2"):
        lines_to_read(["u1", "3*u1"], 2, tones, "here")
    with pytest.raises(BadInput, match="here: "):
        lines_to_read([], None, tones, "here")
    read, _ = lines_to_read(["u2", "u1"], None, tones, "here")
    assert [line.factors for line in read] == [(0, 1), (1, 0)]


def test_multiples_have_three_digits_at_most() -> None:
    assert parse_combination("999*u1", ("u1",), "here").factors == (999,)
    with pytest.raises(BadInput, match="fewer digits"):
        parse_combination("1000*u1", ("u1",), "here")


def test_names_put_positive_terms_first() -> None:
    names = ("a", "b", "c")
    assert combination_name((-1, 0, 2), names) == "2 c - a"
    assert combination_name((-1, -3, 0), names) == "-a - 3 b"
    assert combination_name((1, 1, -1), names) == "a + b - c"


# --- tones


def test_periods_and_turns_are_exact() -> None:
    assert common_period((0.1, 0.25, 0.0)) == 20
    assert common_period((6.0, 4.0)) == Fraction(1, 2)
    with pytest.raises(BadInput, match="at least"):
        common_period((0.0,))
    times = np.array([1e9 + 1.0 / 3.0, 0.1, 12345.678])
    for f in (6.94026e6, 0.3):
        turns = [float(Fraction(f) * Fraction(t) % 1) for t in times.tolist()]
        assert np.mod(cycle_fraction(f, times), 1.0) == pytest.approx(turns, abs=1e-9)


def test_a_fit_of_tones_with_one_sample_fewer_than_unknowns_has_no_condition() -> None:
    times = np.linspace(0.0, 0.9, 10)
    assert ToneFit((1.0,), times[:2]).condition == math.inf
    assert ToneFit((1.0,), np.array([0.0, 0.25, 0.5, 0.75])).condition == pytest.approx(2.0**0.5)
    t = np.linspace(0.0, 3.0, 40)
    values = 2.0 + 3.0 * np.cos(2 * np.pi * t + 0.5) + 0.7 * np.sin(2 * np.pi * 1.7 * t)
    found = fit_tones((1.0, 1.7), t, values)
    assert found.mean == pytest.approx(2.0)
    assert found.phasors == pytest.approx([3.0 * np.exp(0.5j), -0.7j])
    assert found.amplitudes == pytest.approx([3.0, 0.7])
    assert found.rest == pytest.approx(np.zeros(40), abs=1e-12)
    with pytest.raises(BadInput, match=r"1 Hz and 1\.0001 Hz"):
        fit_tones((1.0, 1.0001), t, values)


def test_tones_a_thousand_times_apart_look_like_a_forgotten_unit() -> None:
    assert unit_hint((6.94, 6.9e3)) == ""
    assert "factor of 1000" in unit_hint((6.94, 6.95e3))
    assert "factor of 14000" in unit_hint((5e-4, 7.0))
    assert unit_hint((0.0, 7e6)) == ""
    assert tones_in_words((6.94018, 6940360.0)).endswith("6.94018 Hz and 6940360 Hz")
    assert tones_in_words((5.0,)) == "tone 5 Hz"


# --- windows


@pytest.mark.parametrize(
    ("step_s", "settle_s", "samples", "words"),
    [
        (0.1, 0.0, 5, None),
        (0.0, 0.0, 5, "step 0.0 s"),
        (0.1, -1.0, 5, "settling -1.0 s"),
        (math.nan, 0.0, 5, "step nan s"),
        (0.1, 0.0, 4, "4 samples .*2 tones"),
    ],
)
def test_windows_have_a_step_a_time_and_a_sample_for_every_unknown(
    step_s: float, settle_s: float, samples: int, words: str | None
) -> None:
    def window() -> Window:
        return Window(tones_hz=(1.0, 2.0), settle_s=settle_s, step_s=step_s, samples=samples)

    if words is None:
        assert window().length_s == pytest.approx(0.5)
        assert window().input_step_s == 0.1
        assert replace(window(), hold_steps=4).input_step_s == pytest.approx(0.025)
        with pytest.raises(ValueError, match=r"6 samples.* 5"):
            window().read(np.zeros(6))
        return
    with pytest.raises(ValueError, match=words):
        window()


@pytest.mark.parametrize(
    ("cycles", "samples", "place"), [(3, 8, 3), (5, 8, 3), (8, 8, 0), (12, 8, 4)]
)
def test_a_line_is_seen_in_the_bin_that_a_fourier_transform_says(
    cycles: int, samples: int, place: int
) -> None:
    wave = np.cos(2.0 * np.pi * cycles * np.arange(samples) / samples)
    assert folded(cycles, samples) == int(np.argmax(np.abs(np.fft.rfft(wave)))) == place


def test_tones_are_apart_where_their_bins_are() -> None:
    """By sampled cosines and sines: the design of mean and tones has its full rank."""
    for samples in range(5, 40):
        for cycles in ((3, 10), (5, 6), (7, 14)):
            angle = 2.0 * np.pi * np.outer(np.arange(samples), cycles) / samples
            design = np.column_stack([np.ones(samples), np.cos(angle), np.sin(angle)])
            apart = np.linalg.matrix_rank(design, tol=1e-8) == 5
            assert kept_apart(cycles, (), samples) == apart
            assert not kept_apart(cycles, (cycles[0] + samples,), samples)


@pytest.mark.parametrize(
    ("time_s", "whole_s"), [(0.0, 0.0), (0.61, 0.75), (0.75, 0.75), (0.76, 1.0)]
)
def test_times_are_rounded_up_to_whole_steps(time_s: float, whole_s: float) -> None:
    assert whole_steps(time_s, 0.25) == whole_s


# --- peaks and lines


def rayleigh(size: int, sigma: float, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return np.abs(sigma * (rng.standard_normal(size) + 1j * rng.standard_normal(size)))


def test_points_near_a_tone_are_no_noise() -> None:
    """Six to either side of the nearest: thirteen points, of which ten others are wanted."""
    f = np.arange(23.0)
    quiet = np.full(23, 2.0)
    quiet[5:18] = 50.0
    assert noise_floor(f, quiet, (11.3,), "mean").level_v == 2.0
    assert noise_floor(f, quiet, (11.3,), "mean").sigma_v == pytest.approx(2.0 / (np.pi / 2) ** 0.5)
    robust = noise_floor(f, quiet, (11.3,), "robust")
    assert robust.sigma_v == pytest.approx(2.0 / (2.0 * np.log(2.0)) ** 0.5)
    assert robust.level_v == pytest.approx(robust.sigma_v * (np.pi / 2) ** 0.5)
    with pytest.raises(BadInput, match=r"9 points .* 6 points"):
        noise_floor(f[:22], quiet[:22], (11.3,), "mean")


@pytest.mark.parametrize(("above", "found"), [(1.02, True), (0.98, False)])
def test_an_unknown_line_is_told_where_noise_reaches_it_once_in_a_million_spectra(
    above: float, found: bool
) -> None:
    """n exp(-a^2/(2 sigma^2)) = 1e-6, sigma by the median of Rayleigh's distribution."""
    f = np.arange(400.0)
    a = rayleigh(400, 0.3, 1)
    away = np.delete(np.arange(400), np.arange(94, 107))
    sigma = np.median(a[away]) / (2.0 * np.log(2.0)) ** 0.5
    a[250] = above * sigma * (2.0 * np.log(387 / 1e-6)) ** 0.5
    a[100] = 99.0
    assert unknown_line(f, a, (100.0,)) == ((250.0, a[250]) if found else None)
    assert unknown_line(f, a, ()) == (100.0, 99.0)
    assert unknown_line(f[:22], a[:22], (11.0,)) is None


@pytest.mark.parametrize(("height", "told"), [(4.05, True), (3.95, False)])
def test_a_peak_stands_four_sigma_out_of_the_noise(height: float, told: bool) -> None:
    f = np.arange(101.0)
    a = rayleigh(101, 0.2, 2)
    sigma = noise_floor(f, a, (50.0,), "robust").sigma_v
    a[50] = height * sigma
    if told:
        found = read_peaks(f, a, (50.0,))
        assert found.raw_v == pytest.approx([height * sigma])
        assert found.peaks_v == pytest.approx([sigma * (height**2 - 1.0) ** 0.5])
        assert found.sigmas_v == pytest.approx([sigma])
        assert read_peaks(f, a, (50.0,), "none").peaks_v == pytest.approx([height * sigma])
        return
    with pytest.raises(BadInput, match="tone 50 Hz"):
        read_peaks(f, a, (50.0,))


def test_a_tone_may_lie_half_a_step_beyond_the_trace() -> None:
    f, a = np.arange(10.0, 111.0), np.ones(101)
    a[0] = a[-1] = 50.0
    for tone, end in ((9.6, 0), (110.4, -1)):
        assert read_peaks(f, a, (tone,), "none").raw_v == [a[end]]
    for tone in (9.4, 110.6):
        with pytest.raises(BadInput, match=f"tone {tone:g} Hz.* 10 to 110 Hz"):
            read_peaks(f, a, (tone,))
    with pytest.raises(ValueError, match="'median'"):
        read_peaks(f, a, (20.0,), "median")


def test_a_bare_list_of_lines_has_no_floor() -> None:
    f, a = np.arange(22.0), np.full(22, 3.0)
    assert read_peaks(f, a, (5.0,), "none").floor.level_v == 0.0
    longer = read_peaks(np.arange(23.0), np.append(np.full(22, 1e-3), 3.0), (22.0,), "none")
    assert longer.floor.level_v > 0.0


def test_the_standard_deviations_of_a_resonance_are_those_of_curve_fit() -> None:
    """And that of Q = eta/w by both and their correlation."""
    eta, width = 1000.0, 7.0
    f = eta + np.linspace(-20.0, 30.0, 61)
    rng = np.random.default_rng(3)
    a = 2.0 * np.abs(mode_response(f, eta, width)) + 0.02 * rng.standard_normal(61)

    def law(f: FloatArray, eta: float, width: float, height: float) -> FloatArray:
        return np.asarray(height * np.abs(mode_response(f, eta, width)))

    x, spread = curve_fit(law, f, a, p0=(eta, width, 2.0))
    found = fit_resonance(f, a)
    # ± holds 68 %: Student's, as the residuals of 61 - 3 degrees of freedom tell the noise
    student = t.ppf(norm.cdf(1.0), 58.0 / found.structure.widening**2)
    std = np.sqrt(np.diag(spread)) * found.structure.widening * student
    assert (found.frequency.value, found.width.value, found.amplitude.value) == pytest.approx(
        x, rel=1e-5
    )
    assert (found.frequency.std, found.width.std, found.amplitude.std) == pytest.approx(
        std, rel=1e-3
    )
    assert found.correl[0][1] == pytest.approx(
        spread[0, 1] / np.sqrt(spread[0, 0] * spread[1, 1]), abs=1e-3
    )
    slope = np.array([1.0 / x[1], -x[0] / x[1] ** 2])
    q_std = np.sqrt(slope @ spread[:2, :2] @ slope) * found.structure.widening * student
    assert found.q.std == pytest.approx(q_std, rel=1e-3)
    assert found.rms_residual == pytest.approx(np.std(law(f, *x) - a) / x[2], rel=0.01)
    assert found.curve == pytest.approx(law(f, *x), rel=1e-5)


@pytest.mark.parametrize(
    ("beside", "widths", "found"),
    [(0.0, 0.4, True), (0.0, 0.15, False), (2.9, 3.0, True), (3.4, 3.0, False)],
)
def test_a_resonance_must_lie_within_its_sweep(beside: float, widths: float, found: bool) -> None:
    """Its top inside, and its width below three times the span."""
    f = 1000.0 + 10.0 * np.linspace(-widths, widths, 41)
    a = np.abs(mode_response(f, 1000.0 + 10.0 * beside, 10.0))
    if found:
        assert fit_resonance(f, a).width.value == pytest.approx(10.0, rel=1e-4)
        return
    with pytest.raises(BadInput, match="no resonance"):
        fit_resonance(f, a)


@pytest.mark.parametrize(("background", "least"), [("none", 8), ("complex", 8)])
def test_eight_points_make_a_resonance(background: str, least: int) -> None:
    f = 1000.0 + np.linspace(-20.0, 20.0, least)
    a = np.abs(mode_response(f, 1001.0, 10.0) + (0.1j if background == "complex" else 0.0))
    assert fit_resonance(f, a, background=background).frequency.value == pytest.approx(
        1001.0, abs=1e-3
    )
    with pytest.raises(BadInput, match=f"{least - 1} points"):
        fit_resonance(f[1:], a[1:], background=background)
    with pytest.raises(ValueError, match="background"):
        fit_resonance(f, a, background="linear")
