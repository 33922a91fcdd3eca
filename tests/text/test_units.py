"""Quantities as people and FMUs write them; truth is decimal arithmetic and the SI brochure."""

from __future__ import annotations

import itertools
import math
from decimal import Decimal
from typing import Any

import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fitting.text.errors import BadInput
from fitting.text.tables import hertz_of
from fitting.text.units import (
    COMMON,
    convert,
    dimension_of,
    is_frequency,
    parse_quantity,
    product_words,
    same_kind,
)

W = "campaign.toml, key fmu.start.u1"


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        ("6.94016 MHz", 6.94016, "MHz"),
        ("6.94016MHz", 6.94016, "MHz"),
        ("  -3e-6 V ", -3e-6, "V"),
        ("1.9498", 1.9498, None),
        (".5 rad", 0.5, "rad"),
        ("2. kg.m2", 2.0, "kg.m2"),
    ],
)
def test_written_quantity_is_split(text: str, value: float, unit: str | None) -> None:
    assert parse_quantity(text, where=W) == (value, unit)


@pytest.mark.parametrize(
    "text",
    ["", "MHz", "6,94016 MHz", "1e999 Hz", "nan Hz", "inf", "6.9 zorg", "3 __import__", "--3"],
)
def test_nonsense_is_refused_with_place_and_finding(text: str) -> None:
    with pytest.raises(BadInput) as complaint:
        parse_quantity(text, where=W)
    assert str(complaint.value).startswith(W)
    assert repr(text) in str(complaint.value)


@pytest.mark.parametrize(
    ("value", "unit", "wanted", "truth"),
    [
        (6.94016, "MHz", "Hz", 6940160.0),
        (6.94036, "MHz", "Hz", 6940360.0),
        (7.0275, "MHz", "Hz", 7027500.0),
        (180, "deg", "rad", math.pi),
        (60, "rpm", "rad/s", 2 * math.pi),
        (1, "kg.m2", "g.cm2", 1e7),
        (9.81, "m/s2", "mm/s2", 9810.0),
        (2, "N/m", "kg/s2", 2.0),
        (20, "degC", "K", 293.15),
        (0.3, "µV", "V", 3e-7),
        (0.3, "uV", None, 3e-7),
        (2, "Ohm", "kOhm", 0.002),
        (5, "%", "1", 0.05),
        (5, "-", "1", 5.0),
    ],
)
def test_conversion(value: float, unit: str, wanted: str | None, truth: float) -> None:
    assert convert(value, unit, wanted, where=W) == truth


def test_common_units_are_those_of_pint() -> None:
    """They are known without it: kind, factor and dimensions of each pair are its own."""
    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(non_int_type=Decimal)
    for unit, other in itertools.product(COMMON, repeat=2):
        one, two = (
            registry.parse_units({"": "1", "-": "1", "1": ""}.get(u, u.replace("s2", "s**2")))
            for u in (unit, other)
        )
        angles = [u in ("rad", "mrad", "deg", "rad/s") for u in (unit, other)]  # plain to pint
        assert same_kind(unit, other) == (
            one.dimensionality == two.dimensionality and angles[0] == angles[1]
        )
        if same_kind(unit, other):
            truth = str(registry.Quantity(Decimal("0.3"), one).to(two).magnitude)
            assert convert(0.3, unit, other, where=W) == float(truth), (unit, other)
        assert dimension_of(unit, where=W) == {
            str(n): float(str(p)) for n, p in one.dimensionality.items()
        }


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [
        ("Hz", "V"),
        ("s", "Hz"),
        ("Hz", "rad/s"),  # a factor of 2π that dimensions alone do not show
        ("rad/s", "Hz"),
        ("N.m", "N.m/rad"),
        ("zorg", "Hz"),
        ("Hz", "zorg"),
        ("dBm", "W"),
    ],
)
def test_units_that_do_not_fit_are_refused(unit: str, wanted: str) -> None:
    with pytest.raises(BadInput, match=unit):
        convert(1.0, unit, wanted, where=W)
    assert not same_kind(unit, wanted)


@pytest.mark.parametrize(
    ("powers", "words"),
    [
        ({"Hz": 2.0, "V": -1.0}, "Hz²/V"),
        ({"kHz/mV": 1.0, "V": 1.0}, "kHz"),
        ({"Hz": 1.0, "1": 1.0}, "Hz"),
        ({"s": 1.0, "Hz": 1.0}, "a plain number"),
        ({}, "a plain number"),
        ({"degC": 1.0}, "°C"),
    ],
)
def test_a_product_of_units_is_told_in_those_units(powers: dict[str, float], words: str) -> None:
    assert product_words(powers) == words


def test_private_unit_of_an_fmu_is_taken_as_it_is() -> None:
    assert convert(3.5, "zorg/frob", "zorg/frob", where=W) == 3.5


@given(st.decimals(-(10**6), 10**6, places=9, allow_nan=False))
@settings(max_examples=200, deadline=None)
def test_decimal_prefixes_round_once(value: Decimal) -> None:
    number = float(value)
    exact = Decimal(repr(number))
    assert convert(number, "MHz", "Hz", where=W) == float(exact * 10**6)
    assert convert(number, "mHz", "Hz", where=W) == float(exact / 1000)


@given(st.text(max_size=30))
@settings(max_examples=150, deadline=None)
def test_any_text_is_a_quantity_or_bad_input(text: str) -> None:
    try:
        value, unit = parse_quantity(text, where=W)
    except BadInput:
        return
    assert math.isfinite(value)
    assert unit is None or convert(1.0, unit, unit, where=W) == 1.0


def test_frequencies_of_a_column_are_hertz_whichever_way_they_count() -> None:
    """Cycles are rounded once; angular frequencies are divided by 2 pi."""
    assert hertz_of([6.94016], "MHz", where="").tolist() == [6940160.0]
    angular = hertz_of([2e3 * math.pi, 0.0], "rad/s", where="")
    assert angular == pytest.approx([1000.0, 0.0], rel=1e-15)
    assert hertz_of([2.0 * math.pi], "krad/s", where="") == pytest.approx([1000.0], rel=1e-15)
    assert is_frequency("krad/s")
    assert not is_frequency("rad")
    with pytest.raises(BadInput, match=r"column 'f': .*'s', .*'Hz'"):
        hertz_of([1.0], "s", where="column 'f'")
