"""Decaying lines side by side, against the sums they are made of."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.decaying_lines import decaying_lines

DT = 1.0 / 8000.0
T = np.arange(3000) * DT


def decay(frequency_hz: float, width_hz: float, size: float, phase: float = 0.3) -> np.ndarray:
    return np.asarray(
        size * np.exp(-np.pi * width_hz * T) * np.cos(2.0 * np.pi * frequency_hz * T + phase)
    )


def test_two_lines_that_beat_are_found_exactly() -> None:
    found = decaying_lines(decay(1013.0, 5.0, 0.6) + decay(1000.3, 4.0, 1.0), DT, 2)
    assert found is not None
    assert found.frequency_hz == pytest.approx((1000.3, 1013.0), abs=1e-4)
    assert found.width_hz == pytest.approx((4.0, 5.0), rel=1e-4)
    assert found.squares < 1e-8
    assert found.unknowns == 8


def test_a_constant_is_solved_for_where_it_is_asked_for() -> None:
    y = 2.0 + decay(700.0, 3.0, 1.0)
    found = decaying_lines(y, DT, 1, offset=True)
    assert found is not None
    assert found.frequency_hz == pytest.approx((700.0,), abs=1e-4)
    assert found.squares < 1e-8


def test_what_hardly_oscillates_is_no_line() -> None:
    assert decaying_lines(np.exp(-10.0 * T), DT, 1) is None
