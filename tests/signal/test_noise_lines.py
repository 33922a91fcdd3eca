"""Lines of a power spectral density against the closed forms that it was made of."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.noise_lines import COUPLED, OWN, TOGETHER, noise_lines
from fitting.text.arrays import ComplexArray, FloatArray

F = 5000.0 + np.linspace(-160.0, 260.0, 301)


def response(f0: float, width: float) -> ComplexArray:
    """Of a damped mode, one in size at its frequency."""
    return np.asarray(f0 * width / (f0**2 - F**2 + 1j * F * width))


def averaged(density: FloatArray, averages: int, seed: int) -> FloatArray:
    """An average of periodograms of a density: so many exponential ones."""
    return density * np.random.default_rng(seed).gamma(averages, 1.0 / averages, F.size)


@pytest.mark.parametrize("seeds", [2, pytest.param(8, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("averages", [1, 100])
def test_two_modes_with_forces_of_their_own_are_found_within_their_errors(
    averages: int, seeds: int
) -> None:
    """In units of 1e-12; the lines stand two widths apart. 1 average scatters by all of itself."""
    density = np.abs(response(5000.0, 20.0)) ** 2 + 0.5 * np.abs(response(5060.0, 30.0)) ** 2
    pulls = []
    for seed in range(seeds):
        found = noise_lines(F, 1e-12 * averaged(density + 0.02, averages, seed))
        assert found is not None
        assert len(found.frequency_hz) == 2
        assert found.kind == OWN
        assert found.averages == pytest.approx(averages, rel=0.5)
        truths = zip((5000.0, 5060.0), (20.0, 30.0), strict=True)
        for k, (f0, width) in enumerate(truths):
            pulls.append((found.frequency_hz[k] - f0) / found.frequency_std_hz[k])
            pulls.append((found.width_hz[k] - width) / found.width_std_hz[k])
    # 32 pulls of a standard normal: mean square 1 +- 0.25; of 8 it is within these, too
    assert 0.4 < float(np.mean(np.square(pulls))) < 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_force_on_both_modes_is_told_by_what_stands_between_them(sign: float) -> None:
    seen = response(5000.0, 20.0) + sign * np.sqrt(0.5) * response(5060.0, 30.0)
    found = noise_lines(F, averaged(np.abs(seen) ** 2 + 0.002, 100, 3))
    assert found is not None
    assert found.kind == TOGETHER
    assert found.height[1] / found.height[0] == pytest.approx(0.5 * sign, rel=0.1)


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.nightly) for k in (2, 3))])
def test_coupled_modes_in_heat_of_which_one_is_seen_are_told_from_lines_that_add_up(
    seed: int,
) -> None:
    """The truth by inverting the matrix of both coordinates, its lines by the poles of the motion.

    Lines that only add up fit 4 and 9 errors off these.
    """
    f = 62540.0 + np.linspace(-600.0, 600.0, 481)
    f1, w1, f2, w2, coupling = 62500.0, 30.0, 62580.0, 45.0, 2739.7
    density = []
    for u in f:
        corner = [f1**2 - u**2 + 1j * u * w1, f2**2 - u**2 + 1j * u * w2]
        matrix = np.diag(corner) + coupling**2 * np.array([[0.0, 1.0], [1.0, 0.0]])
        density.append(-np.linalg.inv(matrix)[0, 0].imag / u)
    y = np.array(density) / np.max(density) + 0.01
    found = noise_lines(f, y * np.random.default_rng(seed).gamma(200.0, 1.0 / 200.0, f.size))
    assert found is not None
    assert found.kind == COUPLED
    assert found.modes == pytest.approx((f1, w1, f2, w2, coupling), rel=0.1)
    motion = np.zeros((4, 4))
    motion[:2, 2:] = np.eye(2)
    motion[2:, :2] = -np.array([[f1**2, coupling**2], [coupling**2, f2**2]])
    motion[2:, 2:] = -np.diag([w1, w2])
    poles = sorted((p for p in np.linalg.eigvals(motion) if p.imag > 0.0), key=abs)
    for k, pole in enumerate(poles):
        assert abs(found.frequency_hz[k] - abs(pole)) < 3.5 * found.frequency_std_hz[k]
        assert abs(found.width_hz[k] + 2.0 * pole.real) < 3.5 * found.width_std_hz[k]


@pytest.mark.parametrize("seeds", [2, pytest.param(10, marks=pytest.mark.nightly)])
def test_one_line_is_one_and_a_level_none(seeds: int) -> None:
    density = np.abs(response(5000.0, 20.0)) ** 2 + 0.02
    for seed in range(seeds):
        found = noise_lines(F, averaged(density, 30, seed))
        assert found is not None
        assert len(found.frequency_hz) == 1
        assert noise_lines(F, averaged(np.ones(F.size), 30, seed)) is None
