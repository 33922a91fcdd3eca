"""Cells of CSV files: no spreadsheet takes a name for a formula, and readers find it as it was."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitting.lab import writer
from fitting.text.tables import csv_line, csv_text, read_table, split_line

FITTING = Path(__file__).parents[2] / "fitting"
#: As spreadsheets see them: such a cell is worked out, unless it is a number.
FORMULA = re.compile(r"\s*[=+\-@].")
NAMES = ("=1+1", "+cmd|' /C calc'!A1", "-x", "@sum", "'=1", "''+a", "'a", "=a,b", '="a"', " =1")


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@given(
    st.lists(
        st.one_of(
            st.sampled_from(NAMES),
            st.floats().map(repr),
            st.text("=+-@',\"ab1 ", max_size=6).map(str.strip),
        ),
        min_size=2,
        max_size=4,
    )
)
def test_names_are_no_formulas_and_are_read_back(cells: list[str]) -> None:
    line = csv_line(cells)
    assert split_line(line, ",") == tuple(cell.strip() for cell in cells)
    [seen] = csv.reader(io.StringIO(line))
    assert [c for c in seen if FORMULA.match(c) and not is_number(c)] == []
    numbers = [number for number in cells if is_number(number)]
    assert [number in seen for number in numbers] == [True] * len(numbers)


@pytest.mark.parametrize("name", NAMES[:5])
def test_a_column_and_a_label_come_back(name: str, tmp_path: Path) -> None:
    columns: dict[str, list[float | str]] = {"experiment": [name, "b"], f"{name} (V)": [-1.5, 2.0]}
    path = tmp_path / "table.csv"
    path.write_text(writer.csv_text(columns, ("made by a test",)), "utf-8")
    table = read_table(path)
    assert [column.name for column in table.columns] == ["experiment", name]
    assert table.cells == ((name, "-1.5"), ("b", "2.0"))


def test_there_is_one_writer() -> None:
    """Of every CSV file of the package."""
    assert csv_text([["a", "b"], ["1", ""]]) == "a,b\n1,\n"
    others = [
        path.relative_to(FITTING).as_posix()
        for path in sorted(FITTING.rglob("*.py"))
        if re.search(r"csv\.writer|DictWriter", path.read_text("utf-8"))
    ]
    assert others == ["text/tables.py"]
