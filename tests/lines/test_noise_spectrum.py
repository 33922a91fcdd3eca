"""Lines of a power spectral density against the closed forms that it was made of."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines.noise_spectrum import COUPLED, OWN, TOGETHER, NoiseSpectrum, noise_lines
from fitting.lines.sweep_model import Place
from fitting.text.arrays import ComplexArray, FloatArray

F = 5000.0 + np.linspace(-160.0, 260.0, 301)


def response(f0: float, width: float) -> ComplexArray:
    """Of a damped mode, one in size at its frequency."""
    return np.asarray(f0 * width / (f0**2 - F**2 + 1j * F * width))


def averaged(density: FloatArray, averages: int, seed: int) -> FloatArray:
    """An average of periodograms of a density: so many exponential ones."""
    return density * np.random.default_rng(seed).gamma(averages, 1.0 / averages, F.size)


@pytest.mark.parametrize("kind", [OWN, TOGETHER, COUPLED])
def test_slopes_are_those_of_differences(kind: str) -> None:
    model = NoiseSpectrum(
        frequency_hz=F, starts=[Place(5000.0, 20.0), Place(5060.0, 30.0)], kind=kind
    )
    x, step = np.array([0.1, 0.2, -0.3, 0.1, -0.6][: model.count]), 1e-5
    for k, slope in enumerate(model.columns(x).slopes):
        up, down = x.copy(), x.copy()
        up[k] += step
        down[k] -= step
        moved = model.columns(up).values - model.columns(down).values
        assert slope == pytest.approx(moved / (2.0 * step), abs=1e-5)
        for line, above, below in zip(
            model.lines(x), model.lines(up), model.lines(down), strict=True
        ):
            change = (np.array(above[0]) - np.array(below[0])) / (2.0 * step)
            assert line[1][:, k] == pytest.approx(change, abs=1e-3)


def test_the_flank_of_a_line_beyond_the_points_does_not_move_the_one_among_them() -> None:
    """Alone the line would be half as wide, with an error of several times its width."""
    density = np.abs(response(5000.0, 20.0)) ** 2 + 2.0 * np.abs(response(5290.0, 40.0)) ** 2
    for seed in range(3):
        found = noise_lines(F, averaged(density + 0.002, 400, seed))
        assert found is not None
        line = found.lines[found.first]
        assert line.frequency.value == pytest.approx(5000.0, abs=4.0 * line.frequency.std)
        assert line.width.value == pytest.approx(20.0, abs=4.0 * line.width.std)
        assert line.width.std < 0.5


def test_a_line_whose_top_is_not_among_the_points_is_refused() -> None:
    density = np.abs(response(5300.0, 40.0)) ** 2 + 1e-4
    with pytest.raises(ValueError, match="does not show"):
        noise_lines(F, averaged(density, 100, 1))


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
        assert len(found.lines) == 2
        assert found.kind == OWN
        assert found.averages == pytest.approx(averages, rel=0.5)
        for line, f0, width in zip(found.lines, (5000.0, 5060.0), (20.0, 30.0), strict=True):
            pulls.append((line.frequency.value - f0) / line.frequency.std)
            pulls.append((line.width.value - width) / line.width.std)
    # 32 pulls of a standard normal: mean square 1 +- 0.25; of 8 it is within these, too
    assert 0.4 < float(np.mean(np.square(pulls))) < 2.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_force_on_both_modes_is_told_by_what_stands_between_them(sign: float) -> None:
    seen = response(5000.0, 20.0) + sign * np.sqrt(0.5) * response(5060.0, 30.0)
    found = noise_lines(F, averaged(np.abs(seen) ** 2 + 0.002, 100, 3))
    assert found is not None
    assert found.kind == TOGETHER
    assert found.height[1] / found.height[0] == pytest.approx(0.5 * sign, rel=0.1)


def test_modes_that_interfere_widely_are_not_taken_for_coupled_ones() -> None:
    """Seven widths apart over a low floor: as lines that add up both are a third too narrow."""
    f = np.arange(9500.0, 10500.0, 4.0)
    one, two = (
        f0 * w / (f0**2 - f**2 + 1j * f * w) for f0, w in ((10_000.0, 20.94), (10_158.2, 22.32))
    )
    density = np.abs(one - 0.7 * two) ** 2 + 2.5e-4
    for seed in range(3):
        scatter = np.random.default_rng(seed).gamma(20.0, 1.0 / 20.0, f.size)
        found = noise_lines(f, density * scatter)
        assert found is not None
        assert found.kind == TOGETHER
        line = found.lines[0]
        assert line.width.value == pytest.approx(20.94, abs=4.0 * line.width.std)


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
    for line, pole in zip(found.lines, poles, strict=True):
        assert abs(line.frequency.value - abs(pole)) < 3.5 * line.frequency.std
        assert abs(line.width.value + 2.0 * pole.real) < 3.5 * line.width.std


@pytest.mark.parametrize("seeds", [2, pytest.param(10, marks=pytest.mark.nightly)])
def test_one_line_is_one_and_a_level_none(seeds: int) -> None:
    density = np.abs(response(5000.0, 20.0)) ** 2 + 0.02
    for seed in range(seeds):
        found = noise_lines(F, averaged(density, 30, seed))
        assert found is not None
        assert len(found.lines) == 1
        assert noise_lines(F, averaged(np.ones(F.size), 30, seed)) is None
