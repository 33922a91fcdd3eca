"""What goes into a publication: numbers of figures, tables of values, figures of a width."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from fitting.report.figures.data import HEADS, figure_csv
from fitting.report.figures.measurements import draw_measurement
from fitting.report.figures.reconstruction import ONE_COLUMN, TWO_COLUMNS, save_pdf
from fitting.report.figures.style import new_figure, style
from fitting.report.published import (
    latex,
    latex_name,
    latex_text,
    rows_of,
    write_values,
)
from fitting.result.result import Result
from tests.support import report_records as records


@pytest.fixture(scope="module")
def result() -> Result:
    """d1 is the width of the sweep's line, which knows it better: ± 0.24 Hz beside ± 0.7 Hz."""
    made = records.result_for(records.campaign())
    assert made.line is not None
    d1 = replace(made.parameters["d1"], value=made.line.width.value + 0.5, std=0.7)
    return replace(
        made,
        parameters={**made.parameters, "d1": d1},
        line=replace(made.line, values={"d1": "width"}),
    )


def test_the_points_of_a_figure_are_written_as_they_are_drawn() -> None:
    figure = Figure()
    upper, lower = figure.subplots(2, 1, sharex=True)
    x = np.linspace(0.1, 0.7, 4)
    upper.plot(x, x**2, label="λ₁ squared")
    upper.axhline(1.0)
    upper.set(ylabel="amplitude (V)", title="a panel")
    lower.scatter(x, -x, label="points")
    lower.vlines([0.2], [0.0], [3.0], label="bar")
    lower.set_xlabel("frequency (Hz)")
    head, *rows = csv.reader(io.StringIO(figure_csv(figure)))
    assert tuple(head) == HEADS
    own = [row for row in rows if row[0] == "a panel"]
    assert {tuple(row[1:4]) for row in own} == {("λ₁ squared", "frequency (Hz)", "amplitude (V)")}
    assert [(float(row[4]), float(row[5])) for row in own] == [(v, v**2) for v in x]
    rest = [(row[1], float(row[4]), float(row[5])) for row in rows if row[0] == "2"]
    assert rest == [*(("points", v, -v) for v in x), ("bar", 0.2, 0.0), ("bar", 0.2, 3.0)]


def test_values_are_exact_in_the_table_and_rounded_in_latex(result: Result, tmp_path: Path) -> None:
    assert result.line is not None
    table, text = write_values(result, tmp_path)
    rows = list(csv.DictReader(io.StringIO(table.read_text("utf-8"))))
    assert [row["name"] for row in rows] == ["theta", "d1", "d1", "lambda", "D11"]
    theta, fitted, swept, *_ = rows
    assert (theta["value"], theta["std"]) == ("", "")
    assert float(fitted["value"]) == result.parameters["d1"].value
    assert float(swept["value"]) == result.line.width.value
    assert fitted["source"] == "fit"
    assert "sweep" in swept["source"]
    # 95 % of a normal distribution
    assert float(swept["ci95 high"]) - float(swept["value"]) == pytest.approx(0.24 * 1.96, rel=1e-4)
    lines = [line for line in text.read_text("utf-8").splitlines() if " & " in line]
    assert len(lines) == 1 + len(rows)
    assert all(len(re.findall(r"(?<!\\)&", line)) == 4 for line in lines)
    assert all(line.endswith(r" \\") for line in lines)
    assert any(line.startswith(r"$\lambda$ & --") for line in lines)
    assert any(f"{result.line.width.value:.2f}~$\\pm$~0.24~Hz" in line for line in lines)


def test_names_are_written_for_latex() -> None:
    assert latex_name("eta_plus") == r"$\eta_{+}$"
    assert latex_name("Q_minus") == "$Q_{-}$"
    assert latex_name("width_plus") == r"width\_plus"
    assert latex_text("50 % of a_b & {c} ± 1") == r"50 \% of a\_b \& \{c\} $\pm$ 1"


@pytest.mark.parametrize("width", [ONE_COLUMN, TWO_COLUMNS], ids=["one column", "two columns"])
def test_figures_for_print_have_their_width_and_no_title(
    result: Result, width: float, tmp_path: Path
) -> None:
    pairs = enumerate(records.PAIRS_HZ[:2])
    data = records.campaign([records.experiment(f"pair{m + 1}", pair) for m, pair in pairs])
    result = records.result_for(data)
    with style(paper_width=width):
        drawings = [
            draw_measurement(records.response(data, result), data),
            draw_measurement(records.spectra(data, result), data),
        ]
        written = save_pdf(drawings, tmp_path, width)
        assert {d.drawn.get_suptitle() for d in drawings} == {"SYNTHETIC DATA"}
    # panels beside each other do not fit one column
    count = 1 if width == ONE_COLUMN else 2
    assert len(written) == count
    for path in written:
        content = path.read_bytes()
        box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", content)
        assert box is not None
        assert float(box[1]) == pytest.approx(72.0 * width)
    with style():
        assert new_figure("T", "C", synthetic=True, height=2.0).get_suptitle() == "T\nC"


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("9.8 × 10³¹ to 1.01 × 10³²", r"9.8 $\times$ 10$^{31}$ to 1.01 $\times$ 10$^{32}$"),
        ("2 × 10⁻⁹ V", r"2 $\times$ 10$^{-9}$ V"),
        ("0.16 Hz*F**0.5", r"0.16 Hz$\cdot$F$^{0.5}$"),
        ("4 Hz/V**2", r"4 Hz/V$^{2}$"),
    ],
)
def test_exponents_are_written_for_latex(text: str, written: str) -> None:
    """pdflatex: "Unicode character ³¹ not set up for use with LaTeX", and no table."""
    assert latex_text(text) == written


def test_every_letter_of_the_table_is_one_that_latex_knows(result: Result) -> None:
    rows = [
        (
            replace(row, value=scale * row.value, std=scale * row.std, ci95=(scale, 9 * scale)),
            source,
        )
        for row, source in rows_of(result)
        for scale in (1e-32, 1e-9, 1e31)
    ]
    found = {letter for letter in latex(rows) if ord(letter) > 126}
    assert found == set()
