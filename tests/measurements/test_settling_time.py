"""How long a response settles by the line width that is stated."""

from __future__ import annotations

import math

import pytest

from fitting.measurements.planning import settling_s


def test_settling_leaves_what_was_asked_for() -> None:
    settle = settling_s(50.0, 1e-7)
    assert math.exp(-math.pi * 25.0 * settle) == pytest.approx(1e-7, rel=1e-9)
    with pytest.raises(ValueError, match="line width"):
        settling_s(0.0, 1e-7)
    for accuracy in (0.0, 1.5, -1e-3):
        with pytest.raises(ValueError, match="accuracy"):
            settling_s(50.0, accuracy)
