"""Windows: whole periods, no tone on another, settling; amplitudes from few samples."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fitting.signal.combinations import expected_hz
from fitting.signal.window import Window, plan_window, tone_misfit
from fitting.simulate.words import window_in_words
from fitting.text.errors import BadInput
from tests.support.closed_form import Q1_PAIRS_MHZ


def sampled(window: Window, tones: list[tuple[float, float, float]], mean: float) -> np.ndarray:
    """Tones (frequency, amplitude, phase) at the window's times, phases in exact arithmetic."""
    values = []
    for j in range(window.samples):
        t = Fraction(window.settle_s) + j * Fraction(window.step_s)
        value = mean
        for f, a, phase in tones:
            turns = float(Fraction(f) * t % 1)
            value += a * math.cos(2 * math.pi * turns + phase)
        values.append(value)
    return np.array(values)


def test_combinations_close_to_tones_without_whole_periods_do_not_leak_into_these() -> None:
    """2 u1 - u2 and the third harmonic, as a cubic term makes them, at any time of the beat."""
    tones = (1000.0 * math.sqrt(2.0), 1000.0 * math.sqrt(2.0) + 0.01 * math.pi)
    near = expected_hz(tones, 5)
    lines = [(tones[0], 1.0, 0.3), (tones[1], 0.5, 1.0)]
    for factors, amplitude in (((2, -1), 0.1), ((-1, 2), 0.2), ((3, 0), 0.1), ((1, 1), 0.05)):
        mixed = factors[0] * tones[0] + factors[1] * tones[1]
        assert min(abs(f - mixed) for f in near) < 1e-9
        lines.append((mixed, amplitude, 0.5 + factors[0]))
    for settle_s in (0.0, 31.0):
        window = plan_window(tones, settle_s, expected_hz=near)
        assert not window.coherent
        found = window.read(sampled(window, lines, 0.2))
        assert found.amplitudes == pytest.approx([1.0, 0.5], rel=1e-9)
        alone = plan_window(tones, settle_s)
        off = alone.read(sampled(alone, lines, 0.2)).amplitudes - [1.0, 0.5]
        assert np.max(np.abs(off)) > 1e-3


@pytest.mark.parametrize("pair_mhz", Q1_PAIRS_MHZ)
def test_the_papers_pairs_come_back_from_a_few_samples(pair_mhz: tuple[float, float]) -> None:
    pair = tuple(round(f * 1e6) for f in pair_mhz)
    window = plan_window(pair, 0.0)
    assert window.coherent
    assert window.samples <= 12
    periods = [Fraction(f) * window.samples * Fraction(window.step_s) for f in pair]
    assert all(abs(p - round(p)) < Fraction(1, 10**8) for p in periods)
    values = sampled(window, [(pair[0], 3.0, 0.4), (pair[1], 0.02, -2.0)], 0.7)
    assert window.read(values).amplitudes == pytest.approx([3.0, 0.02], rel=1e-7)
    assert tone_misfit(window, values) < 1e-8


@pytest.mark.parametrize(
    ("tones", "words"),
    [
        ((0.5,), "0.5 Hz: "),
        ((318.0, 326.0), "318 and 326 Hz: "),
        ((30282.5,), "30.2825 kHz: "),
        ((999e3, 1.001e6), "0.999 and 1.001 MHz: "),
        ((6940160.0, 6940360.0), "6.94016 and 6.94036 MHz: "),
    ],
)
def test_the_reason_names_tones_in_the_unit_that_suits_them(
    tones: tuple[float, ...], words: str
) -> None:
    assert window_in_words(plan_window(tones, 0.0)).startswith(words)


def test_a_window_is_said_to_be_clear_of_the_mixtures_it_was_planned_for() -> None:
    clear = plan_window((6.0, 7.0), 0.0, mixtures_hz=(5.0, 8.0, 13.0))
    assert "3 mixtures" in window_in_words(clear)
    held = plan_window((6.0, 7.0), 0.0, samples_per_period=20)
    assert f"held over steps of {held.input_step_s:.6g} s" in window_in_words(held)
    for tones in ((6.0, 7.0), (math.pi, math.e)):  # with a common period and without
        said = window_in_words(plan_window(tones, 0.0))
        assert "mixtures" not in said
        assert "held" not in said


@given(
    tones=st.lists(st.integers(1, 5_000_000), min_size=1, max_size=3, unique=True),
    grain=st.sampled_from([1, 10, 1000]),
    settle=st.floats(0.0, 0.1),
)
@settings(max_examples=200, deadline=None)
def test_amplitudes_of_any_tones(tones: list[int], grain: int, settle: float) -> None:
    frequencies = [f / grain for f in tones]
    assume(max(frequencies) < 1e5 * min(frequencies))
    window = plan_window(frequencies, settle)
    rows = [(f, 1.0 + i, 0.3 * i) for i, f in enumerate(frequencies)]
    found = window.read(sampled(window, rows, -0.2)).amplitudes
    assert found == pytest.approx([a for _, a, _ in rows], rel=1e-5)


@pytest.mark.parametrize(
    "pair", [(6939923.98561339, 6940082.1069115), (6940519.2576513, 6940855.3217625)]
)
def test_tones_that_even_steps_see_all_alike_are_told_apart(pair: tuple[float, float]) -> None:
    """They make all but whole periods in what divides the steps that are tried first."""
    window = plan_window(pair, 0.1)
    assert not window.coherent
    values = sampled(window, [(pair[0], 3.0, 0.4), (pair[1], 0.02, -2.0)], 0.7)
    assert window.read(values).amplitudes == pytest.approx([3.0, 0.02], rel=1e-6)


def test_a_harmonic_or_a_transient_shows_as_misfit() -> None:
    window = plan_window((1000.0,), 0.0)
    clean = sampled(window, [(1000.0, 1.0, 0.0)], 0.0)
    dirty = clean + 1e-3 * np.exp(-np.arange(window.samples))
    assert tone_misfit(window, clean) < 1e-12
    assert 1e-4 < tone_misfit(window, dirty) < 1e-3


@pytest.mark.parametrize("tones", [(1000.0,), (1000.0, 1010.0), (318.3, 3141.59265358979)])
def test_a_held_drive_has_whole_steps_everywhere(tones: tuple[float, ...]) -> None:
    window = plan_window(tones, 0.1234, samples_per_period=50)
    h = window.input_step_s
    assert 1.0 / (h * max(tones)) >= 50 * (1 - 1e-9)
    for time in (window.settle_s, window.step_s):
        assert time / h == pytest.approx(round(time / h), abs=1e-6)
    assert window.settle_s >= 0.1234 - 1e-12


def test_what_cannot_be_told_apart_is_refused() -> None:
    with pytest.raises(BadInput):
        plan_window((1000.0, 1000.0), 0.0)
    window = plan_window((1000.0,), 0.0)
    with pytest.raises(ValueError, match="planned were 5"):
        window.read(np.zeros(6))
    with pytest.raises(ValueError, match="cannot hold"):
        Window(tones_hz=(1.0, 2.0), settle_s=0.0, step_s=0.1, samples=4)
