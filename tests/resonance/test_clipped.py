"""A top that the instrument cut off: numbers of the other points, against the line that was cut."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines.line import Line, line_of
from fitting.lines.trace import trace_of
from fitting.report.resonance import sentences, text
from fitting.text.arrays import FloatArray
from fitting.text.finding import Kind, of_kind
from tests.support.lines import mode, noise
from tests.support.samples import sampled

ETA, WIDTH, HEIGHT = 50_003.7, 21.0, 1e-3
F = 50_000.0 + np.linspace(-100.0, 100.0, 101)
SIGMA = 0.005


def sweep(seed: int, limit: float, beside: float = 0.0, sigma: float = SIGMA) -> FloatArray:
    """Amplitudes with noise of one size, cut off at a limit; all over the height of the line."""
    seen = np.abs(mode(F, ETA, WIDTH)) + beside
    rough = sigma * np.random.default_rng(seed).standard_normal(F.size)
    return np.asarray(HEIGHT * np.minimum(seen + rough, limit))


def pulls(line: Line) -> list[float]:
    """How far frequency, width and amplitude are off, over half of their 95 % intervals."""
    found = (
        (line.frequency.value, line.frequency.std, ETA),
        (line.width.value, line.width.std, WIDTH),
        (line.amplitude.value, line.amplitude.std, HEIGHT),
    )
    return [(value - truth) / (std * line.ratio95) for value, std, truth in found]


@sampled(6, 24)
@pytest.mark.parametrize(
    ("limit", "beside"), [pytest.param(0.9, 0.0, marks=pytest.mark.nightly), (1.0, 0.2)]
)
def test_a_clipped_line_is_the_one_that_was_cut(limit: float, beside: float, count: int) -> None:
    """Blindly the width was 2.6 of its standard errors off, with a constant background 7.6."""
    seeds = np.arange(1, count + 1) % 24  # among the first six two miss by little
    lines = [line_of(trace_of(F, sweep(int(k), limit, beside), "V")) for k in seeds]
    off = np.array([pulls(line) for line in lines])
    # 95 of 100 hold the truth: that 4 or more of 24 do not happens to one set in thirty
    assert np.all(np.sum(np.abs(off) > 1.0, axis=0) <= count / 6)
    assert np.all(np.abs(np.mean(off, axis=0)) < 0.5)
    assert all(line.clipped is not None and line.amplitude.std < 0.03 * HEIGHT for line in lines)


def test_the_sentence_says_how_many_points_were_left_out_and_why() -> None:
    line = line_of(trace_of(F, sweep(1, 0.9), "V"))
    count = int(np.sum(sweep(1, 0.9) == 0.9 * HEIGHT))
    [said] = [each for each in sentences(line) if "clipped" in each]
    assert f" {count} largest points" in said
    assert "900 µV" in said
    assert not line.faults
    assert text(line).count("clipped") == 1


@sampled(4, 16)
def test_a_top_is_cut_however_little_the_others_tell_of_it(count: int) -> None:
    """Noise of 3 % leaves the height open by more than is missing: 21 of 150 were not told."""
    rough = [line_of(trace_of(F, sweep(k, 0.7, sigma=0.03), "V")) for k in range(count)]
    assert all(line.clipped is not None for line in rough)
    off = np.array([pulls(line) for line in rough])
    assert np.all(np.sum(np.abs(off) > 1.0, axis=0) <= count / 5)


def test_points_that_noise_decides_on_are_left_out_too() -> None:
    """Points whose line is within three standard deviations of the limit, high or low."""
    sigma, limit = 0.02, 0.75
    line = line_of(trace_of(F, sweep(3, limit, sigma=sigma), "V"))
    exact = np.abs(mode(F, ETA, WIDTH))
    # by the fitted line, not quite by this one
    sure, far = exact > limit - 2.0 * sigma, exact < limit - 4.0 * sigma
    kept = np.isin(F, line.points.frequency_hz)
    assert not np.any(kept & sure)
    assert np.all(kept[far])
    assert line.clipped is not None
    assert line.clipped.count + line.clipped.beside == F.size - int(np.sum(kept))
    [excluded] = of_kind(line.reading, Kind.top_excluded)
    assert excluded.numbers["near"] == line.clipped.beside


def test_three_equal_points_at_the_top_of_a_coarse_scale_stay() -> None:
    """A display of 5 % of the height shows a top of equal points, which are not cut off."""
    rounded = 0.05 * HEIGHT * np.round(sweep(2, 9.0) / (0.05 * HEIGHT))
    assert int(np.sum(rounded == np.max(rounded))) >= 3
    assert line_of(trace_of(F, rounded, "V")).clipped is None


@sampled(6, 12)
@pytest.mark.parametrize("share", [0.5, pytest.param(0.8, marks=pytest.mark.nightly)])
def test_parts_that_overflow_are_left_out_of_a_complex_line(share: float, count: int) -> None:
    """X and Y, each cut off at a limit: a width of 94 Hz came out as 128 with an error of 11."""
    exact = HEIGHT * np.exp(0.7j) * mode(F, ETA, WIDTH)
    limit = share * HEIGHT
    lines = []
    for seed in range(count):
        z = exact + noise(F.size, 0.005 * HEIGHT, seed)
        cut = np.clip(z.real, -limit, limit) + 1j * np.clip(z.imag, -limit, limit)
        lines.append(line_of(trace_of(F, cut, "V")))
    off = np.array([pulls(line) for line in lines])
    assert np.all(np.sum(np.abs(off) > 1.0, axis=0) <= count / 4)
    [said] = [each for each in sentences(lines[0]) if "clipped" in each]
    assert f"{1e6 * limit:.0f} µV" in said


@sampled(4, 12)
def test_a_complex_line_that_nothing_cuts_is_whole(count: int) -> None:
    exact = HEIGHT * np.exp(0.7j) * mode(F, ETA, WIDTH)
    whole = [line_of(trace_of(F, exact + noise(F.size, 5e-6, k), "V")) for k in range(count)]
    assert all(line.clipped is None for line in whole)


def test_an_amplitude_that_overflows_beside_its_phase_is_left_out() -> None:
    z = HEIGHT * np.exp(0.7j) * mode(F, ETA, WIDTH) + noise(F.size, 0.005 * HEIGHT, 1)
    cut = np.minimum(np.abs(z), 0.7 * HEIGHT) * np.exp(1j * np.angle(z))
    line = line_of(trace_of(F, cut, "V"))
    assert line.clipped is not None
    assert line.clipped.limit == pytest.approx(0.7 * HEIGHT)
    assert abs(line.width.value - WIDTH) < 3.0 * line.width.std < 1.0
