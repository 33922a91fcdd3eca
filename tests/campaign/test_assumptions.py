"""[[assumptions]]: what else a fit would give, on a mode whose response is known in closed form."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.api.problem import Campaign
from fitting.report.screen import phrases
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind
from fitting.text.formula import Formula
from tests.campaign.test_laws import BEND, CAMPAIGN, ETA_HZ, SLOPE, WIDTH_HZ, written

#: e2/V0 is what the data know; a tenth more of all frequencies is a tenth less of the coefficients.
ASSUMED = """
[[assumptions]]
that = "V0 is a volt"
otherwise = "1.1 V"
quantity = "V0"
value = "1.1 V"

[[assumptions]]
that = "the law is of the eigenfrequency itself"
otherwise = "of one 0.1 % higher"
quantity = "eta_plus"
law = "1.001*eta_plus"

[[assumptions]]
that = "the curvature is downward"
otherwise = "upward"
start = { e2 = "-e2" }

[[assumptions]]
that = "the drive is as strong as it was stated"
otherwise = "1 % more"
quantity = "g1"
value = 1.01
"""


def campaign(tmp_path: Path, fmu: Path, tables: str) -> Campaign:
    """The scene of the laws with further tables, whose braces are no places to fill."""
    return ff.read_campaign(
        written(tmp_path, fmu, CAMPAIGN + tables.replace("{", "{{").replace("}", "}}"))
    )


def findings(tmp_path: Path, fmu: Path) -> tuple[Finding, ...]:
    fit = ff.fit(ff.Problem.of(campaign(tmp_path, fmu, ASSUMED)))
    assert len(phrases("result", "resting", fit.result)) == 4
    return tuple(f for f in fit.result.findings if f.kind is Kind.assumption)


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, 1) as opened:
        yield opened


def test_values_shift_as_the_closed_form_says(swift_fmu: Path, tmp_path: Path) -> None:
    constant, law, other, drive = findings(tmp_path, swift_fmu)
    assert constant.subject == "V0 is a volt; 1.1 V"
    assert constant.severity == "note"
    shifts = {name: constant.numbers[f"shift_{name}"] for name in ("d1", "e0", "e1", "e2")}
    assert shifts == pytest.approx({"d1": 0.0, "e0": 0.0, "e1": 0.0, "e2": 0.1 * BEND}, abs=1e-5)
    less = 1.0 / 1.001 - 1.0  # in Hz and Hz/V, also of what is fitted in kHz
    wanted = {"d1": 0.0, "e0": less * ETA_HZ, "e1": less * SLOPE, "e2": less * BEND}
    shifts = {name: law.numbers[f"shift_{name}"] for name in wanted}
    assert shifts == pytest.approx(wanted, rel=1e-3, abs=1e-5)
    # there is no second solution: the fit comes back, and nothing shifts
    back = {name: other.numbers[f"shift_{name}"] for name in wanted}
    assert back == pytest.approx(dict.fromkeys(wanted, 0.0), abs=1e-4)
    assert max(abs(f.numbers["chi_square"]) for f in (constant, law, other)) < 1e-3
    # a stronger drive wants a wider line, and cannot hide in it: the wings are higher, too
    assert 0.0 < drive.numbers["shift_d1"] < 0.05 * WIDTH_HZ
    assert drive.numbers["chi_square"] > 10.0
    q = {name: f.numbers["shift_Q_plus"] for name, f in (("drive", drive), ("law", law))}
    d1 = WIDTH_HZ + drive.numbers["shift_d1"]
    mean = ETA_HZ + BEND * 2.0  # over the voltages
    assert q["drive"] == pytest.approx(mean / d1 - mean / WIDTH_HZ, rel=0.02)
    assert q["law"] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("", "'quantity'.*'start'"),
        ('quantity = "V0"', "'value' or 'law'"),
        ('quantity = "V0"\nvalue = 1\nlaw = "e0"', "'value' or 'law'"),
        ('quantity = "V0"\nvalue = 1\nstart = { e0 = "e1" }', "start.*'quantity'"),
        ('quantity = "e0"\nvalue = 1', "'e0' is fitted"),
        ('quantity = "V1"\nvalue = 1', "'V1' is neither.*V0"),
        ('quantity = "V0"\nlaw = "2*V0"', "'V0' is a constant"),
        ('quantity = "eta_plus"\nvalue = "1 Hz"', "eta_plus.*'law'"),
        ('quantity = "eta_plus"\nlaw = "2*eta_plus + bias"', "eta_plus"),
        ('quantity = "eta_plus"\nlaw = "2*eta_plus + "', "formula"),
        ('quantity = "eta_plus"\nlaw = "eta_plus*sqrt(-bias**2 - V0**2)/V0"', "no finite value"),
        ('quantity = "eta_plus"\nlaw = "eta_plus + nobody"', "'nobody'"),
        ('start = { e9 = "e0" }', "'e9' is no.*e0"),
        ('start = { e0 = "e9" }', "'e9' is no.*e0"),
        ('quantity = "d2"\nvalue = "1 V"', "V.*Hz|Hz.*V"),
    ],
)
def test_what_is_no_assumption(
    fmu: ff.Fmu, swift_fmu: Path, tmp_path: Path, keys: str, words: str
) -> None:
    table = f'[[assumptions]]\nthat = "so"\notherwise = "not so"\n{keys}\n'
    with pytest.raises(BadInput, match=words) as caught:
        ff.Problem.of(campaign(tmp_path, swift_fmu, table), fmu)
    assert str(tmp_path / "campaign.toml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_formula_is_written_out() -> None:
    laws = {"f": Formula("a + b", "f"), "depth": Formula("-gain*volts", "depth")}
    found = Formula("0.05*depth*f**2/sqrt(-f + g)", "law").written_out(laws)
    values = {"a": 2.0, "b": 1.0, "gain": 3.0, "volts": 0.5, "g": 7.0}
    assert float(found.value(values)) == pytest.approx(0.05 * -1.5 * 9.0 / np.sqrt(4.0))
    assert set(found.names) == set(values)
    assert found.where == "law"
