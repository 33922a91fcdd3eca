"""A free decay of two lines is not described by one, and that of one line is."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.inference.adequacy import Model, compared_decay
from fitting.inference.sweeps import decaying_lines
from fitting.measurements.traces import Trace
from fitting.text.rendering import phrase

T = np.arange(2500) / 8000.0


@pytest.mark.parametrize(("second", "said"), [(0.6, True), (0.05, True), (0.0, False)])
def test_a_second_line_is_told_where_one_line_leaves_it(second: float, said: bool) -> None:
    """1000.3 and 1013 Hz; what one line leaves by least squares stands for a model of one mode."""
    for seed in range(10):
        noise = 0.01 * np.random.default_rng(seed).standard_normal(T.size)
        fall = np.exp(-np.pi * 4.0 * T)
        y = fall * (np.cos(2e3 * np.pi * 1.0003 * T) + second * np.sin(2e3 * np.pi * 1.013 * T))
        trace = Trace(T, y + noise, input="force", start="unknown")
        one, _, _ = decaying_lines(trace, 1)
        found = compared_decay(trace, Model(one.residuals, 4))
        assert (found is not None) is said
        if found is not None:
            assert not found.describes
            assert found.rival is not None
            assert found.rival.frequencies_hz == pytest.approx((1000.3, 1013.0), abs=0.5)
            assert "states = 4" in phrase("status", "remedy", found.rival, "")
