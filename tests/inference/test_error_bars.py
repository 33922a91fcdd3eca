"""What is written beside a value, against likelihoods whose intervals are written down by hand."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.api.fitted import Value
from fitting.fit.fit import solve_problem
from fitting.fit.options import Options, Schedule
from fitting.fit.problem import Problem
from fitting.inference.infer import infer
from fitting.report.published import write_values
from fitting.report.screen import phrase, printed_lines
from fitting.report.summary import summary_lines, summary_of
from fitting.report.table import csv_text, text_lines
from fitting.report.table import table as table_of
from fitting.result.calibration import Calibration
from fitting.text.arrays import FloatArray
from fitting.text.estimate import (
    EVEN,
    ErrorBars,
    FittedEstimate,
    ParameterEstimate,
    Verdict,
    error_bars,
)
from tests.support import report_records as records
from tests.support.whitened import Z95, parameter, whitened

#: A valley that is narrow at its bottom and wide above: asinh(d/DEEP)/STEEP is 1 at d = 25.
DEEP = 10.0
STEEP = math.asinh(2.5)


def found_of(row: Callable[[float], float], start: float, top: float) -> FittedEstimate:
    """One value whose chi square is row(p)^2, in three rows, through fit and profile."""
    objective = whitened(
        lambda p: np.full(3, row(float(p[0])) / math.sqrt(3.0)),
        parameter("p", start / 100.0, top, start=start, unit="Hz"),
    )
    problem = Problem(objective.parameters, objective.data)
    options = Options(schedule=Schedule(starts=1, nu_start=1e-6, iterations=2))
    return infer(solve_problem(problem, lambda _: objective.response, options)).parameters["p"]


def words_of(found: FittedEstimate) -> str:
    return phrase("values", "reported", found).replace("\u00a0", " ")


def test_a_parabola_has_one_error() -> None:
    found = found_of(lambda p: (p - 4.0) / 0.5, start=5.0, top=40.0)
    assert words_of(found) == "4.00 ± 0.50 Hz"
    assert found.bars.is_even
    assert found.bars.covers95


def test_sides_of_different_length_are_both_told() -> None:
    """1/p is measured, 0.25 ± 0.04: 68 % from 1/0.29 to 1/0.21, 95 % from 1/0.3284 to 1/0.1716."""
    found = found_of(lambda p: (1.0 / p - 0.25) / 0.04, start=5.0, top=40.0)
    assert found.bars.below == pytest.approx(4.0 - 1.0 / 0.29, rel=0.03)
    assert found.bars.above == pytest.approx(1.0 / 0.21 - 4.0, rel=0.03)
    assert found.ci95 == pytest.approx((1.0 / 0.3284, 1.0 / 0.1716), rel=0.01)
    assert found.std == pytest.approx(0.5 * (1.0 / 0.21 - 1.0 / 0.29), rel=0.03)
    assert words_of(found) in {f"4.00 +0.7{a} −0.5{b} Hz" for a in "567" for b in "456"}


def test_an_interval_that_the_error_does_not_tell_stands_beside_it() -> None:
    """The valley of a coupling that was seen: ± 25 in an interval of ± 126, not ± 49."""
    found = found_of(lambda p: math.asinh((p - 235.0) / DEEP) / STEEP, start=260.0, top=2000.0)
    half = DEEP * math.sinh(STEEP * Z95)
    assert 120.0 < half < 130.0
    assert found.status is Verdict.BOUNDED
    assert found.bars.is_even
    assert not found.bars.covers95
    told = words_of(found)
    assert told.startswith("235 ± 2")
    low, high = (float(end) for end in told.partition("(")[2].partition(" Hz")[0].split(" to "))
    assert low == pytest.approx(235.0 - half, abs=4.0)
    assert high == pytest.approx(235.0 + half, abs=4.0)


def profile_of(near: FloatArray, far: FloatArray) -> FittedEstimate:
    """Of 500 Hz, with sides at 68 % and at 95 %."""
    return FittedEstimate(
        name="f",
        role="parameter",
        unit="Hz",
        value=500.0,
        ci68=(500.0 - near[0], 500.0 + near[1]),
        ci95=(500.0 - far[0], 500.0 + far[1]),
        status=Verdict.DETERMINED,
    )


@pytest.mark.parametrize("ratio", [0.5, 0.75, 0.85, 1.0, 1.2, 1.3, 2.0, 8.0])
@pytest.mark.parametrize("longer", [0.5, 0.7, 1.0, 1.4, 1.6, 8.0])
@pytest.mark.parametrize("simulation", [0.0, 50.0])
def test_no_side_is_far_from_what_is_told_of_it(
    ratio: float, longer: float, simulation: float
) -> None:
    """Below ±, and 1.96 times ±, both ends lie within an eighth and within a half."""
    sides = np.array([10.0, 10.0 * ratio])
    ends = Z95 * sides * (1.0, longer)
    near, far = sides + simulation, ends + simulation
    profile = profile_of(near, far)
    bars = error_bars(profile.likely, profile.ci68, profile.ci95, simulation)
    assert (bars.below, bars.above) == pytest.approx(tuple(near))
    if bars.is_even:
        assert np.all(np.abs(near / np.mean(near) - 1.0) < 0.125)
    assert bars.covers95 == (1 / 1.5 < longer < 1.5)
    assert error_bars(profile.likely, (math.nan, math.nan), profile.ci95, simulation) == EVEN


UNEVEN = ErrorBars(below=8.9, above=12.8, is_even=False, covers95=False)


def test_answer_tables_and_files_tell_both_sides(tmp_path: Path) -> None:
    result = records.result_for(records.campaign())
    d1 = replace(
        result.parameters["d1"],
        value=94.0,
        std=10.85,
        ci68=(94.0 - 8.9, 94.0 + 12.8),
        ci95=(40.0, 130.0),
        unit="Hz",
    )
    uneven = replace(result, parameters={**result.parameters, "d1": d1}, line=None)
    summary = summary_of(uneven)
    [shown] = [v.text.replace("\u00a0", " ") for v in summary.values if v.name == "d1"]
    assert shown.startswith("94.0 +12.8 −8.9 Hz ")
    assert "40.0 to 130.0 Hz" in shown
    assert "94.0 +12.8 -8.9 Hz " in " ".join(summary_lines(summary))
    table = table_of("intervals", result=uneven)
    [line] = [line for line in text_lines(table) if line.startswith("d1")]
    assert "  +12.8 -8.9  40.0 to 130.0" in line
    [row] = [
        row for row in csv.DictReader(io.StringIO(csv_text(table))) if row["parameter"] == "d1"
    ]
    assert float(row["std"]) == 10.85
    values, latex = write_values(uneven, tmp_path)
    rows = csv.DictReader(io.StringIO(values.read_text("utf-8")))
    [row] = [row for row in rows if row["name"] == "d1"]
    assert float(row["ci68 low"]) == pytest.approx(94.0 - 8.9)
    assert float(row["ci68 high"]) == pytest.approx(94.0 + 12.8)
    assert "$94.0^{+12.8}_{-8.9}$~Hz & 40.0 to " in latex.read_text("utf-8")


def test_a_value_from_python_tells_both_sides() -> None:
    profile = profile_of(np.array([20.0, 40.0]), np.array([39.2, 78.4]))
    value = Value(
        name="f",
        role="parameter",
        unit="Hz",
        value=500.0,
        std=30.0,
        status=Verdict.DETERMINED,
        ci95=profile.ci95,
    )
    assert repr(value) == "f = 500 ± 30 Hz, determined"
    assert repr(replace(value, ci68=profile.ci68)) == "f = 500 +40 −20 Hz, determined"


def test_a_value_that_is_handed_on_takes_its_sides_into_the_unit_of_the_fmu() -> None:
    handed = ParameterEstimate(
        name="d1",
        value=0.094,
        unit="kHz",
        std=0.01085,
        ci68=(0.094 - 0.0089, 0.094 + 0.0128),
        ci95=(0.094 - 0.0174, 0.094 + 0.0251),
        status=Verdict.DETERMINED,
    )
    found = Calibration(
        parameters=(handed,), left={}, campaign_values={}, settings={}, open_settings={}
    )
    line = printed_lines("calibration", "screen", "a fit", found, EVEN, False, ())[1]
    assert line.replace("\u00a0", " ").endswith("d1 = 0.0940 +0.0128 -0.0089 kHz")


def test_sides_take_the_unit_and_the_power_of_ten_of_their_value() -> None:
    def told(value: float, below: float, above: float, unit: str) -> str:
        bars = ErrorBars(below=below, above=above, is_even=False)
        words = bars.words(value, 0.5 * (below + above), unit, (math.nan, math.nan))
        return words.replace("\u00a0", " ")

    assert told(647400.0, 200.0, 400.0, "Hz") == "647.40 +0.40 −0.20 kHz"
    # an error that would be all zeros in kHz
    assert told(647400.0, 0.02, 0.04, "Hz") == "647400.000 +0.040 −0.020 Hz"
    assert told(1.2e30, 1e29, 2e29, "1/s") == "(1.20 +0.20 −0.10) × 10³⁰ 1/s"
    assert told(-4.0, 0.1, 0.2, "") == "−4.00 +0.20 −0.10"
