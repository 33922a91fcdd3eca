"""Lines of a power spectral density against the closed forms that it was made of."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.noise_lines import noise_lines
from fitting.text.arrays import ComplexArray, FloatArray

F = 5000.0 + np.linspace(-160.0, 260.0, 301)


def response(f0: float, width: float) -> ComplexArray:
    """Of a damped mode, one in size at its frequency."""
    return np.asarray(f0 * width / (f0**2 - F**2 + 1j * F * width))


def averaged(density: FloatArray, averages: int, seed: int) -> FloatArray:
    """An average of periodograms of a density: so many exponential ones."""
    return density * np.random.default_rng(seed).gamma(averages, 1.0 / averages, F.size)


@pytest.mark.parametrize("averages", [1, 100])
def test_two_modes_with_forces_of_their_own_are_found_within_their_errors(averages: int) -> None:
    """In units of 1e-12; the lines stand two widths apart. 1 average scatters by all of itself."""
    density = np.abs(response(5000.0, 20.0)) ** 2 + 0.5 * np.abs(response(5060.0, 30.0)) ** 2
    pulls = []
    for seed in range(8):
        found = noise_lines(F, 1e-12 * averaged(density + 0.02, averages, seed))
        assert found is not None
        assert len(found.frequency_hz) == 2
        assert not found.together
        assert found.averages == pytest.approx(averages, rel=0.5)
        truths = zip((5000.0, 5060.0), (20.0, 30.0), strict=True)
        for k, (f0, width) in enumerate(truths):
            pulls.append((found.frequency_hz[k] - f0) / found.frequency_std_hz[k])
            pulls.append((found.width_hz[k] - width) / found.width_std_hz[k])
    # 32 pulls of a standard normal: mean square 1 +- 0.25
    assert 0.4 < float(np.mean(np.square(pulls))) < 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_force_on_both_modes_is_told_by_what_stands_between_them(sign: float) -> None:
    seen = response(5000.0, 20.0) + sign * np.sqrt(0.5) * response(5060.0, 30.0)
    found = noise_lines(F, averaged(np.abs(seen) ** 2 + 0.002, 100, 3))
    assert found is not None
    assert found.together
    assert found.height[1] / found.height[0] == pytest.approx(0.5 * sign, rel=0.1)


def test_one_line_is_one_and_a_level_none() -> None:
    density = np.abs(response(5000.0, 20.0)) ** 2 + 0.02
    for seed in range(10):
        found = noise_lines(F, averaged(density, 30, seed))
        assert found is not None
        assert len(found.frequency_hz) == 1
        assert noise_lines(F, averaged(np.ones(F.size), 30, seed)) is None
