"""One description of a table, read back from terminal, page and file."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import html

from fitting.report.table import (
    Cell,
    Table,
    csv_text,
    html_table,
    numeric,
    table,
    terminal_text,
    text_lines,
    wrapped,
)
from fitting.report.tables import symbol
from fitting.text.notation import number
from tests.support import plot_records
from tests.support import report_records as records

#: Two modes: symbol, frequency, a number that may be missing, words.
TABLE = Table(
    caption="Modes",
    heads=(Cell("mode"), Cell("frequency (Hz)"), Cell("share"), Cell("remark")),
    rows=(
        (
            symbol("eta_plus"),
            numeric(6940260.125, 7),
            numeric(9.6e-7, 2),
            Cell("observed in all the spectra of the series"),
        ),
        (symbol("eta_minus"), numeric(7027600.5), numeric(math.nan), Cell("<not> observed")),
    ),
    note="A note & more.",
)
FREQUENCIES = (6940260.125, 7027600.5)


def test_a_terminal_gets_aligned_columns_in_plain_signs() -> None:
    assert text_lines(TABLE) == [
        "mode       frequency (Hz)   share  remark",
        "eta_plus          6940260  9.6e-7  observed in all the spectra of the series",
        "eta_minus       7027600.5       -  <not> observed",
    ]


def test_a_file_gets_exact_numbers_in_the_unit_of_its_head() -> None:
    rows = list(csv.reader(io.StringIO(csv_text(TABLE))))
    assert rows[0] == ["mode", "frequency (Hz)", "share", "remark"]
    assert [float(row[1]) for row in rows[1:]] == [*FREQUENCIES]
    assert [row[2] for row in rows[1:]] == ["9.6e-07", ""]


def test_a_page_gets_names_and_both_the_shown_and_the_exact_number() -> None:
    root = html.fromstring(html_table(TABLE))
    (table,) = root.iter("table")
    assert table.findtext("caption") == "Modes"
    assert [h.text_content() for h in table.findall("thead/tr/th")] == [
        "mode",
        "frequency (Hz)",
        "share",
        "remark",
    ]
    first, second = table.findall("tbody/tr")
    assert first[0].text_content() == "η₊"
    assert first[0].get("scope") == "row"
    assert first[1].text_content() == "6940260"
    assert float(first[1].find("data").get("value")) == FREQUENCIES[0]
    assert second[2].find("data") is None
    assert [cell.get("class") for cell in second[1:]] == ["n", "n", "words"]
    assert second[3].text_content() == "<not> observed"
    assert not list(root.iter("script"))
    assert root.find("p").text_content() == "A note & more."


def test_a_notebook_shows_a_table_by_itself() -> None:
    shown = TABLE._repr_html_()
    assert shown == html_table(TABLE)
    assert type(shown) is str  # one of jinja's would escape what it is joined to


def test_names_cannot_become_markup() -> None:
    evil = "<script>alert(1)</script>"
    made = table("pairs", caption=evil, heads=(evil, evil), pairs={evil: evil})
    root = html.fromstring(html_table(made))
    assert not list(root.iter("script"))
    assert root.find("table/caption").text == evil


def test_a_table_by_its_name_keeps_numbers_that_are_exact() -> None:
    series = [(1e-300, 12), (0.1 + 0.2, 3)]
    rows = [{"value": exact, "draws": count} for exact, count in series]
    made = table("pairs", caption="Draws", heads=("value", "draws"), pairs=dict(series))
    assert [(row[0].value, row[1].value) for row in made.rows] == series
    assert len(rows) == len(made.rows)


def test_what_separates_cells_cannot_come_from_names() -> None:
    made = table("pairs", caption="¦ a", heads=("b¦", "¶ c"), pairs={"d\n¦ e": "¶ f ␟"})
    assert [len(row) for row in (made.heads, *made.rows)] == [2, 2]
    assert not made.note


def test_rows_must_fill_their_columns() -> None:
    with pytest.raises(ValueError, match=r"Modes: 1 .* 2 "):
        Table(caption="Modes", heads=(Cell("a"), Cell("b")), rows=((Cell("only"),),))


@given(st.floats(-1e300, 1e300), st.integers(1, 12))
def test_a_terminal_s_number_is_the_number_to_its_digits(value: float, digits: int) -> None:
    shown = float(terminal_text(number(value, digits)))
    assert shown == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits), abs=5e-324)


def test_a_result_in_short_gives_no_value_where_the_data_give_none() -> None:
    data = records.campaign()
    lines = text_lines(table("intervals", result=records.result_for(data), ends=False))
    assert lines[0].split()[:5] == ["parameter", "value", "unit", "std", "reference"]
    told = {line.split()[0]: line.split() for line in lines[1:]}
    assert told["theta"][1] == "-"
    verdict = " ".join(told["lambda"][5:])
    assert verdict.startswith("unconstrained (63000 to 781000")
    assert told["d1"][1:6] == ["93.42", "Hz", "0.24", "94", "determined"]


def test_what_is_not_determined_has_no_value_and_few_digits_of_where_a_search_stopped() -> None:
    result = records.result_for(records.campaign())
    for shown, name, likely, stopped in (
        (table("parameters", result=result), "theta", "value", "1.96"),
        (table("derived", result=result), "lambda", "mean", "657000"),
    ):
        [row] = [r for r in shown.rows if r[0].text == name]
        cells = dict(zip([head.text for head in shown.heads], row, strict=True))
        assert cells[likely].text == "–"
        assert cells[likely].value is None
        assert cells["Algorithm 2"].text == stopped


def test_deviations_are_told_to_be_those_of_algorithm_2() -> None:
    """χ² of the headline is that of another point: its residuals are not in the table."""
    data = records.campaign()
    result = records.result_for(data)
    peaks = table("peaks", result=result, data=data)
    for shown in (peaks, table("mean_deviations", result=result, data=data)):
        assert re.search("“after” .*Algorithm 2", shown.note)


def test_errors_have_two_digits_and_other_estimates_the_digits_of_the_error() -> None:
    """A std of 0.6 beside 94.65; Algorithm 2's and the profile's values have no digits beyond."""
    result = records.result_for(records.campaign())
    changed: dict[str, Any] = {
        "value": 94.6537,
        "most_likely": 94.6537,
        "std": 0.6,
        "algorithm2": 94.5372231,
        "ci95": (93.4, 95.8),
    }
    d1 = replace(result.parameters["d1"], **changed)
    derived = replace(result.derived["D11"], **changed)
    result = replace(
        result,
        parameters={**result.parameters, "d1": d1},
        derived={**result.derived, "D11": derived},
    )
    [row] = [r for r in table("intervals", result=result, ends=False).rows if r[0].text == "d1"]
    assert [cell.text for cell in row[1:4]] == ["94.65", "Hz", "0.60"]
    for shown, name in (
        (table("parameters", result=result), "d1"),
        (table("derived", result=result), "D11"),
    ):
        heads = [head.text for head in shown.heads]
        [row] = [r for r in shown.rows if r[0].text == name]
        cells = dict(zip(heads, row, strict=True))
        assert (cells["std"].text, cells["Algorithm 2"].text) == ("0.60", "94.54")
        assert cells["Algorithm 2"].value == 94.5372231  # the page keeps all digits behind it
    known = plot_records.determined()
    value = replace(
        known.parameters["d1"], value=94.653722, ci68=(93.99, 95.34), ci95=(93.36, 95.99)
    )
    profiled = replace(known, parameters={"d1": value}, derived={})
    [row] = table("profiles", known=profiled).rows
    assert [cell.text for cell in row[2:4]] == ["94.65", "93.99 to 95.34"]


def test_a_line_breaks_between_values_and_never_inside_one() -> None:
    said = ", ".join(f"line_{k} = {k}.25 ± 0.{k}3 µV" for k in range(1, 9))
    lines = wrapped(f"known:     {said}", 11)
    assert max(map(len, lines)) <= 100
    assert len(lines) > 2
    assert all(line.startswith(" " * 11) for line in lines[1:])
    values = [value for line in lines for value in line.removeprefix("known:").split(",")]
    assert [value.strip() for value in values if value.strip()] == said.split(", ")
    whole = "/a/path/" + "that/no/line/breaks/" * 8
    assert wrapped(f"written: {whole}")[1] == whole


def test_chi_square_over_nu_says_which_degrees_of_freedom_it_is_held_against() -> None:
    """Those of all data, `tests/inference/test_nu_choice.py`: the headline has fewer."""
    found = table("nu", nu=plot_records.nu_choice())
    assert re.search(r"\b12\b.* 95 %", found.note)
