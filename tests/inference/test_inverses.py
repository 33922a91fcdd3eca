"""A quality factor is constrained as the width is: with the inverse ends, and the same status."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fitting.inference.likelihood.knowledge import Determined
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Verdict
from tests.support.whitened import Z95, learnt, parameter, whitened

Rows = Callable[[FloatArray], FloatArray]
#: Frequency of a line whose width is a parameter, and how far it drifts with another one.
ETA, WIDTH, STD = 1e6, 100.0, 2.0


def drifting(share: float, rows: Rows | None = None) -> Determined:
    """What the data say of a line that drifts by such a share of its frequency, at most."""

    def measured(p: FloatArray) -> FloatArray:
        return np.array([(p[0] - WIDTH) / STD, p[1] / 0.1, 0.5])

    objective = whitened(
        measured if rows is None else rows,
        parameter("width", 1.0, 1000.0, start=WIDTH),
        parameter("step", -1.0, 1.0),
        w=lambda p: float(p[0]),
        q=lambda p: ETA * (1.0 + share * p[1]) / float(p[0]),
    )
    return learnt(objective)


@pytest.mark.parametrize("share", [0.0, 1e-5, 1e-4, 1e-2])
def test_the_interval_of_q_is_that_of_the_width(share: float) -> None:
    """width 100 +- 2; the step is known to 0.1, so that Q moves by 1e-3 of itself at most."""
    found = drifting(share)
    low, high = found.derived["q"].ci95
    assert low == pytest.approx(ETA / (WIDTH + Z95 * STD), rel=2e-4)
    assert high == pytest.approx(ETA / (WIDTH - Z95 * STD), rel=2e-4)
    assert found.derived["q"].status is found.derived["w"].status is Verdict.DETERMINED


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_a_frequency_that_the_data_hold_moves_no_quality_factor(share: float) -> None:
    """Over its box it goes by 5 or 20 %, and is known to 1e-4 of that."""

    def measured(p: FloatArray) -> FloatArray:
        return np.array([(p[0] - WIDTH) / STD, p[1] / 1e-4, 0.5])

    found = drifting(share, measured)
    assert found.derived["q"].ci95[0] == pytest.approx(ETA / (WIDTH + Z95 * STD), rel=2e-4)


@pytest.mark.parametrize("share", [1e-4, 2e-3])
def test_a_bound_of_q_is_that_of_the_width_from_the_other_side(share: float) -> None:
    """Beyond 100 the width is free: only what is below it is excluded."""

    def one_sided(p: FloatArray) -> FloatArray:
        return np.array([min(p[0] - WIDTH, 0.0) / STD, p[1] / 0.1, 0.5])

    found = drifting(share, one_sided)
    assert found.derived["w"].status is Verdict.BELOW
    assert found.derived["q"].status is Verdict.ABOVE
    assert found.derived["q"].ci95[1] == pytest.approx(ETA / found.derived["w"].ci95[0], rel=1e-3)
