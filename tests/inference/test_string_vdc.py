"""lambda over the bias voltage, where the pump acts on lambda^2 as the map shows.

The data are those of `fitting.lab.modes`; a closed form in the coordinates of the lines stands
against them, and the FMU with the campaign's laws against both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.lab.string import STRING
from fitting.lab.synthesis import synthesize
from fitting.lab.true_values import true_values
from fitting.lab.voltage import VoltageBench
from fitting.text.arrays import FloatArray
from fitting.text.finding import Kind
from tests.support.voltage_line import VoltageLine

#: Fewer points, so little noise that the mean of a noisy magnitude is the amplitude itself.
BENCH = VoltageBench(volts=(14.0, 20.0, 28.0), points=20, coupling_share=0.3, noise_v=0.2e-12)


@pytest.fixture(scope="module")
def fmu(swift_modes_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_modes_fmu, 1) as opened:
        yield opened


def truth(bench: VoltageBench) -> FloatArray:
    """theta, d1, d2, gain, g2, at_plus, at_minus, at_11, at_22, at_12."""
    turn = bench.string.transform()
    slopes, read = turn @ bench.slopes @ turn.T, bench.read_slopes
    at = slopes[0, 0] - read["s11"], slopes[1, 1] - read["s22"], slopes[0, 1] - read["s12"]
    s = bench.string
    return np.array([s.theta_rad, s.d1_hz, s.d2_hz, bench.gain, bench.drive, 0.0, 0.0, *at])


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_the_laboratory_is_an_own_closed_form(share: float) -> None:
    string = replace(STRING, theta_rad=2.0, d1_hz=70.0, d2_hz=150.0)
    bench = VoltageBench(string=string, coupling_share=share)
    swept = VoltageLine(bench, reach=9).swept(truth(bench)) * bench.volts_per_m
    assert swept == pytest.approx(bench.true_v().ravel(), rel=1e-9)
    coupling = VoltageLine(bench).outputs(truth(bench))["lambda12"]
    at_volts = bench.truth(1)["outcome"]["lambda_at_volts_hz"]
    assert coupling[: len(at_volts)] == pytest.approx(at_volts, rel=1e-9)


def test_the_laws_of_the_campaign_are_the_laboratory(fmu: ff.Fmu, tmp_path: Path) -> None:
    """Without noise nothing is left at the truth, with p12 = 0.3 p11; depths are derivatives."""
    made = synthesize(replace(BENCH, noise_scale=0.0), out=tmp_path)
    problem = ff.Problem.of(ff.read_campaign(tmp_path / "campaign.toml"), fmu)
    names = ("theta", "d1", "d2", "gain", "g2", "at_plus", "at_minus", "at_11", "at_22", "at_12")
    assert tuple(problem.names) == names
    p = truth(BENCH)
    assert np.abs(problem.residuals(p)).max() < 1e-6
    put_in = true_values(made.truth)
    assert [put_in[name] for name in names[:5]] == pytest.approx(p[:5])
    mean_hz = np.mean(VoltageLine(BENCH).outputs(p)["lambda12"])
    assert put_in["lambda12"] == pytest.approx(mean_hz, rel=1e-9)
    # as if the pump did not act on lambda^2: off by far more than the noise of a laboratory
    text = (tmp_path / "campaign.toml").read_text("utf-8")
    law = 'depth_lambda12 = "2*gain*d(lambda12, V)/lambda12*Vac"\n'
    assert law in text
    (tmp_path / "campaign.toml").write_text(text.replace(law, ""), "utf-8")
    without = ff.Problem.of(ff.read_campaign(tmp_path / "campaign.toml"), fmu)
    assert np.abs(without.residuals(p)).max() > 0.02


@pytest.mark.nightly
def test_the_shipped_campaign_gives_lambda_at_every_voltage(fmu: ff.Fmu) -> None:
    """By the FMU: every 95 % interval holds the truth, and nothing is assumed of lambda^2."""
    data = Path(__file__).parents[2] / "data" / "string_vdc" / "campaign.toml"
    result = ff.fit(ff.Problem.of(data, fmu), starts=1).result
    assert result.status == "converged"
    coupling, bench = result.derived["lambda12"], VoltageBench()
    wanted = VoltageLine(bench).outputs(truth(bench))["lambda12"]
    assert np.all(np.abs(np.array(coupling.values) - wanted) < 1.5 * np.array(coupling.halves95))
    # the standard error at V0 of an own Fisher matrix, Hz
    assert coupling.stds[3] == pytest.approx(635.0, rel=0.1)
    assumed = [f.subject for f in result.findings if f.kind is Kind.assumption]
    assert len(assumed) == 1
    assert "detector" in assumed[0]
