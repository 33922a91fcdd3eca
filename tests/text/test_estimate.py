"""Names and words of 0.2.0 for values: they work, with a warning where a script uses them."""

from __future__ import annotations

from typing import Any

import pytest

from fitting.lines.record import number_of_line
from fitting.result.schema import upgraded
from fitting.text.estimate import Estimate, Verdict


def test_the_old_status_works_with_a_warning() -> None:
    with pytest.warns(DeprecationWarning, match="unconstrained"):
        assert getattr(Verdict, "OPEN") is Verdict.UNCONSTRAINED  # noqa: B009 - no name of now
    with pytest.warns(DeprecationWarning, match="unconstrained"):
        assert Verdict.UNCONSTRAINED == "not determined"
    with pytest.warns(DeprecationWarning, match="unconstrained"):
        assert Verdict.DETERMINED != "not determined"
    assert Verdict.UNCONSTRAINED == "unconstrained"
    assert hash(Verdict.UNCONSTRAINED) == hash("unconstrained")
    with pytest.raises(AttributeError, match="CLOSED"):
        getattr(Verdict, "CLOSED")  # noqa: B009 - no name at all


def test_files_with_old_words_are_read_without_one() -> None:
    assert Verdict("not determined") is Verdict.UNCONSTRAINED
    old = {"status": "not determined", "closed_by": ["round", "cost"]}
    kept = {"status": "determined", "closed_by": ["crossed", "held"]}
    data: dict[str, Any] = {
        "schema": 2,
        "parameters": {"theta": old, "w": kept},
        "knowledge": {"scans": {"theta": {"held": []}, "w": {"held": ["d"]}}},
    }
    read = upgraded(data)
    assert read["parameters"]["theta"] == {"status": "unconstrained", "closed_by": ["periodic", ""]}
    assert read["parameters"]["w"] == {"status": "determined", "closed_by": ["data", "bound"]}
    assert read["knowledge"]["scans"]["theta"]["stopped"] == ["", "budget"]
    assert upgraded(read) == read


def test_only_numbers_of_a_line_are_numbers() -> None:
    q = number_of_line("q", 1161.0, unit="1")
    with pytest.warns(DeprecationWarning, match="value"):
        assert 2.0 * q == 2322.0  # type: ignore[operator]
    plain = Estimate(name="q", value=1161.0, unit="1")
    with pytest.raises(TypeError):
        2.0 * plain  # type: ignore[operator]


def test_percentiles_and_qualities_that_were_written_before_are_values_now() -> None:
    old = {"median": 8.0, "std": 0.5, "interval95": [7.0, 9.0]}
    data: dict[str, Any] = {
        "schema": 2,
        "parameters": {"w": {"unit": "Hz"}},
        "knowledge": {"scans": {}, "sentences": ["A text."], "bootstrap": {"values": {"w": old}}},
        "quadratures": {"qualities": [{"name": "Q", "value": 10.0, "std": 1.0, "ci95": [8, 12]}]},
    }
    read = upgraded(data)
    now = {"name": "w", "value": 8.0, "unit": "Hz", "std": 0.5, "ci95": [7.0, 9.0]}
    assert read["knowledge"] == {"scans": {}, "bootstrap": {"values": {"w": now}}}
    assert read["quadratures"]["qualities"][0]["unit"] == ""
    assert data["quadratures"]["qualities"][0].get("unit") is None
