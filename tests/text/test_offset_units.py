"""Units with a zero of their own: a value of them is no difference, and no plain number."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.draft.api import init
from fitting.measurements.time_record import Traces
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.units import Written, convert, in_unit
from tests.support.cfmu_build import build_lag_fmu, reworded
from tests.support.lines import write_csv


@pytest.mark.parametrize("unit", ["degC", "°C", "degF"])
def test_no_value_becomes_kelvin_where_nobody_wants_kelvin(unit: str) -> None:
    """Against a variable without a unit 20 degrees became 293.15, and nothing said so."""
    with pytest.raises(BadInput):
        convert(20.0, unit, None, where="x")
    with pytest.raises(BadInput):
        in_unit(Written(f"20 {unit}", None, "x"), None)
    assert convert(20.0, "degC", "K", where="x") == 293.15
    assert convert(20.0, "K", None, where="x") == 20.0
    assert convert(20.0, "mV", None, where="x") == 0.02


def unitless(folder: Path) -> Path:
    """The lag whose output and input declare no unit."""
    return reworded(build_lag_fmu(folder), {' unit="V"': ""})


CAMPAIGN = """title = "t"
[fmu]
file = "{fmu}"
[observe]
output = "y"
[[trace]]
file = "t.csv"
input = "u"
{more}
[[parameters]]
name = "tau"
start = "0.3 s"
lower = "0.1 s"
upper = "1 s"
{parameter}
"""


def recorded(folder: Path, head: str) -> None:
    t: FloatArray = np.array(0.01 * np.arange(100), dtype=float)
    write_csv(folder / "t.csv", head, t, np.ones(100), 20.0 + t)


@pytest.mark.parametrize("head", ["time (s),u (1),y (degC)", "time (s),u (degC),y (1)"])
def test_a_temperature_against_a_variable_without_a_unit_is_refused(
    head: str, tmp_path: Path
) -> None:
    fmu = unitless(tmp_path)
    recorded(tmp_path, head)
    text = CAMPAIGN.format(fmu=fmu.as_posix(), more="", parameter="")
    (tmp_path / "c.toml").write_text(text, "utf-8")
    with pytest.raises(BadInput, match="degC"):
        ff.Problem.of(ff.read_campaign(tmp_path / "c.toml"))
    with pytest.raises(BadInput, match="degC"):
        init(tmp_path / "t.csv", fmu, out=tmp_path / "o")


#: The parameter in kelvin, with numbers in degrees Celsius.
START = """[[parameters]]
name = "x_start"
start = "20 degC"
lower = "0 degC"
upper = "50 degC"
scale = "5 degC"
prior = "0.5 degC"
"""


def test_standard_deviations_in_degrees_are_those_in_kelvin(tmp_path: Path) -> None:
    """0.5 degC beside values in kelvin was 273.65 K: of sigma, of a prior, of a scale."""
    kelvin = '<UnitDefinitions><Unit name="K"><BaseUnit K="1"/></Unit>'
    words = {' unit="V"': ' unit="K"', "<UnitDefinitions>": kelvin}
    fmu = reworded(build_lag_fmu(tmp_path), words)
    recorded(tmp_path, "time (s),u (K),y (K)")
    more = 'sigma = "0.5 degC"'
    text = CAMPAIGN.format(fmu=fmu.as_posix(), more=more, parameter=START)
    (tmp_path / "c.toml").write_text(text, "utf-8")
    problem = ff.Problem.of(ff.read_campaign(tmp_path / "c.toml"))
    traces = next(m for m in problem.record.measurements if isinstance(m, Traces))
    assert traces.traces[0].sigma == 0.5
    parameter = next(p for p in problem.record.parameters if p.name == "x_start")
    assert (parameter.start, parameter.scale, parameter.prior_sigma) == (293.15, 5.0, 0.5)
