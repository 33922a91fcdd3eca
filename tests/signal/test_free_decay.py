"""Free decays from few of their samples, against sums of damped exponentials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from fitting.measurements.time_record import SPARED, few_samples
from fitting.signal.free_decay import FewSamples, Rebuilt, rebuilt
from fitting.text.arrays import FloatArray

N = 10_800
#: What a plan of the usual accuracy lets decays be off by.
TOLERANCE = 1e-8
FEW = {few.blocks: few for few in few_samples(N)}


def summed(*terms: tuple[complex, complex], samples: int = N) -> FloatArray:
    """Sum of Re[a exp(r n)] over terms (r, a); whole turns are left out before they are rounded."""
    n = np.arange(samples)
    total = np.zeros(samples)
    for r, a in terms:
        turned = np.remainder(np.imag(r) * n, 2.0 * np.pi)
        total += np.real(a * np.exp(np.real(r) * n + 1j * turned))
    return total


def off(found: Rebuilt, y: FloatArray) -> float:
    return float(np.max(np.abs(found.samples - y)) / np.max(np.abs(y)))


def first_found(y: FloatArray, tolerance: float = TOLERANCE) -> Rebuilt | None:
    tried = (rebuilt(few, y[few.indices], tolerance) for few in few_samples(y.size))
    return next((found for found in tried if found is not None), None)


n = np.arange(N)
BLOCK_TURNS = 2j * np.pi * 1000 / FEW[12].stride
#: A decay, and what it may be off by.
CLOSED: dict[str, tuple[FloatArray, float]] = {
    "one mode": (summed((0.97j - 1e-4, 1 + 0.3j)), 1e-11),
    "Q of 1e8": (summed((0.97j - 1e-8, 1 + 0.3j)), 1e-10),
    "beating": (summed((0.97j - 1e-4, 1.0), (0.9703j - 1.3e-4, 0.5 - 1j)), 1e-10),
    "a tenth of a beat": (summed((0.97j - 1e-4, 1.0), (0.97001j - 1.3e-4, 0.5 - 1j)), 1e-10),
    "three": (summed((0.3j - 1e-4, 1.0), (0.31j - 1e-4, 1.0), (1.7j - 1e-4, 1.0)), 1e-10),
    "on an offset": (summed((0.3j - 1e-4, 1.0), (0.0, 1.0)), 1e-10),
    "decayed after a tenth": (summed((0.3j - 1e-2, 1.0)), 1e-9),
    "one fast": (summed((1.3j - 0.03, 1.0), (0.3j - 1e-4, 1.0)), 1e-10),
    "overdamped": (summed((-0.2, 1.0), (-0.01, -1.0)), 1e-9),
    "critical": (np.asarray((1.0 + 1e-2 * n) * np.exp(-1e-3 * n), dtype=float), 1e-10),
    "modes that meet": ((1.0 + 1e-3 * n) * summed((0.97j - 1e-4, 1 + 0.3j)), 1e-8),
    "at half the rate": (summed((np.pi * 1j - 1e-4, 1.0)), 1e-12),
    "a turn in a stride": (summed((BLOCK_TURNS - 1e-4, 1 + 0.3j)), 1e-10),
}


@pytest.mark.parametrize(("y", "error"), CLOSED.values(), ids=CLOSED.keys())
def test_a_sum_of_damped_exponentials_follows_from_few_samples(y: FloatArray, error: float) -> None:
    found = first_found(y)
    assert found is not None
    assert off(found, y) <= found.error <= error


@dataclass(frozen=True)
class Drawn:
    """A decay by chance: one to three modes, near or far, an offset, something fast."""

    y: FloatArray
    states: int


def drawn(seed: int) -> Drawn:
    """Q of 1e3 to 1e8, 0.3 to 12 decay times, turns from sample to sample that are folded."""
    rng = np.random.default_rng(seed)
    samples = int(10.0 ** rng.uniform(2.5, 4.1))
    rate = rng.uniform(0.3, 12.0) / samples
    turn = 2.0 * rate * 10.0 ** rng.uniform(3.0, 8.0)
    modes, near = int(rng.integers(1, 4)), rng.random() < 0.7
    terms = [(1j * np.remainder(turn, 2.0 * np.pi) - rate, np.exp(2j * np.pi * rng.random()))]
    for _ in range(modes - 1):
        beside = 10.0 ** rng.uniform(-2.0, 2.0) * rate if near else turn * rng.uniform(-0.5, 1.0)
        pole = 1j * np.remainder(turn + beside, 2.0 * np.pi) - rate * rng.uniform(0.3, 3.0)
        terms.append((pole, 10.0 ** rng.uniform(-2.0, 0.0) * np.exp(2j * np.pi * rng.random())))
    offset, fast = rng.random() < 0.3, rng.random() < 0.2
    if offset:
        terms.append((0.0, 10.0 ** rng.uniform(-3.0, 0.0)))
    if fast:
        pole = 1j * rng.uniform(0.1, 3.0) - rng.uniform(0.02, 2.0)
        terms.append((pole, 10.0 ** rng.uniform(-9.0, 0.0)))
    return Drawn(summed(*terms, samples=samples), 2 * modes + offset + 2 * fast)


@pytest.mark.parametrize("seeds", [60, pytest.param(300, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("tolerance", [1e-4, TOLERANCE])
def test_no_decay_is_further_off_than_is_said(tolerance: float, seeds: int) -> None:
    """Whatever is handed back holds its bound; nearly every decay is handed back."""
    worst, given, count = 0.0, 0, 0
    for seed in range(seeds):
        scene = drawn(seed)
        tried = few_samples(scene.y.size)
        found = [rebuilt(few, scene.y[few.indices], tolerance) for few in tried]
        worst = max([worst, *(off(each, scene.y) / each.error for each in found if each)])
        if tried and scene.states <= 6:
            count += 1
            given += any(each is not None for each in found)
    assert worst <= 1.0
    assert given >= 0.95 * count > seeds / 3


def test_noise_of_the_samples_is_part_of_what_is_said() -> None:
    clean = summed((0.97j - 1e-4, 1 + 0.3j))
    for seed in range(20):
        y = clean + 1e-10 * np.random.default_rng(seed).standard_normal(N)
        found = rebuilt(FEW[16], y[FEW[16].indices], TOLERANCE)
        assert found is not None
        assert off(found, y) <= found.error


@pytest.mark.parametrize("shift", [1e-2, 1e-3, 1e-4])
def test_a_line_that_moves_with_its_amplitude_is_no_sum_of_exponentials(shift: float) -> None:
    """A Duffing oscillator: by averaging its phase is w t + shift (1 - exp(-2 t d))/(2 d)."""
    n, d = np.arange(N), 3e-4
    phase = 0.97 * n - shift * np.expm1(-2.0 * d * n) / (2.0 * d)
    y = np.exp(-d * n) * np.cos(phase)
    found = first_found(y)
    assert found is None or off(found, y) <= found.error
    if shift >= 1e-3:
        assert rebuilt(FEW[12], y[FEW[12].indices], TOLERANCE) is None


def test_what_differs_between_the_blocks_alone_is_seen() -> None:
    """A decay that jumps where no block lies, as one of an FMU with an event."""
    for at in (100, 300, 345, FEW[16].stride // 2, 2000, 5000):
        y = summed((0.97j - 1e-4, 1 + 0.3j))
        y[at:] *= 1.0 + 1e-6
        assert first_found(y) is None


def test_nothing_and_no_numbers_are_no_decay() -> None:
    few = FEW[12]
    for value in (0.0, np.nan, np.inf):
        assert rebuilt(few, np.full(few.indices.size, value), TOLERANCE) is None


@pytest.mark.parametrize("samples", [100, 240, 300, 700, 864, 928, 1664, 1700, 10_800, 1_000_000])
def test_samples_lie_inside_the_decay_and_are_few(samples: int) -> None:
    for few in few_samples(samples):
        assert SPARED * few.indices.size <= samples
        assert few.indices[0] == 0
        assert few.indices[-1] == samples - 1
        assert np.all(np.diff(few.indices) > 0)
        assert not set(few.checked) & set(few.used.ravel()) - {samples - 1}
    assert bool(few_samples(samples)) == (samples >= 300)


def test_blocks_that_are_too_near_are_refused() -> None:
    with pytest.raises(ValueError, match="far apart"):
        FewSamples(60, 12, 4)
