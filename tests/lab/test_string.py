"""The virtual laboratory: its simulator against 50 digits, its data against what was put in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from fitting.campaign import read_campaign
from fitting.lab.bench import Bench, measure
from fitting.lab.benches import string_bench
from fitting.lab.string import TwoModes, steady_state
from fitting.lab.writer import campaign_files
from fitting.lines.form import fit_resonance
from tests.support.string_benches import read_bench


def exact(modes: TwoModes, u: float) -> list[mp.mpc]:
    """A(u)^-1 (1, 1) at 50 digits, written out from the equation of motion."""
    with mp.workdps(50):
        c, s = mp.cos(mp.mpf(modes.theta_rad)), mp.sin(mp.mpf(modes.theta_rad))
        t = mp.matrix([[-c, s], [s, c]] if modes.reflection else [[c, -s], [s, c]])
        d = 2 * mp.pi * t * mp.diag([mp.mpf(modes.d1_hz), mp.mpf(modes.d2_hz)]) * t.T
        w = 2 * mp.pi * mp.mpf(u)
        k = mp.diag([(2 * mp.pi * mp.mpf(e)) ** 2 for e in (modes.eta_plus_hz, modes.eta_minus_hz)])
        return list(mp.lu_solve(k - w**2 * mp.eye(2) + 1j * w * d, mp.matrix([1, 1])))


@pytest.mark.parametrize("reflection", [False, True])
@pytest.mark.parametrize("u", [6940160.0, 6940260.0, 7027610.0, 6.98e6, 1e3])
def test_steady_state_agrees_with_fifty_digits(u: float, reflection: bool) -> None:
    modes = TwoModes(
        theta_rad=1.9498,
        d1_hz=120.0,
        d2_hz=90.0,
        eta_plus_hz=6940260.0,
        eta_minus_hz=7027600.0,
        reflection=reflection,
    )
    found = steady_state(modes, np.array([u]))[0]
    for value, truth in zip(found, exact(modes, u), strict=True):
        assert abs(complex(truth) - value) < 1e-13 * abs(complex(truth))


def test_widths_follow_the_papers_formula() -> None:
    c2 = np.cos(1.9498) ** 2
    plus, minus = TwoModes(
        theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6940260.0, eta_minus_hz=7027600.0
    ).widths_hz()
    assert plus == pytest.approx(c2 * 120 + (1 - c2) * 90, rel=1e-14)
    assert minus == pytest.approx((1 - c2) * 120 + c2 * 90, rel=1e-14)


@pytest.mark.parametrize("series", ["q1", "q2"])
def test_series_has_the_shape_of_the_papers(series: str) -> None:
    measured = measure(string_bench(series), 3)
    floors = [np.mean(np.sort(t)[:400]) for t in measured.array("amplitude_v")]
    assert len(measured.readings) == 5
    assert np.min(measured.true_peaks_v) > 5e-6
    assert np.max(measured.true_peaks_v) < 50e-6
    assert all(0.14e-6 < floor < 0.3e-6 for floor in floors)
    assert 85.0 < string_bench(series).modes.widths_hz()[string_bench(series).observed] < 120.0
    assert measured.eta_after_hz[0] - measured.eta_before_hz[0] == pytest.approx(100.0, abs=2.0)


def test_noise_averages_to_the_stated_floor() -> None:
    bench = replace(string_bench("q1"), floor_v=(0.25e-6, 0.25e-6), crest_v=1e-12)
    traces = [t for k in range(10) for t in measure(bench, k).array("amplitude_v")]
    assert np.mean(traces) == pytest.approx(0.25e-6, rel=0.02)


def test_same_seed_same_bytes_and_another_seed_other_noise() -> None:
    bench = string_bench("q1")
    once, again = (campaign_files(measure(bench, 7), "cmd") for _ in range(2))
    assert once == again
    assert once["sweep.csv"] != campaign_files(measure(bench, 8), "cmd")["sweep.csv"]


def test_drift_is_linear_plus_a_bow() -> None:
    bench = replace(string_bench("q1"), drift_hz=100.0, curvature_hz=5.0)
    shifts = [bench.at(p).modes.eta_plus_hz - bench.modes.eta_plus_hz for p in (0.0, 0.5, 1.0)]
    assert shifts == [-50.0, 5.0, 50.0]


def quiet(series: str) -> Bench:
    return replace(string_bench(series), noise_scale=0.0, drift_hz=0.0, curvature_hz=0.0)


@pytest.mark.parametrize("series", ["q1", "q2"])
def test_without_noise_and_drift_the_files_are_exact(series: str, tmp_path: Path) -> None:
    measured = measure(quiet(series), 1)
    campaign = read_campaign(write(campaign_files(measured, "cmd"), tmp_path) / "campaign.toml")
    for experiment, pair in zip(campaign.experiments, measured.bench.pairs_hz, strict=True):
        truth = [abs(exact(quiet(series).modes, u)[measured.bench.observed]) for u in pair]
        expected = measured.gain * np.array([float(t) for t in truth])
        np.testing.assert_allclose(experiment.peaks_v, expected, rtol=1e-12)
        assert experiment.tones_hz == pair
    assert campaign.sweep is not None
    np.testing.assert_allclose(campaign.sweep.amplitude_v, measured.sweep.amplitude_v, rtol=1e-14)
    np.testing.assert_array_equal(campaign.sweep.frequency_hz, measured.sweep.frequency_hz)
    fit = fit_resonance(campaign.sweep.frequency_hz, campaign.sweep.amplitude_v)
    width = measured.bench.modes.widths_hz()[measured.bench.observed]
    assert fit.width.value == pytest.approx(width, rel=1e-5)  # the other mode's tail is the rest


def test_truth_reads_back_and_nothing_of_a_fit_opens_it(tmp_path: Path) -> None:
    bench = replace(string_bench("q2"), noise_scale=0.5)
    write(campaign_files(measure(bench, 1), "cmd"), tmp_path)
    assert read_bench(tmp_path / "truth.toml") == bench
    campaign = read_campaign(tmp_path / "campaign.toml")
    assert tmp_path / "truth.toml" not in campaign.files
    (tmp_path / "truth.toml").unlink()
    read_campaign(tmp_path / "campaign.toml")


def test_every_file_says_synthetic_seed_and_command() -> None:
    files = campaign_files(measure(string_bench("q1"), 42), "a-command --seed 42")
    for text in files.values():
        head = text.splitlines()[:2]
        assert head[0].startswith("# synthetic")
        assert "seed 42" in head[0]
        assert head[1].endswith("a-command --seed 42")


@pytest.mark.parametrize(
    "change", [{"d1_hz": 0.0}, {"d2_hz": -1.0}, {"eta_plus_hz": 8e6}, {"eta_plus_hz": 0.0}]
)
def test_impossible_modes_are_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="must"):
        replace(string_bench("q1").modes, **change)


def write(files: dict[str, str], folder: Path) -> Path:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
    return folder
