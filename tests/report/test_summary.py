"""The first screen: values, what is unconstrained, warnings, the next step."""

from __future__ import annotations

import math
import re
import shlex
from dataclasses import replace

import pytest

import fitting as ff
from fitting.fit.fit import Status
from fitting.lines.record import NO_STRUCTURE, TriedForm, line_numbers
from fitting.report.published import latex, rows_of
from fitting.report.screen import printed
from fitting.report.summary import (
    Summary,
    detail_lines,
    next_step,
    result_lines,
    summary_lines,
    summary_of,
)
from fitting.report.table import table as table_of
from fitting.report.table import text_lines
from fitting.result.assembly import without_profiles
from fitting.result.result import Result
from fitting.text.estimate import Closed, Verdict
from fitting.text.finding import Finding, Kind
from tests.support import plot_records
from tests.support import report_records as records


@pytest.fixture(scope="module")
def result() -> Result:
    """d1 and D11 are determined, theta and lambda are not; the line's width is 94 ± 0.24 Hz."""
    return records.result_for(records.campaign())


def with_width(result: Result, value: float, std: float) -> Result:
    """The sweep's line is that of d1, of which the fit of the peaks says this."""
    assert result.line is not None
    d1 = replace(result.parameters["d1"], value=value, std=std)
    return replace(
        result,
        parameters={**result.parameters, "d1": d1},
        line=replace(result.line, values={"d1": "width"}),
    )


def fit(background: str) -> TriedForm:
    eta, width = records.ETA_HZ, records.WIDTH_HZ
    structure = replace(NO_STRUCTURE, p_value=0.5, points=41.0, widening=1.0)
    numbers = line_numbers((eta, 0.11), (width, 0.24), (eta / width, 190.0))
    return TriedForm(
        **numbers, name=background, rms_residual=4e-3, structure=structure, message="done"
    )


def names(summary: Summary) -> list[str]:
    """Names of the values that have an error."""
    return [value.name for value in summary.values]


def line_of(lines: list[str], head: str) -> str:
    """The entry with a head, its further lines joined."""
    text = "\n".join(lines)
    found = re.search(rf"^  {re.escape(head)} +(.*(?:\n {{17}}.*)*)", text, re.MULTILINE)
    assert found is not None, text
    return " ".join(found[1].split())


def warning(kind: Kind, **parts: object) -> Finding:
    return Finding(kind=kind, severity="warning", subject="x", **parts)  # type: ignore[arg-type]


def test_values_and_what_is_unconstrained_are_told_apart(result: Result) -> None:
    summary = summary_of(result)
    assert set(names(summary)) == {"d1", "D11"}
    text = "; ".join(summary.unconstrained)
    assert "θ" in text
    assert "λ 63.3–781 kHz (all that the model allows)" in text


def test_values_without_effect_are_called_that_and_no_range_is_told(result: Result) -> None:
    knowledge = replace(plot_records.determined().knowledge, without_effect=("theta",))
    first, *others = summary_of(replace(result, knowledge=knowledge)).unconstrained
    assert first == "θ (no effect on these data)"
    assert not any("θ" in text for text in others)


def test_a_screen_has_fifteen_lines_and_no_more_than_three_warnings(result: Result) -> None:
    many = tuple(warning(Kind.not_periodic, numbers={"error": 10.0**-k}) for k in range(1, 9))
    urgent = warning(Kind.drift_exchanged)
    lines = result_lines(replace(result, findings=(*many, urgent)))
    assert len(lines) <= 15
    assert sum(line.startswith("  warning") for line in lines) == 3
    # a cause comes first
    assert "Check their order" in line_of(lines, "warning")
    assert "6 more warnings" in "\n".join(lines)


def test_status_and_chi_square_stand_in_the_first_line(result: Result) -> None:
    tested = replace(result, title="A string", chi_square=4.16, dof=4.0)
    assert re.fullmatch(
        r"A string \(synthetic data\) +converged, χ²/dof = 4.16/4", result_lines(tested)[0]
    )
    wrong = replace(tested, status=Status.MISFIT)
    assert "does not describe the data, χ²/dof" in " ".join(result_lines(wrong)[:2])
    assert "estimated from the residuals" in " ".join(
        result_lines(replace(tested, chi_square=math.nan))[:2]
    )


def test_a_whole_period_is_no_interval(result: Result) -> None:
    """Any π of an angle that goes round at π is all of it; a little less is an interval."""
    theta = replace(result.parameters["theta"], period=math.pi, ci95=(0.31, 0.31 + math.pi))
    for found, answered, row in (
        (theta, "any value of the period", "whole period"),
        (replace(theta, ci95=(0.31, 3.4)), "0.31–3.4 rad", "0.31 to 3.40"),
    ):
        there = replace(result, parameters={**result.parameters, "theta": found})
        said = "; ".join(summary_of(there).unconstrained)
        assert re.search(rf"θ \([^)]*{re.escape(answered)}", said), said
        [line] = [
            line
            for line in text_lines(table_of("intervals", result=there, ends=False))
            if line.startswith("theta")
        ]
        assert row in line
        [cells] = [
            cells for cells in table_of("parameters", result=there).rows if cells[0].text == "theta"
        ]
        assert cells[4].text == ("whole period" if found is theta else "0.31 to 3.40")
        [published] = [each for each in rows_of(there) if each[0].name == "theta"]
        written = latex([published]).splitlines()[5].replace("~", " ")
        _, value, _, verdict, *_ = (cell.strip() for cell in written.split(" & "))
        assert (value, verdict) == ("--", Verdict.UNCONSTRAINED)
        assert published[0].ci95 == found.ci95


@pytest.mark.parametrize(
    ("ends", "told"),
    [(("periodic", "periodic"), False), (("bound", "bound"), True)],
)
def test_in_python_too_a_whole_period_is_no_interval(
    ends: tuple[Closed, Closed], told: bool
) -> None:
    theta = ff.Value(
        name="theta",
        role="parameter",
        unit="rad",
        value=math.nan,
        status=Verdict.UNCONSTRAINED,
        reason="every value around its period fits",
        lower=-6.28,
        upper=6.28,
        most_likely=1.9,
        ci95=(0.31, 3.46),
        closed_by=ends,
        scan=plot_records.profile()[1],
    )
    said = repr(theta)
    assert said.startswith("theta: ")
    assert Verdict.UNCONSTRAINED in said
    assert ("0.31 to 3.46 rad" in said) is told
    assert bool(re.search(r"\d", said)) is told


def test_a_search_that_was_cut_is_a_short_word_in_its_row(result: Result) -> None:
    """What would help is said once, below the table."""
    nowhere = (math.nan, math.nan)
    cut = {
        name: replace(
            p,
            status=Verdict.UNKNOWN,
            ci95=nowhere,
            closed_by=("", ""),
        )
        for name, p in result.parameters.items()
    }
    scan = replace(plot_records.profile()[1], stopped=("budget", "budget"))
    knowledge = replace(plot_records.determined().knowledge, scans=dict.fromkeys(cut, scan))
    table = table_of("intervals", result=replace(result, parameters=cut, knowledge=knowledge))
    verdicts = [row[-1].text for row in table.rows[:2]]
    assert all(text == f"{Verdict.UNKNOWN}: search incomplete" for text in verdicts)
    assert not any("budget" in text for text in verdicts)
    assert table.note.count("--budget") == 1
    assert not table_of("intervals", result=result).note


def test_what_holds_only_under_an_assumption_is_warned_of(result: Result) -> None:
    found = warning(
        Kind.assumed_value,
        numbers={"assumed_g2": 0.0, "step": 0.1, "move": 1.0},
        names={
            "values": ("theta", "d1"),
            "assumed": ("g2",),
            "units": ("",),
            "example": ("g2", "", "d1"),
        },
    )
    profiled = replace(result, findings=(found,), knowledge=plot_records.determined().knowledge)
    lines = summary_lines(summary_of(profiled))
    said = line_of(lines, "warning")
    assert "θ and d₁ hold only if g2 = 0" in said
    assert "one standard error higher" in said
    assert "g₂" in line_of(lines, "next")


def test_a_verdict_that_rests_on_boxes_names_them_wherever_it_stands(result: Result) -> None:
    found = replace(result.parameters["d1"], active_bounds=("d2", "theta"))
    there = replace(result, parameters={**result.parameters, "d1": found})
    where = "within the bounds of d2 and theta"
    [shown] = [v for v in summary_of(there).values if v.name == "d1"]
    assert shown.remark == where
    for table in (
        table_of("intervals", result=there, ends=False),
        table_of("parameters", result=there),
    ):
        [said] = [row[-1].text for row in table.rows if row[0].text == "d1"]
        assert said.startswith("determined")
        assert said.endswith(where)
    [row] = [row for row, _ in rows_of(there) if row.name == "d1"]
    assert f"{row.status}{row.condition}" == f"determined {where}"
    assert not any(row.condition for row, _ in rows_of(result))


def shown(result: Result, name: str) -> str:
    """How a value is printed."""
    [value] = [v for v in summary_of(result).values if v.name == name]
    return printed(value).replace("\u00a0", " ")


def test_the_sweep_s_own_line_is_printed_where_it_is_the_better_one(result: Result) -> None:
    line = result.line
    assert line is not None
    better = with_width(result, line.width.value + 1.25, 0.7)
    assert shown(better, "d1") == f"d₁ {line.width.value:.2f} ± 0.24 Hz (from the sweep)"


@pytest.mark.parametrize(("off", "std"), [(0.1, 0.2), (5.0, 0.7)], ids=["better", "contradicts"])
def test_the_fit_is_printed_where_it_is_better_or_the_sweep_contradicts(
    result: Result, off: float, std: float
) -> None:
    assert result.line is not None
    there = with_width(result, result.line.width.value + off, std)
    assert "sweep" not in shown(there, "d1")


def test_a_line_that_depends_on_its_background_is_not_called_the_best(result: Result) -> None:
    found = with_width(result, 94.5, 0.7)
    assert found.line is not None
    assert "sweep" in shown(found, "d1")
    doubtful = replace(found.line, forms=(fit("none"), fit("complex")), background_p=1e-9)
    assert "sweep" not in shown(replace(found, line=doubtful), "d1")
    harmless = replace(doubtful, background_p=0.5)
    assert "sweep" in shown(replace(found, line=harmless), "d1")


def test_the_next_step_is_a_command_that_can_be_copied(result: Result) -> None:
    origin = replace(
        result.provenance,
        command="fmu-fit reconstruct 'a b.toml' more.toml --out 'my out' --quick",
    )
    told = f"{origin.command} --resume --no-profiles --no-report"
    summary = summary_of(replace(result, provenance=replace(origin, command=told)))
    assert "profiles" in summary.advice
    assert summary.command == f"{origin.command} --no-report"
    summary = summary_of(replace(result, provenance=replace(origin, command="")))
    assert summary.advice.endswith(": ff.profile")
    assert summary.command == ""
    profiled = replace(result, provenance=origin, knowledge=plot_records.determined().knowledge)
    summary = summary_of(profiled)
    words = ["fmu-fit", "design", "a b.toml", "more.toml", "--at", "my out/result.json"]
    assert shlex.split(summary.command) == [*words, "--target", "lambda"]
    # in one line, whatever its length
    assert sum(summary.command in line for line in summary_lines(summary)) == 1


def test_nothing_is_proposed_where_every_value_is_determined(result: Result) -> None:
    done = replace(
        result,
        parameters={"d1": result.parameters["d1"]},
        derived={"D11": result.derived["D11"]},
        knowledge=plot_records.determined().knowledge,
    )
    summary = summary_of(done)
    assert not summary.unconstrained
    assert "none needed" in summary.advice
    assert not summary.command


def test_profiles_that_were_not_completed_are_gone_on_with(result: Result) -> None:
    """Only one command is offered, that with --resume, and it keeps the budget."""
    asked = "fmu-fit reconstruct a.toml --budget 900 --no-report"
    origin = replace(result.provenance, command=asked)
    ended = without_profiles(replace(result, provenance=origin), "pending")
    assert summary_of(ended).command == f"{asked} --resume"
    again = replace(origin, command=f"{asked} --resume")
    assert summary_of(replace(ended, provenance=again)).command == f"{asked} --resume"
    spent = without_profiles(replace(result, provenance=origin), "budget")
    words = ["fmu-fit", "reconstruct", "a.toml", "--no-report"]  # without the budget
    assert shlex.split(summary_of(spent).command) == words
    assert "budget" in " ".join(spent.warnings)


@pytest.mark.parametrize(
    ("status", "told"),
    [
        (Status.INTERRUPTED, "--resume"),
        (Status.NOT_CONVERGED, "--starts"),
        (Status.MISFIT, "another model"),
    ],
)
def test_a_bad_end_has_another_next_step(result: Result, status: Status, told: str) -> None:
    assert told in summary_of(replace(result, status=status)).advice


@pytest.mark.parametrize("keys", [(), ("[sweep] background",)])
def test_a_background_is_proposed_where_the_campaign_can_have_one(
    result: Result, keys: tuple[str, ...]
) -> None:
    found = warning(Kind.correlated_residuals, numbers={"widening": 2.0}, names={"keys": keys})
    known = replace(result, knowledge=plot_records.determined().knowledge, findings=(found,))
    advice, _ = next_step(known, {})
    assert "another model" in advice
    assert ("background" in advice) is bool(keys)


def test_values_that_the_samples_leave_are_decided_by_the_bounds(result: Result) -> None:
    """No further measurement of the kind tells f from f - rate."""
    found = warning(
        Kind.sampling_ambiguity,
        numbers={"rate_hz": 10.0},
        names={"frequencies": ("f1", "f1 − 10 Hz")},
    )
    known = replace(result, knowledge=plot_records.determined().knowledge, findings=(found,))
    summary = summary_of(known)
    assert "bounds" in summary.advice
    assert not summary.command


def test_of_a_model_that_does_not_describe_the_data_no_value_is_printed(result: Result) -> None:
    gone = {
        name: replace(p, status=Verdict.WITHDRAWN, std=math.nan, ci95=(math.nan, math.nan))
        for name, p in result.parameters.items()
    }
    bad = replace(result, status=Status.MISFIT, parameters=gone, derived={})
    summary = summary_of(bad)
    assert not [*summary.values, *summary.limits, *summary.unconstrained, *summary.unknown]


def test_withdrawn_values_of_campaigns_that_contradict_have_their_reason(result: Result) -> None:
    d1 = replace(result.parameters["d1"], status=Verdict.WITHDRAWN, reason="one: 90, two: 97")
    there = replace(result, status=Status.CONVERGED, parameters={"d1": d1}, derived={})
    assert summary_of(there).unknown == ("d₁ (one: 90, two: 97)",)


def test_what_only_the_measurement_brings_along_is_no_target(result: Result) -> None:
    """A cable's delay: nobody has asked for it."""
    profiled = replace(result, knowledge=plot_records.determined().knowledge)
    delay = replace(result.parameters["d1"], status=Verdict.UNCONSTRAINED, asked=False)
    known = {"d1": result.parameters["d1"], "cable_delay": delay}
    told = summary_of(replace(profiled, parameters=known, derived={}))
    assert "cable_delay" not in f"{told.advice} {told.command}"


def test_an_output_that_is_a_parameter_is_printed_once(result: Result) -> None:
    """One mode's width, under the name of the output beside that of the parameter."""
    d1, output = result.parameters["d1"], result.derived["D11"]
    same = replace(
        output,
        **{name: getattr(d1, name) for name in ("value", "std", "ci95", "unit", "status")},
        most_likely=d1.most_likely,
        spread=0.0,
    )
    twice = replace(result, derived={"width": same}, line=None)
    assert [value.symbols for value in summary_of(twice).values] == [("d₁", "width")]
    rows = [
        line.split()
        for line in text_lines(table_of("intervals", result=twice, ends=False))
        if line.startswith("width")
    ]
    assert rows == [["width", "-", d1.unit, "-", "-", "=", "d1"]]
    other = replace(same, value=1.001 * d1.value)
    apart = summary_of(replace(twice, derived={"width": other}))
    assert set(names(apart)) == {"d1", "width"}


def test_two_outputs_that_are_one_number_are_printed_once(result: Result) -> None:
    """Two equal circuits: f1 is f2, whatever the parameters are."""
    f1 = replace(result.derived["D11"], spread=0.0)
    for f2, once in (
        (replace(f1), True),
        (replace(f1, value=1.001 * f1.value), False),
        (replace(f1, unit="rad"), False),
        (replace(f1, ci95=(f1.ci95[0], 2.0 * f1.ci95[1])), False),
    ):
        pair = replace(result, derived={"f1": f1, "f2": f2}, line=None)
        symbols = [value.symbols for value in summary_of(pair).values]
        assert (("f₁", "f₂") in symbols) is once


def test_the_details_hold_every_finding_once(result: Result) -> None:
    found = (warning(Kind.drift_exchanged), warning(Kind.not_periodic, numbers={"error": 0.1}))
    text = " ".join(detail_lines(replace(result, findings=found)))
    assert text.count("Check their order") == 1
    assert text.count("differ from mean and tones") == 1


def test_where_noise_is_larger_than_stated_it_is_to_be_stated(result: Result) -> None:
    kind, numbers = Kind.noise_underestimated, {"factor": 2.91}
    larger = Finding(kind=kind, severity="warning", subject="measurements", numbers=numbers)
    determined = {
        name: replace(p, status=Verdict.DETERMINED) for name, p in result.parameters.items()
    }
    knowledge = plot_records.determined().knowledge
    there = replace(
        result, findings=(larger,), parameters=determined, derived={}, knowledge=knowledge
    )
    words, command = next_step(there, {})
    assert "2.91" in words
    assert command == ""
    assert next_step(replace(there, findings=()), {})[0] != words
