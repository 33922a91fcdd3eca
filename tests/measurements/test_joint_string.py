"""A sweep, a ringdown and thermal noise of one string together, far from the shipped numbers.

Two modes at 2.8 and at 7.03 MHz, of which the lower one, eta_plus, is seen. The search for fits
beyond the bounds comes to where the mode that is seen is the farther one of every tone: what would
be left out there is what was measured. Data are synthetic, by closed forms in numpy.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.constants import Boltzmann

from fitting.result.result import read_result
from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.in_process import told

F_HZ, WIDTH_HZ, KELVIN, MASS_KG, GAIN = 2.8e6, 2000.0, 300.0, 1e-12, 6e4
CAMPAIGN = """title = "A string: sweep, ringdown and thermal motion"
synthetic = true
[fmu]
file = "{fmu}"
[fmu.start]
periodic_start = true
theta = 0.0
g2 = 0.0
u2 = "2.81 MHz"
[observe]
output = "q1_hybrid"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
[continuation]
misfit = "squares"
[[parameters]]
name = "eta_plus"
unit = "Hz"
lower = 2.79e6
upper = 2.81e6
start = 2.8005e6
[[parameters]]
name = "d1"
unit = "Hz"
lower = 100.0
upper = 20000.0
start = 1500.0
"""
SWEEP = """[noise]
relative = "1 %"
[sweep]
file = "sweep.csv"
amplitude = "V peak"
use = "fit"
scale = "fit"
"""
RINGDOWN = """[[trace]]
file = "ringdown.csv"
input = "b"
start = "unknown"
set = { A1 = 0.0, A2 = 0.0 }
"""
SPECTRUM = """[[noise_spectrum]]
file = "spectrum.csv"
averages = 100
force = "thermal"
temperature = "300 K"
mass = "1 ng"
"""


def response(u: FloatArray) -> ComplexArray:
    """Of the mode that is seen, to a tone, s^2, (n,)."""
    return np.asarray(1.0 / ((2.0 * np.pi) ** 2 * (F_HZ**2 - u**2 + 1j * u * WIDTH_HZ)))


def written(path: Path, columns: str, *values: FloatArray) -> None:
    np.savetxt(path, np.column_stack(values), delimiter=",", header=columns, comments="")


def measured(folder: Path) -> None:
    """What a laboratory writes: amplitudes, samples and a density of V."""
    rng = np.random.default_rng(9)
    u = np.arange(F_HZ - 12e3, F_HZ + 12e3, 200.0)
    line = np.abs(response(u)) * GAIN * (1.0 + 0.01 * rng.standard_normal(u.size))
    written(folder / "sweep.csv", "frequency (Hz),amplitude (V)", u, line)
    t = np.arange(1500) / 12.5e6
    ring = np.exp(-np.pi * WIDTH_HZ * t) * np.cos(2.0 * np.pi * F_HZ * t + 0.7)
    written(
        folder / "ringdown.csv",
        "time (s),q1_hybrid (V)",
        t,
        1e-3 * (ring + 0.02 * rng.standard_normal(t.size)),
    )
    u = np.arange(F_HZ - 12e3, F_HZ + 12e3, 80.0)
    heat = -4.0 * Boltzmann * KELVIN * response(u).imag / (2.0 * np.pi * u * MASS_KG) * GAIN**2
    density = (heat + 0.01 * np.max(heat)) * rng.gamma(100.0, 0.01, u.size)
    written(folder / "spectrum.csv", "frequency (Hz),density (V2/Hz)", u, density)


@pytest.mark.parametrize(
    "of",
    [
        pytest.param(SPECTRUM, id="spectrum alone"),
        pytest.param(SWEEP + RINGDOWN + SPECTRUM, id="together", marks=pytest.mark.nightly),
    ],
)
def test_the_mode_that_is_seen_is_fitted_together(of: str, swift_fmu: Path, tmp_path: Path) -> None:
    measured(tmp_path)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN.format(fmu=swift_fmu) + of, "utf-8")
    words = ("--out", tmp_path / "out", "--no-report", "--workers", "1")
    ended = told("reconstruct", tmp_path / "campaign.toml", *words)
    assert ended.code == 0, ended.err
    result = read_result(tmp_path / "out" / "result.json")
    assert not [each for each in result.findings if each.severity != "note"]
    for name, truth in {"eta_plus": F_HZ, "d1": WIDTH_HZ}.items():
        value = result.parameters[name]
        assert abs(value.value - truth) < 4.0 * value.std
        assert value.std < 0.02 * WIDTH_HZ
