"""The answer first: what is known, what is not, what next, and whose number is the best."""

from __future__ import annotations

import math
import re
import shlex
from dataclasses import replace

import pytest

import fitting as ff
from fitting.inference.ending import Ending
from fitting.inference.sweep_line import LineFit
from fitting.inference.verdict import Verdict
from fitting.report.table import text_lines
from fitting.report.tables.published import latex, rows_of
from fitting.report.tables.values import interval_table, parameter_table, values_table
from fitting.report.words.answer import (
    BY_SWEEP,
    CUT_SHORT,
    NO_PROFILES,
    answer_lines,
    answer_of,
)
from fitting.report.words.result import further_warnings, result_lines
from fitting.result.result import Result
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


def fit(background: str) -> LineFit:
    return LineFit(
        background=background,
        frequency_hz=records.ETA_HZ,
        frequency_std_hz=0.11,
        width_hz=records.WIDTH_HZ,
        width_std_hz=0.24,
        q=records.ETA_HZ / records.WIDTH_HZ,
        q_std=190.0,
        residual=4e-3,
        structure_p=0.5,
        points=41.0,
        widening=1.0,
        message="done",
    )


def test_known_and_not_known_are_told_apart(result: Result) -> None:
    answer = answer_of(result)
    assert {k.name for k in answer.known} == {"d1", "D11"}
    assert [words.partition(" (")[0] for words in answer.open] == ["theta", "lambda"]
    assert "63 to 781 kHz" in answer.open_words.replace("\u00a0", " ")


def test_a_whole_period_is_no_interval(result: Result) -> None:
    """Any π of an angle that goes round at π is all of it; a little less is an interval."""
    theta = replace(result.parameters["theta"], period=math.pi, ci95=(0.31, 0.31 + math.pi))
    for found, answered, row in (
        (theta, "3.14 rad", "whole period"),
        (replace(theta, ci95=(0.31, 3.4)), "0.31 to 3.40 rad", "0.31 to 3.40"),
    ):
        there = replace(result, parameters={**result.parameters, "theta": found})
        said = answer_of(there).open_words.replace("\u00a0", " ")
        assert re.search(rf"\btheta \([^)]*{re.escape(answered)}", said)
        [line] = [line for line in text_lines(values_table(there, "")) if line.startswith("theta")]
        assert row in line
        [cells] = [cells for cells in parameter_table(there).rows if cells[0].text == "theta"]
        assert cells[4].text == ("whole period" if found is theta else "0.31 to 3.40")
        [published] = [each for each in rows_of(there) if each.name == "theta"]
        written = latex([published]).splitlines()[5].replace("~", " ")
        _, value, interval, verdict, *_ = (cell.strip() for cell in written.split(" & "))
        assert (value, verdict) == ("--", Verdict.OPEN)
        assert answered in interval
        assert (published.low, published.high) == found.ci95


@pytest.mark.parametrize(
    ("ends", "told"),
    [(("round", "round"), False), (("bound", "bound"), True)],
)
def test_in_python_too_a_whole_period_is_no_interval(ends: tuple[str, str], told: bool) -> None:
    profile = replace(plot_records.profile(), verdict=Verdict.OPEN, ends=ends, boxes=())
    nothing = math.nan
    theta = ff.Value(
        name="theta",
        kind="parameter",
        unit="rad",
        value=nothing,
        std=nothing,
        verdict=Verdict.OPEN,
        reason="every value around its period fits",
        range=(-6.28, 6.28),
        stopped_at=1.9,
        algorithm2=1.9,
        reference=1.9,
        interval95=(0.31, 3.46),
        profile=profile,
    )
    said = repr(theta)
    assert said.startswith("theta: ")
    assert Verdict.OPEN in said
    assert ("0.31 to 3.46 rad" in said) is told
    assert bool(re.search(r"\d", said)) is told


def test_a_search_that_was_cut_is_a_short_word_in_its_row(result: Result) -> None:
    """What would help is said once, below the table."""
    nowhere = (math.nan, math.nan)
    cut = {
        name: replace(
            p,
            identifiable=Verdict.UNKNOWN,
            ci95=nowhere,
            reason="on both sides the search was cut for its cost",
        )
        for name, p in result.parameters.items()
    }
    table = interval_table(replace(result, parameters=cut), "")
    verdicts = [row[-1].text for row in table.rows[:2]]
    assert all(text.startswith(f"{Verdict.UNKNOWN}: cut") for text in verdicts)
    assert not any("budget" in text for text in verdicts)
    assert table.note.count("--budget") == 1
    assert not interval_table(result, "").note


def test_what_holds_under_a_condition_alone_stands_with_it(result: Result) -> None:
    said = (
        "theta and d1 hold only if g2 = 0, which nobody measured and these data do not tell: with "
        "g2 0.1 higher, say, the fit is as good, and d1 one standard error above what is told."
    )
    answer = answer_of(replace(result, warnings=(said,)))
    assert [k.name for k in answer.by_data] == ["D11"]
    assert [k.name for k in answer.resting] == ["d1"]
    told = " ".join(" ".join(answer_lines(answer)).replace("\u00a0", " ").split())
    assert told.startswith("known: D11 = ")
    assert "given: d1 = " in told
    assert told.count("d1 = ") == 1
    alone = answer_of(replace(result, warnings=(said.replace("theta and d1", "d1 and D11"),)))
    assert "given" in alone.nothing


def test_a_verdict_that_rests_on_boxes_names_them_wherever_it_stands(result: Result) -> None:
    found = replace(result.parameters["d1"], boxes=("d2", "theta"))
    there = replace(result, parameters={**result.parameters, "d1": found})
    where = "in the boxes of d2 and theta"
    assert f"d1 = 93.42 ± 0.24 Hz ({where})" in "\n".join(answer_lines(answer_of(there))).replace(
        "\u00a0", " "
    )
    for table in (values_table(there, ""), parameter_table(there)):
        [said] = [row[-1].text for row in table.rows if row[0].text == "d1"]
        assert said.startswith("determined")
        assert said.endswith(where)
    [row] = [row for row in rows_of(there) if row.name == "d1"]
    assert row.verdict == f"determined {where}"
    assert not any("box" in row.verdict for row in rows_of(result))


def test_the_sweep_s_own_line_is_told_where_it_knows_better(result: Result) -> None:
    line = result.line
    assert line is not None
    answer = answer_of(with_width(result, line.width_hz + 1.25, 0.7))
    known = next(k for k in answer.known if k.name == "d1")
    assert known.shown.replace("\u00a0", " ") == f"= {line.width_hz:.2f} ± 0.24 Hz"
    assert known.told == f"{known.shown} ({BY_SWEEP})"
    [first] = [said for said in answer_lines(answer) if said.startswith("known:")]
    assert f"d1 {known.told}".replace("\u00a0", " ") in first.replace("\u00a0", " ")
    # hypot(0.7, 0.24) = 0.74 Hz
    assert known.apart == pytest.approx(1.25 / 0.74)
    assert answer.notes[0].startswith("d1 ")
    assert re.search(r"\b1\.7\b", answer.notes[0])


@pytest.mark.parametrize(("off", "std"), [(0.1, 0.2), (5.0, 0.7)], ids=["better", "contradicts"])
def test_the_fit_is_told_where_it_knows_better_or_the_sweep_contradicts(
    result: Result, off: float, std: float
) -> None:
    assert result.line is not None
    answer = answer_of(with_width(result, result.line.width_hz + off, std))
    assert not any(k.fitted for k in answer.known)
    assert len(answer.notes) == 1


def test_a_line_that_depends_on_its_background_is_not_called_the_best(result: Result) -> None:
    found = with_width(result, 94.5, 0.7)
    assert found.line is not None
    assert len(answer_of(found).notes) == 2
    doubtful = replace(found.line, fits=(fit("none"), fit("complex")), background_p=1e-9)
    assert len(answer_of(replace(found, line=doubtful)).notes) == 1
    harmless = replace(doubtful, background_p=0.5)
    assert len(answer_of(replace(found, line=harmless)).notes) == 2


def test_the_next_step_is_a_command_that_can_be_copied(result: Result) -> None:
    origin = replace(
        result.provenance,
        command="fmu-fit reconstruct 'a b.toml' more.toml --out 'my out' --quick",
    )
    told = f"{origin.command} --resume --no-profiles --no-report"
    answer = answer_of(replace(result, provenance=replace(origin, command=told)))
    assert answer.advice.startswith("profiles")
    assert answer.command == f"{origin.command} --no-report"
    answer = answer_of(replace(result, provenance=replace(origin, command="")))
    assert answer.advice.endswith(": ff.profile")
    assert answer.command == ""
    profiled = replace(result, provenance=origin, knowledge=plot_records.knowledge())
    answer = answer_of(profiled)
    words = ["fmu-fit", "design", "a b.toml", "more.toml", "--at", "my out/result.json"]
    assert shlex.split(answer.command) == [*words, "--target", "lambda"]
    [line] = [line for line in answer_lines(answer) if line.startswith("next:")]
    assert answer.command in line


def test_profiles_that_were_not_done_are_gone_on_with(result: Result) -> None:
    """Only one command is offered, that with --resume, and it keeps the budget."""
    asked = "fmu-fit reconstruct a.toml --budget 900 --no-report"
    origin = replace(result.provenance, command=asked)
    ended = replace(result, provenance=origin, warnings=(*result.warnings, NO_PROFILES))
    assert answer_of(ended).command == f"{asked} --resume"
    again = replace(origin, command=f"{asked} --resume")
    assert answer_of(replace(ended, provenance=again)).command == f"{asked} --resume"
    spent = replace(ended, warnings=(CUT_SHORT,))
    words = ["fmu-fit", "reconstruct", "a.toml", "--no-report"]  # without the budget
    assert shlex.split(answer_of(spent).command) == words


@pytest.mark.parametrize("told", [NO_PROFILES, CUT_SHORT])
def test_without_profiles_verdicts_are_not_said_to_be_missing(told: str) -> None:
    """Every row has one: linearised only, or not known."""
    assert "no verdict" not in told


@pytest.mark.parametrize(
    ("status", "told"),
    [
        ("interrupted", "--resume"),
        ("not converged", "a start nearer"),
        ("does not describe the data", "another model"),
    ],
)
def test_a_bad_end_has_another_next_step(result: Result, status: str, told: str) -> None:
    assert told in answer_of(replace(result, status=status)).advice


def test_values_that_the_samples_leave_are_settled_by_the_box(result: Result) -> None:
    """No further measurement of the kind tells f from f - rate."""
    knowledge = plot_records.knowledge()
    said = ("Sampled 10 times a second, f1 and f1 − 10 Hz give the same record: a box decides.",)
    knowledge = replace(knowledge, sentences=(*knowledge.sentences, *said))
    answer = answer_of(replace(result, knowledge=knowledge))
    assert answer.advice.startswith("a box ")
    assert not answer.command


def test_of_a_model_that_does_not_describe_the_data_nothing_is_known(result: Result) -> None:
    why = "the model does not describe the data"
    gone = {
        name: replace(
            p, identifiable=Verdict.WITHDRAWN, std=math.nan, ci95=(math.nan, math.nan), reason=why
        )
        for name, p in result.parameters.items()
    }
    assert result.line is not None
    bad = replace(
        result,
        status="does not describe the data",
        parameters=gone,
        derived={},
        line=replace(result.line, values={"d1": "width"}),
    )
    answer = answer_of(bad)
    assert not answer.by_data
    assert answer.nothing == "nothing"
    [said] = answer.open
    assert said.startswith("theta and d1 (")
    knowledge = plot_records.knowledge()
    misfit = replace(knowledge.adequacy, chi_square=4e3, p_value=0.0, describes=False)
    judged = replace(bad, knowledge=replace(knowledge, adequacy=misfit))
    assert "94.00 ± 0.24 Hz" in answer_of(judged).nothing.replace("\u00a0", " ")
    # where the sweep itself may be wrong its line tells nothing
    for doubt in (replace(misfit, absent="a line"), replace(misfit, scale_off=2.0)):
        there = replace(knowledge, adequacy=doubt)
        assert answer_of(replace(bad, knowledge=there)).nothing == "nothing"


def test_the_answer_stands_before_all_else_and_nothing_is_said_twice(result: Result) -> None:
    ending = Ending(words="converged and describes the data", ground="χ² = 4 on 4", whole=True)
    done = "All 3 levels were done."
    said = ending.told(done)
    verdict = "Not determined by these data: theta, lambda. Prior and start decide where these " + (
        "values are reported."
    )
    told = replace(result, ending=ending, message=said, warnings=(verdict, "Another one."))
    lines = result_lines(told)
    assert lines[1] == f"{ending.words.capitalize()}: {ending.ground}."
    assert [line.split(":")[0] for line in lines[3:6]] == ["known", "not known", "next"]
    assert sum(done in line for line in lines) == 1
    assert further_warnings(told) == ("Another one.",)
    assert sum("± holds 68 %" in line for line in lines) == 1
    failed = replace(told, status="not converged", ending=Ending(words="not converged"))
    message = "Not converged. Why."
    assert result_lines(replace(failed, message=message))[1] == message


@pytest.mark.parametrize(
    ("ground", "told"),
    [
        ("errors 12 times as wide for residuals that hang together", "not noise"),
        ("χ² = 9 on 9 degrees of freedom", "less noise"),
    ],
    ids=["structure", "noise"],
)
def test_structure_of_the_residuals_comes_before_less_noise(
    result: Result, ground: str, told: str
) -> None:
    known = replace(
        result,
        peaks=(),
        parameters={"d1": result.parameters["d1"]},
        derived={"D11": result.derived["D11"]},
        knowledge=plot_records.knowledge(),
        ending=Ending(words="converged and describes the data", ground=ground),
    )
    answer = answer_of(known)
    assert not answer.open
    assert told in answer.advice


def test_nothing_is_proposed_that_only_the_measurement_brings_along(result: Result) -> None:
    """A cable's delay is known worst, or not at all: nobody has asked for it."""
    profiled = replace(result, knowledge=plot_records.knowledge())
    for verdict in (Verdict.DETERMINED, Verdict.OPEN):
        delay = replace(
            result.parameters["d1"], value=1e-9, std=1e-7, identifiable=verdict, asked=False
        )
        known = {"d1": result.parameters["d1"], "cable_delay": delay}
        told = answer_of(replace(profiled, parameters=known, derived={}))
        assert "cable_delay" not in f"{told.advice} {told.command}"
        assert "d1" in f"{told.advice} {told.command}"


def test_an_output_that_is_a_parameter_is_told_once(result: Result) -> None:
    """One mode's width, under the name of the output beside that of the parameter."""
    d1, output = result.parameters["d1"], result.derived["D11"]
    same = replace(
        output,
        **{name: getattr(d1, name) for name in ("value", "std", "ci95", "unit", "identifiable")},
        most_likely=d1.most_likely,
        spread=0.0,
    )
    twice = replace(result, derived={"width": same}, line=None)
    known = answer_of(twice)
    assert [k.named for k in known.known] == ["d1 = width"]
    rows = [
        line.split() for line in text_lines(values_table(twice, "")) if line.startswith("width")
    ]
    assert rows == [["width", "-", d1.unit, "-", "-", "=", "d1"]]
    other = replace(same, value=1.001 * d1.value)
    apart = answer_of(replace(twice, derived={"width": other}))
    assert {k.named for k in apart.known} == {"d1", "width"}


def test_two_outputs_that_are_one_number_are_told_once(result: Result) -> None:
    """Two equal circuits: f1 is f2, whatever the parameters are."""
    f1 = replace(result.derived["D11"], spread=0.0)
    for f2, names in (
        (replace(f1), {"d1", "f1 = f2"}),
        (replace(f1, value=1.001 * f1.value), {"d1", "f1", "f2"}),
        (replace(f1, unit="rad"), {"d1", "f1", "f2"}),
        (replace(f1, ci95=(f1.ci95[0], 2.0 * f1.ci95[1])), {"d1", "f1", "f2"}),
    ):
        pair = replace(result, derived={"f1": f1, "f2": f2}, line=None)
        assert {k.named for k in answer_of(pair).known} == names


@pytest.mark.parametrize("reported", ["likelihood", "algorithm2"])
def test_of_a_value_beyond_its_box_that_of_the_data_is_known(result: Result, reported: str) -> None:
    """93.42 ± 0.24 Hz in a box up to 90 Hz, where Algorithm 2 ended: nobody is to believe 90."""
    d1 = result.parameters["d1"]
    out = replace(d1, upper=90.0, algorithm2=90.0, most_likely=d1.value)
    if reported == "algorithm2":
        out = replace(out, value=90.0)
    there = replace(
        result, parameters={**result.parameters, "d1": out}, line=None, status="converged"
    )
    answer = answer_of(there)
    known = next(k for k in answer.known if k.name == "d1")
    shown = known.shown.replace("\u00a0", " ")
    assert known.beyond
    assert shown.startswith("= 93.42 ± 0.24 Hz (")
    assert "90 Hz" in shown
    note = answer.notes[0].replace("\u00a0", " ")
    assert note.startswith("d1: ")
    assert "93.42" in note
    assert "90 Hz" in note
    advice = answer.advice.replace("\u00a0", " ")
    assert advice.startswith("a box of d1 ")
    assert re.findall(r"[\d.]+ Hz", advice) == ["93.425 Hz", "90 Hz"]
    [row] = [row for row in values_table(there, there.title).rows if row[0].text == "d1"]
    assert any("beyond" in cell.text and "90 Hz" in cell.text for cell in row)
    inside = answer_of(replace(result, line=None))
    assert all(not k.beyond for k in inside.known)
