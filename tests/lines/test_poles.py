"""A resonance in complex data: eta, width, delay and top against the closed form they come from."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines.starts import complex_line
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.lines import mode

ETA_HZ, WIDTH_HZ = 6.94e6, 94.0


def response(f: FloatArray, delay_s: float = 0.0) -> ComplexArray:
    """c + A/(1 + 2i (f - eta)/w), turned by a cable: exp(-i 2 pi (f - middle) tau)."""
    resonance = (3.0 - 4.0j) / (1.0 + 2j * (f - ETA_HZ) / WIDTH_HZ)
    turn = np.exp(-2j * np.pi * (f - 0.5 * (f[0] + f[-1])) * delay_s)
    return np.asarray((0.7 + 0.2j + resonance) * turn)


def grid(low: float = -4.0, high: float = 6.0, points: int = 101) -> FloatArray:
    """Frequencies from so many widths below the resonance to so many above."""
    return np.asarray(ETA_HZ + WIDTH_HZ * np.linspace(low, high, points))


def test_an_exact_line_comes_back() -> None:
    f = grid()
    for scale in (1.0, 1e-5):
        found = complex_line(f, scale * response(f))
        assert found.eta_hz == pytest.approx(ETA_HZ, abs=1e-6 * WIDTH_HZ)
        assert found.width_hz == pytest.approx(WIDTH_HZ, rel=1e-6)
        assert found.top == pytest.approx(scale * (3.7 - 3.8j), rel=1e-6)
        assert found.delay_s == 0.0
        assert found.misfit < 1e-7
        assert found.left < 1e-7


def test_phases_that_are_counted_backwards_show_as_a_negative_width() -> None:
    f = grid()
    found = complex_line(f, np.asarray(np.conj(response(f))))
    assert found.width_hz == pytest.approx(-WIDTH_HZ, rel=1e-6)
    assert found.top == pytest.approx(3.7 + 3.8j, rel=1e-6)


@pytest.mark.parametrize("cycles", [-2.3, 0.6, 5.1])
def test_a_delay_is_taken_off_where_it_is_known_and_found_where_not(cycles: float) -> None:
    """So many turns of the cable over the sweep."""
    f = grid()
    delay_s = cycles / float(np.ptp(f))
    known = complex_line(f, response(f, delay_s), delay_s)
    assert known.width_hz == pytest.approx(WIDTH_HZ, rel=1e-6)
    assert known.delay_s == delay_s
    assert complex_line(f, response(f, delay_s)).misfit > 0.02
    found = complex_line(f, response(f, delay_s), None)
    # the last tried delays are 1/(8 4^4) of a turn apart
    assert abs(found.delay_s - delay_s) * float(np.ptp(f)) <= 0.5 / (8 * 4**4)
    assert found.eta_hz == pytest.approx(ETA_HZ, abs=0.002 * WIDTH_HZ)
    assert found.width_hz == pytest.approx(WIDTH_HZ, rel=0.002)
    assert abs(found.top - (3.7 - 3.8j)) < 0.02


def test_a_gap_in_the_sweep_does_not_hide_the_delay() -> None:
    """The mean turn is that of neighbours: a jump across a gap is no neighbour."""
    f = np.concatenate([grid(-4.0, 0.9, 50), grid(7.9, 10.9, 31)])
    delay_s = 0.4 / float(f[1] - f[0])
    found = complex_line(f, response(f, delay_s), None)
    assert found.delay_s == pytest.approx(delay_s, abs=0.5 / (8 * 4**4) / float(np.ptp(f)))


@pytest.mark.parametrize("beyond", [30.0, 120.0])
def test_a_wide_gap_does_not_hide_it_either(beyond: float) -> None:
    """The guess is off by a part of a turn over what was measured, many turns over gap and all."""
    f = np.concatenate([grid(-4.0, 0.9, 50), grid(beyond, beyond + 3.0, 31)])
    delay_s = 0.4 / float(f[1] - f[0])
    found = complex_line(f, response(f, delay_s), None)
    assert found.delay_s == pytest.approx(delay_s, abs=0.5 / (8 * 4**4) / float(np.ptp(f)))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("value", [1.0, 0.3j, 0.0])
@pytest.mark.parametrize("delay_s", [0.0, None])
def test_a_constant_is_no_line(value: complex, delay_s: float | None) -> None:
    found = complex_line(grid(), np.full(101, value, dtype=complex), delay_s)
    assert np.isnan(found.width_hz)
    assert (found.top, found.left) == (value, 0.0)


def test_noise_is_what_is_left() -> None:
    """rms over the largest modulus; over the spread about the mean for the misfit."""
    f, generator = grid(points=4001), np.random.default_rng(1)
    clean = response(f)
    noise = 0.05 * (generator.standard_normal(f.size) + 1j * generator.standard_normal(f.size))
    found = complex_line(f, clean + noise)
    rms = 0.05 * np.sqrt(2.0)
    assert found.left == pytest.approx(rms / np.max(np.abs(clean + noise)), rel=0.04)
    assert found.misfit == pytest.approx(rms / np.std(clean + noise), rel=0.04)
    # and it carries neither eta nor the width away: weights by the denominator, settled
    assert found.eta_hz == pytest.approx(ETA_HZ, abs=0.01 * WIDTH_HZ)
    assert found.width_hz == pytest.approx(WIDTH_HZ, rel=0.015)


def test_a_narrow_dip_behind_a_cable_that_turns_over_the_sweep_is_found() -> None:
    """Thirty widths, 0.4 of a turn: a line of half the sweep leaves less than any delay near it."""
    f = np.linspace(5.995e9, 6.005e9, 201)
    seen = (1.0 - 0.6j * mode(f, 6e9, 3e5)) * np.exp(-2j * np.pi * f * 40e-9)
    found = complex_line(f, seen, None)
    assert found.delay_s == pytest.approx(40e-9, abs=0.1e-9)
    assert found.eta_hz == pytest.approx(6e9, abs=3e3)
    assert found.width_hz == pytest.approx(3e5, rel=0.02)
