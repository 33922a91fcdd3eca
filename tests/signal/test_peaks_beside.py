"""What stands beside a line's amplitude: against mpmath, and against averages that were drawn."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.stats import rice

from fitting.signal.peaks import fit_resonance, rice_mean
from fitting.signal.single_readings import fit_single_readings
from fitting.text.errors import BadInput
from tests.support.lines import mode, noise

ETA, WIDTH = 5000.0, 20.0
F = ETA + np.linspace(-100.0, 100.0, 101)
RATIOS = (0.0, 1e-6, 0.4, 1.4, 7.0, 430.0, 9.99e3, 1.001e4, 1e7, 1e200)


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_mean_amplitude_of_a_line_in_noise_is_rices(ratio: float) -> None:
    rms = 0.7
    found = float(rice_mean(np.array([ratio * rms]), rms)[0])
    with mp.workdps(50):
        x = mp.mpf(ratio) ** 2
        bessel = (1 + x) * mp.besseli(0, x / 2) + x * mp.besseli(1, x / 2) if ratio < 1e8 else None
        truth = mp.sqrt(mp.pi) / 2 * rms * mp.exp(-x / 2) * bessel if bessel else ratio * rms
        assert found == pytest.approx(float(truth), rel=1e-14)


def test_no_noise_leaves_an_amplitude_as_it_is() -> None:
    assert rice_mean(np.array([0.0, 2.0]), 0.0).tolist() == [0.0, 2.0]


@pytest.mark.parametrize("background", ["offset", "floor", "rice"])
def test_widths_are_right_within_their_errors(background: str) -> None:
    """Twelve lines each, drawn as an instrument makes them: the mean square pull is 1 +- 0.41."""
    line, pulls = mode(F, ETA, WIDTH), []
    for seed in range(12):
        rng = np.random.default_rng([seed, len(background)])
        drawn = line[None, :] + 0.15 * (
            rng.standard_normal((400, F.size)) + 1j * rng.standard_normal((400, F.size))
        )
        amplitude = {
            "offset": np.abs(line) + 0.3 + 0.007 * rng.standard_normal(F.size),
            "floor": np.sqrt(np.mean(np.abs(drawn) ** 2, axis=0)),
            "rice": np.mean(np.abs(drawn), axis=0),
        }[background]
        found = fit_resonance(F, amplitude, background=background)
        pulls.append((found.width.value - WIDTH) / found.width.std)
        truth = 0.3 if background == "offset" else 0.15 * np.sqrt(2.0)
        assert found.background.real == pytest.approx(truth, rel=0.1)
    assert 0.2 < float(np.mean(np.square(pulls))) < 2.6


def test_the_likelihood_of_single_readings_is_rices() -> None:
    """Against `scipy.stats.rice`: at the end that is found, no unknown moved by a bit is likelier.

    The squares are those of equally likely normal noise: N ln(2 pi S/N) + N = -2 ln L.
    """
    readings = np.abs(mode(F, ETA, WIDTH) * np.exp(0.4j) + noise(F.size, 0.08, 3))
    found = fit_single_readings(F, readings)
    line, top = found.resonance, float(np.max(readings))

    def minus_two_ln(eta: float, width: float, height: float, s: float) -> float:
        nu = height * np.abs(mode(F, eta, width))
        return -2.0 * float(np.sum(rice.logpdf(readings / top, nu / s, scale=s / top)))

    there = np.array([line.frequency.value, line.width.value, line.amplitude.value, found.noise])
    there[3] *= np.sqrt((F.size - 3) / F.size)  # the likeliest is smaller than the unbiased one
    least = minus_two_ln(*there)
    n = F.size
    assert n * np.log(2.0 * np.pi * found.squares / n) + n == pytest.approx(least, abs=1e-6)
    errors = (line.frequency.std, line.width.std, line.amplitude.std, 0.05 * found.noise)
    for step in np.diag(np.array(errors)):
        for way in (0.05, -0.05):
            assert minus_two_ln(*(there + way * step)) > least


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_errors_and_noise_of_single_readings_are_right(sigma: float) -> None:
    """60 sweeps: pulls have a mean square of 1 +- 0.18, and the noise is known to 1/sqrt(2 N)."""
    pulls, sizes = [], []
    for seed in range(200, 260):
        readings = np.abs(mode(F, ETA, WIDTH) + noise(F.size, sigma, seed))
        found = fit_single_readings(F, readings)
        line = found.resonance
        pulls.append(
            [
                (line.frequency.value - ETA) / line.frequency.std,
                (line.width.value - WIDTH) / line.width.std,
                (line.amplitude.value - 1.0) / line.amplitude.std,
            ]
        )
        sizes.append(found.noise)
    squares = np.mean(np.square(pulls), axis=0)
    assert np.all((squares > 0.5) & (squares < 1.55))
    assert np.mean(sizes) == pytest.approx(sigma, rel=0.03)


def test_readings_without_noise_are_no_single_ones() -> None:
    with pytest.raises(BadInput, match="no noise"):
        fit_single_readings(F, np.abs(mode(F, ETA, WIDTH)))
