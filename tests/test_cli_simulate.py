"""``fmu-fit simulate`` against closed forms: X(u) = A(u)⁻¹ (1, 1)ᵀ of the coupled oscillator."""

from __future__ import annotations

import csv
import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import mpmath
import numpy as np
import pytest

from fitting.cli import main
from tests.cfmu_build import build_c_fmu

PAIR = (6.94016e6, 6.94036e6)


def read(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    return rows[0], np.array(rows[1:], dtype=float)


def closed_form(
    tone_hz: float, theta: float, d1: float, d2: float, eta: tuple[float, float]
) -> list[float]:
    """|X| of both hybridised modes, rotation form, unit drive on both; 40 digits."""
    with mpmath.workdps(40):
        c, s, u = mpmath.cos(theta), mpmath.sin(theta), mpmath.mpf(tone_hz)
        d = (
            2
            * mpmath.pi
            * mpmath.matrix(
                [
                    [c * c * d1 + s * s * d2, c * s * (d1 - d2)],
                    [c * s * (d1 - d2), s * s * d1 + c * c * d2],
                ]
            )
        )
        stiffness = mpmath.diag([(2 * mpmath.pi * e) ** 2 for e in eta])
        a = stiffness - (2 * mpmath.pi * u) ** 2 * mpmath.eye(2) + 2j * mpmath.pi * u * d
        x = mpmath.lu_solve(a, mpmath.matrix([1, 1]))
        return [float(abs(x[0])), float(abs(x[1]))]


def test_published_pair_has_the_closed_amplitudes(
    oscillator_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "two-tone"
    arguments = ["--set", "u1=6.94016 MHz", "--set", "u2=6940.36 kHz", "--set", "d1=120", "--set",
                 "theta=1.9498", "--set", "eta_plus=6.94026 MHz"]  # fmt: skip
    outputs = ["--outputs", "q1_hybrid,q2_hybrid"]
    assert main(["simulate", str(oscillator_fmu), *arguments, *outputs, "--out", str(out)]) == 0
    header, peaks = read(out / "peaks.csv")
    assert header == ["frequency (Hz)", "q1_hybrid (m)", "q2_hybrid (m)"]
    truth = [closed_form(tone, 1.9498, 120.0, 90.0, (6.94026e6, 7.0276e6)) for tone in PAIR]
    np.testing.assert_array_equal(peaks[:, 0], PAIR)
    np.testing.assert_allclose(peaks[:, 1:], truth, rtol=1e-9)

    _, spectrum = read(out / "spectrum.csv")
    at_tones = [int(np.argmin(np.abs(spectrum[:, 0] - tone))) for tone in PAIR]
    np.testing.assert_allclose(spectrum[at_tones, 1:], truth, rtol=1e-9)
    rest = np.delete(spectrum[:, 1:], at_tones, axis=0)
    assert (rest.max(axis=0) < 1e-8 * np.max(truth, axis=0)).all()

    _, beating = read(out / "beating.csv")
    assert beating[-1, 0] - beating[0, 0] == pytest.approx(2 / 200, rel=1e-3)  # two beats
    assert np.abs(beating[:, 1]).max() == pytest.approx(sum(t[0] for t in truth), rel=1e-2)
    _, carrier = read(out / "carrier.csv")
    assert np.abs(carrier[:, 1]).max() == pytest.approx(sum(t[0] for t in truth), rel=1e-2)
    assert "whole periods" in capsys.readouterr().out
    for name in ("trace", "spectrum"):
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        svg = "".join(ET.parse(out / f"{name}.svg").getroot().itertext())
        assert "CoupledOscillator, driven at 6.94016 MHz and 6.94036 MHz" in svg
    assert "time − 0.2 s (ms)" in "".join(ET.parse(out / "trace.svg").getroot().itertext())


def test_figures_and_tables_are_reproducible(oscillator_fmu: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        arguments = ["simulate", str(oscillator_fmu), "--set", "periodic_start=true"]
        assert main([*arguments, "--out", str(tmp_path / name)]) == 0
    files = sorted(p.name for p in (tmp_path / "a").iterdir())
    assert len(files) == 8
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_tones_without_a_common_period_are_fitted(oscillator_fmu: Path, tmp_path: Path) -> None:
    pair = (6940160.1234567, 6940360.7654321)
    tones = [f"--set=u{k + 1}={tone!r}" for k, tone in enumerate(pair)]
    assert main(["simulate", str(oscillator_fmu), *tones, "--out", str(tmp_path)]) == 0
    _, peaks = read(tmp_path / "peaks.csv")
    truth = [closed_form(tone, 1.9498, 120.0, 90.0, (6.94026e6, 7.0276e6))[0] for tone in pair]
    np.testing.assert_allclose(peaks[:, 1], truth, rtol=1e-7)


def test_an_input_is_driven_where_no_parameter_holds_tones(tmp_path: Path) -> None:
    fmu = build_c_fmu(tmp_path)
    arguments = ["--input", "force", "--drive", "300 Hz, 0.31 kHz", "--level", "0.5"]
    assert main(["simulate", str(fmu), *arguments, "--out", str(tmp_path / "out")]) == 0
    _, peaks = read(tmp_path / "out" / "peaks.csv")
    omega = 2 * math.pi * np.array([300.0, 310.0])
    truth = 0.5 / np.abs(4e3 - 1e-3 * omega**2 + 2e-2j * omega)
    np.testing.assert_allclose(peaks[:, 1], truth, rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "u1"], "wanted NAME=VALUE"),
        (["--set", "u3=1"], "no variable 'u3'"),
        (["--set", "u1=6.94 V"], "--set u1: found unit 'V', wanted 'Hz'"),
        (["--set", "u1=fast"], "--set u1: found 'fast'"),
        (["--set", "solver=0.5"], "wanted a whole number"),
        (["--set", "reflection=maybe"], "wanted true or false"),
        (["--set", "lambda=1"], "cannot be set"),
        (["--set", "u1=6940360"], "wanted different positive frequencies"),
        (["--tones", "theta,u2"], "--tones theta: its unit is 'rad'"),
        (["--outputs", "q3"], "no variable 'q3'"),
        (["--window", "30 ms"], "1.2 common periods"),
        (["--settle", "1 Hz"], "--settle"),
        (["--input", "b"], "wanted both or none"),
        (["--samples", "3"], "no sampling"),
    ],
)
def test_bad_input(
    oscillator_fmu: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    out = tmp_path / "out"
    assert main(["simulate", str(oscillator_fmu), *arguments, "--out", str(out)]) == 2
    told = capsys.readouterr()
    assert words in told.err
    assert told.err.count("\n") == 1
    assert not out.exists()


def test_free_oscillation_without_damping_is_told(
    oscillator_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is as steady as the response itself."""
    arguments = ["--set", "d1=0", "--set", "d2=0", "--set", "u2=6.9403 MHz"]
    assert main(["simulate", str(oscillator_fmu), *arguments, "--out", str(tmp_path)]) == 0
    found = re.search(r"there is (\S+) of the largest peak: (.*)", capsys.readouterr().out)
    assert found is not None
    assert float(found[1]) > 0.1
    assert "free oscillations" in found[2]


def test_what_does_not_settle_is_written_and_told(
    oscillator_fmu: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--set", "d1=1e-6", "--set", "d2=1e-6", "--set", "u2=6.9403 MHz"]
    assert main(["simulate", str(oscillator_fmu), *arguments, "--out", str(tmp_path)]) == 1
    assert "still change" in capsys.readouterr().out
    assert (tmp_path / "peaks.csv").exists()
