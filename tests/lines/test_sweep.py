"""Which model of a sweep is taken, against truth from closed forms: lines, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines.sweep import SweepSearch
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from tests.support.lines import mode, noise

ETA, WIDTH = 50_300.0, 40.0
F = np.linspace(ETA - 300.0, ETA + 300.0, 121)


def bent(shift_hz: float) -> FloatArray:
    """A sweep up of a Duffing line, by the roots of the cubic of its power."""
    made = []
    for f in F - ETA:
        half = (0.5 * WIDTH) ** 2
        roots = np.roots([shift_hz**2, -2.0 * shift_hz * f, f * f + half, -half])
        real = np.sort(roots[np.abs(roots.imag) < 1e-6 * np.abs(roots.real)].real)
        real = real[real > 0.0]
        made.append(np.sqrt(real[-1] if f < shift_hz else real[0]))
    return np.array(made)


@pytest.mark.parametrize("shift_hz", [10.0, 30.0, 150.0], ids=["leans", "critical", "jumps"])
def test_a_bent_line_is_that_of_small_amplitudes_with_its_shift(shift_hz: float) -> None:
    """Noise of half a per cent of every reading; a Lorentzian was off by 2 to 6 errors."""
    rng = np.random.default_rng(int(shift_hz))
    found = SweepSearch(F, bent(shift_hz) * (1.0 + 0.005 * rng.standard_normal(F.size))).fit()
    assert found.bend is not None
    for number, truth in (
        (found.frequency, ETA),
        (found.width, WIDTH),
        (found.bend, shift_hz),
    ):
        assert abs(number.value - truth) < 4.0 * number.std
    assert max(found.frequency.std, found.width.std) < 0.025 * WIDTH


def test_a_short_cable_is_no_background() -> None:
    """A turn of a tenth over the sweep: with a background A was 9 to 26 errors off."""
    for seed in range(3):
        cable = np.exp(-2j * np.pi * (F - ETA) * 1.7e-4)
        values = 0.21 * mode(F, ETA, WIDTH) * cable + noise(F.size, 1e-3, seed)
        found = SweepSearch(F, values).fit()
        assert found.delay is not None
        assert abs(found.delay.value - 1.7e-4) < 4.0 * found.delay.std
        assert abs(found.amplitude.value - 0.21) < 4.0 * found.amplitude.std


def test_noise_that_grows_with_the_amplitude_is_weighted() -> None:
    """Against the information of readings whose noise is known, sum (d ln a/d eta)^2/sigma^2."""
    size, step = np.abs(mode(F, ETA, WIDTH)), 1e-3
    ends = [np.log(np.abs(mode(F, ETA + h, WIDTH))) for h in (-step, step)]
    slope = (ends[1] - ends[0]) / (2.0 * step)
    bound = 0.01 / np.sqrt(np.sum(slope**2))
    rng = np.random.default_rng(5)
    found = SweepSearch(F, size * (1.0 + 0.01 * rng.standard_normal(F.size))).fit()
    assert found.structure.sizes_p > 0.01
    assert 0.7 * bound < found.frequency.std < 1.6 * bound
    assert abs(found.frequency.value - ETA) < 4.0 * found.frequency.std


WIDE = np.geomspace(1e2, 1e6, 161)


@pytest.mark.parametrize(
    ("f", "values", "reason"),
    [
        (WIDE, 0.5 * np.exp(-2j * np.pi * WIDE * 2e-6), "delay"),
        (WIDE, 1.0 / (1.0 + 1j * WIDE / 2e4), "pole"),
        (WIDE, np.abs(1.0 / (1.0 + 1j * WIDE / 2e4)), "pole|cuts off"),
        (F, np.ones(F.size), "straight|height|no form"),
        (F, np.ones(F.size, dtype=complex), "straight|delay|height"),
        (F, np.abs(mode(F, ETA + 400.0, WIDTH)), "cuts off"),
    ],
    ids=["delay", "low-pass", "low-pass sizes", "noise", "complex noise", "flank"],
)
def test_what_is_no_line_is_refused_with_its_reason(
    f: FloatArray, values: FloatArray | ComplexArray, reason: str
) -> None:
    for seed in range(2):
        drawn = noise(f.size, 2e-3, seed)
        seen = values + (drawn if np.iscomplexobj(values) else drawn.real)
        with pytest.raises(BadInput, match=reason):
            SweepSearch(f, seen).fit()


def test_a_wiggle_that_no_model_describes_is_refused() -> None:
    wiggle = np.abs(mode(F, ETA, WIDTH)) + 0.2 * np.sin(F / 15.0) + 0.5
    with pytest.raises(BadInput, match=r"independent|two|straight|pole"):
        SweepSearch(F, wiggle + noise(F.size, 1e-3, 1).real).fit()
