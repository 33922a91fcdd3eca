"""Where a free decay begins: two beating modes after a tone, after silence, after noise."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines.decay_begin import decay_start
from fitting.text.arrays import FloatArray

COUNT, MODES = 2500, ((0.11, 1 / 600.0, 1.0, 0.3), (0.1148, 1 / 780.0, 0.7, 1.0))


def record(before: str, begin: int, noise: float, rng: np.random.Generator) -> FloatArray:
    """Free from sample ``begin`` on; a constant beside it."""
    t = np.arange(COUNT) - begin
    free = sum(
        a * np.exp(-rate * np.maximum(t, 0)) * np.cos(2 * np.pi * f * t + phase)
        for f, rate, a, phase in MODES
    )
    earlier = {
        "silence": np.zeros(COUNT),
        "noise": rng.standard_normal(COUNT),
        "tone": 1.2 * np.cos(2 * np.pi * 0.112 * t + 0.5),
    }[before]
    y = np.where(t < 0, earlier, free)
    return np.asarray(3.0 + y + noise * np.max(np.abs(y)) * rng.standard_normal(COUNT))


#: A seed, and more of them.
SEEDS = pytest.mark.parametrize(
    "seeds", [(0,), pytest.param((1, 2, 3), marks=pytest.mark.nightly)], ids=["one", "more"]
)


@SEEDS
@pytest.mark.parametrize("before", ["silence", "noise", "tone"])
@pytest.mark.parametrize("begin", [0, 40, 700])
@pytest.mark.parametrize("noise", [0.0, 1e-3, 1e-2, 5e-2])
def test_the_decay_begins_where_the_drive_ends(
    before: str, begin: int, noise: float, seeds: tuple[int, ...]
) -> None:
    """Late by a few samples at most times, never early by more than noise can hide."""
    for seed in seeds:
        found = decay_start(record(before, begin, noise, np.random.default_rng(seed)), 4)
        assert found is not None
        assert -1 <= found - begin <= 100


@SEEDS
@pytest.mark.parametrize("begin", [40, 700])
@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_a_tone_before_the_decay_tells_the_very_sample(
    begin: int, noise: float, seeds: tuple[int, ...]
) -> None:
    """There the decay is a quarter of the tone away from it, far more than the noise."""
    for seed in seeds:
        assert decay_start(record("tone", begin, noise, np.random.default_rng(seed)), 4) == begin


def test_what_does_not_decay_has_no_beginning() -> None:
    rng, t = np.random.default_rng(1), np.arange(1000)
    assert decay_start(rng.standard_normal(1000), 2) is None
    assert decay_start(np.cos(0.3 * t), 2) is None


@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_where_a_decay_begins_does_not_depend_on_the_unit(unit: float) -> None:
    y = record("noise", 700, 1e-3, np.random.default_rng(5))
    assert decay_start(unit * y, 4) == decay_start(y, 4)


@pytest.mark.parametrize("begin", [0, 40, 700])
def test_a_decay_about_zero_without_noise_is_found_while_it_is_loud(begin: int) -> None:
    """Two modes that add up to nothing, so that their mean takes nothing off: all is explained.

    Where only rounding is left, samples of either part are as good; none is before the beginning,
    nor after the first mode has fallen to 1/e.
    """
    t = np.arange(COUNT, dtype=float) - begin
    one, other = (
        np.where(t < 0, 0.0, np.exp(-rate * np.maximum(t, 0)) * np.cos(2 * np.pi * f * t + phase))
        for f, rate, _, phase in MODES
    )
    found = decay_start(one - other * np.sum(one) / np.sum(other), 4)
    assert found is not None
    assert begin <= found < begin + 600
