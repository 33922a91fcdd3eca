"""Resonances side by side in complex values: poles that were put there, and noise that is left."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.lines_together import lines_together
from fitting.text.arrays import ComplexArray, FloatArray

F = 5000.0 + np.linspace(-60.0, 60.0, 121)
#: Frequency and width, Hz, and complex height.
LINES = ((4985.0, 12.0, 1.0), (5004.0, 9.0, 0.6 * np.exp(1.1j)), (5030.0, 7.0, -0.4j))


def seen(f: FloatArray, count: int) -> ComplexArray:
    """Poles alone: h (w/2)/(w/2 + i (f - eta))."""
    parts = [h * 0.5 * w / (0.5 * w + 1j * (f - eta)) for eta, w, h in LINES[:count]]
    return np.asarray(np.sum(parts, axis=0), dtype=complex)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("beside", [0, 1, 2])
def test_poles_are_those_that_were_put_there(count: int, beside: int) -> None:
    x = (F - 5000.0) / 60.0
    ground = (0.3 - 0.1j) * (beside > 0) + 0.2j * x * (beside > 1)
    form = lines_together(F, np.asarray(seen(F, count) + ground), count, count + beside)
    assert form.unknowns == 2 * (2 * count + beside)
    assert len(form.modes) == count
    for mode, (eta, width, height) in zip(form.modes, LINES, strict=False):
        assert mode.frequency_hz == pytest.approx(eta, abs=1e-6)
        assert abs(mode.width_hz) == pytest.approx(width, abs=1e-6)
        assert abs(mode.height) == pytest.approx(abs(height), rel=1e-6)
        assert mode.is_seen(F)
    assert len({np.sign(mode.width_hz) for mode in form.modes}) == 1


@pytest.mark.parametrize("sigma", [1e-4, 1e-2, 0.05])
def test_what_is_left_is_the_noise(sigma: float) -> None:
    """Chi square on its degrees of freedom, of 10 draws: least squares, not its linearised form."""
    chi, freedom = 0.0, 0
    for seed in range(10):
        noise = sigma * (np.random.default_rng(seed).standard_normal((2, F.size)).T @ [1.0, 1.0j])
        y = seen(F, 2) + 0.1 + noise
        form = lines_together(F, y, 2, 3)
        chi += form.squares(y) / sigma**2
        freedom += 2 * F.size - form.unknowns
    assert abs(chi - freedom) < 4.0 * np.sqrt(2.0 * freedom)


def test_columns_are_derivatives() -> None:
    form = lines_together(F, seen(F, 2), 2, 3)
    step = 1e-6
    for k in range(5):
        moved = np.concatenate([form.above, form.below])
        moved[k] += step
        there = type(form)(
            x=form.x,
            middle_hz=form.middle_hz,
            half_hz=form.half_hz,
            above=moved[:3],
            below=moved[3:],
        )
        slope = (there.curve - form.curve) / step
        np.testing.assert_allclose(form.columns[:, k], slope, atol=1e-4)


def test_a_pole_beyond_the_points_or_between_two_of_them_is_not_seen() -> None:
    far = 0.5 / (0.5 + 1j * (F - 5100.0) / 12.0)
    narrow = 0.1 / (0.1 + 1j * (F - 5000.5))  # points 1 Hz apart
    for values in (far, narrow):
        [mode] = lines_together(F, np.asarray(values, dtype=complex), 1, 1).modes
        assert not mode.is_seen(F)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(ValueError, match=r"4 points.* 5 .* 2 lines"):
        lines_together(F[:4], seen(F[:4], 2), 2, 3)
