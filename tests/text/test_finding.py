"""A finding goes into a file of results and comes back as it was."""

from __future__ import annotations

import math

import pytest

from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind
from fitting.text.records import from_plain, to_plain


def test_a_finding_comes_back_from_a_file() -> None:
    found = Finding(
        kind=Kind.noise_underestimated,
        severity="warning",
        subject="sweep",
        numbers={"factor": 3.0, "p_value": math.inf},
    )
    plain = to_plain(found)
    assert plain["kind"] == "noise_underestimated"
    assert from_plain(Finding, plain) == found


def test_a_severity_that_does_not_exist_is_refused() -> None:
    plain = to_plain(Finding(kind=Kind.outlier, severity="note", subject="e1"))
    with pytest.raises(BadInput, match="severity"):
        from_plain(Finding, {**plain, "severity": "fatal"})
