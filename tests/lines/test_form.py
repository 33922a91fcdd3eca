"""What is next to a line: against averages and single readings that were drawn, and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import rice

from fitting.lines.form import AMPLITUDE_FORMS, LineFit, fit_form, fit_resonance
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from tests.support.lines import mode, noise

ETA, WIDTH = 5000.0, 20.0
F = ETA + np.linspace(-100.0, 100.0, 101)


def single(amplitude: FloatArray) -> LineFit:
    return fit_form(F, amplitude, AMPLITUDE_FORMS["single"])


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
    found = single(readings)
    top = float(np.max(readings))

    def minus_two_ln(eta: float, width: float, height: float, s: float) -> float:
        nu = height * np.abs(mode(F, eta, width))
        return -2.0 * float(np.sum(rice.logpdf(readings / top, nu / s, scale=s / top)))

    there = np.array(
        [found.frequency.value, found.width.value, found.amplitude.value, found.background.real]
    )
    there[3] *= np.sqrt((F.size - 3) / F.size)  # the likeliest is smaller than the unbiased one
    least = minus_two_ln(*there)
    n = F.size
    assert n * np.log(2.0 * np.pi * found.likely_squares / n) + n == pytest.approx(least, abs=1e-6)
    errors = (
        found.frequency.std,
        found.width.std,
        found.amplitude.std,
        0.05 * found.background.real,
    )
    for step in np.diag(np.array(errors)):
        for way in (0.05, -0.05):
            assert minus_two_ln(*(there + way * step)) > least


@pytest.mark.parametrize("sigma", [0.01, 0.1])
def test_errors_and_noise_of_single_readings_are_right(sigma: float) -> None:
    """60 sweeps: pulls have a mean square of 1 +- 0.18, and the noise is known to 1/sqrt(2 N)."""
    pulls, sizes = [], []
    for seed in range(200, 260):
        readings = np.abs(mode(F, ETA, WIDTH) + noise(F.size, sigma, seed))
        found = single(readings)
        pulls.append(
            [
                (found.frequency.value - ETA) / found.frequency.std,
                (found.width.value - WIDTH) / found.width.std,
                (found.amplitude.value - 1.0) / found.amplitude.std,
            ]
        )
        sizes.append(found.background.real)
    squares = np.mean(np.square(pulls), axis=0)
    assert np.all((squares > 0.5) & (squares < 1.55))
    assert np.mean(sizes) == pytest.approx(sigma, rel=0.03)


def test_readings_without_noise_are_no_single_ones() -> None:
    with pytest.raises(BadInput, match="no noise"):
        single(np.abs(mode(F, ETA, WIDTH)))
