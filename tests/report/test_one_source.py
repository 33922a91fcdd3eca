"""Intervals, and the bounds that a verdict rests on, are the same in every output."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from fitting.report.published import rows_of
from fitting.report.same_values import same_values
from fitting.report.screen import phrase
from fitting.result.assembly import result_of
from fitting.result.result import Result
from fitting.text.estimate import OutputEstimate, ParameterEstimate, Verdict
from fitting.text.records import to_plain
from tests.inference.test_misfit_rule import ORIGIN
from tests.support.curve_fits import U as PLACES
from tests.support.curve_fits import fitted_line, inferred, line, sweep

THETA = ParameterEstimate(
    name="theta",
    value=1.2,
    unit="rad",
    std=math.nan,
    ci95=(0.0, math.pi),
    reference=1.0,
    start=1.0,
    lower=0.0,
    upper=math.pi,
    shrinkage=0.0,
    status=Verdict.UNCONSTRAINED,
    algorithm2=1.2,
    most_likely=1.2,
    period=math.pi,
)


@pytest.fixture(scope="module")
def result() -> Result:
    fit = fitted_line(sweep(line(PLACES), 0.02))
    return result_of(fit, inferred(fit), ORIGIN)


def test_an_interval_of_a_whole_period_is_the_same_in_both_files(result: Result) -> None:
    written = replace(result, parameters={"theta": THETA}, derived={})
    [row] = [row for row, _ in rows_of(written) if row.name == "theta"]
    low, high = to_plain(written)["parameters"]["theta"]["ci95"]
    assert row.ci95 == (low, high)


@pytest.mark.parametrize("verdict", [v for v in Verdict if v is not Verdict.WITHDRAWN])
def test_the_bounds_that_a_verdict_rests_on_are_named_everywhere(
    result: Result, verdict: Verdict
) -> None:
    found = replace(
        THETA,
        std=0.1,
        ci95=(1.0, 1.4),
        status=verdict,
        active_bounds=("d1", "d2"),
        reason="for a reason",
    )
    [(row, _)] = rows_of(replace(result, parameters={"theta": found}, derived={}, line=None))
    status = f"{row.status}{row.condition}"
    for text in (
        status,
        phrase("values", "verdict", found),
        phrase("knowledge", "profile", found.name, found),
    ):
        assert "d1" in text
        assert "d2" in text


def test_an_output_that_rests_on_other_bounds_is_no_other_name_of_a_parameter(
    result: Result,
) -> None:
    known = replace(THETA, ci95=(1.0, 1.4), status=Verdict.DETERMINED, period=None)
    same = OutputEstimate(
        name="angle",
        value=1.2,
        unit="rad",
        values=(1.2,),
        spread=0.0,
        std=0.1,
        ci95=(1.0, 1.4),
        reference=1.0,
        shrinkage=0.9,
        status=Verdict.DETERMINED,
        lower=0.0,
        upper=3.0,
        algorithm2=1.2,
    )
    both = replace(result, parameters={"theta": known}, derived={"angle": same})
    assert same_values(both) == {"angle": "theta"}
    other = replace(both, derived={"angle": replace(same, active_bounds=("d1",))})
    assert same_values(other) == {}
