"""Free decays against their equation of motion, and against records of known truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitting as ff
from fitting.lines.decay import Decays, decay, fit_decays
from fitting.lines.trace import PHASORS, SAMPLES
from fitting.text.arrays import ComplexArray, FloatArray

T = np.arange(3000) / 8000.0


def tone(frequency_hz: float, width_hz: float, size: float = 1.0, phase: float = 0.3) -> FloatArray:
    wave = np.cos(2.0 * np.pi * frequency_hz * T + phase)
    return np.asarray(size * np.exp(-np.pi * width_hz * T) * wave)


def noise(sigma: float, seed: int) -> FloatArray:
    return np.random.default_rng(seed).normal(0.0, sigma, T.size)


@pytest.mark.parametrize("width", [2.0, 1e-7, -0.4])
@pytest.mark.parametrize("law", [(3.0, 1.5), (-2.0, 0.0), (0.0, -0.02), (1.0, 1e-6)])
def test_a_decay_solves_its_equation_and_has_its_derivatives(
    width: float, law: tuple[float, float]
) -> None:
    t, turns, (shift, extra) = np.arange(40) / 40, 4.0, law

    def motion(_: float, y: FloatArray) -> list[float]:
        z, power = complex(*y), float(y @ y)
        rate = -np.pi * (width + extra * power) + 2j * np.pi * (turns + shift * power)
        return [(rate * z).real, (rate * z).imag]

    true = solve_ivp(motion, (0.0, 1.0), [1.0, 0.0], t_eval=t, rtol=1e-11, atol=1e-13).y
    found = decay(t, turns, width, shift, extra)
    assert found.values == pytest.approx(true[0] + 1j * true[1], abs=1e-8)
    at, step = np.array([turns, width, shift, extra]), 1e-5
    for k, slope in enumerate(found.slopes):
        up, down = (decay(t, *(at + sign * step * np.eye(4)[k])).values for sign in (1, -1))
        size = 1.0 + float(np.max(np.abs(slope)))
        assert slope == pytest.approx((up - down) / (2.0 * step), abs=1e-5 * size)


def test_lines_that_beat_are_found_exactly() -> None:
    model = Decays(samples=T.size, kind=SAMPLES, lines=2, constant=False)
    fit = fit_decays(model, tone(1013.0, 5.0, 0.6) + tone(1000.3, 4.0))
    lines = fit.x.reshape(2, 2) / (T.size / 8000.0)
    assert lines[np.argsort(lines[:, 0])] == pytest.approx(
        np.array([[1000.3, 4.0], [1013.0, 5.0]]), rel=1e-6
    )
    assert fit.squares < 1e-16
    assert fit.unknowns == 8


def test_what_hardly_oscillates_is_no_line_of_samples() -> None:
    with pytest.raises(ValueError, match="oscillates"):
        fit_decays(Decays(samples=T.size, kind=SAMPLES), np.exp(-10.0 * T))


def test_a_tone_beside_a_decay_has_no_width() -> None:
    z = np.exp((-40.0 + 2j * np.pi * 30.0) * T) + 0.3 * np.exp(-2j * np.pi * 55.0 * T)
    fit = fit_decays(Decays(samples=T.size, kind=PHASORS, lines=2), z)
    widths = np.sort(fit.x[1::2]) / (T.size / 8000.0)
    assert widths == pytest.approx([0.0, 40.0 / np.pi], abs=1e-6)


@pytest.mark.parametrize("sort", ["samples", "phasors", "amplitudes"])
def test_damping_that_follows_the_amplitude_is_named_and_the_fwhm_is_that_of_small_ones(
    sort: str,
) -> None:
    """a' = -pi w a - pi v a^3, in closed form: an exponential is off by a fifth and more."""
    width, extra, f = 4.0, 10.0, 1875.3
    size = np.exp(-np.pi * width * T)
    size /= np.sqrt(1.0 + extra / width * (1.0 - np.exp(-2.0 * np.pi * width * T)))
    z = size * np.exp(2j * np.pi * (f if sort == "samples" else 7.0) * T)
    values: FloatArray | ComplexArray = z + noise(0.003, 1) + 1j * noise(0.003, 2)
    if sort == "samples":
        values = z.real + noise(0.003, 1)
    elif sort == "amplitudes":
        values = np.abs(values)
    found = ff.ringdown(T, values)
    assert found.form == "damping"
    assert found.width.value == pytest.approx(width, abs=4.0 * found.width.std)
    assert found.extra.value == pytest.approx(extra, abs=4.0 * found.extra.std)
    assert "damping" in repr(found)
    plain = next(form for form in found.forms if form.name in ("constant", "noise"))
    assert abs(plain.width.value - width) > 0.2 * width


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", ["line", "moving", "correlated", "beat"])
def test_no_sample_of_a_free_decay_is_left_out(kind: str, seed: int) -> None:
    """What looks for a begin in these records alone takes up to 375 of 3000 samples from them."""
    f, width, shift = 1210.0 + 40.0 * seed, 3.0 + seed, 12.0 * (kind == "moving")
    turned = shift * (1.0 - np.exp(-2.0 * np.pi * width * T)) / width
    y = np.exp(-np.pi * width * T) * np.cos(2.0 * np.pi * f * T + turned + seed)
    y = y + noise(0.02, seed)
    if kind == "beat":
        y += tone(f + 3.0 * width, width, 0.5)
    if kind == "correlated":
        y += 0.8 * np.concatenate([[0.0], noise(0.02, seed)[:-1]])
    found = ff.ringdown(T, y)
    assert found.left_out == 0
    assert found.width.value == pytest.approx(width, abs=4.0 * found.width.std)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["samples", "phasors", "amplitudes"])
def test_a_short_drive_is_no_part_of_the_decay_behind_it(kind: str, seed: int) -> None:
    """Held for 3 % of the record: a second line could follow it as closely."""
    held, width, f = 90, 5.0, 1500.0 if kind == "samples" else 2.0
    after = np.maximum(T - T[held], 0.0)
    z = np.exp((-np.pi * width + 2j * np.pi * f) * after)
    if kind == "samples":
        z[:held] = np.exp(2j * np.pi * (f + 1.0) * (T - T[held])[:held])
        values: FloatArray | ComplexArray = z.real + noise(0.02, seed)
    else:
        values = z + noise(0.02, seed) + 1j * noise(0.02, seed + 50)
        values = np.abs(values) if kind == "amplitudes" else values
    found = ff.ringdown(T, values)
    assert held - 2 <= found.left_out < held + 100
    assert found.second is None
    assert found.width.value == pytest.approx(width, abs=4.0 * found.width.std)


def test_frequencies_that_have_the_same_samples_are_printed() -> None:
    """8 kHz samples of 6766.5 Hz are those of 1233.5 Hz."""
    found = ff.ringdown(T, tone(6766.5, 6.0) + noise(0.01, 3))
    assert found.frequency.value == pytest.approx(1233.5, abs=4.0 * found.frequency.std + 0.01)
    assert [each.value for each in found.alike] == pytest.approx([6766.5, 9233.5], abs=0.1)
    assert "6766." in repr(found)
    assert ff.ringdown(T, np.exp((-20.0 + 30j) * T) + noise(0.01, 4)).alike == ()
