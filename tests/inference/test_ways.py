"""What fits beside the ends of rooms: an angle that no slope turns, in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fitting.inference.likelihood import ways
from fitting.inference.likelihood.knowledge import Determined
from fitting.text.arrays import FloatArray
from tests.support.whitened import Z95, learnt, parameter, whitened

#: Errors of the line that is seen and of sin^2 of the angle; the limit of the damping.
SEEN, TURN, MOST = 0.1, 1e-5, 1e5


def string() -> Determined:
    """A line at 20 whose mode hangs a little in another one, and the width it would be told as.

    Of that other mode's damping d the line shows nothing to speak of, its first-order width
    a + d sin^2 theta does: at theta = 0, where no slope leads away, it is known to 0.1.
    """

    def rows(p: FloatArray) -> FloatArray:
        turned = math.sin(p[0]) ** 2
        return np.array([(p[2] + 10.0 * turned - 20.0) / SEEN, turned / TURN, 0.0, 0.0])

    return learnt(
        whitened(
            rows,
            parameter("theta", 0.0, math.pi, period=math.pi, start=1e-3),
            parameter("d", 1.0, MOST, start=300.0),
            parameter("a", 1.0, 1e3, start=20.0),
            width=lambda p: float(p[2] + p[1] * math.sin(p[0]) ** 2),
        )
    )


def test_a_little_of_a_mode_damped_without_end_is_much_to_a_width() -> None:
    """20 + sqrt(0.1^2 + (1e-5 d)^2) 1.96 at the limit of d; downwards the line alone counts."""
    width = string().derived["width"]
    assert width.ci95[0] == pytest.approx(20.0 - Z95 * SEEN, rel=1e-3)
    assert width.ci95[1] >= 20.0 + 0.97 * Z95 * math.hypot(SEEN, TURN * MOST)
    assert width.closed_by == ("data", "bound")
    assert width.status == "bounded below"


def test_without_the_turn_the_way_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ways, "TURNS", ())
    found = string()
    width = found.derived["width"]
    assert (width.closed_by[1], found.scans["width"].stopped[1]) == ("", "search")
    assert width.status == "not known"
