"""Rational functions through few values, against rational functions that are known."""

from __future__ import annotations

import numpy as np
import pytest

from fitting.signal.rational import Interpolation
from fitting.text.arrays import ComplexArray, FloatArray

#: Poles 1e-3 and 2e-2 from the real axis, and a zero 1e-2 from it.
POLES = np.array([-0.3 - 1e-3j, 0.45 - 2e-2j])
PLACES = np.linspace(-1.0, 1.0, 401)


def two_lines(f: FloatArray) -> ComplexArray:
    """(f - z)/((f - s1)(f - s2)): degree two."""
    return np.asarray((f - (0.1 + 1e-2j)) / ((f - POLES[0]) * (f - POLES[1])))


def through(f: FloatArray, values: ComplexArray, supports: int) -> Interpolation:
    """Every other of increasing frequencies is a support, as far as they go."""
    inside = np.zeros(f.size, dtype=bool)
    inside[np.round(np.linspace(0, f.size - 1, supports)).astype(int)] = True
    return Interpolation(
        supports_hz=f[inside], supports=values[inside], others_hz=f[~inside], others=values[~inside]
    )


def test_six_values_give_two_lines_between_and_at_them() -> None:
    f = np.linspace(-1.0, 1.0, 6)
    found = through(f, two_lines(f), 3)
    assert found.degree == 2
    exact = two_lines(PLACES)
    assert np.max(np.abs(found.function(PLACES) / exact - 1.0)) < 1e-11
    assert np.array_equal(found.function(found.supports_hz), found.supports)
    assert np.max(found.uncertainty(PLACES)) < 1e-11


def test_a_function_of_a_higher_degree_is_uncertain_where_it_is_wrong() -> None:
    """Degree one cannot hold two lines, and says so, by about as much as it is wrong."""
    f = np.linspace(-1.0, 1.0, 4)
    found = through(f, two_lines(f), 2)
    wrong = np.abs(found.function(PLACES) / two_lines(PLACES) - 1.0)
    assert np.max(wrong) > 0.5
    assert np.max(found.uncertainty(PLACES)) > 0.2 * np.max(wrong)


def test_further_values_are_wanted_where_they_tell_most_until_all_is_known() -> None:
    f = np.linspace(-1.0, 1.0, 4)
    found = through(f, two_lines(f), 2)
    places = found.wanted_hz(PLACES)
    assert len(set(places)) == 2
    assert not np.isin(places, found.frequency_hz).any()
    grown = found.with_values(places, two_lines(np.array(places)))
    assert grown.degree == 2
    assert np.max(np.abs(grown.function(PLACES) / two_lines(PLACES) - 1.0)) < 1e-11
    with pytest.raises(ValueError, match="1 frequencies"):
        found.wanted_hz(np.append(found.frequency_hz, 0.123))


def test_noise_is_told_as_uncertainty() -> None:
    """In 50 draws five times what it says holds the error, and it says no more than is there."""
    rng, f = np.random.default_rng(3), np.linspace(-1.0, 1.0, 8)
    exact = two_lines(PLACES)
    for _ in range(50):
        noise = 1e-8 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
        found = through(f, two_lines(f) * (1.0 + noise), 4)
        error = float(np.max(np.abs(found.function(PLACES) / exact - 1.0)))
        said = float(np.max(found.uncertainty(PLACES)))
        assert error < 5.0 * said
        assert said > 1e-9


def test_no_response_has_no_interpolation() -> None:
    """Zeros, as where no drive reaches the output: uncertain without end, and no exception."""
    f = np.linspace(-1.0, 1.0, 6)
    found = through(f, np.zeros(6, dtype=complex), 3)
    assert np.all(np.isinf(found.uncertainty(PLACES)))


def test_several_at_once_are_what_each_is_and_one_without_value_spoils_no_other() -> None:
    f = np.linspace(-1.0, 1.0, 6)
    values = np.array([two_lines(f), np.full(f.size, np.nan), 3.0j * two_lines(f + 0.1)])
    inside = np.array([True, False, True, False, False, True])
    found = Interpolation(
        supports_hz=f[inside],
        supports=values[:, inside],
        others_hz=f[~inside],
        others=values[:, ~inside],
    ).at(PLACES)
    for row, exact in ((0, two_lines(PLACES)), (2, 3.0j * two_lines(PLACES + 0.1))):
        assert np.max(np.abs(found.values[row] / exact - 1.0)) < 1e-10
        assert np.max(found.uncertainty[row]) < 1e-10
    assert np.all(np.isinf(found.uncertainty[1]))
