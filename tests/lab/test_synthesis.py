"""The laboratory from Python: arrays and truth together, files when asked, kinds of one's own."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import read_campaign
from fitting.lab.bench import Answer, Bench, Instrument, Measured
from fitting.lab.benches import string_bench
from fitting.lab.duffing import CubicModes
from fitting.lab.string import Drive, TwoModes
from fitting.lab.synthesis import synthesize
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.toml import Tables

MODES = TwoModes(
    theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6940260.0, eta_minus_hz=7027600.0
)


@pytest.mark.parametrize("name", ["q1", "duffing"])
def test_arrays_are_those_of_the_files_and_the_truth_is_beside_them(
    name: str, tmp_path: Path
) -> None:
    made = synthesize(name, seed=3, noise_scale=0.5, out=tmp_path)
    campaign = read_campaign(tmp_path / "campaign.toml")
    assert isinstance(made.measured, Measured)
    assert campaign.sweep is not None
    assert campaign.sweep.amplitude_v == pytest.approx(made.measured.sweep.amplitude_v, rel=1e-15)
    for found, reading in zip(campaign.experiments, made.measured.readings, strict=True):
        assert found.label == reading.label
        assert found.tones_hz[:2] == reading.drive.tones_hz
        if name == "duffing":
            assert found.peaks_v == pytest.approx(reading.arrays["peaks_v"], rel=1e-14)
            assert found.sigmas_v == pytest.approx(reading.arrays["sigmas_v"], rel=1e-14)
    assert tomllib.loads((tmp_path / "truth.toml").read_text("utf-8")) == made.truth
    assert made.truth["bench"]["noise_scale"] == 0.5
    again = synthesize(tmp_path / "campaign.toml", seed=3)
    assert again.measured.bench == made.measured.bench
    assert again.truth["experiment"] == made.truth["experiment"]


def test_nothing_is_written_unless_asked_and_nothing_measured_written_over(tmp_path: Path) -> None:
    made = synthesize("q2", seed=1)
    assert not list(tmp_path.iterdir())
    made.write(tmp_path)
    made.write(tmp_path)  # its own
    (tmp_path / "campaign.toml").write_text('title = "measured"\n')
    with pytest.raises(BadInput, match=r"campaign\.toml: .*changed.*synthesize"):
        made.write(tmp_path)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"alpha1": 1e32}, "alpha1: .*'q1'"),
        ({"d3_hz": 1.0}, "d3_hz: "),
        ({"level": 1.0}, "level: "),
        ({"d1_hz": -1.0}, r"d1 = -1\.0"),
        ({"seed": -1}, "seed: .*-1"),
    ],
)
def test_what_the_bench_does_not_have_is_refused(changes: dict[str, float], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        synthesize("q1", **changes)  # type: ignore[arg-type]
    with pytest.raises(BadInput, match="q9"):
        synthesize("q9")


def test_both_kinds_of_sample_answer_alike_without_cubic_terms() -> None:
    """Unequal tones, one mode driven more than the other, a line that is not there."""
    drive = Drive(
        (6940250.0, 6940290.0), (0.3, -0.7), gains=(1.0, 0.2), lines=((0, 1), (1, 0), (2, -1))
    )
    linear = MODES.shifted(7.0).amplitudes(drive)
    cubic = CubicModes(MODES, 0.0).shifted(7.0).amplitudes(drive)
    assert np.abs(cubic - linear).max() < 1e-12 * np.abs(linear).max()
    assert np.abs(linear[2]).max() == 0.0
    assert np.abs(linear[:2, 0]).min() > 0.0


@dataclass(frozen=True)
class Quadratures(Instrument):
    """A kind of the test's own: complex lines, in columns of their own."""

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        return tuple(a.reading({"x_v": a.lines_v.real, "y_v": a.lines_v.imag}) for a in answers)

    def edit(self, tables: Tables) -> None:
        tables["experiments"] = {"file": "experiments.csv", "quadratures": ["x1", "y1"]}

    def columns(self, reading: Answer) -> dict[str, float | str]:
        return {
            "x1 (V)": float(reading.arrays["x_v"][0]),
            "y1 (V)": float(reading.arrays["y_v"][0]),
        }

    def files(self, reading: Answer) -> dict[str, dict[str, FloatArray]]:
        return {f"{reading.label}.csv": {"x (V)": reading.arrays["x_v"]}}


def test_a_further_kind_of_instrument_is_a_class_of_its_own() -> None:
    made = synthesize(string_bench("q1"), instrument=Quadratures())
    lines = np.hypot(made.measured.array("x_v"), made.measured.array("y_v"))
    assert lines == pytest.approx(made.measured.true_peaks_v, rel=1e-14)
    rows = str(made.files["experiments.csv"]).splitlines()
    assert rows[2].split(",")[3:] == ["x1 (V)", "y1 (V)"]
    assert float(rows[3].split(",")[3]) == made.measured.readings[0].arrays["x_v"][0]
    table = tomllib.loads(str(made.files["campaign.toml"]))["experiments"]
    assert table == {"file": "experiments.csv", "quadratures": ["x1", "y1"]}
    assert str(made.files["pair5.csv"]).splitlines()[2] == "x (V)"
