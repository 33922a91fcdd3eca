"""What is derived from residuals along an axis, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.measurements.residuals import ResidualCurve
from fitting.text.arrays import FloatArray


def test_shares_of_power_are_those_of_two_lorentzians() -> None:
    """The power of a line up to f is 1/2 + arctan(2 (f - f0)/width)/pi of all of it."""
    f, width = np.linspace(-4000.0, 4000.0, 160_001), 1.0
    there, here = (
        np.asarray(1.0 / (1.0 + 2j * (f - at) / width), dtype=complex) for at in (30.0, -20.0)
    )
    curve = ResidualCurve(
        rows=np.arange(f.size),
        share=np.ones(f.size),
        axis=f,
        model=np.asarray(3.0j * here),
        measured=there,
    )
    exact = np.arctan(2.0 * (f + 20.0) / width) - np.arctan(2.0 * (f - 30.0) / width)
    assert curve.power_shares == pytest.approx(exact / np.pi, abs=2e-2)
    assert curve.power_shares[-1] == pytest.approx(0.0, abs=1e-12)


def test_lines_further_apart_differ_more_in_shares_though_not_in_rows() -> None:
    f, width = np.linspace(990.0, 1010.0, 401), 0.1

    def of_line(at: float) -> FloatArray:
        return np.asarray(np.abs(1.0 / (1.0 + 2j * (f - at) / width)))

    def distances(at: float) -> tuple[float, float]:
        curve = ResidualCurve(
            rows=np.arange(f.size),
            share=np.ones(f.size),
            axis=f,
            model=of_line(at),
            measured=of_line(1004.0),
        )
        rows = of_line(at) - of_line(1004.0)
        return float(rows @ rows), float(curve.power_shares @ curve.power_shares)

    near, far = distances(1000.0), distances(994.0)
    assert far[0] == pytest.approx(near[0], rel=0.05)
    assert far[1] == pytest.approx(2.5 * near[1], rel=0.05)
