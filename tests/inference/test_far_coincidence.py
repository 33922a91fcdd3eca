"""A value that the data cut inside its box is known, whatever fits far beyond by a coincidence."""

from __future__ import annotations

import numpy as np
import pytest

import fitting as ff
from fitting.text.estimate import Verdict
from tests.support import closed_posteriors as closed


def test_a_fit_at_the_end_of_the_room_leaves_nothing_open_in_the_box() -> None:
    """z = 2 + (cos, sin)(2 pi p) at p = 100: p = 10 and p = 1000 fit as well, by whole turns."""
    formula = closed.Formula(
        lambda p: 2.0 + np.column_stack([np.cos(2.0 * np.pi * p), np.sin(2.0 * np.pi * p)])
    )
    p = closed.parameter("p", 99.8, 100.4, 100.1)
    problem = closed.problem(formula, [p], np.array([3.0, 2.0]), np.array([0.003, 0.003]))
    found = ff.profile(ff.fit(problem, ff.Tikhonov(levels=3), starts=1))["p"]
    assert found.status is Verdict.DETERMINED
    half = 1.96 * 0.003 / (2.0 * np.pi)
    assert found.interval() == pytest.approx((100.0 - half, 100.0 + half), abs=0.02 * half)
