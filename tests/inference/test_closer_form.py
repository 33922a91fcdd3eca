"""Sweeps whose residuals tell the noise: is a model that something beside the line refutes told?"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from fitting.inference.closer_form import compared
from fitting.text.arrays import FloatArray
from tests.support.lines import mode

ETA, WIDTH = 1e6, 400.0
F = ETA + np.linspace(-2000.0, 2000.0, 81)
LINE = np.abs(mode(F, ETA, WIDTH))


def nearest_line(amplitude: FloatArray) -> FloatArray:
    """What the best single line leaves, over the top: of 200 widths, each with its best height."""
    best = math.inf
    left = amplitude
    for width in WIDTH * np.geomspace(0.3, 8.0, 200):
        curve = np.abs(mode(F, ETA, width))
        rows = amplitude - curve * float(curve @ amplitude) / float(curve @ curve)
        if float(rows @ rows) < best:
            best, left = float(rows @ rows), rows
    return np.asarray(left / np.max(amplitude))


@pytest.mark.parametrize(
    ("amplitude", "against"),
    [
        (LINE + 0.3, r"added to its amplitude"),
        # a constant in quadrature adds its power to the line's, too, but for its slope
        (np.hypot(LINE, 0.3), r"whose power is added|complex constant"),
        (np.abs(mode(F, ETA, WIDTH) + 0.3 * np.exp(0.7j)), r"complex constant"),
    ],
    ids=["offset", "power", "crosstalk"],
)
def test_a_line_without_what_stands_beside_it_does_not_describe(
    amplitude: FloatArray, against: str
) -> None:
    noise = 5e-3 * np.random.default_rng(7).standard_normal(F.size)
    found = compared(F, amplitude + noise, nearest_line(amplitude + noise))
    assert found is not None
    assert not found.describes
    assert re.search(against, found.against)
    # what the true form leaves is the noise: chi square is what is left over its variance
    left = nearest_line(amplitude + noise) * float(np.max(amplitude + noise))
    assert found.chi_square == pytest.approx(float(left @ left) / 5e-3**2, rel=0.4)


def test_noise_is_not_told_to_be_another_form() -> None:
    """Of 40 honest lines, 1 to 10 % of noise, none: the probability for it is below 1e-4 each."""
    told = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        f = ETA + np.linspace(-1500.0, 1500.0, int(rng.integers(9, 41)))
        noise = 10.0 ** rng.uniform(-2.0, -1.0) * rng.standard_normal(f.size)
        found = compared(f, np.abs(np.abs(mode(f, ETA, WIDTH)) + noise), noise)
        told += found is not None and not found.describes
    assert told == 0


def test_two_lines_are_no_line_with_something_beside_it() -> None:
    """A model of two lines leaves noise, and no form of one line is held against it."""
    rng = np.random.default_rng(3)
    two = np.abs(mode(F, ETA - 500.0, WIDTH) + 0.6 * mode(F, ETA + 500.0, 300.0))
    noise = 5e-3 * rng.standard_normal(F.size)
    found = compared(F, two + noise, noise / float(np.max(two)))
    assert found is None or found.describes
