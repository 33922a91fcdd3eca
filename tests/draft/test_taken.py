"""What one sweep of two coupled modes does not tell stands beside the answer, and is true."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from fitting.cli.main import main
from fitting.result.result import Result, read_result
from fitting.text.arrays import ComplexArray, FloatArray, both_parts
from tests.support.lines import noise, write_csv

pytestmark = pytest.mark.usefixtures("swift_models")

#: A sample of which the drive and the detector reach 0.4 of mode 2: f1, f2, d1, d2, lambda.
TRUTH = {"f1": 20_003.0, "f2": 19_991.0, "d1": 10.0, "d2": 3.0, "lambda12": 600_000.0**0.5}
BOTH = 0.4
F = np.linspace(19_900.0, 20_120.0, 161)
SIGMA = 0.005


def response(p: FloatArray, driven: float, seen: float, f: FloatArray = F) -> ComplexArray:
    """(1, seen) (K - f^2 + i f D)^-1 (1, driven)^T of two coupled modes, by Cramer's rule."""
    f1, f2, d1, d2, coupling = p
    one, two = f1**2 - f**2 + 1j * f * d1, f2**2 - f**2 + 1j * f * d2
    top = two + coupling**2 * (driven + seen) + driven * seen * one
    return np.asarray(top / (one * two - coupling**4))


def measured(driven: float = BOTH, seen: float = BOTH) -> ComplexArray:
    """A lock-in's record of it, over its largest value."""
    exact = response(np.array(list(TRUTH.values())), driven, seen)
    return np.asarray(exact / np.max(np.abs(exact)) + noise(F.size, SIGMA, 19))


def reconstructed(campaign: Path) -> Result:
    """The result without profiles and report."""
    out = campaign.parent / "results"
    words = ["reconstruct", str(campaign), "--out", str(out), "--no-profiles", "--no-report"]
    assert main([*words, "--workers", "1", "--quick"]) == 0
    return read_result(out / "result.json")


def test_what_one_sweep_does_not_tell_of_two_modes_stands_beside_the_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = measured()
    file = write_csv(tmp_path / "both.csv", "f (Hz),X (V),Y (V)", F, y.real, y.imag)
    assert main(["init", str(file), "--out", str(tmp_path / "o"), "--yes"]) == 0
    campaign = tmp_path / "o" / "campaign.toml"
    assert tomllib.loads(campaign.read_text("utf-8"))["fmu"]["taken"] == ["readout2"]
    capsys.readouterr()
    found = reconstructed(campaign)
    values = found.parameters
    # readout2 = 0 is not so, and a fit at the noise is not the sample
    assert all(abs(values[n].value - v) > 3.0 * values[n].std for n, v in TRUTH.items())
    [said] = [each for each in found.warnings if "readout2 = 0" in each]
    assert all(name in said for name in (*TRUTH, "g2"))
    told = " ".join(capsys.readouterr().out.split())
    assert told.count("hold only if readout2 = 0") == 1

    # the example of the sentence, by the closed form: as good a fit, g2 one standard error lower
    more = float(re.findall(r"readout2 ([\d.]+) higher", said)[0])
    start = [*(values[n].value for n in TRUTH), values["g2"].value]
    (here, one), (there, other) = (_fit(y, seen, start) for seen in (0.0, more))
    assert abs(there - here) / SIGMA**2 < 1.0
    assert one - other == pytest.approx(values["g2"].std, rel=0.15)


def test_two_lines_that_decay_do_not_tell_their_coupling(tmp_path: Path) -> None:
    """Two modes beside each other; lambda moves both lines by lambda^4/(2 f (f2^2 - f1^2))."""
    t = np.arange(1500) / 50e3
    lines = ((10e3, 40.0, 1.0), (10.15e3, 60.0, 0.7))
    y = 0.01 * np.random.default_rng(3).standard_normal(t.size)
    for f, width, size in lines:
        rings = np.sqrt(f**2 - 0.25 * width**2)
        y += size * np.exp(-np.pi * width * t) * np.cos(2.0 * np.pi * rings * t + size)
    file = write_csv(tmp_path / "ring.csv", "t (s),U (V)", t, y)
    assert main(["init", str(file), "--out", str(tmp_path), "--yes"]) == 0
    written = tomllib.loads((tmp_path / "campaign.toml").read_text("utf-8"))
    assert written["fmu"]["model"] == "CoupledModes2"
    assert written["fmu"]["taken"] == ["lambda12"]
    assert written["trace"][0]["states"] == 4
    assert written["derived"]["outputs"] == ["Q1", "Q2"]
    found = reconstructed(tmp_path / "campaign.toml")
    values = found.parameters
    for k, (f, width, _) in enumerate(lines, start=1):
        assert abs(values[f"f{k}"].value - f) < 4.0 * values[f"f{k}"].std
        assert abs(values[f"d{k}"].value - width) < 4.0 * values[f"d{k}"].std
        q = found.derived[f"Q{k}"]
        assert abs(q.value - f / width) < 4.0 * q.std
    [said] = [each for each in found.warnings if "lambda12 = 0 Hz" in each]
    assert all(name in said for name in ("f1", "d1", "f2", "d2"))
    [(more, name)] = re.findall(r"lambda12 ([\d.]+) Hz higher.* and (\w+) is one", said)
    (f1, _, _), (f2, _, _) = lines
    shift = float(more) ** 4 / (2.0 * {"f1": f1, "f2": f2}[name] * (f2**2 - f1**2))
    assert shift == pytest.approx(values[name].std, rel=0.2)


def _fit(y: ComplexArray, seen: float, start: list[float]) -> tuple[float, float]:
    """Least squares of the closed form with a constant background, with a gain; and g2 there."""
    size = np.array([1.0, 1.0, 1.0, 1.0, 10.0, 0.1])

    def left(x: FloatArray) -> FloatArray:
        p = np.array(start) + size * x
        columns = np.column_stack([response(p[:5], p[5], seen) * 1e6, np.ones(F.size)])
        return both_parts(columns @ np.linalg.lstsq(columns, y, rcond=None)[0] - y)

    found = least_squares(left, np.zeros(6), xtol=1e-12, ftol=1e-14)
    return 2.0 * float(found.cost), float(start[5] + size[5] * found.x[5])


def test_nothing_is_said_of_what_the_data_tell(tmp_path: Path) -> None:
    """Both modes read one after the other: lines, and two zeros, each of which tells g2."""
    p = np.array(list(TRUTH.values()))
    f1, f2, d1, d2, coupling = p
    one, two = f1**2 - F**2 + 1j * F * d1, f2**2 - F**2 + 1j * F * d2
    scale = np.max(np.abs(two / (one * two - coupling**4)))
    for name, top in (("q1", two), ("q2", coupling**2 + 0.0 * F)):
        y = top / (one * two - coupling**4) / scale + noise(F.size, SIGMA, len(name) + ord(name[1]))
        write_csv(tmp_path / f"{name}.csv", "f (Hz),X (V),Y (V)", F, y.real, y.imag)
    sweeps = "".join(
        f'[[complex_sweep]]\nfile = "{name}.csv"\nlayout = "csv"\nlabel = "{name}"\n'
        f'output = "{name}"\ncolumns = {{ frequency = "f", x = "X", y = "Y" }}\n'
        for name in ("q1", "q2")
    )
    fitted = "".join(
        f'[[parameters]]\nname = "{n}"\nunit = "Hz"\nlower = {v - w}\nupper = {v + w}\n'
        f"start = {v + 0.01 * w}\nscale = {0.1 * w}\n"
        for (n, v), w in zip(TRUTH.items(), (50.0, 50.0, 9.0, 2.9, 500.0), strict=True)
    )
    (tmp_path / "campaign.toml").write_text(
        'title = "both read"\n[fmu]\nmodel = "CoupledModes2"\ntaken = ["g2"]\n'
        "[fmu.start]\nperiodic_start = true\nA2 = 0.0\ng2 = 0.0\n"
        '[observe]\noutput = "q1"\nsteady_start = true\n'
        '[drive]\nkind = "tones"\nfrequencies = ["u1"]\namplitudes = ["A1"]\n'
        f"{sweeps}{fitted}[continuation]\nnu_start = 1e-6\nbeta = 0.001\niterations = 2\n"
        'misfit = "squares"\nstarts = 1\n',
        "utf-8",
    )
    found = reconstructed(tmp_path / "campaign.toml")
    for name, value in TRUTH.items():
        assert abs(found.parameters[name].value - value) < 4.0 * found.parameters[name].std, name
    assert not [each for each in found.warnings if "g2 = 0" in each]


def test_what_is_taken_has_a_start_value(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    y = measured()
    file = write_csv(tmp_path / "both.csv", "f (Hz),X (V),Y (V)", F, y.real, y.imag)
    assert main(["init", str(file), "--out", str(tmp_path), "--yes"]) == 0
    campaign = tmp_path / "campaign.toml"
    text = campaign.read_text("utf-8").replace('["readout2"]', '["readout1"]')
    campaign.write_text(text, "utf-8")
    capsys.readouterr()
    assert main(["reconstruct", str(campaign), "--out", str(tmp_path / "r")]) != 0
    assert "taken: 'readout1'" in capsys.readouterr().err
