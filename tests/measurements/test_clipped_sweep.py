"""A sweep whose top the instrument cut off: these points are left out of a fit, and it is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.lines.excluded import clipped_top
from fitting.measurements.control_sweep import ControlSweep
from fitting.text.rendering import sentence
from fitting.text.toml import read_toml, toml_text
from tests.faults.scene import CAMPAIGN, D_HZ, ETA_HZ, FMU, SWEEP, amplitude_v, csv, texts
from tests.support import crossing_spectra as crossing
from tests.support.complex_data import mode, with_noise, write_xy

F = np.linspace(242.0, 402.0, 81)


def noisy(seed: int) -> np.ndarray:
    """The line of one mode in closed form, with noise of 0.5 % of its top."""
    a = amplitude_v(F)
    return np.asarray(a + 0.005 * a.max() * np.random.default_rng(seed).standard_normal(F.size))


@pytest.fixture
def campaign(tmp_path: Path, swift_fmu: Path) -> Path:
    """A sweep alone, all of its points fitted."""
    (tmp_path / CAMPAIGN).write_text(texts()[CAMPAIGN], "utf-8")
    (tmp_path / FMU).write_bytes(swift_fmu.read_bytes())
    tables = read_toml(tmp_path / CAMPAIGN)
    for name in ("experiments", "drift", "noise", "design", "derived"):
        del tables[name]
    tables["sweep"] |= {"use": "fit", "scale": "fit"}
    (tmp_path / CAMPAIGN).write_text(toml_text(tables), "utf-8")
    return tmp_path / CAMPAIGN


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.nightly)])
def test_the_width_is_that_of_the_line_and_the_rows_are_named(
    campaign: Path, seed: int, swift: ff.Fmu
) -> None:
    a = noisy(seed)
    limit = 0.7 * float(np.max(a))
    (campaign.parent / SWEEP).write_text(csv(F, np.minimum(a, limit)), "utf-8")
    fit = ff.fit(ff.Problem.of(campaign, swift))
    for name, truth, most in (("d1", D_HZ, 3.0), ("eta_plus", ETA_HZ, 0.5)):
        assert abs(fit[name].value - truth) < min(most, 3.0 * fit[name].std)
    flat = np.flatnonzero(a >= limit)
    [said] = [words for words in fit.warnings if "left out" in words]
    first, last = (int(word.split()[0]) for word in said.split("row ")[1:3])
    assert first <= flat[0] + 2 <= flat[-1] + 2 <= last  # the head is row 1
    assert last - first - (flat[-1] - flat[0]) <= 3
    assert said.startswith(str(campaign.parent / SWEEP))


def test_a_whole_sweep_is_left_whole() -> None:
    for seed in range(20):
        assert not np.any(clipped_top(noisy(seed)))


def test_a_flat_top_of_a_coarse_scale_is_no_limit() -> None:
    """Steps of a fortieth of the top make three equal readings there."""
    a = amplitude_v(np.linspace(312.0, 332.0, 81))
    coarse = np.round(40.0 * a / a.max()) / 40.0
    assert np.sum(coarse == coarse.max()) > 3
    assert not np.any(clipped_top(coarse))


ETA, WIDTH = 1000.0, 12.5
SEEN = ETA + np.linspace(-40.0, 40.0, 65)
COMPLEX = """
title = "One mode"
[fmu]
file = "{fmu}"
start = {{ periodic_start = true, theta = 0.0, d2 = "10 Hz", eta_minus = "2 kHz", u2 = "1.5 kHz" }}
[observe]
output = "q1_hybrid"
steady_start = true
[drive]
kind = "tones"
frequencies = ["u1", "u2"]
amplitudes = ["A1", "A2"]
[[complex_sweep]]
file = "sweep.csv"
[[parameters]]
name = "d1"
lower = "1 Hz"
upper = "100 Hz"
start = "30 Hz"
[[parameters]]
name = "eta_plus"
lower = "0.98 kHz"
upper = "1.02 kHz"
start = "1.004 kHz"
[continuation]
starts = 1
misfit = "squares"
"""


def test_parts_that_overflow_are_left_out_of_a_complex_sweep(
    swift: ff.Fmu, swift_fmu: Path, tmp_path: Path
) -> None:
    """X and Y of one mode in closed form, each cut off at 0.6 of the largest amplitude."""
    y = np.exp(0.7j) * mode(SEEN, ETA, WIDTH)
    y = with_noise(y / np.max(np.abs(y)), 0.005, seed=4)
    cut = np.clip(y.real, -0.6, 0.6) + 1j * np.clip(y.imag, -0.6, 0.6)
    write_xy(tmp_path / "sweep.csv", SEEN, cut)
    path = tmp_path / "campaign.toml"
    path.write_text(COMPLEX.format(fmu=swift_fmu.as_posix()), "utf-8")
    fit = ff.fit(ff.Problem.of(path, swift))
    for name, truth, most in (("d1", WIDTH, 0.6), ("eta_plus", ETA, 0.2)):
        assert abs(fit[name].value - truth) < min(most, 3.5 * fit[name].std)
    [said] = [words for words in fit.warnings if "left out" in words]
    assert said.startswith(str(tmp_path / "sweep.csv"))
    assert "600 mV" in said


def test_tops_that_are_cut_off_are_left_out_of_a_control_sweep(
    swift_fmu: Path, tmp_path: Path
) -> None:
    """Amplitudes that reach the limit of the detector at some voltages and not at others."""
    exact = crossing.measured(3, 0.01)
    limit = 0.6 * float(np.max(exact))
    path = crossing.written(tmp_path, swift_fmu, np.minimum(exact, limit))
    [sweep] = ff.Problem.of(ff.read_campaign(path)).record.measurements
    assert isinstance(sweep, ControlSweep)
    for spectrum, row in zip(sweep.spectra, exact, strict=True):
        run = np.convolve(row >= limit, np.ones(3), mode="valid")
        if np.any(run == 3.0):
            assert not np.any(np.isin(spectrum.u_hz, crossing.SWEPT_HZ[row >= limit]))
            assert set(map(sentence, spectrum.left_out)) <= set(map(sentence, sweep.left_out))
            assert spectrum.left_out
        else:
            assert spectrum.u_hz.size == row.size
    assert sweep.left_out
