"""Two lines that overlap, in closed form: are they found, with errors that hold, and only they?"""

from __future__ import annotations

import numpy as np
import pytest

from fitting.lines.form import LineFit
from fitting.lines.several import NOISE_P, fit_lines, shows_all
from fitting.text.arrays import ComplexArray, FloatArray

F = np.linspace(8930.0, 9130.0, 401)


def coupled(splitting: float, d1: float, d2: float) -> tuple[ComplexArray, FloatArray]:
    """q1 = D2/(D1 D2 - k^2) of modes at 9028 and 9033 Hz over its top, and both lines, Hz.

    The lines are roots of D1 D2 = k^2: frequencies, then full widths.
    """
    one, two = ([-1.0, 1j * d, f * f] for f, d in ((9028.0, d1), (9033.0, d2)))
    square = splitting**2 * 9028.0 * 9033.0
    below = np.polyval(one, F) * np.polyval(two, F) - square
    both = np.polymul(one, two)
    both[-1] -= square
    poles = sorted((p for p in np.roots(both) if p.real > 0.0), key=abs)
    seen = np.polyval(two, F) / below
    return seen / np.max(np.abs(seen)), np.array([*map(abs, poles), *(2.0 * p.imag for p in poles)])


def found(values: FloatArray | ComplexArray) -> LineFit:
    pair = fit_lines(F, values, 2)
    assert pair is not None
    assert pair.structure.p_value > NOISE_P
    assert shows_all(F, pair)
    return pair


def numbers(pair: LineFit) -> tuple[FloatArray, FloatArray]:
    """Frequencies, then widths, the lower line first, with their errors, Hz."""
    both = sorted((pair, *pair.others), key=lambda line: line.frequency.value)
    each = [line.frequency for line in both] + [line.width for line in both]
    return np.array([n.value for n in each]), np.array([n.std for n in each])


@pytest.mark.parametrize("sweeps", [5, pytest.param(20, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("phases", [True, False])
def test_lines_nearer_than_they_are_wide_are_where_they_are(phases: bool, sweeps: int) -> None:
    """Of 20 sweeps each value is off by less than 4 errors, and by 1.7 of them at most (rms)."""
    exact, lines = coupled(8.0, 10.0, 14.0)
    assert lines[1] - lines[0] < 0.5 * (lines[2] + lines[3])
    off = []
    for seed in range(sweeps):
        x, y = 6e-3 * np.random.default_rng(seed).standard_normal((2, F.size))
        noisy = exact + x + 1j * y
        pair = found(noisy if phases else np.abs(noisy))
        values, errors = numbers(pair)
        off.append((values - lines) / errors)
    assert np.max(np.abs(off)) < 4.0
    assert np.sqrt(np.mean(np.square(off))) < 1.7


def test_without_noise_the_lines_are_exact() -> None:
    exact, lines = coupled(40.0, 6.0, 9.0)
    pair = found(exact)
    assert numbers(pair)[0] == pytest.approx(lines, abs=1e-5)


def test_few_points_hold_no_pair() -> None:
    exact, _ = coupled(40.0, 6.0, 9.0)
    assert fit_lines(F[::40], exact[::40], 2) is None
