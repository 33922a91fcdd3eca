"""A sweep whose top the instrument cut off: these points are left out of a fit, and it is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.signal.clipped_top import clipped_top
from fitting.text.toml import read_toml, toml_text
from tests.faults.scene import CAMPAIGN, D_HZ, ETA_HZ, FMU, SWEEP, amplitude_v, csv, texts

F = np.linspace(242.0, 402.0, 81)


def noisy(seed: int) -> np.ndarray:
    """The line of one mode in closed form, with noise of 0.5 % of its top."""
    a = amplitude_v(F)
    return np.asarray(a + 0.005 * a.max() * np.random.default_rng(seed).standard_normal(F.size))


@pytest.fixture
def campaign(tmp_path: Path, oscillator_fmu: Path) -> Path:
    """A sweep alone, all of its points fitted."""
    (tmp_path / CAMPAIGN).write_text(texts()[CAMPAIGN], "utf-8")
    (tmp_path / FMU).write_bytes(oscillator_fmu.read_bytes())
    tables = read_toml(tmp_path / CAMPAIGN)
    for name in ("experiments", "drift", "noise", "design", "derived"):
        del tables[name]
    tables["sweep"] |= {"use": "fit", "scale": "fit"}
    (tmp_path / CAMPAIGN).write_text(toml_text(tables), "utf-8")
    return tmp_path / CAMPAIGN


@pytest.mark.parametrize("seed", [1, 2])
def test_the_width_is_that_of_the_line_and_the_rows_are_named(campaign: Path, seed: int) -> None:
    a = noisy(seed)
    limit = 0.7 * float(np.max(a))
    (campaign.parent / SWEEP).write_text(csv(F, np.minimum(a, limit)), "utf-8")
    fit = ff.fit(ff.Problem.of(campaign))
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
