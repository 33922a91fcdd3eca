"""Coherent windows and tone fits against tones of known amplitude."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.signal.spectrum import Band, amplitude_spectrum, plan_band
from fitting.signal.tones import common_period, exact, fit_tones
from fitting.text.errors import BadInput

PAIR = (6.94016e6, 6.94036e6)


def test_common_period_of_the_published_pairs() -> None:
    # 6940160 = 40 · 173504 and 6940360 = 40 · 173509
    assert common_period(PAIR) == Fraction(1, 40)
    assert common_period((6.94025e6, 6.94027e6)) == Fraction(1, 10)
    assert common_period((0.1, 0.25)) == 20
    assert common_period((3.0,)) == Fraction(1, 3)


def test_published_pair_is_read_back_exactly() -> None:
    band = plan_band(PAIR, longest_s=1.0)
    assert band is not None
    window, n = band.window_s, band.samples
    # exact phases, so that only the transform is tested: k f T/N in whole numbers
    turns = [[(j * exact(f) * window / n) % 1 for j in range(n)] for f in PAIR]
    values = 3e-12 * np.cos(2 * math.pi * np.array(turns[0], dtype=float) + 0.3)
    values += 7e-12 * np.sin(2 * math.pi * np.array(turns[1], dtype=float))
    spectrum = amplitude_spectrum(values)
    for tone, k, amplitude in zip(PAIR, band.bins(), (3e-12, 7e-12), strict=True):
        assert spectrum[k] == pytest.approx(amplitude, rel=1e-13)
        assert band.frequencies_hz()[k] == pytest.approx(tone, abs=1e-6)
    rest = np.delete(spectrum, band.bins())
    assert np.max(rest) < 1e-24


@given(
    st.lists(st.integers(1, 10**7), min_size=1, max_size=4, unique=True),
    st.integers(0, 4),
    st.one_of(st.none(), st.integers(16, 3000)),
)
@settings(max_examples=100, deadline=None)
def test_tones_never_fold_onto_each_other(whole: list[int], places: int, n: int | None) -> None:
    tones = [f / 10**places for f in whole]
    try:
        band = plan_band(tones, longest_s=1e9, samples=n)
    except BadInput:
        return
    assert band is not None
    bins = band.bins()
    assert len(set(bins)) == len(tones)
    assert all(0 < k < band.samples / 2 for k in bins)
    frequencies = band.frequencies_hz()
    for tone, k in zip(tones, bins, strict=True):
        assert frequencies[k] == pytest.approx(tone, rel=1e-12)
    assert (exact(max(tones)) * band.window_s).denominator == 1


def test_band_refuses_edges_and_broken_periods() -> None:
    with pytest.raises(BadInput, match="whole"):
        Band(tones_hz=(3.0,), window_s=Fraction(1, 2), samples=64, zone=0)
    with pytest.raises(BadInput, match="edge of"):
        Band(tones_hz=(32.0,), window_s=Fraction(1), samples=64, zone=0)  # half the sampling rate
    with pytest.raises(BadInput, match="edge of"):
        Band(tones_hz=(64.0,), window_s=Fraction(1), samples=64, zone=2)  # seen as 0 Hz
    with pytest.raises(BadInput, match="edge of"):
        Band(
            tones_hz=(10.0, 54.0), window_s=Fraction(1), samples=64, zone=0
        )  # seen on top of each other


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"tones_hz": (1.0, 1.0)}, "different positive"),
        ({"tones_hz": (0.0, 1.0)}, "different positive"),
        ({"tones_hz": (math.inf,)}, "different positive"),
        ({"tones_hz": PAIR, "window_s": 0.03}, "1.2 common periods"),
        ({"tones_hz": PAIR, "samples": 3}, "no sampling"),
        ({"tones_hz": PAIR, "samples": 0}, "samples is 0"),
        ({"tones_hz": PAIR, "samples": 1}, r"0\.025 s with 1 sample "),
        ({"tones_hz": (1.0, 1e7)}, "1 Hz and 10000000 Hz: "),
        ({"tones_hz": (1.0, 1e7)}, "factor of 10000000: "),
    ],
)
def test_impossible_windows_are_refused(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        plan_band(**{"longest_s": 100.0, **arguments})  # type: ignore[arg-type]


def test_a_window_is_whole_periods_to_nine_digits() -> None:
    """A third of a second in decimals, off by 7 and by 13 parts in ten thousand millions."""
    band = plan_band((3.0,), longest_s=1.0, window_s=0.3333333331)
    assert band is not None
    assert band.window_s == Fraction(1, 3)
    with pytest.raises(BadInput, match="whole number"):
        plan_band((3.0,), longest_s=1.0, window_s=0.3333333329)


@given(st.integers(200, 400), st.integers(1, 20), st.integers(200, 400))
@settings(max_examples=60, deadline=None)
def test_a_nonlinear_response_has_lines_at_combinations_only(first: int, gap: int, n: int) -> None:
    try:
        band = plan_band((first, first + gap), longest_s=10.0, window_s=1.0, samples=n)
    except BadInput:
        return
    assert band is not None
    turns = np.outer((first, first + gap), np.arange(n)) % n / n  # whole numbers: exact
    x = np.cos(2 * np.pi * turns).sum(axis=0)
    lines = amplitude_spectrum(x + x**2 / 3 + x**3 / 7)
    seen = set(np.flatnonzero(lines > 1e-12).tolist())
    combined = set(band.combination_bins())
    assert seen <= combined | set(band.bins())
    assert not combined & set(band.bins())


def test_combinations_are_those_of_order_five_and_those_beside_the_tones_up_to_41() -> None:
    """k1 f1 + k2 f2 by counting: |k1| + |k2| <= 5, or k1 + k2 = 1 and |k1| + |k2| <= 41."""
    band = Band(tones_hz=(1001.0, 1002.0), window_s=Fraction(1), samples=10000, zone=0)
    wanted = set()
    for k1 in range(-41, 42):
        for k2 in range(-41, 42):
            order = abs(k1) + abs(k2)
            if order <= 5 or (k1 + k2 == 1 and order <= 41):
                cycles = (1001 * k1 + 1002 * k2) % 10000
                wanted.add(min(cycles, 10000 - cycles))
    assert band.combination_bins() == tuple(sorted(wanted - {1001, 1002}))


def test_combinations_are_a_part_of_the_band_only() -> None:
    """Between and beside the published pair, 200 Hz apart; else a free oscillation is not seen."""
    band = plan_band(PAIR, longest_s=1.0)
    assert band is not None
    seen = band.frequencies_hz()[list(band.combination_bins())]
    beside = np.array([PAIR[0] + 200 * k for k in range(-8, 10) if k not in (0, 1)])
    assert all(np.abs(seen - f).min() < 1e-6 for f in beside)
    assert len(seen) < 0.6 * band.samples / 2


@pytest.mark.parametrize("gap", [1, 10, 200, 1000])
def test_two_tones_are_seen_in_the_middle_of_their_band(gap: int) -> None:
    """So that what a nonlinear response has beside them is seen on both sides alike."""
    pair = (6940160.0, 6940160.0 + gap)
    band = plan_band(pair, longest_s=10.0)
    assert band is not None
    seen = band.frequencies_hz()
    middle = 0.5 * float(seen[0] + seen[-1])
    width = abs(float(seen[-1] - seen[0]))
    assert abs(0.5 * sum(pair) - middle) < 0.06 * width
    assert 6.0 * gap <= width * 1.01


@pytest.mark.parametrize(
    ("tone_hz", "window_s"), [(300.0, 64 / 300), (0.2, 100.0), (0.03, 400 / 3), (1e-3, 4000.0)]
)
def test_a_single_tone_always_has_a_window_of_whole_periods(
    tone_hz: float, window_s: float
) -> None:
    """Of 64, of as many as 100 s hold, of four."""
    band = plan_band([tone_hz], longest_s=100.0)
    assert band is not None
    assert float(band.window_s) == pytest.approx(window_s, rel=1e-12)
    assert band.bins() == (round(tone_hz * window_s),)


def test_no_common_period_of_reasonable_length() -> None:
    assert plan_band((1.0, 1.0000001), longest_s=100.0) is None


@pytest.mark.parametrize("n", [64, 65])
def test_mean_and_half_the_rate_are_not_doubled(n: int) -> None:
    j = np.arange(n)
    values = 2.5 + 1.5 * np.cos(2 * np.pi * 5 * j / n) + (0.5 * (-1.0) ** j if n % 2 == 0 else 0)
    spectrum = amplitude_spectrum(values)
    assert spectrum[0] == pytest.approx(2.5, rel=1e-14)
    assert spectrum[5] == pytest.approx(1.5, rel=1e-13)
    if n % 2 == 0:
        assert spectrum[-1] == pytest.approx(0.5, rel=1e-13)


def test_fit_of_incommensurable_tones() -> None:
    tones = (math.pi, math.e)
    times = np.linspace(0, 17.3, 200)
    values = np.stack(
        [
            1.0 + 2.0 * np.cos(2 * np.pi * tones[0] * times) + np.sin(2 * np.pi * tones[1] * times),
            3.0 * np.sin(2 * np.pi * tones[1] * times + 0.2),
        ],
        axis=1,
    )
    values[7, 1] += 1e-3
    found = fit_tones(tones, times, values)
    peaks, rest = found.amplitudes, found.rest
    np.testing.assert_allclose(peaks, [[2.0, 0.0], [1.0, 3.0]], atol=1e-4)
    np.testing.assert_allclose(peaks[:, 0], [2.0, 1.0], rtol=1e-12)
    assert np.argmax(np.abs(rest[:, 1])) == 7
    with pytest.raises(BadInput, match=r"1 Hz and 1\.0001 Hz"):
        fit_tones((1.0, 1.0001), np.linspace(0, 1, 50), np.zeros((50, 1)))


FIRST = range(1_000_000, 8_000_000, 237_137)


@pytest.mark.parametrize(
    "first",
    [
        *FIRST[::5],
        *(pytest.param(f, marks=pytest.mark.nightly) for f in FIRST if f not in FIRST[::5]),
    ],
)
def test_harmonics_and_mixtures_stay_off_the_tones(first: int) -> None:
    """(cos a + cos b)^3 has lines of 9/4 at either tone; 3 f1 or 2 f1 + f2 would add 1/4 or 3/4."""
    for gap in (1, 2, 10, 20, 200, 1000):
        band = plan_band((float(first), float(first + gap)), longest_s=100.0)
        assert band is not None
        j = np.arange(band.samples)
        whole = [int(Fraction(tone) * band.window_s) for tone in (first, first + gap)]
        a, b = (np.cos(2.0 * np.pi * (k * j % band.samples) / band.samples) for k in whole)
        peaks = amplitude_spectrum(((a + b) ** 3)[:, np.newaxis])[list(band.bins()), 0]
        assert peaks == pytest.approx([2.25, 2.25], abs=1e-9)
