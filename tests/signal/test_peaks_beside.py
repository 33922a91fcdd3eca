"""What stands beside a line's amplitude: against mpmath, and against averages that were drawn."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from fitting.signal.peaks import fit_resonance, rice_mean
from tests.support.lines import mode

ETA, WIDTH = 5000.0, 20.0
F = ETA + np.linspace(-100.0, 100.0, 101)
RATIOS = (0.0, 1e-6, 0.4, 1.4, 7.0, 430.0, 9.99e3, 1.001e4, 1e7, 1e200)


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_mean_amplitude_of_a_line_in_noise_is_rices(ratio: float) -> None:
    noise = 0.7
    found = float(rice_mean(np.array([ratio * noise]), noise)[0])
    with mp.workdps(50):
        x = mp.mpf(ratio) ** 2
        bessel = (1 + x) * mp.besseli(0, x / 2) + x * mp.besseli(1, x / 2) if ratio < 1e8 else None
        truth = mp.sqrt(mp.pi) / 2 * noise * mp.exp(-x / 2) * bessel if bessel else ratio * noise
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
        pulls.append((found.width_hz - WIDTH) / found.width_std_hz)
        truth = 0.3 if background == "offset" else 0.15 * np.sqrt(2.0)
        assert found.background.real == pytest.approx(truth, rel=0.1)
    assert 0.2 < float(np.mean(np.square(pulls))) < 2.6
