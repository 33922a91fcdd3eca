"""Fitted quantities: their checks, the change of variables and the periodic range."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.campaign import parameters as ps
from fitting.text.errors import BadInput

THETA = {
    "name": "theta",
    "unit": "rad",
    "lower": -6.0,
    "upper": 6.0,
    "start": 0.0,
    "reference": 1.9,
    "scale": 1.0,
    "period": math.pi,
}
D1 = {
    "name": "d1",
    "unit": "Hz",
    "lower": 1.0,
    "upper": 1000.0,
    "start": 94.0,
    "reference": 94.0,
    "scale": 100.0,
}


def two() -> tuple[ps.Parameter, ...]:
    return ps.Parameter(**THETA), ps.Parameter(**D1)  # type: ignore[arg-type]


def test_search_vector_is_distance_from_the_reference_in_scales() -> None:
    both = two()
    np.testing.assert_allclose(ps.to_search(both, np.array([2.9, 294.0])), [1.0, 2.0], rtol=1e-15)
    np.testing.assert_allclose(ps.to_model(both, np.array([-1.9, 0.5])), [0.0, 144.0], atol=1e-15)
    low, high = ps.search_bounds(both)
    np.testing.assert_allclose([low, high], [[-7.9, -0.93], [4.1, 9.06]], rtol=1e-14)
    assert ps.names(both) == ("theta", "d1")
    np.testing.assert_array_equal(ps.starts(both), [0.0, 94.0])


@given(st.lists(st.floats(-1e3, 1e3), min_size=6, max_size=6))
def test_search_and_model_are_inverse_for_many_points_at_once(numbers: list[float]) -> None:
    both, values = two(), np.reshape(numbers, (3, 2))
    back = ps.to_model(both, ps.to_search(both, values))
    np.testing.assert_allclose(back, values, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize(
    ("theta", "reported"),
    [(0.5, 0.5), (0.5 - math.pi, 0.5), (2 * math.pi + 0.5, 0.5), (-1e-17, 0.0), (math.pi, 0.0)],
)
def test_canonical_angle_lies_in_zero_to_pi(theta: float, reported: float) -> None:
    found = ps.canonical(two(), np.array([theta, -5.0]))
    assert 0.0 <= found[0] < math.pi
    assert found[0] == pytest.approx(reported, abs=1e-14)
    assert found[1] == -5.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lower": 7.0}, "'theta': lower = 7.0 is not below upper = 6.0 rad"),
        ({"start": 6.5}, r"start = 6.5 lies outside its bounds \[-6.0, 6.0\] rad"),
        ({"scale": 0.0}, "scale = 0.0; wanted a positive number"),
        ({"period": -1.0}, "period = -1.0"),
        ({"reference": math.nan}, "reference is nan"),
        ({"upper": math.inf}, "upper is inf"),
    ],
)
def test_nonsense_is_refused_when_made(change: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        ps.Parameter(**{**THETA, **change})


def test_next_to_an_end_is_a_ratio_where_the_box_spans_decades() -> None:
    """1.5 Hz is no lower end of 1 to 1000 Hz, though it is within a thousandth of that box."""
    theta, d1 = two()
    assert d1.spans_decades
    assert d1.near(d1.lower, 1e-3) == pytest.approx(1e-3)
    assert d1.near(d1.upper, 1e-3) == pytest.approx(1.0)
    assert not theta.spans_decades
    assert theta.near(theta.lower, 1e-3) == pytest.approx(12e-3)
    assert not ps.Parameter(**{**THETA, "lower": 0.1, "start": 1.0}).spans_decades  # type: ignore[arg-type]
    assert not ps.Parameter(**{**D1, "lower": 0.0}).spans_decades  # type: ignore[arg-type]
