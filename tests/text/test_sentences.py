"""Every kind of finding has a block in the template and a row in the documentation."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from fitting.text import rendering
from fitting.text.finding import SEVERITIES, Finding, Kind
from fitting.text.rendering import sentence, warning_sentences

ROOT = Path(__file__).resolve().parents[2]


def test_every_kind_has_one_block_and_one_row() -> None:
    template = (rendering.TEMPLATES / "findings.txt.j2").read_text("utf-8")
    blocks = re.findall(r"macro (\w+)\(s, n, names\)", template)
    assert sorted(blocks) == sorted(kind.value for kind in Kind)
    page = (ROOT / "docs/reference/findings.md").read_text("utf-8")
    rows = re.findall(r"^\* `(\w+)`(?: \((\w+)(?:, else \w+)?\))?: .{10}", page, re.MULTILINE)
    assert [kind for kind, _ in rows] == [kind.value for kind in Kind]
    assert {severity or "warning" for _, severity in rows} <= set(SEVERITIES)


def test_a_name_is_spelled_as_it_is_and_other_sentences_begin_with_a_capital() -> None:
    bound = Finding(
        kind=Kind.outside_interval,
        severity="warning",
        subject="theta",
        numbers={"value": 1.0, "low": 2.0, "high": 3.0},
        names={"unit": ("rad",)},
    )
    assert sentence(bound).startswith("theta = 1")
    noisy = Finding(kind=Kind.not_converged, severity="error", subject="measurements")
    assert sentence(noisy).startswith("The fit")


def test_notes_are_no_warnings_and_nothing_is_said_twice() -> None:
    note = Finding(kind=Kind.scale_none, severity="note", subject="scale")
    error = Finding(kind=Kind.not_converged, severity="error", subject="a")
    assert warning_sentences((note, error, error)) == (sentence(error),)


def test_what_a_block_needs_and_does_not_have_is_an_error() -> None:
    with pytest.raises(Exception, match="error"):
        sentence(Finding(kind=Kind.not_periodic, severity="warning", subject="x"))


def test_starts_that_differ_are_listed_by_their_keys() -> None:
    found = Finding(
        kind=Kind.starts_differ,
        severity="note",
        subject="theta",
        numbers={"start_one": 1.5, "start_other": 2.0},
        names={"keys": ("start",), "campaigns": ("q1", "q2")},
    )
    assert sentence(found).startswith("'theta' has start 1.5 and 2 in q1 and q2")
