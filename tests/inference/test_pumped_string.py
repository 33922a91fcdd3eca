"""lambda of the string from pumped sweeps, without the depth of the pump, and what it rests on.

The data are those of `fitting.lab.modes`, the fits go through the FMU's native twin.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.lab.subharmonic import SubharmonicBench
from fitting.lab.true_values import true_values
from fitting.result.result import Result, read_result
from fitting.text.estimate import Verdict
from fitting.text.finding import Finding, Kind
from fitting.text.toml import read_toml
from tests.bench.bench_pumped_string import FISHER, fisher
from tests.support.pumped_string import CLOSER, METHOD, pumped_problem

SHIPPED = Path(__file__).parents[2] / "data" / "string_pumped"
BENCH = SubharmonicBench()
TRUTH = true_values(read_toml(SHIPPED / "truth.toml"))


@pytest.fixture(scope="module")
def fmu(swift_modes_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_modes_fmu, 1) as opened:
        yield opened


@pytest.fixture(scope="module")
def shipped(swift_modes_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Result:
    """The shipped campaign by the command, as it starts, without profiles."""
    folder = tmp_path_factory.mktemp("pumped")
    text = (SHIPPED / "campaign.toml").read_text("utf-8")
    model = f'file = "{swift_modes_fmu.as_posix()}"'
    text = text.replace('model = "CoupledModes2"', model)
    (folder / "campaign.toml").write_text(text, "utf-8")
    (folder / "sweeps.csv").write_bytes((SHIPPED / "sweeps.csv").read_bytes())
    words = ["reconstruct", str(folder / "campaign.toml"), "--out", str(folder / "out")]
    assert main([*words, "--quick", "--no-profiles", "--no-report", "--workers", "1"]) == 0
    return read_result(folder / "out" / "result.json")


def assumed(result: Result, words: str) -> Finding:
    [found] = [f for f in result.findings if f.kind is Kind.assumption and words in f.subject]
    return found


def test_the_shipped_campaign_gives_what_was_put_in(shipped: Result) -> None:
    values = {**shipped.parameters, **shipped.derived}
    off = {name: (values[name].value - true) / values[name].std for name, true in TRUTH.items()}
    assert set(off) == {"theta", "d1", "d2", "f1", "f2", "gain", "lambda12"}
    assert max(map(abs, off.values())) < 3.0
    # the standard errors of an own Fisher matrix: 0.83 kHz, 1.2 and 0.6 Hz
    assert values["lambda12"].std == pytest.approx(830.0, rel=0.1)
    assert values["d1"].std == pytest.approx(1.2, rel=0.1)
    assert values["d2"].std == pytest.approx(0.6, rel=0.1)
    assert shipped.status == "converged"
    assert not [f for f in shipped.findings if f.severity != "note"]


def test_what_the_values_rest_on_is_a_finding(shipped: Result) -> None:
    """p12: 34 kHz to first order, p22: 0.03 to 0.1 kHz; both unseen by the data."""
    coupling, second = assumed(shipped, "lambda12^2"), assumed(shipped, "mode called 1")
    assert abs(coupling.numbers["shift_lambda12"]) == pytest.approx(34e3, rel=0.2)
    assert abs(second.numbers["shift_lambda12"]) < 150.0
    assert max(coupling.numbers["chi_square"], second.numbers["chi_square"]) < 4.0
    # the exchanged modes: lambda within its error, d1 and d2 exchanged
    other = assumed(shipped, "exchanged").numbers
    d1, d2 = (shipped.parameters[name].value for name in ("d1", "d2"))
    assert abs(other["shift_lambda12"]) < 3.0 * shipped.derived["lambda12"].std
    assert other["shift_d1"] == pytest.approx(d2 - d1, abs=4.0)
    assert other["shift_d2"] == pytest.approx(d1 - d2, abs=4.0)
    assert other["shift_theta"] == pytest.approx(1.5 * np.pi - 2.0 * TRUTH["theta"], abs=0.01)
    # an error that both pumps share goes into eta_minus, and lambda^2 with it
    common = assumed(shipped, "frequencies of the pump").numbers
    assert common["shift_at_minus"] == pytest.approx(470.0, abs=3.0)
    assert 0.5e3 < common["shift_lambda12"] < 2.5e3
    assert common["chi_square"] < 9.0


def test_without_the_third_sweep_only_a_combination_is_known(fmu: ff.Fmu, tmp_path: Path) -> None:
    bench = replace(BENCH, sweeps=BENCH.sweeps[:2])
    result = ff.fit(pumped_problem(bench, fmu, tmp_path), METHOD, starts=1).result
    assert result.status == "converged"
    coupling = result.derived["lambda12"]
    assert not coupling.std < 100e3
    [found] = [f for f in result.findings if f.kind is Kind.combination]
    assert found.severity == "warning"
    assert set(found.names["pair"]) == {"theta", "gain"}
    assert "lambda12" in found.names["following"]
    assert abs(found.numbers["correlation"]) > 0.999
    # with the gain known theta would be known as well as with the third sweep
    assert found.numbers["std_alone_theta"] == pytest.approx(1.2e-3, rel=0.5)
    assert found.numbers["std_theta"] > 50.0 * found.numbers["std_alone_theta"]


@pytest.mark.nightly
def test_a_pump_misstated_in_one_sweep_is_found(fmu: ff.Fmu, tmp_path: Path) -> None:
    """By five line widths, 235 Hz at half of the distance."""
    problem = pumped_problem(BENCH, fmu, tmp_path, sweeps={"43.769": "44.004"})
    result = ff.fit(problem, METHOD, starts=1).result
    assert result.status != "converged"
    assert "not_described" in {f.kind for f in result.findings}
    assert not any(v.status.has_value for v in result.derived.values())


@pytest.mark.nightly
def test_both_pumps_misstated_are_found_where_eta_minus_is_known(
    fmu: ff.Fmu, tmp_path: Path
) -> None:
    narrow = {**CLOSER, '"-500 Hz"': '"-30 Hz"', '"500 Hz"': '"30 Hz"'}
    words = {"43.769": "44.004", "87.34": "87.81"}
    problem = pumped_problem(BENCH, fmu, tmp_path, campaign=narrow, sweeps=words)
    result = ff.fit(problem, METHOD, starts=1).result
    assert result.status != "converged"
    assert {f.severity for f in result.findings} >= {"error"}


@pytest.mark.nightly
def test_a_pump_that_is_off_determines_nothing(fmu: ff.Fmu, tmp_path: Path) -> None:
    problem = pumped_problem(replace(BENCH, depth_per_volt=0.0), fmu, tmp_path)
    result = ff.fit(problem, METHOD, starts=1).result
    for name in ("lambda12", "f1", "f2"):
        assert not result.derived[name].std < 100.0 * TRUTH[name] / 1e3
    assert not result.parameters["theta"].std < 0.1


@pytest.mark.nightly
def test_a_pump_on_lambda_is_off_by_what_the_finding_says(fmu: ff.Fmu, tmp_path: Path) -> None:
    problem = pumped_problem(replace(BENCH, coupling_share=0.05), fmu, tmp_path)
    result = ff.fit(problem, METHOD, starts=1).result
    assert result.status == "converged"  # nothing in the data shows it
    coupling = result.derived["lambda12"]
    shift = assumed(result, "lambda12^2").numbers["shift_lambda12"]
    assert TRUTH["lambda12"] - coupling.value == pytest.approx(shift, rel=0.2)
    assert abs(shift) > 20.0 * coupling.std


@pytest.mark.nightly
def test_the_verdicts_of_the_shipped_campaign(fmu: ff.Fmu, tmp_path: Path) -> None:
    """With profiles: lambda is determined, and its interval holds the truth."""
    fit = ff.fit(pumped_problem(BENCH, fmu, tmp_path), METHOD, starts=1)
    coupling = ff.profile(fit, ["lambda12"]).result.derived["lambda12"]
    low, high = coupling.ci95
    assert coupling.status is Verdict.DETERMINED
    assert low < TRUTH["lambda12"] < high


@pytest.mark.nightly
def test_standard_errors_are_those_of_an_own_fisher_matrix(fmu: ff.Fmu) -> None:
    """By sweeps and by what is known of the depth: 0.64 to 194 kHz, to 10 %."""
    for (_, wanted), row in zip(FISHER, fisher(fmu), strict=True):
        assert row == pytest.approx(wanted, rel=0.1)
