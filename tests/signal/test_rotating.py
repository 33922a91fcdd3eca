"""Demodulated free responses, and lengths of phasors in noise, against closed forms and scipy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.stats import rice

from fitting.signal.rotating import SENSED, Reference, reference, rotating_responses
from fitting.signal.roughness import (
    quadrature_noise,
    rician,
    rician_deviation,
    scatter_of,
)
from fitting.text.arrays import FloatArray

F_HZ = 1.2345678e6


def both_responses(
    motion: Sequence[tuple[complex, complex]], found: Reference, samples: int, further: int
) -> tuple[FloatArray, FloatArray]:
    """Re sum c exp(s t) at the samples of a run and of the second one, (factor c, rate s) each."""
    count = (samples - 1) * found.between + 1 + further
    made = []
    for n, step in ((count, found.step_s), (SENSED, found.sensing_step_s)):
        t = np.arange(n) * step
        made.append(np.real(sum(c * np.exp(s * t) for c, s in motion)))
    return np.asarray(made[0]), np.asarray(made[1])


@pytest.mark.parametrize("quality", [1e3, 1e8])
@pytest.mark.parametrize("apart", [pytest.param(0.0, id="meeting"), pytest.param(2.5, id="apart")])
def test_a_pulse_s_response_spans_what_a_demodulator_shows(quality: float, apart: float) -> None:
    """Two lines whose frequencies meet or lie apart, and one elsewhere that is not looked at."""
    width = F_HZ / quality
    beside = np.array([-1.0 + 0.6j, -1.3 + 1j * (0.6 + 2.0 * apart)])
    rates = np.pi * width * beside + 2j * np.pi * F_HZ
    elsewhere = -1.0 * width + 2j * np.pi * 0.37 * F_HZ
    samples, spacing = 120, 2.0 / (np.pi * width) / 120
    found = reference(F_HZ, spacing)
    shifts = np.unique(np.round(np.geomspace(1.0, 60.0, 15))).astype(np.intp)
    motion = ((1.0, rates[0]), (0.4 - 0.7j, rates[1]), (0.3j, elsewhere))
    decay, sensed = both_responses(motion, found, samples, int(shifts[-1]))
    columns = rotating_responses(decay, sensed, shifts, found, samples, 2)
    z = np.exp((rates - 2j * np.pi * F_HZ) * (np.arange(samples) * spacing)[:, None])

    def left(values: np.ndarray) -> float:
        rest = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
        return float(np.linalg.norm(rest) / np.linalg.norm(values))

    rounding = 1e-6 if quality > 1e6 else 1e-10  # phases of 1e8 turns
    assert left(z @ np.array([0.3 + 1.0j, -0.8])) < rounding
    assert left(np.conj(z) @ np.array([0.3 + 1.0j, -0.8])) > 0.1


def test_fewer_lines_than_are_asked_for_leave_columns_of_zeros() -> None:
    found = reference(1e3, 0.01)
    decay, sensed = both_responses(((1.0, 2j * np.pi * 1e3 - 3.0),), found, 90, 8)
    shifts = np.arange(8, dtype=np.intp)
    columns = rotating_responses(decay, sensed, shifts, found, 90, 2)
    assert np.count_nonzero(np.linalg.norm(columns, axis=0)) == 1


@pytest.mark.parametrize("f_hz", [50e3, 1234.5, 7.123e6])
@pytest.mark.parametrize("offset", [0.012, -0.012, 0.45, -0.6, 0.988, -1.012, 2.3, -7.7])
def test_lines_beyond_half_the_rate_turn_as_they_do(f_hz: float, offset: float) -> None:
    """Offsets in sampling rates, of 10/s: exp(2 pi i offset n) over the samples n, and no mirror.

    Another line at other multiples of the frequency is not taken for it.
    """
    found, samples = reference(f_hz, 0.1), 150
    shifts = np.unique(np.round(np.geomspace(1.0, 60.0, 12))).astype(np.intp)
    line = -0.3 + 2j * np.pi * (f_hz + 10.0 * offset)
    n = np.arange(samples)
    z = np.exp((-0.03 + 2j * np.pi * offset) * n)
    for elsewhere in (0.41, 1.83, 2.0, 3.0):
        motion = ((0.8 - 0.3j, line), (1.0, -0.2 + 2j * np.pi * elsewhere * f_hz))
        decay, sensed = both_responses(motion, found, samples, 60)
        [column] = rotating_responses(decay, sensed, shifts, found, samples, 1).T
        size = np.linalg.norm(column) * np.linalg.norm(z)
        assert abs(np.vdot(z, column)) / size == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("top", [8.0, 30.0])
def test_noise_of_magnitudes_is_that_of_their_quadratures(top: float) -> None:
    """Also where most points lie in the noise, beside a line: there they scatter by 0.66."""
    rng = np.random.default_rng(4)
    line = top / np.abs(1.0 + 2j * np.linspace(-1.0, 1.0, 401) / 0.1)
    found = [
        quadrature_noise(0.7 * np.abs(line + rng.standard_normal(401) + 1j * turned))
        for turned in rng.standard_normal((60, 401))
    ]
    assert np.mean(found) == pytest.approx(0.7, rel=0.12)
    assert quadrature_noise(np.ones(20)) == 0.0


@pytest.mark.parametrize("ratio", [0.0, 0.3, 1.0, 4.0, 30.0])
def test_lengths_of_phasors_in_noise_follow_rice(ratio: float) -> None:
    sigma, nu = 0.7, np.array([0.7 * ratio])
    assert rician(nu, sigma).mean == pytest.approx(rice.mean(ratio, scale=sigma), rel=1e-9)
    assert rician_deviation(np.array([ratio])) == pytest.approx(rice.std(ratio), rel=1e-6)
    step = 1e-3
    slope = (rice.mean(ratio + step) - rice.mean(abs(ratio - step))) / (2.0 * step)
    assert rician(nu, sigma).slope == pytest.approx(slope, abs=1e-4)
    ends = [
        rice.mean(ratio * sigma / s, scale=s)
        for s in (np.sqrt(sigma**2 + step), np.sqrt(sigma**2 - step))
    ]
    assert rician(nu, sigma).rise == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4)


def test_without_noise_a_length_is_itself() -> None:
    nu = np.array([0.0, 1.0, 2.0])
    assert rician(nu, 0.0).mean == pytest.approx(nu)
    assert rician(nu, 0.0).slope == pytest.approx(1.0)
    assert rician(nu, 0.0).rise[1:] == pytest.approx([0.5, 0.25])


def test_scatter_tells_where_amplitudes_drown_in_noise() -> None:
    """A decay from 100 times the noise into it: deviations of 1 above, of 0.655 within."""
    rng = np.random.default_rng(4)
    t = np.linspace(0.0, 20.0, 2000)
    z = 2.0 * np.exp(-t) + 0.02 * (rng.standard_normal(2000) + 1j * rng.standard_normal(2000))
    found = scatter_of(np.abs(z))
    weights = found.weights
    assert found.drowns
    assert found.noise == pytest.approx(0.02, rel=0.1)
    assert not scatter_of(np.abs(z[:200])).drowns
    truth = [rice.std(min(ratio, 30.0)) for ratio in 100.0 * np.exp(-t[::50])]
    assert weights[::50] == pytest.approx(truth, abs=0.1)
    assert float(np.mean(weights[1000:])) == pytest.approx(rice.std(0.0), rel=0.05)
