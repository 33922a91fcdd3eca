"""Data that are listed twice are refused under any path or name; coincidences are not."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.text.errors import BadInput

SETUP = ff.Setup(
    drive=ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
    output="q1_hybrid",
    steady_start=True,
)
D1 = ff.Parameter("d1", 94.0, bounds=(1.0, 1e3))
F = 6.9402e6 + 10.0 * np.arange(12.0)
LINE = 1e-6 / (1.0 + ((F - F[6]) / 30.0) ** 2)
PAIRS = [[6940160.0, 6940360.0], [6940180.0, 6940340.0]]
PEAKS = [[1.2345e-6, 2.3456e-6], [3.4567e-6, 4.5678e-6]]


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> ff.Fmu:
    return ff.Fmu(swift_fmu)


def problem(fmu: ff.Fmu, *measurements: Any) -> ff.Problem:
    return ff.Problem(fmu, D1, list(measurements))


def tones(drive_hz: Any, peaks_v: Any, **more: Any) -> ff.Tones:
    return ff.Tones(SETUP, drive_hz, peaks_v, **{"amplitude_unit": "m", **more})


def refused(fmu: ff.Fmu, *measurements: Any) -> str:
    with pytest.raises(BadInput) as caught:
        problem(fmu, *measurements)
    return str(caught.value)


def test_the_same_arrays_in_two_series(fmu: ff.Fmu) -> None:
    one = tones(PAIRS, PEAKS, series="a")
    two = tones(PAIRS[1:], PEAKS[1:], series="b", labels=["again"])
    said = refused(fmu, one, two)
    assert re.findall("arrays/(.): experiment '(.+?)'", said) == [("b", "again"), ("a", "2")]
    other = [[peak * 1.0001 for peak in PEAKS[1]]]
    problem(fmu, one, replace(two, peaks_v=other))


def test_the_same_row_twice_in_one_measurement(fmu: ff.Fmu) -> None:
    said = refused(fmu, tones([PAIRS[0]] * 2, [PEAKS[0]] * 2, labels=["x", "y"]))
    assert re.findall("experiment '(.)'", said) == ["y", "x"]


@pytest.mark.parametrize("written", [1.0, np.sqrt(2.0)])
def test_peaks_of_few_digits_may_agree_by_chance(fmu: ff.Fmu, written: float) -> None:
    """Two measurements of one setting, to three digits as peak, as rms or in dBm."""
    peaks = np.array([[1.23e-6, 4.56e-6]] * 2) * written
    dbm = np.sqrt(0.1 * 10.0 ** (np.array([[-60.1, -58.3]] * 2) / 10.0))
    for each in (peaks, dbm):
        both = problem(fmu, tones([PAIRS[0]] * 2, each, labels=["x", "y"]))
        assert [e.label for e in both.record.experiments] == ["x", "y"]


def test_the_same_drive_with_another_setting_is_another_measurement(fmu: ff.Fmu) -> None:
    """Exact data of a model that does not see the setting."""
    settings = {"g2": [1.0, 0.5]}
    both = problem(fmu, tones([PAIRS[0]] * 2, [PEAKS[0]] * 2, settings=settings))
    assert [e.settings["g2"] for e in both.record.experiments] == [1.0, 0.5]


def test_a_sweep_is_fitted_once_and_may_give_its_scale_twice(fmu: ff.Fmu) -> None:
    one, two = (ff.Sweep(SETUP, F, LINE, series=name) for name in "ab")
    assert re.findall("arrays/(.): sweep", refused(fmu, one, two)) == ["b", "a"]
    beside = tones(PAIRS, PEAKS, series="b", amplitude_unit="V")
    problem(fmu, one, replace(two, use="scale", scale="maximum"), beside)
    problem(fmu, one, replace(two, amplitude_v=3.0 * LINE))  # a linear sample driven harder


def copied(folder: Path, name: str) -> Path:
    shutil.copytree(ff.example("string_q1").parent, folder / name)
    return folder / name / "campaign.toml"


def test_a_spectrum_under_another_name(fmu: ff.Fmu, tmp_path: Path) -> None:
    path = copied(tmp_path, "one")
    spectra = path.parent / "spectra"
    rows = path.parent / "experiments.csv"
    text = rows.read_text()
    pair2 = next(line for line in text.splitlines() if line.startswith("pair2,"))
    shutil.copy(spectra / "pair2.csv", spectra / "again.csv")
    rows.write_text(text + pair2.replace("pair2", "again") + "\n")
    with pytest.raises(BadInput) as caught:
        ff.Problem.of(path, fmu)
    said = str(caught.value)
    for label in ("pair2", "again"):
        assert f"{path}: experiment '{label}' ({spectra / label}.csv)" in said
    assert "\n" not in said


@pytest.mark.parametrize("how", ["copied", "linked", "in other units"])
def test_a_campaign_under_another_path(fmu: ff.Fmu, tmp_path: Path, how: str) -> None:
    path, other = copied(tmp_path, "one"), tmp_path / "two" / "campaign.toml"
    if how == "linked":
        other.parent.symlink_to(path.parent)
    else:
        copied(tmp_path, "two")
    if how == "in other units":
        text = other.read_text()
        assert 'amplitude = "V peak"' in text
        other.write_text(text.replace('amplitude = "V peak"', 'amplitude = "V rms"'))
    with pytest.raises(BadInput) as caught:
        ff.Problem.of([path, other], fmu)
    assert str(other) in str(caught.value)
    assert how == "linked" or f" {path}: experiment" in str(caught.value)
