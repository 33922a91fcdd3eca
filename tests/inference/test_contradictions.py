"""Measurements of one sample agree, or are told to disagree; all in closed form."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.report.summary import Summary, summary_of
from fitting.result.result import Result, read_result
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind
from tests.support.in_process import told as reconstructed

F_HZ, WIDTH_HZ = 1000.0, 10.0
#: The second mode is neither driven nor seen.
ONE_MODE = {"theta": 0.0, "g2": 0.0, "u2": 1500.0, "eta_minus": 2000.0, "d2": 20.0}
SWEPT = ff.Setup(
    ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
    "q1_hybrid",
    steady_start=True,
    start_values=ONE_MODE | {"periodic_start": True},
)
FREE = ff.Setup(ff.Drive(), "q1_hybrid", start_values=ONE_MODE | {"A1": 0.0, "A2": 0.0})
PARAMETERS = (
    ff.Parameter("eta_plus", 1000.5, bounds=(950.0, 1050.0), unit="Hz"),
    ff.Parameter("d1", 9.0, bounds=(1.0, 60.0), unit="Hz"),
)
METHOD = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")


def together(fmu: Path, ringing_hz: float) -> tuple[Result, Summary]:
    """Both fitted with one frequency and one width, where the ringdown has a width of its own."""
    rng = np.random.default_rng(5)
    t = np.linspace(0.0, 0.0998, 500)
    ring = np.exp(-np.pi * ringing_hz * t) * np.cos(2.0 * np.pi * F_HZ * t + 1.0)
    f = np.linspace(960.0, 1040.0, 41)
    swept = F_HZ * WIDTH_HZ / np.abs(F_HZ**2 - f**2 + 1j * f * WIDTH_HZ)
    measurements: list[ff.Trace | ff.Sweep] = [
        ff.Trace(
            t,
            ring + 0.005 * rng.standard_normal(t.size),
            setup=FREE,
            input="b",
            start="unknown",
            unit="m",
            series="ring",
        ),
        ff.Sweep(
            SWEPT,
            f,
            swept + 0.003 * rng.standard_normal(f.size),
            amplitude_unit="m",
            series="swept",
        ),
    ]
    fit = ff.fit(ff.Problem(fmu, PARAMETERS, measurements), method=METHOD, starts=1)
    found = ff.profile(fit, names=["d1", "eta_plus"]).result
    return found, summary_of(found)


def test_a_ringdown_and_a_sweep_of_one_width_agree(swift_fmu: Path) -> None:
    result, summary = together(swift_fmu, WIDTH_HZ)
    assert result.ending.kind != "contradiction"
    assert {value.name for value in summary.values} == {"d1", "eta_plus"}
    d1 = result.parameters["d1"]
    assert abs(d1.value - WIDTH_HZ) < 3.0 * d1.std


def test_widths_that_differ_are_not_known_and_both_are_told(swift_fmu: Path) -> None:
    """8 % apart, some eight errors: what lies between them is true of neither."""
    result, summary = together(swift_fmu, 1.08 * WIDTH_HZ)
    assert result.ending.kind == "contradiction"
    assert not result.ending.is_whole
    assert [value.name for value in summary.values] == ["eta_plus"]  # of which both say the same
    d1 = result.parameters["d1"]
    assert d1.status is Verdict.WITHDRAWN
    assert np.isnan(d1.std)
    assert result.joint is not None
    for part, truth in zip(result.joint.series, (1.08 * WIDTH_HZ, WIDTH_HZ), strict=True):
        alone = part.alone["d1"]
        assert abs(alone.value - truth) < 3.0 * alone.std
        assert re.search(rf"{part.name} .*{alone.value:.2f}", " ".join(summary.unknown))
    assert "campaign" in summary.advice


def three_sweeps(fmu: Path, folder: Path, widths_hz: dict[str, float], gain: float) -> list[Path]:
    """A campaign file each, with a sweep whose noise of 1 % is stated; `gain` of the last."""
    rng, paths = np.random.default_rng(1), []
    noise_m = 0.01 / ((2.0 * np.pi) ** 2 * F_HZ * WIDTH_HZ)
    f = np.linspace(960.0, 1040.0, 81)
    start = "".join(f"{name} = {value}\n" for name, value in ONE_MODE.items())
    for name, width in widths_hz.items():
        swept = 1.0 / np.abs((2.0 * np.pi) ** 2 * (F_HZ**2 - f**2 + 1j * f * width))
        swept *= gain if name == list(widths_hz)[-1] else 1.0
        swept += noise_m * rng.standard_normal(f.size)
        rows = "".join(f"{u!r},{y!r}\n" for u, y in zip(f.tolist(), swept.tolist(), strict=True))
        (folder / f"{name}.csv").write_text("frequency (Hz),amplitude (m)\n" + rows)
        text = f'''title = "{name}"
synthetic = true
[fmu]
file = "{fmu}"
[fmu.start]
periodic_start = true
{start}A2 = 0.0
u1 = 1000.0
[observe]
output = "q1_hybrid"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
[noise]
absolute = "{noise_m} m"
[sweep]
file = "{name}.csv"
amplitude = "m peak"
use = "fit"
scale = "none"
[continuation]
misfit = "squares"
starts = 1
iterations = 1
nu_start = 1e-6
'''
        for p in PARAMETERS:
            text += f'[[parameters]]\nname = "{p.name}"\nunit = "Hz"\nstart = {p.start}\n'
            text += f"lower = {p.lower}\nupper = {p.upper}\n"
        paths.append(folder / f"{name}.toml")
        paths[-1].write_text(text)
    return paths


@pytest.mark.parametrize(
    ("last_hz", "gain", "told"),
    [
        (WIDTH_HZ, 1.0, []),
        (1.3 * WIDTH_HZ, 1.0, [(Kind.contradiction, "c")]),
        (1.2 * WIDTH_HZ, 1.0, [(Kind.contradiction, "c")]),  # structure below 5 %
        (WIDTH_HZ, 1.2, [(Kind.gain, "c"), (Kind.contradiction, "c")]),
    ],
)
def test_the_sweep_of_another_sample_is_named_once_and_no_cause_beside_it(
    swift_fmu: Path,
    tmp_path: Path,
    last_hz: float,
    gain: float,
    told: list[tuple[Kind, str]],
) -> None:
    widths = {"a": WIDTH_HZ, "b": WIDTH_HZ, "c": last_hz}
    paths = three_sweeps(swift_fmu, tmp_path, widths, gain)
    words = ("--no-path", "--no-report", "--workers", "1")
    reconstructed("reconstruct", *paths, "--out", tmp_path / "out", *words)
    result = read_result(tmp_path / "out" / "result.json")
    named = {Kind.contradiction, Kind.disagreement_unsearched, Kind.gain, Kind.offset, Kind.shift}
    assert [(f.kind, f.subject) for f in result.findings if f.kind in named] == told
    assert len(summary_of(result).warnings) >= len(told)
